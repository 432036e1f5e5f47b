"""Telemetry that is older than its stamp, and what each grade of state reports."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire.ids import GpsFix, MessageId
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    DistanceSensor,
    EstimatorStatus,
    GpsRaw,
    LocalPosition,
    Odometry,
    Received,
    Source,
)
from sitl_sim.vehicles.firmware.late_samples import TelemetryLag
from sitl_sim.vehicles.grades import GRADES
from sitl_sim.vehicles.sensor_noise import SensorNoise
from sitl_sim.worlds.ground import Ground


def falling(make_flight, lag, boot=0.0, **options):
    """A vehicle that falls from 50 m without drag, its telemetry: (sent [s], message)."""
    f = make_flight(noise=SensorNoise.none(), telemetry_lag=lag, boot_offset=[boot], **options)
    f.vehicles.p[0, 2] = 50.0
    f.vehicles.body.drag_linear[:] = f.vehicles.body.drag_quadratic[:] = 0.0
    heard = []
    for k in range(1, 60):
        f.autopilots.advance(k * 0.02)
        heard += [(k * 0.02, m) for m in f.autopilots.telemetry(0, "companion")]
    return heard


def ages(heard):
    """Age [s] of each position, by how far the free fall has come."""
    fall = [(sent, m) for sent, m in heard if isinstance(m, LocalPosition) and sent > 0.4]
    return np.array([sent - math.sqrt(2 * (50.0 - m.p[2]) / 9.80665) for sent, m in fall])


@pytest.mark.parametrize("lag", [0.0, 0.013, 0.1, 0.2])
def test_what_telemetry_tells_is_as_old_as_configured(make_flight, lag):
    heard = falling(make_flight, TelemetryLag([lag]))
    np.testing.assert_allclose(ages(heard), lag, atol=0.001)
    assert all(abs(m.time - sent) < 1e-6 for sent, m in heard if isinstance(m, LocalPosition))


def test_a_stamp_can_be_that_of_the_measurement(make_flight):
    heard = falling(make_flight, TelemetryLag([0.1], stamp="measured"), boot=3.0)
    for kind in (LocalPosition, Attitude):
        late = [sent + 3.0 - m.time for sent, m in heard if isinstance(m, kind) and sent > 0.3]
        np.testing.assert_allclose(late, 0.1, atol=1e-6)


def test_a_lag_that_varies_stays_in_its_bounds_and_never_goes_back_in_time(make_flight):
    lag = TelemetryLag([0.1], jitter=0.05, stamp="measured")
    told = [(s, m.time) for s, m in falling(make_flight, lag) if isinstance(m, LocalPosition)]
    age = np.array([sent - stamp for sent, stamp in told if sent > 0.4])
    assert 0.045 < age.min() < 0.07
    assert 0.13 < age.max() < 0.155
    assert (np.diff([stamp for _, stamp in told]) >= 0.0).all()


def report(make_flight, grade, kind, seconds=2.0, **options):
    f = make_flight(grade=GRADES[grade], rangefinder=True, **options)
    heard = []
    for k in range(round(seconds * 50)):
        f.autopilots.advance((k + 1) * 0.02)
        heard += [m for m in f.autopilots.telemetry(0, "companion") if isinstance(m, kind)]
    return heard


def test_each_grade_reports_its_fix_and_whether_its_position_is_absolute(make_flight):
    absolute = 0x10  # ESTIMATOR_POS_HORIZ_ABS
    for grade, fix, there in (
        ("rtk", GpsFix.RTK_FIXED, True),
        ("gps", GpsFix.FIX_3D, True),
        ("vio", GpsFix.NO_FIX, False),
    ):
        gps = report(make_flight, grade, GpsRaw)[-1]
        assert gps.fix_type is fix
        assert (gps.horizontal_accuracy > 0.0) == there
        assert bool(report(make_flight, grade, EstimatorStatus)[-1].flags & absolute) == there


def test_odometry_tells_doubts_and_resets(make_flight):
    f = make_flight(grade=GRADES["vio"])
    f.autopilots.advance(0.5)
    f.autopilots.errors.reset(0, [0.2, 0.0, 0.0])
    f.autopilots.advance(1.0)
    (told,) = [m for m in f.autopilots.telemetry(0, "companion") if isinstance(m, Odometry)]
    assert told.resets == 1
    np.testing.assert_allclose(told.position_sigma, 0.1)
    np.testing.assert_allclose(told.attitude_sigma, np.radians([0.5, 0.5, 1.0]))


def test_a_vehicle_in_motion_capture_sends_odometry_at_its_rate_and_as_requested(make_flight):
    """The onboard link of PX4: 30 Hz without a request; without a rangefinder no distance."""
    f = make_flight()

    def told(seconds):
        sent = []
        first = round(f.autopilots.t * 100)
        for k in range(first + 1, first + round(seconds * 100) + 1):
            f.autopilots.advance(k / 100)
            sent += f.autopilots.telemetry(0, "companion")
        assert not [m for m in sent if isinstance(m, DistanceSensor)]
        return len([m for m in sent if isinstance(m, Odometry)])

    assert told(2.0) == pytest.approx(60, abs=2)
    interval = Command(511, (float(MessageId.ODOMETRY), 20000.0, 0, 0, 0, 0, 0), 1)
    f.autopilots.receive(0, Received(Source(1, 191), interval))
    assert told(2.0) == pytest.approx(100, abs=2)
    never = Command(511, (float(MessageId.ODOMETRY), -1.0, 0, 0, 0, 0, 0), 1)
    f.autopilots.receive(0, Received(Source(1, 191), never))
    assert told(1.0) == 0


def test_a_rangefinder_measures_the_ground_below_and_no_farther_than_it_can(make_flight):
    ramp = {"x": [-10.0, 10.0], "y": [-5.0, 5.0], "z": [[2.0, 2.0], [2.0, 2.0]]}
    f = make_flight(rangefinder=True, ground=Ground({"terrain": ramp}))
    measure = f.autopilots._shared.rangefinder.measure
    level = np.array([1.0, 0.0, 0.0, 0.0])
    found = [measure(0, np.array([0.0, 0.0, 5.0]), level) for _ in range(400)]
    assert np.mean(found) == pytest.approx(3.0, abs=0.006)
    assert np.std(found) == pytest.approx(0.03, rel=0.15)
    tilted = np.array([math.cos(0.25), math.sin(0.25), 0.0, 0.0])  # 0.5 rad
    far = [measure(0, np.array([0.0, 0.0, 5.0]), tilted) for _ in range(50)]
    assert np.mean(far) == pytest.approx(3.0 / math.cos(0.5), abs=0.03)
    assert measure(0, np.array([0.0, 0.0, 15.0]), level) == math.inf
