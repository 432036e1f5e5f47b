"""Where a simulated vehicle truly is, from HIL_STATE_QUATERNION.

PX4 sends it without a stamp, and its degrees come in steps of a centimetre. So the velocity, which
is finer, carries the place from one message to the next, and each message corrects it a little.
"""

from __future__ import annotations

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import HilState, LocalPosition
from sitl_sim.worlds.geodesy import GeoReference

_GAIN = 0.1  # of the difference between place and message
_JUMP = 1.0  # m, beyond which the vehicle was moved, and did not fly
_LONGEST = 0.5  # s between messages that the velocity bridges


class TrueMotion:
    """Follows one vehicle, in metres from where it was heard first."""

    def __init__(self) -> None:
        self._reference: GeoReference | None = None
        self._last: LocalPosition | None = None

    def hear(self, m: HilState, stamp: float) -> LocalPosition | None:
        """Return where the vehicle is; stamp: s, of the newest message with one.

        None where no stamp is known, or the message before has the same.
        """
        time = m.time or stamp
        if not np.isfinite(time):
            return None
        if self._reference is None:
            self._reference = GeoReference(m.latitude_deg, m.longitude_deg, m.altitude)
        east, north = self._reference.to_metres(m.latitude_deg, m.longitude_deg)
        told = np.array([east, north, m.altitude - self._reference.altitude])
        last = self._last
        if last is not None and time == last.time:
            return None
        self._last = LocalPosition(time, self._followed(told, m.v, time), m.v)
        return self._last

    def _followed(self, told: Vector, v: Vector, time: float) -> Vector:
        last = self._last
        if last is None or not 0.0 < time - last.time < _LONGEST:
            return told
        carried = last.p + 0.5 * (time - last.time) * (last.v + v)
        off = told - carried
        return told if float(np.linalg.norm(off)) > _JUMP else carried + _GAIN * off
