"""Steadiness: what share of the finds are of neighbours that are known by then.

Eyes that see well show the same neighbours in picture after picture. Where most of what they show
is new each time, it is not there, or it is missed as often as it is seen. That tells poor eyes
before anybody comes near, whatever the detector says of itself; but only where there is somebody to
see: a drone that has left the others behind has nothing but false finds.
"""

from __future__ import annotations

from collections import deque

_LATELY = 5.0  # s of pictures that count
_LEAST = 8  # finds, from which they tell anything
_STEADY = 0.6  # share: docs/history/mechanisms.md has how many drones reach it, look by look


class Steadiness:
    """Counts the finds of the last 5 s."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all pictures."""
        self._pictures: deque[tuple[float, int, int]] = deque()

    def update(self, time: float, found: int, known: int) -> None:
        """Take in the picture of `time` [s]: how much it showed, and how much of it was known."""
        self._pictures.append((time, found, known))
        while time - self._pictures[0][0] > _LATELY:
            self._pictures.popleft()

    @property
    def enough(self) -> bool:
        """Return whether enough is found, and enough of that is of known neighbours."""
        found = sum(picture[1] for picture in self._pictures)
        known = sum(picture[2] for picture in self._pictures)
        return found >= _LEAST and known >= _STEADY * found
