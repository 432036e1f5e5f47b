"""One emulated autopilot: its commander, parameters, frame, clock and links."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice

from mavlink_bridge.wire.ids import MessageId, VehicleType
from mavlink_bridge.wire.messages import (
    Heartbeat,
    Message,
    MissionCurrent,
    MissionItemReached,
    StatusText,
)
from sitl_sim.vehicles.battery import Batteries
from sitl_sim.vehicles.estimator import Estimate
from sitl_sim.vehicles.firmware.commander import Commander
from sitl_sim.vehicles.firmware.flavour import Flavour
from sitl_sim.vehicles.firmware.guidance import Guidance
from sitl_sim.vehicles.firmware.late_samples import LateSamples, Sample
from sitl_sim.vehicles.firmware.missions import Missions
from sitl_sim.vehicles.firmware.parameters import Parameters
from sitl_sim.vehicles.firmware.schedule import Schedule
from sitl_sim.vehicles.firmware.sticks import Sticks
from sitl_sim.vehicles.outer_loops import Setpoints
from sitl_sim.vehicles.rangefinder import Rangefinder
from sitl_sim.vehicles.rates import RateLoop
from sitl_sim.vehicles.rigid_body import Body, State
from sitl_sim.vehicles.state_errors import StateErrors
from sitl_sim.worlds.geodesy import LocalFrame

LINKS = ("companion", "gcs")
LISTENS_US = 2_500_000  # after a listener's last message; PX4's HEARTBEAT_TIMEOUT_US


@dataclass(frozen=True)
class Shared:
    """Arrays of all vehicles, a row each."""

    state: State
    body: Body
    loop: RateLoop
    setpoints: Setpoints
    estimate: Estimate
    batteries: Batteries
    errors: StateErrors
    late: LateSamples
    rangefinder: Rangefinder

    def feet(self, i: int) -> float:
        """Return the true height [m] of vehicle i's feet over the ground."""
        x, y, z = (float(k) for k in self.state.p[i])
        base, east, north = (float(k) for k in self.body.ground[i])
        return z - (base + east * x + north * y)


Builder = Callable[["Unit"], Message | None]  # makes one telemetry message


class Unit:
    """The autopilot of vehicle i with system id `system`; now_us: the world's clock [µs]."""

    def __init__(
        self,
        i: int,
        system: int,
        flavour: Flavour,
        frame: LocalFrame,
        boot_offset: float,
        shared: Shared,
        overrides: Mapping[str, float],
        builders: Mapping[int, Builder],
        more_streams: Mapping[str, Mapping[int, float]],
    ) -> None:
        self.i, self.system, self.flavour, self.frame = i, system, flavour, frame
        self.parameters = Parameters(flavour, overrides)
        settings = self.parameters.settings()
        self.guidance = Guidance(
            i,
            settings,
            shared.setpoints,
            shared.estimate,
            feet=lambda: shared.feet(i),
            ranges=shared.rangefinder.fitted[i],
            origin_z=float(frame.origin[2]),
        )
        self.commander = Commander(flavour, settings, self.guidance, shared.state)
        if flavour.sticks:
            self.commander.sticks = Sticks(self.parameters["rate_max"])
        self.missions = Missions(
            frame, self.guidance, flavour.first_item_is_home, not flavour.strict_parameters
        )
        self._shared = shared
        self.errors, self.grade = shared.errors, shared.errors.grades[i]
        self._boot_us = round(boot_offset * 1e6)
        self.now_us = 0
        self.pings = 0  # sent
        self.asked_mode = flavour.modes[flavour.initial]
        self.components: dict[str, set[int]] = {name: set() for name in LINKS}  # heard on each
        self._builders = builders
        self.schedules = {
            name: Schedule({**flavour.streams[name], **more_streams.get(name, {})})
            for name in LINKS
        }
        self._outbox: dict[str, deque[Message]] = {name: deque() for name in LINKS}
        self._listened_us = dict.fromkeys(LINKS, -LISTENS_US - 1)
        self._texts_sent = 0
        self.configure()

    @property
    def boot_us(self) -> int:
        """Microseconds since this autopilot started."""
        return self.now_us + self._boot_us

    @property
    def boot_ns(self) -> int:
        """Nanoseconds since this autopilot started, for TIMESYNC."""
        return self.boot_us * 1000

    @property
    def time_boot(self) -> float:
        """Seconds since this autopilot started."""
        return self.boot_us * 1e-6

    def sample(self) -> Sample:
        """Return what telemetry tells now: the estimate, or an older one where telemetry lags."""
        return self._shared.late.sample(self.i, self.now_us, self.boot_us)

    def measured_range(self, s: Sample) -> float:
        """Return what the rangefinder measures [m] at a sample."""
        return self._shared.rangefinder.measure(self.i, s.true_p, s.true_q)

    @property
    def rangefinder(self) -> bool:
        """Whether the airframe has a rangefinder."""
        return self._shared.rangefinder.fitted[self.i]

    @property
    def custom_mode(self) -> int:
        """The mode as HEARTBEAT sends it."""
        mode, asked = self.commander.mode, self.asked_mode
        # An alias (manual, which flies as stabilized) keeps its own number.
        return asked if self.flavour.mode_of(asked) is mode else self.flavour.modes[mode]

    def battery(self) -> tuple[float, float, float]:
        """Return voltage [V], current [A] and remaining charge 0…1."""
        b, i = self._shared.batteries, self.i
        return float(b.voltage[i]), float(b.current[i]), float(b.remaining[i])

    def configure(self) -> None:
        """Let changed parameters take effect."""
        settings = self.parameters.settings()
        self.commander.configure(settings)
        self._shared.setpoints.hover[self.i] = settings.hover
        self._shared.loop.curve[self.i] = settings.thrust_curve

    def compensate_battery(self, motor_gain: float) -> None:
        """Let the mixer make up for a low battery, where the parameters say so."""
        compensated = self.commander.settings.battery_compensated
        self._shared.loop.boost[self.i] = 1.0 / motor_gain if compensated else 1.0
        self.commander.remaining = float(self._shared.batteries.remaining[self.i])

    def telemetry(self, link: str, quiet: bool = False) -> list[Message]:
        """Return the messages due now on this link; quiet: HEARTBEAT alone."""
        self.commander.time_boot = self.time_boot
        self._collect()
        messages: list[Message] = []
        due = self.schedules[link].due(self.boot_us)
        if quiet:
            self._outbox[link].clear()
            due = [message_id for message_id in due if message_id == MessageId.HEARTBEAT]
        for message_id in due:
            message = self._builders[message_id](self)
            if message is not None:
                messages.append(message)
        messages += self.missions.repeated(link, self.boot_us)
        outbox = self._outbox[link]
        if outbox:
            messages.extend(outbox)
            outbox.clear()
        return messages

    def _collect(self) -> None:
        """Queue new texts and reached mission items, once for every link."""
        c, reached = self.commander, self.guidance.reached
        if self._texts_sent == c.said_total and not reached:
            return
        old = max(len(c.said) - (c.said_total - self._texts_sent), 0)
        events: list[Message] = [*islice(c.said, old, None)]
        if reached:
            events += [MissionItemReached(seq) for seq in reached]
            events.append(MissionCurrent(self.guidance.mission_seq))
            reached.clear()
        self._texts_sent = c.said_total
        for link, outbox in self._outbox.items():
            heard = self._hears_words(link)
            outbox.extend(m for m in events if heard or not isinstance(m, StatusText))

    def hear(self, m: Message, link: str) -> None:
        """Note who listens on a link: where words go."""
        ground = isinstance(m, Heartbeat) and m.vehicle_type == VehicleType.GCS
        if ground or not self.flavour.texts_need_ground:
            self._listened_us[link] = self.now_us

    def _hears_words(self, link: str) -> bool:
        return self.now_us - self._listened_us[link] <= LISTENS_US
