"""Two missions in a row: phases of a companion against the emulated autopilots, no solver."""

import numpy as np
import pytest

from companion.guidance.mission import MissionConfig
from companion.pipeline import Companion
from companion.process.events import Events
from companion.settings.config import CompanionConfig
from companion.supervision.phases import PhaseMachine
from companion.tick import TickInputs
from companion.types import Phase
from mavlink_bridge.autopilots.answers import Answers
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.autopilots.registry import adapter
from mavlink_bridge.wire.messages import Heartbeat, RateSetpoint, Received, Source, VehicleState
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles

COMPANION, AUTOPILOT = Source(1, 191), Source(1, 1)
HOVER = Airframe().hover_thrust


class Mission:
    """One daemon's life: it starts beside a vehicle on the ground, flies 2 s, lands."""

    def __init__(self, name, autopilots):
        self.vehicle, self.autopilot = autopilots, adapter(name, 1)
        self.phases = PhaseMachine(MissionConfig(auto=True), self.autopilot)
        self.answers, self.refusals = Answers(self.autopilot), []
        self.heartbeat = None
        self.flew = 0

    def tick(self):
        a = self.vehicle
        a.advance(round(a.t + 0.1, 3))
        heard = a.telemetry(0, "companion")
        self.heartbeat = next((m for m in heard if isinstance(m, Heartbeat)), self.heartbeat)
        s = a.vehicles.state
        own = VehicleState(a.t, s.p[0].copy(), s.v[0].copy(), s.q[0].copy(), s.omega[0].copy())
        self.flew += self.phases.phase is Phase.FLY
        complete = self.flew > 20
        up = bool(s.p[0, 2] > 0.3)
        decision = self.phases.update(a.t, self.heartbeat, own, True, complete, airborne=up)
        self.answers.ask(decision.requests)
        sent = list(decision.requests)
        if decision.stream:
            sent.append(RateSetpoint(a.t, np.zeros(3), HOVER, 1))
        for message in sent:
            heard += a.receive(0, Received(COMPANION, message), "companion")
        self.refusals += self.answers.refusals(heard)

    def fly(self, limit=45.0):
        """Fly until the phase is done; return whether it came to that, having flown."""
        end = self.vehicle.t + limit
        while self.vehicle.t < end and self.phases.phase is not Phase.DONE:
            self.tick()
        return self.phases.phase is Phase.DONE and self.flew > 20


@pytest.mark.row("41")
@pytest.mark.parametrize(("name", "options"), [("px4", {}), ("ardupilot", {"GUID_OPTIONS": 8})])
def test_a_second_mission_flies_after_the_first_has_landed(name, options):
    vehicle = Autopilots(Vehicles(Airframe(), [[0, 0, 0]], 0.0), [1], name, parameters=options)
    first = Mission(name, vehicle)
    assert first.fly()
    second = Mission(name, vehicle)
    assert second.fly()
    assert first.refusals == second.refusals == []


def test_without_hold_first_px4_refuses_the_second_mission_and_says_why(monkeypatch):
    """The check that the test above can fail: arming as before the mend."""
    vehicle = Autopilots(Vehicles(Airframe(), [[0, 0, 0]], 0.0), [1], "px4")
    assert Mission("px4", vehicle).fly()
    arm = Px4.arm
    monkeypatch.setattr(Px4, "arm", lambda self: arm(self)[1:])  # all but the request to hold
    second = Mission("px4", vehicle)
    assert not second.fly(10.0)
    assert second.phases.phase is Phase.ARM
    assert "arm: temporarily rejected" in second.refusals
    assert "arming denied: no setpoints for offboard" in second.refusals


def test_a_companion_restarted_in_flight_tells_what_it_waits_for(monkeypatch):
    """An ArduCopter stays in guided when its companion dies, and answers the next companion."""
    told = []
    monkeypatch.setattr(
        "companion.process.events.event", lambda name, *level, **fields: told.append((name, fields))
    )
    body, options = Vehicles(Airframe(), [[0, 0, 0]], 0.0), {"GUID_OPTIONS": 8}
    vehicle = Autopilots(body, [1], "ardupilot", parameters=options)
    first = Mission("ardupilot", vehicle)
    while first.phases.phase is not Phase.FLY:
        first.tick()
    link = {"autopilot": "ardupilot"}
    config = CompanionConfig.model_validate({"name": "drone1", "link": link})
    second, events, reasons, answers = Companion(config, lambda: 0.0), Events(), [], []
    for _ in range(30):
        vehicle.advance(round(vehicle.t + 0.1, 3))
        heard = answers + vehicle.telemetry(0, "companion")
        inputs = TickInputs(vehicle.t, [Received(AUTOPILOT, m) for m in heard], None)
        tick = second.tick(inputs)
        events.tick(inputs, tick)
        reasons.append(tick.supervised.inhibit_reason)
        answers = []
        for message in tick.supervised.requests:
            answers += vehicle.receive(0, Received(COMPANION, message), "companion")
    assert any("waiting for parameter GUID_OPTIONS" in r for r in reasons)
    assert "flew in offboard before this companion started" in reasons[-1]
    assert told[-1] == ("inhibited", {"reason": reasons[-1]})
    for message in first.autopilot.hold():  # the pilot's choice
        vehicle.receive(0, Received(Source(255, 190), message), "gcs")
    for _ in range(15):
        vehicle.advance(round(vehicle.t + 0.1, 3))
        heard = vehicle.telemetry(0, "companion")
        inputs = TickInputs(vehicle.t, [Received(AUTOPILOT, m) for m in heard], None)
        events.tick(inputs, second.tick(inputs))
    assert told[-1] == ("no longer inhibited", {"reason": reasons[-1]})
