"""What makes a daemon ready, and what feeds its watchdog."""

import numpy as np
import pytest

from companion.control.planning import Planned
from companion.estimation.vehicle import VehicleEstimate
from companion.perception.frontend import Detections
from companion.process.liveness import Liveness
from companion.supervision.guard import Reason, Verdict
from companion.supervision.supervision import Supervised
from companion.tick import Tick
from mavlink_bridge.wire.messages import Heartbeat, RateCommand, VehicleState

OWN = VehicleState(0.0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))
HEARTBEAT = Heartbeat(12, 2, False, 0, 3)


def verdict(reason, bad_ticks=0):
    return Verdict(RateCommand(np.zeros(3), 9.81), reason, bad_ticks)


def test_ready_needs_heartbeat_frame_and_plan():
    liveness = Liveness(0.1)
    liveness.judge(Tick(0.0), sent=False)
    assert not liveness.ready
    assert liveness.missing == (
        "waiting for heartbeat and telemetry of the autopilot, camera frame, solved plan"
    )
    liveness.judge(Tick(0.1, vehicle=VehicleEstimate(heartbeat=HEARTBEAT)), sent=False)
    liveness.judge(Tick(0.2, seen=Detections(0.2, OWN)), sent=False)
    assert not liveness.ready
    assert liveness.missing == "waiting for solved plan"
    liveness.judge(Tick(0.3, planned=Planned(self_tested=True)), sent=False)
    assert liveness.ready


@pytest.mark.parametrize(
    ("of_tick", "sent", "alive"),
    [
        (None, False, True),  # no stream: the tick came to its end
        (verdict(Reason.PLAN), True, True),
        (verdict(Reason.PLAN), False, False),  # solved, but nothing left the process
        (verdict(Reason.BRAKE, 25), True, True),  # a fallback may last 2.5 s
        (verdict(Reason.BRAKE, 26), True, False),
        (verdict(Reason.NO_STATE, 100), True, False),
    ],
)
def test_what_feeds_the_watchdog(of_tick, sent, alive):
    made = Tick(0.0, supervised=Supervised(verdict=of_tick))
    assert Liveness(0.1).judge(made, sent) is alive
