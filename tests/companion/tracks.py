"""An own state and tracks of neighbours for tests of guidance and control."""

import numpy as np

from companion.types import Track
from mavlink_bridge.wire.messages import VehicleState

OWN = VehicleState(0.0, np.zeros(3), np.array([1.5, 0, 0]), np.array([1.0, 0, 0, 0]), np.zeros(3))


def track(n, p, v=(0.0, 0.0, 0.0)):
    return Track(n, np.array(p, float), np.array(v, float), np.eye(6), 1.0, 0.0)
