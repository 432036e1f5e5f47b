"""A vehicle that is not ours to fly: only its MAVLink is read, to know where it is.

Where a simulator flies it, PX4 tells by HIL_STATE_QUATERNION where it truly is. Its estimate slides
by metres as its GPS does, and trunks that slid with it would contradict its gyros.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from mavlink_bridge.autopilots.registry import ADAPTERS
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import AutopilotId, CommandId, MessageId, SystemState, VehicleType
from mavlink_bridge.wire.link import Link, open_endpoint
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    Heartbeat,
    HilState,
    Message,
    Source,
    VehicleState,
)
from sitl_sim.external.external_sitl import ExternalError
from sitl_sim.external.reported_poses import ReportedPoses
from sitl_sim.external.true_motion import TrueMotion

_STREAMS = {  # Hz; attitudes are the clock of what has no stamp
    MessageId.ATTITUDE_QUATERNION: 100.0,
    MessageId.LOCAL_POSITION_NED: 50.0,
    MessageId.HIL_STATE_QUATERNION: 50.0,
}
_SECOND_COMPUTER = 192  # MAV_COMP_ID_ONBOARD_COMPUTER2: 191 is the companion's
# No ground station's: that would keep the failsafe for a lost one from acting.
_HELLO = Heartbeat(
    autopilot=AutopilotId.INVALID,
    vehicle_type=VehicleType.ONBOARD_CONTROLLER,
    armed=False,
    custom_mode=0,
    system_status=SystemState.ACTIVE,
)
_ASK = 1.0  # s between requests
_HEARD, _LOCATED = 10.0, 60.0  # s to wait for a heartbeat, and for a pose that stands still
_STILL, _STILL_FOR = 0.3, 1.0  # m and m/s within which a vehicle stands, for so many s


class WatchedVehicle:
    """One vehicle on a link of its own, which no companion shares.

    believed: where it believes to have been, in its own frame. poses: where it was, from an origin
    of their own: the truth where a simulator tells it, else what is believed. armed: as its
    HEARTBEAT says. heard_at: CLOCK_MONOTONIC [s] at which the newest pose came.

    Raises:
        EndpointError: `url` is none of the forms of an endpoint, or cannot be opened.
    """

    def __init__(self, url: str, system: int) -> None:
        """Open the link; system: the vehicle's MAVLink id."""
        self.url, self.system = url, system
        self.believed = ReportedPoses()
        self.poses = self.believed
        self._truth = TrueMotion()
        self.armed = False
        self.heard_at = -math.inf
        self._link = Link(open_endpoint(url), Codec(system, _SECOND_COMPUTER), Source(system, 1))
        self._autopilot: int | None = None
        self._others: set[int] = set()
        self._asked_at = -math.inf
        self._placed = False  # it has told where it stands: its streams run

    def listen(self, timeout: float) -> None:
        """Read what arrives within `timeout` [s]; ask for telemetry where none comes."""
        self._link.wait(timeout)
        received = self._link.receive()
        now = time.monotonic()
        mine = [r.message for r in received if r.source == Source(self.system, 1)]
        self._others |= {r.source.system for r in received} - {self.system}
        for m in mine:
            if isinstance(m, Heartbeat):
                self.armed, self._autopilot = m.armed, m.autopilot
        before = self.poses.known_until
        self._hear_poses(mine)
        if self.poses.known_until != before:
            self.heard_at = now
        waits = not self._placed or not self.poses.flowing or now - self.heard_at > _ASK
        if waits and now - self._asked_at > _ASK:
            self._asked_at = now
            self._link.send(self._requests())

    @property
    def knows_truth(self) -> bool:
        """Whether a simulator tells where the vehicle truly is."""
        return self.poses is not self.believed

    def _hear_poses(self, messages: Sequence[Message]) -> None:
        """Sort what tells of the estimate, and what of the truth, message by message."""
        for m in messages:
            self.believed.hear([m])
            if isinstance(m, HilState) and (self.knows_truth or not self._placed):
                place = self._truth.hear(m, self.believed.newest)
                if place is not None:
                    if not self.knows_truth:
                        self.poses = ReportedPoses()
                    self.poses.hear([place])
            elif self.knows_truth and isinstance(m, Attitude):
                self.poses.hear([m])

    def _requests(self) -> list[Message]:
        """Return a sign of life, for which some vehicles wait, and requests for the streams."""
        rest = (0.0, 0.0, 0.0, 0.0, 0.0)
        return [
            _HELLO,
            *(
                Command(
                    int(CommandId.SET_MESSAGE_INTERVAL), (float(m), 1e6 / rate, *rest), self.system
                )
                for m, rate in _STREAMS.items()
            ),
        ]

    def await_stand(self, stopped: Callable[[], bool]) -> VehicleState:
        """Wait until the vehicle knows its pose and stands still; return the believed pose.

        stopped: whether to give up.

        Raises:
            ExternalError: the vehicle is not heard, or not what is needed; the message says what.
            KeyboardInterrupt: `stopped`.
        """
        began = time.monotonic()
        first: VehicleState | None = None
        still_since = math.inf
        while True:
            if stopped():
                raise KeyboardInterrupt
            self.listen(0.05)
            now = self.believed.at(self.believed.known_until)
            if now is not None and self._autopilot is not None:
                if first is None or _moved(first, now) or not self.poses.flowing:
                    first, still_since = now, now.time
                elif now.time - still_since > _STILL_FOR:
                    self._placed = True
                    return now
            self._raise_if_hopeless(time.monotonic() - began)

    def _raise_if_hopeless(self, waited: float) -> None:
        vehicle = f"--vehicle {self.url}: vehicle {self.system}"
        if self._autopilot is None:
            if waited > _HEARD:
                others = ", ".join(str(s) for s in sorted(self._others))
                why = f"heard {others}: --system {others}" if others else self._link.problem
                raise ExternalError(f"{vehicle} sends no heartbeat; {why or 'nothing is heard'}")
        elif waited > _LOCATED:
            lacking = " and no ".join(self.believed.lacking)
            what = f"tells no {lacking}" if lacking else "tells its pose too seldom"
            if self.poses.flowing:
                what = "does not stand still"
            raise ExternalError(f"{vehicle} {what} after {waited:.0f} s")

    @property
    def autopilot(self) -> str:
        """The name of its autopilot, as in `link.autopilot` of a companion's configuration.

        Raises:
            ExternalError: no companion can fly it.
        """
        for name, kind in ADAPTERS.items():
            if kind.autopilot == self._autopilot:
                return name
        raise ExternalError(
            f"--vehicle {self.url}: vehicle {self.system} is an unknown autopilot "
            f"(MAV_AUTOPILOT {self._autopilot}); valid: {', '.join(ADAPTERS)}"
        )

    def close(self) -> None:
        """Close the link."""
        self._link.close()


def _moved(before: VehicleState, now: VehicleState) -> bool:
    """Return whether the vehicle moves, or its estimate does: it has just found its place."""
    away = float(np.linalg.norm(now.p - before.p))
    return max(away, float(np.linalg.norm(now.v))) > _STILL
