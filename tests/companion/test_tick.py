"""The packets of one tick."""

import numpy as np

from companion.supervision.supervision import Supervised
from companion.tick import Tick
from mavlink_bridge.wire.messages import Heartbeat, RateSetpoint

HEARTBEAT = Heartbeat(12, 2, True, 0, 4)
SETPOINT = RateSetpoint(1.0, np.zeros(3), 0.4, 1)


def packets(repeat):
    supervised = Supervised(requests=[HEARTBEAT], repeat=repeat)
    return Tick(1.0, supervised=supervised, setpoint=SETPOINT).packets


def test_on_a_lossy_link_setpoint_and_requests_go_out_three_times():
    assert packets(repeat=False) == [[HEARTBEAT, SETPOINT]]
    assert packets(repeat=True) == [[HEARTBEAT, SETPOINT]] * 3
