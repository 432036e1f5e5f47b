"""Contradictions between sections: values that are valid alone, and not together."""

from __future__ import annotations

from collections.abc import Iterator

from companion.settings.sections import CompanionSections
from mavlink_bridge.shared.settings import Contradiction

_SIM_ONLY = {"neighbours": ("truth",), "obstacles": ("map", "depth")}
_REACHED = 0.5  # share of a goal's tolerance that the distance to the fence may take


def contradictions(config: CompanionSections) -> Iterator[Contradiction]:
    """Return every contradiction between the sections of a drone's configuration."""
    yield from _sources(config)
    yield from _fence(config)
    yield from _goals(config)
    yield from _distances(config)
    yield from _ticks(config)
    yield from _input_bounds(config)
    if config.mission.commission and config.log.path is None:
        yield Contradiction(
            ("mission.commission", "log.path"),
            "commission: a flight without log.path tells nothing: `companion run --commission "
            "FLIGHT.mcap` sets both",
        )


def _sources(config: CompanionSections) -> Iterator[Contradiction]:
    """Check what the source of frames can give."""
    simulated = config.camera.source.startswith("sim:")
    if config.timing.pace == "frames" and not simulated:
        yield Contradiction(
            ("timing.pace", "camera.source"), "pace: frames needs the simulator as source"
        )
    for key, choices in _SIM_ONLY.items():
        chosen = getattr(config.sensing, key)
        if chosen in choices and not simulated:
            text = f"{key}: {chosen} needs the simulator as source; a camera has {key}: camera"
            yield Contradiction((f"sensing.{key}", "camera.source"), text)
    if config.camera.latency >= config.camera_health.late:
        yield Contradiction(
            ("camera.latency", "camera_health.late"),
            f"every frame is late: camera.latency, {config.camera.latency:g}, must be below "
            f"camera_health.late, {config.camera_health.late:g}",
        )
    between, life = 2 * config.sensing.trunks_every, config.obstacles.doubtful_unseen
    if between * config.timing.period >= life:
        yield Contradiction(
            ("sensing.trunks_every", "obstacles.doubtful_unseen"),
            f"trunks would be forgotten between two searches: sensing.trunks_every, "
            f"{config.sensing.trunks_every}, is too many frames for obstacles.doubtful_unseen, "
            f"{life:g}",
        )
    if config.sensing.detector == "yolo" and config.sensing.model is None:
        yield Contradiction(
            ("sensing.detector", "sensing.model"),
            "detector: yolo needs sensing.model: FILE.onnx",
        )


def _fence(config: CompanionSections) -> Iterator[Contradiction]:
    """Check that the fence leaves room between its planes, each kept at a distance."""
    fence, apart = config.fence, config.nmpc.d_obstacle_safety
    needed = f"twice nmpc.d_obstacle_safety, {apart:g}"
    low, high = "fence.altitude_min", "fence.altitude_max"
    if fence.altitude_max <= fence.altitude_min:
        yield Contradiction((high, low), "altitude_max must be above altitude_min")
    elif fence.altitude_max - fence.altitude_min < 2.0 * apart:
        yield Contradiction(
            (high, low, "nmpc.d_obstacle_safety"),
            f"altitude_max must be above altitude_min by {needed}",
        )
    if not fence.altitude_min < config.mission.takeoff_altitude < fence.altitude_max:
        yield Contradiction(
            ("mission.takeoff_altitude", low, high), "takeoff_altitude must lie inside the fence"
        )
    if fence.altitude_band < apart:
        yield Contradiction(
            ("fence.altitude_band", "nmpc.d_obstacle_safety"),
            f"altitude_band, {fence.altitude_band:g}, must be at least nmpc.d_obstacle_safety, "
            f"{apart:g}, which is kept to its top and bottom as well",
        )
    for key, limits in (("fence.east", fence.east), ("fence.north", fence.north)):
        if limits is not None and limits[1] - limits[0] < 2.0 * apart:
            yield Contradiction(
                (key, "nmpc.d_obstacle_safety"), f"must be wider than {needed}, got {limits}"
            )


def _goals(config: CompanionSections) -> Iterator[Contradiction]:
    """Check that each goal is within reach, given the fence and the distance kept to it."""
    fence, mission, apart = config.fence, config.mission, config.nmpc.d_obstacle_safety
    low, high = "fence.altitude_min", "fence.altitude_max"
    for n, given in enumerate(mission.goals):
        key, goal = f"mission.goals.{n}", given.place
        if goal is None:  # its place is known, and checked, once the vehicle tells its home
            continue
        for what, height in ("goal", goal[2]), ("way to it", goal[2] + mission.level):
            if not fence.goal_min <= height <= fence.altitude_max:
                yield Contradiction(
                    (key, "mission.level", low, "fence.ground_min", high),
                    f"the {what}, {height:g} m high, must lie inside the fence",
                )
        last = n == len(mission.goals) - 1
        tolerance = mission.final_tolerance if last else mission.tolerance
        inside = apart - _REACHED * tolerance
        sides = {
            "fence.east": (goal[0], fence.east),
            "fence.north": (goal[1], fence.north),
            low: (goal[2], [fence.goal_min, fence.altitude_max]),
        }
        for side, (place, limits) in sides.items():
            if limits is None:
                continue
            if not limits[0] <= place <= limits[1]:
                yield Contradiction((key, side), f"must lie inside {side}, {limits}, got {goal}")
            elif min(place - limits[0], limits[1] - place) < inside - 1e-9:
                yield Contradiction(
                    (key, side, "nmpc.d_obstacle_safety"),
                    f"must lie {inside:g} m inside the fence, {limits}, or it is never reached: "
                    f"nmpc.d_obstacle_safety, {apart:g}, is kept to the fence; got {goal}",
                )


def _distances(config: CompanionSections) -> Iterator[Contradiction]:
    """Check that the distances, which count from the centre, exceed the drone's body."""
    radius, nmpc = config.airframe.radius, config.nmpc
    if not nmpc.d_obstacle_safety > radius:
        yield Contradiction(
            ("nmpc.d_obstacle_safety", "airframe.radius"),
            f"nmpc.d_obstacle_safety, {nmpc.d_obstacle_safety:g}, from the drone's centre, "
            f"must be above airframe.radius, {radius:g}",
        )
    if not nmpc.d_agent_safety > 2.0 * radius:
        yield Contradiction(
            ("nmpc.d_agent_safety", "airframe.radius"),
            f"nmpc.d_agent_safety, {nmpc.d_agent_safety:g}, from centre to centre, must be "
            f"above twice airframe.radius, {radius:g}",
        )


def _ticks(config: CompanionSections) -> Iterator[Contradiction]:
    """Check that the plan's step and the guard's lateness fit the tick."""
    period = config.timing.period
    if config.nmpc.dt != period:
        yield Contradiction(
            ("nmpc.dt", "timing.period"),
            f"nmpc.dt, {config.nmpc.dt:g}, must be timing.period, {period:g}: a plan is shifted by "
            "one step a tick",
        )
    if not config.guard.late > period:
        yield Contradiction(
            ("guard.late", "timing.period"),
            f"guard.late, {config.guard.late:g}, must be above timing.period, {period:g}, or "
            "every command is late",
        )


def _input_bounds(config: CompanionSections) -> Iterator[Contradiction]:
    """Check that every plan lies within the bounds of the guard.

    A guard with tighter bounds would clip plans that keep their own, and the drone would not fly
    what was planned. Wider bounds are fine: they hold for braking, too.
    """
    nmpc, guard = config.nmpc, config.guard
    for key, fits, relation in (
        ("c_min", guard.c_min <= nmpc.c_min, "at most"),
        ("c_max", guard.c_max >= nmpc.c_max, "at least"),
        ("omega_max", guard.omega_max >= nmpc.omega_max, "at least"),
    ):
        if not fits:
            ours, theirs = getattr(guard, key), getattr(nmpc, key)
            yield Contradiction(
                (f"guard.{key}", f"nmpc.{key}"),
                f"guard.{key}, {ours:g}, must be {relation} nmpc.{key}, {theirs:g}, or the guard "
                "clips plans",
            )
