"""The time of a picture; `python -m tests.benchmarks.test_render_time` prints figures."""

from __future__ import annotations

import time

import numpy as np
import pytest

from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.renderer import Renderer
from sitl_sim.sensors.scenes import still_scenes

LENS = Lens(640, 400)


def frame_times(count: int, seed: int) -> np.ndarray:
    """(count,) ms of one thread's processor time, forest with up to nine drones about the view."""
    scenes = list(still_scenes(25, seed, LENS))  # of one world
    renderer = Renderer(scenes[0].world, LENS.width, LENS.height, seed=seed)
    out = np.empty((LENS.height, LENS.width, 3), np.uint8)
    times = []
    for k in range(count + 5):
        s = scenes[k % len(scenes)]
        begun = time.thread_time()
        renderer.render(s.p, s.q, s.drones, s.attitudes, k, out)
        times.append((time.thread_time() - begun) * 1e3)
    return np.array(times[5:])  # the first ones compile, or load what was compiled


@pytest.mark.slow
def test_a_picture_takes_no_more_than_8_ms_of_one_core():
    assert np.median(frame_times(100, 31)) <= 8.0


if __name__ == "__main__":
    every = np.concatenate([frame_times(200, seed) for seed in (31, 32, 33)])
    print(f"640×400: p50 {np.median(every):.2f} ms, p99 {np.percentile(every, 99):.2f} ms")
