"""A made-up run folder: drones that fly side by side, and logs that know all or make mistakes."""

import json

import numpy as np
import yaml
from mcap.writer import Writer

from sitl_sim.recording.run_folder import own_frames
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.sensors.perfect_detector import camera_rays

DRONES = 3
SECONDS = 12.0
WORLD = {
    "drone_radius": 0.2,
    "boxes": [],
    "target_tolerance": 1.0,
    "cylinders": [{"x": 6.0, "y": 4.0, "radius": 0.5, "height": 8.0}],
}
NAMES = [f"drone{i + 1}" for i in range(DRONES)]


def scenario():
    return scenarios.Scenario.model_validate(
        {
            "name": "made up",
            "drones": {
                "count": DRONES,
                "frame_yaw_deg": "random",
                "starts": [[0, 0], [1.5, 1.2], [1.5, -1.2]],
            },
            "sensing": {"width": 640, "height": 400},
        }
    )


def truth(gap=1.2):
    """Drones in a wedge fly east at 1 m/s, 2 m up; the two behind `gap` m to each side."""
    t = np.arange(0.0, SECONDS, 0.02)
    start = np.array([[0.0, 0.0, 0.0], [1.5, gap, 0.0], [1.5, -gap, 0.0]])
    p = np.zeros((len(t), DRONES, 3))
    p[..., 2] = np.minimum(t, 2.0)[:, None]
    p[..., 0] = np.maximum(t - 2.0, 0.0)[:, None]
    p += start
    v = np.gradient(p, 0.02, axis=0)
    v[99:102] = (p[100:103] - p[98:101]) / 0.04
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), DRONES, 1))
    armed = np.ones((len(t), DRONES), bool)
    return {
        "t": t,
        "position": p,
        "velocity": v,
        "attitude": q,
        "armed": armed,
        "names": np.array(NAMES),
    }


def log(i, world, miss=0.0, ghost=0.0, turn=0.0, stretch=1.0, slow=0.0):
    """Ticks of drone i. miss, ghost: share of frames with one detection less or more.

    turn: rad that detections are off. stretch: of ranges. slow: m/s that tracks are off.
    """
    rng = np.random.default_rng(i)
    frame, s = own_frames(scenario(), WORLD)[i], scenario()
    half = np.radians(s.sensing.fov_deg) / 2
    own = lambda d: np.asarray(d) @ frame.vectors(np.eye(3)).T  # noqa: E731
    ticks = []
    for n, time in enumerate(np.arange(0.1, SECONDS - 0.3, 0.1)):
        k = round(time / 0.02)
        time = float(world["t"][k])
        p, v = world["position"][k], world["velocity"][k]
        others = [j for j in range(DRONES) if j != i]
        offsets = p[others] - p[i]
        rays = camera_rays(world["attitude"][k, i], offsets)
        distance = np.linalg.norm(offsets, axis=1)
        rows = [
            [r[0] + turn, r[1], r[2], d * stretch, 1.0]
            for r, d in zip(rays, distance, strict=True)
            if np.arccos(r[2]) < half and rng.random() >= miss
        ]
        if rng.random() < ghost:
            rows.append([0.0, -0.5, 0.866, 3.0, 1.0])
        tracks = [
            {
                "id": j,
                "p": own(p[j] - frame.origin).tolist(),
                "unseen": 0.0,
                "sigma": 0.1,
                "v": (own(v[j]) + np.array([slow, 0, 0])).tolist(),
            }
            for j in others
        ]
        place = own(p[i] - frame.origin)
        plan = [(place + own([0.1 * a, 0, 0])).tolist() for a in range(21)]
        stamp = time + frame.boot
        ticks.append(
            {
                "time": stamp,
                "frame": stamp,
                "phase": "fly" if time > 2 else "takeoff",
                "own": {"p": place.tolist(), "q": [1, 0, 0, 0]},
                "goal": {"p": [9, 0, 2], "index": 0},
                "detections": rows,
                "trunks": [],
                "tracks": tracks,
                "cylinders": [],
                "critical": [[others[0], 0.8]],
                "plan": plan,
                "solver": {"solve_ms": 2.0 + n % 5, "usable": True},
                "command": {"reason": "plan" if n % 40 else "brake"},
                "stages_ms": {"tick": 6.0},
                "counters": {"deadline_misses": 0},
            }
        )
    return ticks


def write_run(folder, gap=1.2, **mistakes):
    """A run folder of such a flight."""
    world = truth(gap)
    folder.mkdir(exist_ok=True)
    text = yaml.safe_dump(scenario().model_dump())
    (folder / "scenario.yaml").write_text(text)
    targets = {n: [[9.0, y, 2.0]] for n, y in zip(NAMES, (0.0, gap, -gap), strict=True)}
    (folder / "world.json").write_text(json.dumps(WORLD | {"targets": targets}))
    np.savez_compressed(folder / "truth.npz", **world)
    for i, name in enumerate(NAMES):
        place = folder / "drones" / name
        place.mkdir(parents=True, exist_ok=True)
        with (place / "flight.mcap").open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/tick", "json", 0)
            for tick in log(i, world, **mistakes):
                stamp = round(tick["time"] * 1e9)
                writer.add_message(channel, stamp, json.dumps(tick).encode(), stamp)
            writer.finish()
    return folder
