"""The flow of the ground in a tick's inputs: what is logged is what a replay sees."""

import numpy as np

from companion.flightlog.inputs import decode, encode
from companion.flightlog.replay import _frame
from companion.perception.frontend import Detections
from companion.perception.ground_flow import GroundFlow


def test_the_flow_of_the_ground_is_replayed():
    flow = GroundFlow(1.0, 1.1, np.array([0.15, -0.04]), 1.9)
    recorded = decode(encode(1.2, [b"ab"], 1.1, Detections(flow=flow)))
    assert recorded.datagrams == [b"ab"]
    assert GroundFlow.from_row(_frame(recorded).arrays["flow"]).row == flow.row


def test_a_picture_without_ground_has_none():
    recorded = decode(encode(1.2, [], 1.1, Detections()))
    assert recorded.flow is None
    assert "flow" not in _frame(recorded).arrays


def test_the_lag_of_a_picture_is_replayed():
    """Else a picture 0.2 s younger than telemetry would be one of the future."""
    frame = _frame(decode(encode(1.2, [], 1.2, Detections(), lag=-0.2)))
    assert (frame.time, frame.lag) == (1.0, -0.2)
