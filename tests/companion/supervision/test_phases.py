"""The phases: when the companion takes control, and how it gives control back."""

import numpy as np
import pytest

from companion.guidance.mission import MissionConfig
from companion.supervision.phases import GiveBack, PhaseMachine
from companion.types import Phase
from mavlink_bridge.autopilots.ardupilot import MODES as ARDUPILOT
from mavlink_bridge.autopilots.ardupilot import ArduPilot
from mavlink_bridge.autopilots.betaflight import MODES as BETAFLIGHT
from mavlink_bridge.autopilots.betaflight import PILOT, Betaflight
from mavlink_bridge.autopilots.px4 import MODES as PX4
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.wire.messages import Command, Heartbeat, VehicleState

# POSCTL, LOITER, and the mode of the bridge in which the sticks fly
ALL = [
    (Px4(1), PX4 | {"pilot": 0x00030000}),
    (ArduPilot(1), ARDUPILOT | {"pilot": 5}),
    (Betaflight(1), BETAFLIGHT | {"pilot": PILOT}),
]


def at(height):
    return VehicleState(
        0.0, np.array([0.0, 0.0, height]), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3)
    )


class Flown:
    """A phase machine, tick by tick, and the heartbeats of its vehicle."""

    def __init__(self, adapter, modes, **mission):
        self.phases = PhaseMachine(MissionConfig(**mission), adapter)
        self.modes, self.kind, self.time = modes, adapter.autopilot, 0.0

    def tick(self, mode, *, armed=True, height=0.0, ready=True, complete=False, airborne=None):
        """airborne: None: as the height tells."""
        self.time += 0.1
        heartbeat = Heartbeat(self.kind, 2, armed, self.modes[mode], 4)
        airborne = height > 0.3 if airborne is None else airborne
        return self.phases.update(
            self.time, heartbeat, at(height), ready, complete, airborne=airborne
        )

    def until(self, phase):
        """Tick until `phase`, with the heartbeats of a vehicle that obeys."""
        up, climbs = self.phases._autopilot.mode_after_takeoff, False
        for _ in range(20):
            now = self.phases.phase
            if now is phase:
                return
            height = 2.0 if climbs else 0.0
            if now is Phase.TAKEOFF and not climbs:
                mode, climbs = ("takeoff" if "takeoff" in self.modes else up), True
            else:
                mode = "offboard" if now in (Phase.ENGAGE, Phase.FLY) else up
            complete = phase is Phase.LAND
            self.tick(mode, armed=now is not Phase.WAIT, height=height, complete=complete)
        raise AssertionError(self.phases.phase)

    def nothing_more(self, mode, height=2.0, ticks=35):
        """Whether the companion leaves a vehicle in `mode` alone from the first tick on."""
        decisions = [self.tick(mode, height=height) for _ in range(ticks)]
        passive = (Phase.PASSIVE, [], False)
        return all((d.phase, d.requests, d.stream) == passive for d in decisions)


def test_px4_is_engaged_in_hold_and_flown_in_offboard():
    flown = Flown(Px4(1), PX4)
    assert flown.tick("hold", armed=False).phase is Phase.WAIT
    engaged = flown.tick("hold")
    assert (engaged.phase, engaged.stream) == (Phase.ENGAGE, True)
    assert flown.tick("takeoff").phase is Phase.ENGAGE
    assert flown.tick("offboard", height=2.0).phase is Phase.FLY


def test_ardupilot_is_left_alone_until_it_is_up():
    flown = Flown(ArduPilot(1), ARDUPILOT)
    flown.tick("offboard", armed=False, height=7.0)  # where it stands is 7 m up in its frame
    for height in (7.0, 7.0, 7.5, 8.0):
        decision = flown.tick("offboard", height=height)
        assert (decision.phase, decision.stream) == (Phase.WAIT, False)
    assert flown.tick("hold", height=9.0).phase is Phase.WAIT
    assert flown.tick("offboard", height=9.0).phase is Phase.ENGAGE
    assert flown.tick("offboard", height=9.0).phase is Phase.FLY


@pytest.mark.parametrize(("adapter", "modes"), [(Px4(1), PX4), (ArduPilot(1), ARDUPILOT)])
def test_control_is_given_back(adapter, modes):
    flown = Flown(adapter, modes)
    for mode in ("hold", "offboard", "offboard", "offboard"):
        flown.tick(mode, height=3.0)
    assert flown.phases.phase is Phase.FLY
    flown.phases.release()
    asked = flown.tick("offboard", height=3.0)
    assert asked.stream  # until the vehicle shows that it holds by itself
    assert asked.requests == adapter.hold()
    ended = flown.tick("hold", height=3.0)
    assert (ended.phase, ended.stream, ended.requests) == (Phase.PASSIVE, False, [])
    assert flown.tick("offboard", height=3.0).phase is Phase.PASSIVE


@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_companion_that_resumes_neither_arms_nor_takes_off(adapter, modes):
    """Though `mission.auto` lets it do both when it starts."""
    flown = Flown(adapter, modes, auto=True)
    flown.until(Phase.FLY)
    flown.tick("land", height=1.0)
    flown.phases.resume()
    up = [flown.tick("land", height=1.0) for _ in range(15)]
    down = [flown.tick(adapter.mode_after_takeoff, armed=False) for _ in range(35)]
    assert {d.phase for d in up + down} == {Phase.WAIT}
    asked = [m for d in up + down for m in d.requests]
    assert [m for m in asked if m not in adapter.request_streams()] == []


def test_a_companion_that_flies_goes_on_when_told_to_resume():
    flown = Flown(Px4(1), PX4, auto=True)
    flown.until(Phase.FLY)
    flown.phases.release()
    flown.phases.resume()  # control is being given back: that goes on
    assert flown.tick("offboard", height=2.0).requests == Px4(1).hold()


def test_a_companion_without_control_gives_nothing_back():
    flown = Flown(Px4(1), PX4)
    flown.tick("offboard", armed=False)
    flown.phases.release()
    decision = flown.tick("offboard")  # another program's offboard
    assert (decision.phase, decision.stream, decision.requests) == (Phase.PASSIVE, False, [])


def foreign_modes():
    """(adapter, its modes, phase, mode) wherever the phase does not lead to the mode."""
    for adapter, modes in ALL:
        for phase in (Phase.TAKEOFF, Phase.ENGAGE, Phase.FLY, Phase.LAND):
            own = "land" if phase is Phase.LAND else adapter.mode_after_takeoff
            for mode in sorted({"pilot", "rtl", "hold", "land"} & set(modes) - {own}):
                name = f"{type(adapter).__name__}-{phase.value}-{mode}"
                yield pytest.param(adapter, modes, phase, mode, id=name)


@pytest.mark.row("13")
@pytest.mark.parametrize(("adapter", "modes", "phase", "mode"), list(foreign_modes()))
def test_a_mode_that_was_not_requested_wins_in_every_phase(adapter, modes, phase, mode):
    flown = Flown(adapter, modes, auto=True)
    flown.until(phase)
    assert flown.nothing_more(mode)
    assert flown.nothing_more("offboard")


@pytest.mark.row("13")
@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_landing_that_a_pilot_ends_is_not_requested_again(adapter, modes):
    for mode in sorted({"pilot", "rtl", "hold"} & set(modes)):
        flown = Flown(adapter, modes, auto=True)
        flown.until(Phase.LAND)
        assert flown.tick("land", height=1.5).phase is Phase.LAND
        assert flown.nothing_more(mode, height=1.5)


@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_request_to_land_that_is_lost_is_repeated(adapter, modes):
    flown = Flown(adapter, modes, auto=True)
    flown.until(Phase.LAND)
    decisions = [flown.tick("offboard", height=2.0) for _ in range(35)]
    assert all(d.stream for d in decisions)
    assert [d.requests for d in decisions if d.requests] == [adapter.land()] * 3
    assert flown.tick("land", height=1.0).requests == []
    assert flown.tick("land", armed=False).phase is Phase.DONE


@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_vehicle_that_disarms_in_another_mode_has_landed(adapter, modes):
    flown = Flown(adapter, modes, auto=True)
    flown.until(Phase.LAND)
    flown.tick("land", height=1.0)
    assert flown.tick("hold", armed=False).phase is Phase.DONE


@pytest.mark.row("13")
@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_take_off_that_a_pilot_ends_is_not_requested_again(adapter, modes):
    for climbs in (False, True):
        flown = Flown(adapter, modes, auto=True)
        flown.until(Phase.TAKEOFF)
        if climbs:
            flown.tick("takeoff" if "takeoff" in modes else adapter.mode_after_takeoff, height=0.8)
        assert flown.nothing_more("pilot", height=0.8)


def test_a_vehicle_that_a_pilot_stops_low_in_its_take_off_waits_there():
    flown = Flown(Px4(1), PX4, auto=True)
    flown.until(Phase.TAKEOFF)
    flown.tick("takeoff", height=0.8)
    stopped = [flown.tick("hold", height=0.8) for _ in range(35)]
    assert all((d.phase, d.requests, d.stream) == (Phase.TAKEOFF, [], False) for d in stopped)


@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_vehicle_whose_height_drifts_on_the_ground_is_asked_to_take_off(adapter, modes):
    """By GPS one seemed to stand 0.4 m up, was never asked, and disarmed after ten seconds."""
    flown = Flown(adapter, modes, auto=True)
    flown.until(Phase.ARM)
    ground = adapter.mode_after_takeoff
    flown.tick(ground, armed=False)
    asked = [flown.tick(ground, height=0.4, airborne=False) for _ in range(15)]
    assert adapter.takeoff(2.0) in [d.requests for d in asked]


@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_vehicle_that_stands_in_a_pilots_mode_takes_off_all_the_same(adapter, modes):
    flown = Flown(adapter, modes, auto=True)
    for armed in (False, False, True):
        flown.tick("pilot", armed=armed)
    asked = [flown.tick("pilot") for _ in range(65)]
    assert [d.requests for d in asked if d.requests] == [adapter.takeoff(2.0)] * 2
    flown.tick("takeoff" if "takeoff" in modes else adapter.mode_after_takeoff, height=0.5)
    assert flown.tick(adapter.mode_after_takeoff, height=2.0).phase is Phase.ENGAGE


@pytest.mark.row("21")
@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_landing_for_safety_is_requested_again_while_in_offboard(adapter, modes):
    flown = Flown(adapter, modes, auto=True)
    flown.until(Phase.FLY)
    flown.phases.release(GiveBack.LAND)
    decisions = [flown.tick("offboard", height=2.0) for _ in range(12)]
    assert all(d.stream for d in decisions)
    assert [d.requests for d in decisions if d.requests] == [adapter.land()] * 4
    assert flown.nothing_more("pilot")


def test_a_vehicle_that_is_not_ready_any_more_is_not_armed():
    flown = Flown(Px4(1), PX4, auto=True)
    flown.until(Phase.ARM)
    blind = [flown.tick("hold", armed=False, ready=False) for _ in range(30)]
    assert {d.phase for d in blind} == {Phase.WAIT}
    assert not {m for d in blind for m in d.requests} & set(Px4(1).arm())
    assert flown.tick("hold", armed=False).requests == Px4(1).arm()


@pytest.mark.parametrize(("blind", "phase"), [(10, Phase.TAKEOFF), (30, Phase.ENGAGE)])
def test_a_vehicle_armed_on_request_takes_off_only_if_it_is_ready_soon(blind, phase):
    flown = Flown(Px4(1), PX4, auto=True)
    flown.until(Phase.ARM)
    decisions = [flown.tick("hold", ready=False) for _ in range(blind)]
    assert not {m for d in decisions for m in d.requests} & set(Px4(1).takeoff(2.0))
    decisions = [flown.tick("hold") for _ in range(30)]
    assert decisions[0].phase is phase
    asked = [m for d in decisions for m in d.requests]
    assert bool(asked) is (phase is Phase.TAKEOFF)  # else the vehicle is the pilot's


def test_a_vehicle_that_a_pilot_has_flown_is_not_armed_after_disarming():
    flown = Flown(Px4(1), PX4 | {"pilot": 0x00030000}, auto=True)
    flown.tick("hold", armed=False, ready=False)
    for ready in (False, True):
        assert all(flown.tick("pilot", ready=ready).phase is Phase.WAIT for _ in range(30))
    landed = [flown.tick("pilot", armed=False) for _ in range(30)]
    assert {d.phase for d in landed} == {Phase.WAIT}
    assert not {m for d in landed for m in d.requests} & set(Px4(1).arm())


def test_a_vehicle_that_a_pilot_flies_after_a_reboot_is_not_taken():
    """Its clock begins anew: the request to arm from before the reboot no longer counts."""
    flown = Flown(ArduPilot(1), ARDUPILOT | {"pilot": 5}, auto=True)
    flown.time = 100.0
    flown.until(Phase.ARM)
    flown.tick("offboard", armed=False, ready=False)
    flown.phases.rebooted()
    flown.time = 0.0
    flown.tick("pilot", ready=False)
    decisions = [flown.tick("pilot", height=1.0) for _ in range(30)]
    assert {d.phase for d in decisions} == {Phase.WAIT}
    assert not {m for d in decisions for m in d.requests} & set(ArduPilot(1).takeoff(2.0))


def test_streams_are_requested_even_where_telemetry_comes_at_once():
    """It may come at lower rates: the companion is ready with telemetry up to 0.3 s old."""
    flown = Flown(Px4(1), PX4, auto=True)
    asked = [m for _ in range(30) for m in flown.tick("hold", armed=False).requests]
    assert flown.phases.phase is Phase.ARM
    assert [m for m in asked if m in Px4(1).request_streams()] == Px4(1).request_streams()


@pytest.mark.parametrize("auto", [True, False])
def test_a_companion_that_starts_in_flight_takes_nothing_unasked(auto):
    machine = PhaseMachine(MissionConfig(auto=auto), Px4(1))

    def tick(time, mode, armed=True):
        heartbeat = Heartbeat(12, 2, armed, PX4[mode], 4)
        return machine.update(time, heartbeat, at(0.0), ready=True, complete=False)

    assert all(tick(0.1 * n, "offboard").phase is Phase.WAIT for n in range(5))
    if auto:
        assert tick(1.0, "hold").phase is Phase.ENGAGE  # streams, for a pilot to choose offboard
        requests = [m for n in range(30) for m in tick(1.1 + 0.1 * n, "hold").requests]
        assert requests == []
    assert tick(9.0, "land", armed=False).phase in (Phase.WAIT, Phase.PASSIVE)
    assert tick(9.1, "land", armed=False).phase is not Phase.ARM


@pytest.mark.row("41")
@pytest.mark.parametrize(("adapter", "modes"), ALL)
@pytest.mark.parametrize("phase", [Phase.ENGAGE, Phase.FLY])
def test_a_vehicle_disarmed_in_flight_is_let_go_in_that_tick(adapter, modes, phase):
    """A kill switch: the mode stays offboard, and only the armed flag of HEARTBEAT falls."""
    flown = Flown(adapter, modes, auto=True)
    flown.until(phase)
    flown.tick("offboard", height=2.0)
    decision = flown.tick("offboard", armed=False, height=1.9)
    assert (decision.phase, decision.stream, decision.requests) == (Phase.PASSIVE, False, [])


@pytest.mark.parametrize(("adapter", "modes"), ALL)
def test_a_vehicle_disarmed_while_control_is_given_back_is_let_go_in_that_tick(adapter, modes):
    flown = Flown(adapter, modes, auto=True)
    flown.until(Phase.FLY)
    flown.phases.release()
    assert flown.tick("offboard", height=2.0).stream
    decision = flown.tick("offboard", armed=False, height=1.9)
    assert (decision.phase, decision.stream, decision.requests) == (Phase.PASSIVE, False, [])


def test_px4_is_asked_to_hold_before_it_is_armed():
    """It refuses to arm in the offboard mode to which it returns after a flight."""
    flown = Flown(Px4(1), PX4, auto=True)
    asked = [m for _ in range(5) for m in flown.tick("offboard", armed=False).requests]
    sent = [m for m in asked if isinstance(m, Command) and m.command in (176, 400)]
    commands = [(m.command, m.params[1:3]) for m in sent]
    assert commands == [(176, (4, 3)), (400, (0.0, 0.0))]


def test_offboard_is_asked_for_only_once_setpoints_have_come():
    flown = Flown(Px4(1), PX4, auto=True)
    flown.until(Phase.ENGAGE)
    decisions = [flown.tick("hold", height=2.0) for _ in range(6)]
    assert all(d.stream for d in decisions)
    assert [bool(d.requests) for d in decisions].index(True) == 2  # 0.3 s after the first


def test_of_several_ways_to_give_control_back_landing_wins():
    flown = Flown(Px4(1), PX4, auto=True)
    flown.until(Phase.FLY)
    flown.phases.release(GiveBack.LAND)
    flown.phases.release(GiveBack.HOLD)
    assert flown.tick("offboard", height=2.0).requests == Px4(1).land()
    other = Flown(Px4(1), PX4, auto=True)
    other.until(Phase.FLY)
    other.phases.release(GiveBack.RETURN)
    assert other.tick("offboard", height=2.0).requests == Px4(1).rtl()
