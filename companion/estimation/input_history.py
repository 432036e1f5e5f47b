"""The inputs that were sent and may still be in flight: what the vehicle's motion follows from."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from companion.model import HOVER
from mavlink_bridge.shared.arrays import Vector

_KEPT = 64  # inputs: the longest delay and age at the shortest period


@dataclass(frozen=True)
class SentInput:
    """One input: sent at the tick of `time` [s]; u (4,) c, omega; thrust 0…1, normalised."""

    time: float
    u: Vector
    thrust: float


class InputHistory:
    """The last inputs sent, oldest first.

    delay: s, from an input's tick to its effect. delay_sigma: its 1 σ, where it is measured.
    """

    def __init__(self, delay: float) -> None:
        """delay: s from a tick to its effect: compute, transport, rate loop."""
        self.delay, self.delay_sigma = delay, 0.0
        self.epoch = 0  # grows whenever the inputs are forgotten
        self._sent: deque[SentInput] = deque(maxlen=_KEPT)

    @property
    def u_last(self) -> Vector:
        """(4,) the last input sent; hover where none was."""
        return self._sent[-1].u if self._sent else HOVER

    @property
    def u_first(self) -> Vector:
        """(4,) the oldest input remembered; hover where none is."""
        return self._sent[0].u if self._sent else HOVER

    def add(self, sent: SentInput) -> None:
        """Remember an input that was sent."""
        self._sent.append(sent)

    def acting(self, start: float, end: float) -> tuple[Vector, list[tuple[float, Vector]]]:
        """Return what acts from `start` to `end` [s]: the input u (4,) at first, then the others.

        Of each other input the time from which it acts [s], and u; oldest first.
        """
        later: list[tuple[float, Vector]] = []
        for sent in reversed(self._sent):
            acts = sent.time + self.delay
            if acts <= start:
                return sent.u, later[::-1]
            if acts < end:
                later.append((acts, sent.u))
        return self.u_first, later[::-1]

    def clear(self) -> None:
        """Forget all inputs: the autopilot flies by itself, and no motion follows from ours."""
        self._sent.clear()
        self.epoch += 1

    def __reversed__(self) -> Iterator[SentInput]:
        return reversed(self._sent)

    def __len__(self) -> int:
        return len(self._sent)
