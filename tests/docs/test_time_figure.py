"""The picture of where the time goes: each sample in one group, compiling left out."""

import importlib.util

import pytest

from tests.docs.tutorial import ROOT

pytest.importorskip("matplotlib")

LOOK = "eyes: closer look"
TICK = "Companion.tick (companion/pipeline.py:152)"


@pytest.fixture(scope="module")
def figure():
    spec = importlib.util.spec_from_file_location("time_figure", ROOT / "docs" / "time_figure.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("inner", "group"),
    [
        ("run (companion/perception/network_search.py:9)", "eyes: search"),
        # The search calls the closer look.
        ("_(companion/perception/network_search.py);_(companion/perception/closer_look.py)", LOOK),
        ("see (companion/perception/frontend.py:9)", "eyes: the rest"),
        ("solve (companion/control/nmpc/rti.py:80)", "plan: the NMPC"),
        ("place (companion/process/frame_source.py:80)", "companion: the rest"),
    ],
)
def test_a_sample_is_of_the_part_that_it_is_in(figure, inner, group):
    assert figure.group_of(f"main (sitl_sim/commands/run.py:1);{TICK};{inner}") == group


def test_shares_leave_out_compiling_and_come_largest_first(figure):
    lines = [
        f"{TICK};solve (companion/control/nmpc/rti.py:80) 1",
        f"{TICK};update (companion/guidance/guidance.py:80) 3",
        f"{TICK};compile (numba/core/compiler.py:80) 96",
    ]
    assert figure.shares(lines) == {"guidance": 0.75, "plan: the NMPC": 0.25}


def test_every_part_that_is_named_is_in_the_tree(figure):
    for parts in figure.GROUPS.values():
        for part in parts:
            ours = part.startswith(("companion/", "sitl_sim/", "mavlink_bridge/"))
            assert not ours or any(ROOT.glob(f"{part}*")), part
