"""Made-up ticks for tests of what is written and read."""

import numpy as np

from companion.guidance.mission import MissionProgress
from companion.perception.frontend import Detections
from companion.pipeline import TickInputs, TickOutputs
from companion.settings.config import CompanionConfig
from companion.supervision.guard import Reason, Verdict
from companion.types import Detection, Obstacles, Phase, Plan, PlanStatus, Track, Trunk
from mavlink_bridge.wire.messages import RateCommand, VehicleState
from mavlink_bridge.wire.video import Frame


def config(path=None, **log):
    data = {"name": "tester", "log": {"path": path and str(path), **log}}
    return CompanionConfig.model_validate(data)


def tick(n, phase=Phase.FLY, image=None):
    """The n-th tick of a made-up flight: a pair of inputs and outputs."""
    rng = np.random.default_rng(n)
    time = round(0.1 * n, 6)
    own = VehicleState(time, rng.normal(size=3), rng.normal(size=3), np.array([1.0, 0, 0, 0]),
                       rng.normal(size=3))  # fmt: skip
    tracks = [Track(i, rng.normal(size=3), rng.normal(size=3), np.eye(6) * 0.01, 1.0, 0.1)
              for i in range(6)]  # fmt: skip
    sighting = Detections(
        time, own,
        [Detection(rng.normal(size=3), rng.uniform(1, 9), 0.01, 0.1, 0.9) for _ in range(4)],
        [Trunk(rng.normal(size=3), rng.uniform(1, 9), 1.0, 0.1) for _ in range(5)],
    )  # fmt: skip
    result = Plan(rng.normal(size=(21, 10)), rng.normal(size=(20, 4)), PlanStatus.SOLVED, True, 3,
                    0.01, 0.1, 0.0, 0.0, 0.0, ("agent",), 1.0)  # fmt: skip
    out = TickOutputs(
        time, phase=phase, own=own, sighting=sighting, tracks=tracks,
        critical=[(t, 0.5) for t in tracks[:3]],
        obstacles=Obstacles(rng.normal(size=(5, 3)), np.zeros((0, 4)), np.zeros((0, 3))),
        progress=MissionProgress(np.array([1.0, 2.0, 3.0]), 0, False), result=result,
        verdict=Verdict(RateCommand(rng.normal(size=3), 9.8), Reason.PLAN, 0),
        stages={"see": 0.004, "plan": 0.01},
    )  # fmt: skip
    return TickInputs(time, [], Frame(time, {} if image is None else {"image": image})), out
