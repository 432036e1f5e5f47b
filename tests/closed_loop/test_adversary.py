"""The certificate alone keeps a drone clear that looks at nothing; see adversary.py."""

import numpy as np
import pytest

from companion.supervision import certify
from companion.supervision.certificate import CAUSES, Findings
from tests.closed_loop import adversary

pytestmark = pytest.mark.timeout(3600)  # about 15 s of processor time, on a busy machine as well


def contacts(counts, how=""):
    return {k: n for k, n in counts.items() if k.startswith(f"contact: {how}")}


def test_a_certified_drone_that_moves_touches_nothing():
    counts = adversary.fly(1800, seed=2901)
    assert contacts(counts, "moving, certified") == {}
    assert counts["refused commands that flew"] == 0
    assert counts["moving"] > 800
    assert counts["flown: way"] > 20  # the planner needs it
    # 0.051 in 84,653 ticks; in so few as these 0.02 to 0.07, by eight seeds.
    assert counts["flown: none"] < 0.12 * counts["ticks"]


def test_without_the_checker_it_does(monkeypatch):
    def blind(way, *args):
        n = len(way.p)
        return Findings(np.ones(n), (CAUSES[0],) * n, *np.ones((3, n)))

    monkeypatch.setattr(certify, "check", blind)
    counts = adversary.fly(900, seed=2901)
    assert contacts(counts, "moving, certified") != {}


@pytest.mark.slow
def test_nor_in_forty_thousand_ticks():
    counts = adversary.fly(40_000, seed=2902)
    assert contacts(counts, "moving, certified") == {}
    assert counts["refused commands that flew"] == 0
    assert counts["flown: none"] < 0.1 * counts["ticks"]  # 0.065 in 40,168
