import tracemalloc
from types import SimpleNamespace

import numpy as np

from sitl_sim.recording.truth import RATE_HZ, Truth

N = 3


def bodies(k):
    rng = np.random.default_rng(k)
    return SimpleNamespace(
        p=rng.normal(size=(N, 3)), v=rng.normal(size=(N, 3)), q=rng.normal(size=(N, 4))
    )


def recorded(count, last_seconds=None, estimate=False):
    truth = Truth([f"d{i}" for i in range(N)], last_seconds)
    for k in range(count):
        armed = np.array([k % 2 == 0, True, False])
        truth.record(k / RATE_HZ, bodies(k), armed, np.full((N, 3), k) if estimate else None)
    return truth


def test_every_sample_is_kept_as_it_was():
    arrays = recorded(5000, estimate=True).arrays()
    assert arrays["t"].tolist() == [k / RATE_HZ for k in range(5000)]
    for k in (0, 1023, 1024, 4999):
        assert (arrays["position"][k] == bodies(k).p).all()
        assert (arrays["velocity"][k] == bodies(k).v).all()
        assert (arrays["attitude"][k] == bodies(k).q).all()
        assert arrays["armed"][k].tolist() == [k % 2 == 0, True, False]
        assert (arrays["estimate"][k] == k).all()
    assert "estimate" not in recorded(3).arrays()


def test_of_a_world_that_is_served_the_last_seconds_are_kept():
    for count, oldest in ((30, 0), (50, 0), (51, 1), (149, 99)):
        arrays = recorded(count, last_seconds=1.0).arrays()
        assert arrays["t"].tolist() == [k / RATE_HZ for k in range(oldest, count)]
        assert (arrays["position"][0] == bodies(oldest).p).all()


def test_a_served_world_takes_its_memory_once():
    truth, body, armed = recorded(10, last_seconds=60.0), bodies(1), np.ones(N, bool)
    tracemalloc.start()
    for k in range(10 * 60 * RATE_HZ):
        truth.record(k / RATE_HZ, body, armed)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 2000  # bytes in ten minutes
