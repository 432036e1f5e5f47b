"""Neighbours: the tracks of other drones, updated by each frame and carried to now."""

from __future__ import annotations

from companion.estimation.clear_share import ClearShare
from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.scenery import Scenery
from companion.estimation.steadiness import Steadiness
from companion.estimation.surprises import Surprises
from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.perception.frontend import Detections
from companion.perception.view import View
from companion.types import Track
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import VehicleState


class NeighbourEstimator:
    """Tracks neighbours in the drone's own ENU frame."""

    def __init__(self, view: View, config: TrackerConfig) -> None:
        self._view = view
        self._config = config
        self._surprises = Surprises(view)
        self._scenery = Scenery()
        self._steadiness = Steadiness()
        self._clear_share = ClearShare(config.clear)
        self.reset()

    def reset(self) -> None:
        """Forget all neighbours: the vehicle's frame has begun anew."""
        self._tracker = Tracker(self._config)
        self._surprises.reset()
        self._scenery.reset()
        self._steadiness.reset()
        self._clear_share.reset()

    def turn(self, p: Vector, angle: float) -> None:
        """Turn all tracks left about p (3,) m by a small `angle` [rad]."""
        self._tracker.turn(p, angle)
        self._scenery.turn(angle)

    def update(
        self,
        time: float,
        seen: Detections,
        obstacles: KnownObstacles,
        *,
        on_mission: bool = True,
    ) -> list[Track]:
        """Return the confirmed tracks at the tick of `time` [s], oldest first.

        on_mission: whether the drone flies its mission. Before it, others climb as it does, so
        that neither surprises nor scenery count.
        """
        if seen.own is not None:
            self._tracker.predict(seen.time)
            in_view = in_plain_view(self._view, seen.own, self._tracker, obstacles)
            mount, drones = self._view.mount, seen.drones
            if on_mission:
                drones = self._scenery.without(drones, seen.time, seen.own, mount)
            self._tracker.update(seen.time, drones, seen.own, mount, in_view, seen.partly)
            if not seen.partly:  # all three tell of what a search finds
                self._clear_share.update(seen.time, seen.drones)
                self._steadiness.update(seen.time, len(drones), self._tracker.known)
                tracks = self._tracker.tracks()
                self._surprises.update(seen.time, seen.own, tracks, obstacles, counting=on_mission)
        self._tracker.predict(time)
        return self._tracker.tracks()

    def lately(self) -> list[Track]:
        """Return the tracks whose place is no guess, unconfirmed ones, too."""
        return self._tracker.lately()

    @property
    def steady(self) -> bool:
        """Return whether the eyes have shown neighbours, the same ones, in the last 5 s."""
        return self._steadiness.enough

    @property
    def clear_share(self) -> float:
        """Return what share 0…1 of the last finds was clear, see `clear_share.py`."""
        return self._clear_share.value

    def surprises(self, time: float) -> int:
        """Return how many neighbours came up close by, in plain view, in the last 20 s."""
        return self._surprises.lately(time)


def in_plain_view(
    view: View, own: VehicleState, tracker: Tracker, obstacles: KnownObstacles
) -> list[bool]:
    """Return whether each of the tracker's `positions` must show in a picture taken from `own`.

    One whose place is in doubt by as much as it is inside the picture need not: it may have left
    the view, and its track would end although nothing is known of it.
    """
    places = tracker.positions()
    shown = view.shows(own, places, doubts=tracker.sigmas())
    return [v and not h for v, h in zip(shown, obstacles.hidden(own.p, places), strict=True)]
