"""Numbers at the ends of their fields and beyond, what stands for "unknown", and texts."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.codec import Codec
from tests.mavlink_bridge.wire.fields import heard, wire

NAN, INF = math.nan, math.inf
TARGET = {"target_system": 3, "target_component": 191}


def gps_raw(**changed):
    return m.GpsRaw(2.0, 3, 47.0, 8.0, 400.0, 9, **changed)


def global_position(*v):
    return m.GlobalPosition(2.0, 47.0, 8.0, 400.0, 2.0, np.array(v))


def hil_gps(*v):
    return m.HilGps(2.0, 47.0, 8.0, 400.0, np.array(v))


def mission_item(x, y):
    return m.MissionItem(1, 1, 0, 6, 16, 0, 1, (0.0, 0.0, 0.0, 0.0), x, y, 5.0)


UINT16, UINT32 = 65535, 4294967295


def clips(field, least, most, unit):
    """The field, and (value, wire) at both of its ends and beyond: `unit` to one of the wire."""
    return field, [
        (least * unit, least),
        ((least + 1) * unit, least + 1),
        ((least - 1) * unit, least),
        ((most - 1) * unit, most - 1),
        (most * unit, most),
        ((most + 1) * unit, most),
        (1e12, most),
        (-1e12, least),
    ]


@pytest.mark.parametrize(
    ("make", "field", "values"),
    [
        (
            lambda x: m.SystemStatus(1, 1, 1, x, 0.0, 0.0),
            *clips("voltage_battery", 0, UINT16, 1e-3),
        ),
        (
            lambda x: m.SystemStatus(1, 1, 1, 0.0, x, 0.0),
            *clips("current_battery", -32768, 32767, 0.01),
        ),
        (
            lambda x: m.SystemStatus(1, 1, 1, 0.0, 0.0, x),
            *clips("battery_remaining", -1, 100, 0.01),
        ),
        (lambda x: m.SystemStatus(1, 1, 1, 0.0, 0.0, 0.0, x), *clips("load", 0, 1000, 1e-3)),
        (lambda x: m.BatteryStatus(0.0, x, 0.0), *clips("current_battery", -1, 32767, 0.01)),
        (lambda x: m.BatteryStatus(0.0, 0.0, x), *clips("battery_remaining", -1, 100, 0.01)),
        (lambda x: gps_raw(hdop=x), *clips("eph", 0, UINT16, 0.01)),
        (lambda x: gps_raw(vdop=x), *clips("epv", 0, UINT16, 0.01)),
        (lambda x: gps_raw(speed=x), *clips("vel", 0, UINT16, 0.01)),
        (lambda x: gps_raw(horizontal_accuracy=x), *clips("h_acc", 0, UINT32, 1e-3)),
        (lambda x: gps_raw(vertical_accuracy=x), *clips("v_acc", 0, UINT32, 1e-3)),
        (lambda x: gps_raw(speed_accuracy=x), *clips("vel_acc", 0, UINT32, 1e-3)),
        (
            lambda x: m.DistanceSensor(2.0, x, 0.0, 0.0, 25),
            *clips("current_distance", 0, UINT16, 0.01),
        ),
        (lambda x: m.DistanceSensor(2.0, 0.0, x, 0.0, 25), *clips("min_distance", 0, UINT16, 0.01)),
        (lambda x: m.DistanceSensor(2.0, 0.0, 0.0, x, 25), *clips("max_distance", 0, UINT16, 0.01)),
        (
            lambda x: m.DistanceSensor(2.0, 0.0, 0.0, 0.0, 25, quality=x),
            *clips("signal_quality", 0, 100, 1),
        ),
        # ENU (1, 2, 3) is NED (2, 1, -3).
        (lambda x: global_position(0.0, x, 0.0), *clips("vx", -32768, 32767, 0.01)),
        (lambda x: global_position(x, 0.0, 0.0), *clips("vy", -32768, 32767, 0.01)),
        (lambda x: global_position(0.0, 0.0, -x), *clips("vz", -32768, 32767, 0.01)),
        (lambda x: hil_gps(0.0, x, 0.0), "vn", [(327.67, 32767), (327.68, 32767), (-400, -32768)]),
        (lambda x: hil_gps(x, 0.0, 0.0), "ve", [(327.67, 32767), (327.68, 32767), (-400, -32768)]),
        (lambda x: hil_gps(0.0, 0.0, -x), "vd", [(327.67, 32767), (327.68, 32767), (-400, -32768)]),
        (lambda x: mission_item(x, 0.0), *clips("x", -(2**31), 2**31 - 1, 1e-7)),
        (lambda x: mission_item(0.0, x), *clips("y", -(2**31), 2**31 - 1, 1e-7)),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_a_number_beyond_its_field_is_the_fields_last(make, field, values):
    """0 is the field's own, and what is not finite its least."""
    for value, expected in [(0, 0), *values]:
        assert getattr(wire(make(value)), field) == expected, value
    if field in ("current_distance", "eph", "battery_remaining", "vx", "load"):
        for value in (NAN, INF, -INF):
            assert getattr(wire(make(value)), field) == min(e for _, e in values), value


@pytest.mark.parametrize(
    ("volts", "cell"),
    # 65535 would say that there is no such cell.
    [(0.0, 0), (0.001, 1), (-1.0, 0), (65.534, 65534), (65.535, 65534), (99.0, 65534), (NAN, 0)],
)
def test_a_voltage_beyond_the_field_is_never_that_of_a_missing_cell(volts, cell):
    assert wire(m.BatteryStatus(volts, 0.0, 0.0)).voltages == [cell] + [65535] * 9


@pytest.mark.parametrize(
    ("sigma", "variance"), [(0.0, 255), (0.01, 1), (0.1, 100), (0.159, 253), (0.16, 254), (9, 254)]
)
def test_a_range_of_great_doubt_is_not_one_of_unknown_doubt(sigma, variance):
    assert wire(m.DistanceSensor(2.0, 1.0, 0.1, 9.0, 25, sigma=sigma)).covariance == variance


@pytest.mark.parametrize(
    ("x", "expected"), [(NAN, 2147483647), (INF, 2147483647), (-INF, 2147483647)]
)
def test_a_place_that_is_not_finite_is_none(x, expected):
    item = wire(mission_item(x, 8.5))
    assert (item.x, item.y) == (expected, 85000000)
    item = wire(mission_item(8.5, x))
    assert (item.x, item.y) == (85000000, expected)


@pytest.mark.parametrize(
    ("time", "told"),
    [(0.0, 0), (0.0014, 1), (4294967.295, 4294967295), (4294967.296, 0), (4294968.0, 704)],
)
def test_a_clock_of_milliseconds_begins_anew_after_49_days(time, told):
    assert wire(m.LocalPosition(time, np.zeros(3), np.zeros(3))).time_boot_ms == told


@pytest.mark.parametrize(
    ("yaw", "course"), [(0.0, 9000), (math.pi / 2, 0), (math.pi, 27000), (-math.pi / 2, 18000)]
)
def test_a_course_counts_clockwise_from_north(yaw, course):
    fix = gps_raw(speed=1.0, course=yaw)
    assert wire(fix).cog == course
    read = Codec(1, 191).decode(Codec(1, 1).encode([fix]))[0].message.course
    assert math.remainder(read - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("v", "cog"), [((0, 1), 0), ((1, 0), 9000), ((0, -1), 18000), ((-1, 0), 27000), ((1, 1), 4500)]
)
def test_the_course_of_a_simulated_fix_is_that_of_its_velocity(v, cog):
    assert wire(hil_gps(*v, 0.0)).cog == cog


@pytest.mark.parametrize(("heading", "told"), [(0.0, 0), (math.pi, 18000), (None, 65535)])
def test_a_heading_is_told_in_centidegrees_or_as_unknown(heading, told):
    position = m.GlobalPosition(2.0, 47.0, 8.0, 400.0, 2.0, np.zeros(3), heading)
    assert wire(position).hdg == told
    assert Codec(1, 191).decode(Codec(1, 1).encode([position]))[0].message.heading == heading


@pytest.mark.parametrize(
    ("name", "fields", "text"),
    [
        ("STATUSTEXT", {"severity": 4, "text": b"\xffno \xc3\xa9"}, lambda r: r.text),
        ("PARAM_VALUE", {"param_id": b"\xffno \xc3\xa9", "param_value": 1.0, "param_type": 9,
                         "param_count": 1, "param_index": 0}, lambda r: r.name),
        ("PARAM_SET", {**TARGET, "param_id": b"\xffno \xc3\xa9", "param_value": 1.0,
                       "param_type": 9}, lambda r: r.name),
        ("PARAM_REQUEST_READ", {**TARGET, "param_id": b"\xffno \xc3\xa9", "param_index": -1},
         lambda r: r.name),
        ("PARAM_ERROR", {**TARGET, "param_id": b"\xffno \xc3\xa9", "param_index": -1, "error": 1},
         lambda r: r.name),
        ("NAMED_VALUE_FLOAT", {"time_boot_ms": 0, "name": b"\xffno \xc3\xa9", "value": 1.0},
         lambda r: r.name),
        ("NAMED_VALUE_INT", {"time_boot_ms": 0, "name": b"\xffno \xc3\xa9", "value": 1},
         lambda r: r.name),
    ],
)  # fmt: skip
def test_a_byte_that_is_no_text_is_replaced(name, fields, text):
    assert text(heard(name, fields)) == "\ufffdno é"


def test_names_of_a_camera_that_are_no_text_are_replaced():
    vendor = [*b"\xffno \xc3\xa9", *bytes(26)]
    read = heard(
        "CAMERA_INFORMATION",
        {"time_boot_ms": 0, "vendor_name": vendor, "model_name": vendor[::-1],
         "firmware_version": 0, "focal_length": NAN, "sensor_size_h": NAN, "sensor_size_v": NAN,
         "resolution_h": 1, "resolution_v": 2, "lens_id": 0, "flags": 0,
         "cam_definition_version": 0, "cam_definition_uri": b""},
    )  # fmt: skip
    assert read.vendor == "\ufffdno é"
    assert read.model == "\0" * 26 + "\ufffd\ufffd on\ufffd"


@pytest.mark.parametrize(
    ("message", "field", "told"),
    [
        (m.StatusText(4, "x" * 49 + "yz"), "text", "x" * 49 + "y"),
        (m.NamedValue(1.0, "ten_letter_and_more", 1.5), "name", "ten_letter"),
        (m.NamedValue(1.0, "ten_letter_and_more", 1), "name", "ten_letter"),
        (m.CameraInformation(1.0, "v" * 40, "m", NAN, NAN, NAN, 1, 1, 0), "vendor_name",
         [ord("v")] * 32),
        (m.CameraInformation(1.0, "v", "m" * 40, NAN, NAN, NAN, 1, 1, 0), "model_name",
         [ord("m")] * 32),
    ],
)  # fmt: skip
def test_a_text_is_cut_at_the_end_of_its_field(message, field, told):
    assert getattr(wire(message), field) == told
