"""Telemetry whose content is older than the moment at which it is sent.

A real autopilot's estimate waits in a queue, on a radio or a serial line, and in the filter's own
delayed horizon. PX4 stamps LOCAL_POSITION_NED and ATTITUDE when it sends them, so a receiver that
trusts the stamp believes that an old estimate is a new one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import norm
from sitl_sim.vehicles.estimator import Estimate
from sitl_sim.vehicles.rigid_body import State

Floats = NDArray[np.float64]
Stamp = Literal["sent", "measured"]

KEPT = 32  # ticks: 0.3 s, the largest lag with its jitter


@dataclass(frozen=True)
class TelemetryLag:
    """Lag (n,) s of each vehicle's telemetry, and how much it varies: ± jitter [s], uniform.

    stamp: of what telemetry says, the time at which it is sent, or at which it was measured.
    """

    lag: Sequence[float]
    jitter: float = 0.0
    stamp: Stamp = "sent"


@dataclass(frozen=True)
class Sample:
    """What telemetry tells of one vehicle, world; time: s, by the vehicle's clock, its stamp.

    true_p, true_q: the truth at the same instant, for sensors that measure it.
    """

    time: float
    p: Floats
    v: Floats
    q: Floats
    omega: Floats
    true_p: Floats
    true_q: Floats


class LateSamples:
    """The newest estimates of n vehicles, and the older ones that late telemetry tells."""

    def __init__(
        self,
        system_ids: Sequence[int],
        lag: TelemetryLag | None,
        state: State,
        estimate: Estimate,
        seed: int,
    ) -> None:
        self._lag, self._state, self._estimate = lag, state, estimate
        n = len(system_ids)
        self._rngs = [np.random.default_rng([seed, 0x1A6, s]) for s in system_ids]
        self._rows = np.zeros((KEPT, n, 20))  # p, v, q, omega, true p, true q
        self._at = np.full(KEPT, -1, dtype=np.int64)  # µs of each row
        self._newest = -1
        # Of each vehicle: when it last told something [µs], the content and its time [µs]. No
        # content is older than the content before.
        self._told: list[tuple[int, Floats, int]] = [(-1, np.zeros(20), 0)] * n

    def record(self, now_us: int) -> None:
        """Keep the estimates of this instant; called every 10 ms."""
        if self._lag is None:
            return
        self._newest = (self._newest + 1) % KEPT
        self._rows[self._newest] = self._present()
        self._at[self._newest] = now_us

    def sample(self, i: int, now_us: int, boot_us: int) -> Sample:
        """Return what vehicle i's telemetry tells at now_us; its clock shows boot_us [µs]."""
        e, s = self._estimate, self._state
        if self._lag is None or self._newest < 0:
            return Sample(boot_us * 1e-6, e.p[i], e.v[i], e.q[i], e.omega[i], s.p[i], s.q[i])
        told_at, row, then = self._told[i]
        if told_at != now_us:
            then = max(now_us - self._age(i), then)
            row = self._row(i, then, now_us)
            self._told[i] = (now_us, row, then)
        stamp = boot_us if self._lag.stamp == "sent" else max(boot_us - (now_us - then), 0)
        q, true_q = _unit(row[6:10]), _unit(row[16:20])
        return Sample(stamp * 1e-6, row[:3], row[3:6], q, row[10:13], row[13:16], true_q)

    def _age(self, i: int) -> int:
        """Draw the age of what vehicle i tells next [µs]."""
        assert self._lag is not None
        jitter = self._lag.jitter
        age = self._lag.lag[i] + (self._rngs[i].uniform(-jitter, jitter) if jitter else 0.0)
        return round(max(age, 0.0) * 1e6)

    def _present(self) -> Floats:
        e, s = self._estimate, self._state
        rows: Floats = np.hstack([e.p, e.v, e.q, e.omega, s.p, s.q])
        return rows

    def _row(self, i: int, at_us: int, now_us: int) -> Floats:
        """Return the row of vehicle i at a time, between the kept rows around it."""
        order = (self._newest + 1 + np.arange(KEPT)) % KEPT
        order = order[self._at[order] >= 0]
        times = self._at[order]
        k = int(np.clip(np.searchsorted(times, at_us, side="right") - 1, 0, len(times) - 1))
        row: Floats = self._rows[order[k], i].copy()
        if at_us <= times[k]:
            return row
        last = k + 1 == len(times)
        after = self._present()[i] if last else self._rows[order[k + 1], i].copy()
        for first in (6, 16):  # q and -q are one attitude
            if after[first : first + 4] @ row[first : first + 4] < 0.0:
                after[first : first + 4] *= -1.0
        end = now_us if last else int(times[k + 1])
        row += (at_us - times[k]) / (end - times[k]) * (after - row)
        return row


def _unit(q: Floats) -> Floats:
    unit: Floats = q / norm(q)
    return unit
