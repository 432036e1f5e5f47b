"""Two frames (REP 105): goals and fence in the map, all that is seen in a frame that never jumps.

The autopilot's position is a place on the map. It steps when its estimator is reset, when a GPS
signal takes another path, or when an RTK solution floats. Trunks and neighbours do not step. So
what the reported velocity does not explain is taken out of the position and becomes the offset of
the map: the goals move, and nothing that was seen does. The pictures correct the velocity
(`velocity_by_sight.py`), and the position in odometry follows the corrected one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from companion.estimation.velocity_by_sight import VelocityBySight
from companion.estimation.velocity_error import VelocityError
from mavlink_bridge.shared.arrays import Vector, finite, norm
from mavlink_bridge.wire.messages import LocalPosition, Message, Odometry

_WINDOW = 0.5  # s over which position and velocity are compared
_GATE = 0.08  # m; positions and velocities that differ by less within the window are noise
_GATE_TIME = 1.0  # s; the gate grows with the velocity's doubt by this
_SLIDES = 1.5  # s after a step for which the velocity alone counts: filters follow slowly
_LONGEST_GAP = 0.25  # s without a position, over which the velocity says too little
_UNEXPLAINED = 1.0  # m; a larger step that no reset explains is a fault and stays one
_ANNOUNCED = 0.3  # s for which a reset explains a step
_SILENT = 0.5  # s without LOCAL_POSITION_NED, after which ODOMETRY gives the position


class OdometryFrame:
    """Takes steps out of positions.

    by_sight: corrects the velocity from now on. slid: (3,) m, what the velocity did not show.
    """

    def __init__(self) -> None:
        self.by_sight = VelocityBySight()
        self.slid: Vector = np.zeros(3)
        self._way: Vector = np.zeros(3)  # m, of the corrections by sight
        self._until = math.inf  # s, up to which that way is known
        self.steps = 0
        self._before: tuple[float, Vector, Vector] | None = None  # time, p and v in odometry
        self._told: Vector = np.zeros(3)  # m/s, its velocity as it was reported
        self._velocity = VelocityError()
        self._excess: Vector = np.zeros(3)  # m of motion within the window that no velocity shows
        self._resets: int | None = None
        self._reset_at = self._local_at = self._slides_until = -math.inf

    @property
    def offset(self) -> Vector:
        """(3,) m, position on the map less that in odometry."""
        return self.slid - self._way

    def localised(self, messages: Iterable[Message], velocity_sigma: float) -> Iterator[Message]:
        """Yield the messages, with positions in odometry; velocity_sigma: m/s, 1 σ."""
        for m in messages:
            if isinstance(m, LocalPosition):
                self._local_at = m.time
                p, v = self._step_free(m, velocity_sigma)
                v = self._go_on(m.time, v)
                yield LocalPosition(m.time, p + self._way, v)
            elif isinstance(m, Odometry):
                if self._resets is not None and m.resets != self._resets:
                    self._reset_at = m.time
                self._resets = m.resets
                if m.time - self._local_at > _SILENT:
                    self._go_on(m.time, self._step_free(m, velocity_sigma)[1])
                v = self._corrected(m.v + self._velocity.error)
                yield replace(m, p=m.p - self.offset, v=v)
            else:
                yield m

    def _corrected(self, v: Vector) -> Vector:
        """Return a velocity (3,) m/s by sight; one that is no number is refused later."""
        return self.by_sight.corrected(v) if finite(v) else v

    def _go_on(self, time: float, reported: Vector) -> Vector:
        """Return a velocity (3,) m/s by sight, summed up to the `time` [s] of its position."""
        v = self._corrected(reported)
        dt = time - self._until
        if 0.0 < dt <= _LONGEST_GAP and finite(v):
            self._way = self._way + dt * (v - reported)
        self._until = time
        return v

    def _step_free(
        self, m: LocalPosition | Odometry, velocity_sigma: float
    ) -> tuple[Vector, Vector]:
        """Return a position (3,) m in odometry and its velocity (3,) m/s.

        What the velocity does not explain moves the offset.
        """
        p, v = m.p - self.slid, m.v + self._velocity.error
        before = self._before
        dt = math.inf if before is None else m.time - before[0]
        if not (finite(m.p) and finite(m.v)) or dt <= 0.0:
            return p, v
        if before is None or dt > _LONGEST_GAP:
            self._before, self._told, self._excess = (m.time, p, v), m.v, np.zeros(3)
            return p, v
        _, p_before, v_before = before
        way = p - p_before
        unexplained = way - 0.5 * dt * (self._told + m.v)
        if norm(unexplained) < _GATE:  # else it is a step
            self._velocity.update(unexplained, dt, velocity_sigma, self.by_sight.shown)
            v = m.v + self._velocity.error
        step = way - 0.5 * dt * (v_before + v)
        announced = 0.0 <= m.time - self._reset_at < _ANNOUNCED
        if norm(step) > _UNEXPLAINED and not announced:
            return p, v  # the own state refuses it; where it lasts, that is a fault
        self._excess = math.exp(-dt / _WINDOW) * self._excess + step
        slides = m.time < self._slides_until
        if slides:
            self.slid = self.slid + step
        if norm(self._excess) > _GATE + _GATE_TIME * velocity_sigma:
            self._slides_until = m.time + _SLIDES
            if not slides:
                self.slid = self.slid + self._excess
                self.steps += 1
                self._excess = np.zeros(3)
        p = m.p - self.slid
        self._before, self._told = (m.time, p, v), m.v
        return p, v
