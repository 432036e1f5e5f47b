"""A flight in one process: the runner's world, each companion's pipeline behind its codec.

All but sockets and processes is real: the bytes of MAVLink, the lockstep, the faults of the
scenario. A flight of one drone and 15 s takes about half a second.
"""

import itertools
import tempfile
import time
from collections import deque
from operator import itemgetter
from pathlib import Path

import numpy as np

from companion.pipeline import Companion as OneCompanion
from companion.process.signing_keys import Timestamps
from companion.settings.config import CompanionConfig
from companion.tick import TickInputs
from companion.types import Phase
from mavlink_bridge.shared.settings import overlay
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.video import Answer
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.faults.catalogue import PIXELS, Schedule
from sitl_sim.figures.metrics import safety
from sitl_sim.flight.runner import Flight
from sitl_sim.flight.sensors import Sensors
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.worlds.world import surface_distance

OVERRIDES = {}  # of every companion's config: a test that takes a mechanism out
SEED = 1  # of flights that name none: a test flies rows with others


class Outcome:
    """What the rows of the matrix ask of a tick."""

    def __init__(self, tick):
        self.time, self.tracks, self.setpoint = tick.time, tick.tracks, tick.setpoint
        self.verdict, self.phase = tick.supervised.verdict, tick.supervised.phase
        self.own, self.heartbeat = tick.vehicle.state, tick.vehicle.heartbeat
        self.fault, self.alignment = tick.seen.fault, tick.seen.alignment
        self.messages = tick.packets[0]
        self.failure, self.beyond = tick.failure, tick.beyond
        self.certified = tick.supervised.certified


class Companion:
    """A pipeline in the place of a companion process: a tick for each frame, answered at once."""

    connected = True

    def __init__(self, config, endpoint, key=None):
        self.settings, self.endpoint = config, endpoint
        self.config = CompanionConfig.model_validate(config)
        self.companion = OneCompanion(self.config, time.perf_counter)
        link = self.config.link
        signing = None if key is None else Timestamps(key, 0, None).signing
        self.link = Link(endpoint, Codec(link.system_id, link.component_id, link.heard(), signing))
        self.outs, self.seconds, self.times = [], [], []
        self.clock = lambda: 0.0  # of the flight [s]; the vehicle's own may begin anew
        self.stopwatch = lambda: 0.0  # time.thread_time where ticks are to be timed: it costs
        self.before = lambda inputs: inputs  # what a test does to a tick's inputs
        self._answers = deque()

    def send(self, frame):
        started = self.stopwatch()
        due = frame.time if frame.due is None else frame.due
        inputs = self.before(TickInputs(due, self.link.receive(), frame))
        out = self.companion.tick(inputs)
        for packet in out.packets:
            self.link.send(packet)
        self.seconds.append(self.stopwatch() - started)
        self.outs.append(Outcome(out))
        self.times.append(self.clock())
        self._answers.append(Answer(due, self.link.packets_out, out.supervised.phase is Phase.DONE))
        return True

    def answer(self, timeout):
        return self._answers.popleft() if self._answers else None

    def close(self):
        pass

    # --- measures ------------------------------------------------------------------------

    def setpoints(self):
        """(time, setpoint) of all that were sent."""
        return [(o.time, o.setpoint) for o in self.outs if o.setpoint is not None]

    def ticks(self, t, until=np.inf):
        """(flight time [s], outcome) of the ticks in [t, until)."""
        return [(at, o) for at, o in zip(self.times, self.outs, strict=True) if t <= at < until]

    def streamed(self, t):
        """Flight times from t on at which a setpoint was sent."""
        return [at for at, o in self.ticks(t) if o.setpoint is not None]

    def at(self, t):
        """The first tick's outcome from t [s, vehicle's clock] on."""
        return next(o for o in self.outs if o.time >= t - 1e-9)

    def reasons(self, t, until=np.inf):
        """Guard reasons of the ticks in [t, until) s of the vehicle's clock."""
        return [
            o.verdict.reason for o in self.outs if o.verdict is not None and t <= o.time < until
        ]


class InProcess(Flight):
    """A flight with its companions in this process; `companions` by index, foreign drones last."""

    def __init__(self, scenario):
        self.companions = []
        self.modes = [[] for _ in range(scenario.drones.count)]  # (t, name) at each change
        super().__init__(scenario, Path(tempfile.gettempdir()), in_process=True)

    def _wire(self, system, camera):
        if f"drone{system}" not in self._with_companion:
            return super()._wire(system, camera)
        vehicle = MemoryEndpoint()
        config = self.companion_config(system - 1)
        overlay(config, OVERRIDES)
        self.companions.append(Companion(config, MemoryEndpoint(vehicle), self.key))
        self.companions[-1].clock = lambda: self._now / 1e3
        return self.companions[-1], vehicle, MemoryEndpoint()

    def note_modes(self, t):
        """Record changes of modes at t [s]."""
        for i, seen in enumerate(self.modes):
            if not seen or seen[-1][1] != self.mode(i):
                seen.append((t, self.mode(i)))

    # --- measures ------------------------------------------------------------------------

    def figures(self):
        """Distances, collisions, targets, from the truth."""
        return safety(self.truth.arrays(), self.world, self.names)

    def mode(self, i=0):
        return self._autopilots.mode[i].name

    def drone_time(self, t, i=0):
        """Time of drone i's clock at flight time t [s]."""
        return t + self._drones[i].boot_ms / 1e3

    def speed(self, t, i=0):
        """m/s, true, at flight time t [s]."""
        truth = self.truth.arrays()
        return float(np.linalg.norm(truth["velocity"][np.searchsorted(truth["t"], t), i]))

    def moved(self, i, since):
        """Length of drone i's way from `since` on [m]."""
        truth = self.truth.arrays()
        p = truth["position"][truth["t"] >= since, i]
        return float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())

    def most_tilt(self, since, i=0):
        """Degrees, from flight time `since` [s] on."""
        truth = self.truth.arrays()
        q = truth["attitude"][truth["t"] > since, i]
        return float(np.degrees(np.arccos(1 - 2 * (q[:, 1] ** 2 + q[:, 2] ** 2).max())))

    def check_always(self, healthy=None):
        """Assert what holds in every row: no collisions, only valid setpoints on the wire."""
        for c in self.companions:
            for _, s in c.setpoints():
                assert np.isfinite(s.omega).all()
                assert np.abs(s.omega).max() <= c.config.guard.omega_max + 1e-9
                assert 0.0 <= s.thrust <= 1.0
        truth = self.truth.arrays()
        indices = range(len(self.names)) if healthy is None else healthy
        p = truth["position"][:, list(indices)]
        up = p[..., 2] > 0.3
        clear = np.where(up, surface_distance(p.astype(float), self.world), np.inf)
        least = clear.min(initial=np.inf)
        assert least > self.scenario.drones.radius, ("obstacle", float(least))
        for i in indices:
            assert self.lowest_in_offboard(i) > 0.5, f"drone{i + 1} went down"
        for a in range(p.shape[1]):
            for b in range(a):
                gap = np.linalg.norm(p[:, a] - p[:, b], axis=1).min()
                assert gap > 2 * self.scenario.drones.radius, (a, b, gap)

    def lowest_in_offboard(self, i):
        """Least height [m] of drone i while its companion flies it.

        A PX4 that is disarmed after landing goes back to the mode last chosen: offboard, on the
        ground.
        """
        truth, changes = self.truth.arrays(), [*self.modes[i], (np.inf, "")]
        flown = np.zeros(len(truth["t"]), bool)
        for (start, name), (end, _) in itertools.pairwise(changes):
            if name == "OFFBOARD":
                flown |= (truth["t"] > start) & (truth["t"] <= end)
        return truth["position"][flown & truth["armed"][:, i].astype(bool), i, 2].min(
            initial=np.inf
        )


# Without a turn at the start, so that the times of rows are of full flight.
SET_OUT_AT_ONCE = {"gaze": {"survey": 0.0}, "mission": {"others": False}}
# Nor a slow take-off; and a vehicle whose stream ends holds, so that what rows measure stays apart.
AUTOPILOT = {"COM_SPOOLUP_TIME": 0.0, "MPC_TKO_RAMP_T": 0.0, "COM_OBL_RC_ACT": 5.0}


def scenario(faults=(), count=1, seed=None, **more):
    """A short flight: fly 12 m east among a few trunks and stay there; perfect detectors."""
    data = {
        "name": "row",
        "seed": SEED if seed is None else seed,
        "world": {"cylinders": [{"x": 7.0, "y": 0.3, "radius": 0.5}]},
        "drones": {
            "count": count,
            "heading_deg": 0.0,
            "frame_yaw_deg": 0.0,
            "parameters": AUTOPILOT,
        },
        "mission": {"targets": [[14.0, 0.0, 2.0]], "home": False, "time_limit": 20.0},
        "sensing": {"neighbours": "truth", "obstacles": "map", "width": 64, "height": 64},
        "faults": list(faults),
        "companion": SET_OUT_AT_ONCE,
    }
    for path, value in more.items():
        section, _, key = path.partition("__")
        if key:
            data[section] = {**data.get(section, {}), key: value}
        else:
            data[section] = value
    return Scenario.model_validate(data)


class NoisySensors(Sensors):
    """Sensors with a noisy picture, too: no drone is in it, but camera health can be checked."""

    def frame(self, i, stamp, p, q):
        rng = np.random.default_rng(round(stamp * 1e3))
        row = rng.integers(60, 200, (1, self._sensing.width, 3), np.uint8)
        picture = np.broadcast_to(row, (self._sensing.height, self._sensing.width, 3))
        return super().frame(i, stamp, p, q) | {"image": picture}


class WithPictures(InProcess):
    """Frames also hold a noisy picture."""

    def __init__(self, scenario):
        every = Schedule(scenario.faults, scenarios.drone_names(scenario), scenario.seed)
        others = [f for f in scenario.faults if f.kind not in PIXELS]
        super().__init__(scenario.model_copy(update={"faults": others}))
        self.sensors = NoisySensors(scenario, self.world)
        for drone in self._drones:
            drone.camera = FaultyCamera(every, drone.index)


def fly(faults=(), at=None, before=None, pictures=False, **options):
    """Fly `scenario`; at: {s: call(flight)}; before: call(inputs) → inputs of drone 0's ticks."""
    flight = (WithPictures if pictures else InProcess)(scenario(faults, **options))
    if before is not None:
        flight.companions[0].before = before
    return run(flight, at)


def run(flight, at=None):
    """Fly it to its end; at: {s: call(flight)}."""
    waiting = sorted((at or {}).items(), key=itemgetter(0))

    def progress(t):
        flight.note_modes(t)
        while waiting and t >= waiting[0][0]:
            waiting.pop(0)[1](flight)

    try:
        flight.run(progress)
    finally:
        flight.close()
    return flight
