"""Made-up ticks for tests of what is written and read."""

import numpy as np

from companion.control.planning import Planned
from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.vehicle import VehicleEstimate
from companion.guidance.guidance import Reference
from companion.guidance.mission import MissionProgress
from companion.perception.frontend import Detections
from companion.settings.config import CompanionConfig
from companion.supervision.guard import Reason, Verdict
from companion.supervision.supervision import Supervised
from companion.tick import Tick, TickInputs
from companion.types import Detection, Obstacles, Phase, Plan, PlanStatus, Track, Trunk
from mavlink_bridge.wire.messages import RateCommand, VehicleState
from mavlink_bridge.wire.video import Frame

COSTS = {"tick": 0.02, "log": 0.001}  # s, beside the stages


def config(path=None, **log):
    """The configuration of a drone whose log is `path`."""
    data = {"name": "tester", "log": {"path": path and str(path), **log}}
    return CompanionConfig.model_validate(data)


def tick(n, phase=Phase.FLY, image=None):
    """The n-th tick of a made-up flight: its inputs and its results."""
    rng = np.random.default_rng(n)
    time = round(0.1 * n, 6)
    level = np.array([1.0, 0, 0, 0])
    own = VehicleState(time, rng.normal(size=3), rng.normal(size=3), level, rng.normal(size=3))
    tracks = [
        Track(i, rng.normal(size=3), rng.normal(size=3), np.eye(6) * 0.01, 1.0, 0.1)
        for i in range(6)
    ]
    results = Tick(
        time,
        vehicle=VehicleEstimate(state=own),
        seen=detections(rng, time, own),
        obstacles=KnownObstacles(rng.normal(size=(5, 3)), np.zeros((0, 3))),
        tracks=tracks,
        reference=reference(tracks),
        planned=Planned(plan=plan(rng)),
        supervised=Supervised(
            phase, verdict=Verdict(RateCommand(rng.normal(size=3), 9.8), Reason.PLAN, 0)
        ),
        stages={"see": 0.004, "plan": 0.01},
    )
    return TickInputs(time, [], Frame(time, {} if image is None else {"image": image})), results


def detections(rng, time, own):
    """Four drones and five trunks somewhere in view."""
    drones = [Detection(rng.normal(size=3), rng.uniform(1, 9), 0.01, 0.1, 0.9) for _ in range(4)]
    trunks = [Trunk(rng.normal(size=3), rng.uniform(1, 9), 1.0, 0.1) for _ in range(5)]
    return Detections(time, own, drones, trunks, stamp=time)


def reference(tracks):
    """A detour on the way to a goal, slowed down for a neighbour."""
    return Reference(
        progress=MissionProgress(np.array([1.0, 2.0, 3.0]), 0, False),
        aim=np.array([1.0, 3.0, 3.0]),
        target=np.array([1.5, 3.0, 3.0]),
        route=("detour", "right of way"),
        yaw=0.3,
        speed=1.2,
        speed_limit="headway",
        v_max=1.8,
        near=[(t, 0.5) for t in tracks],
        critical=[(t, 0.5) for t in tracks[:3]],
        cohesive=frozenset({0, 1}),
        obstacles=Obstacles(np.zeros((0, 3)), np.zeros((0, 4)), np.zeros((0, 3)), np.zeros(0)),
        land=False,
    )


def plan(rng):
    """A plan of 20 steps that touches nothing."""
    return Plan(
        x=rng.normal(size=(21, 10)),
        u=rng.normal(size=(20, 4)),
        status=PlanStatus.SOLVED,
        usable=True,
        iterations=3,
        solve_time=0.01,
        step_norm=0.1,
        slack_agent=0.0,
        slack_obstacle=0.0,
        slack_plane=0.0,
        active=("agent",),
        cost=1.0,
    )
