"""The command of the studies runs; its figures are for the docs."""

import pytest

from tests.benchmarks import nmpc_study


@pytest.mark.parametrize("name", ["norms"])
def test_a_study_prints_its_table(name, monkeypatch, capsys):
    monkeypatch.setattr(nmpc_study, "SCENES", 1)
    monkeypatch.setattr(nmpc_study, "TICKS", 2)
    nmpc_study.study(name)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + len(nmpc_study.STUDIES[name][1])
    assert lines[0].startswith("| factor | RTI p50 ms")
    assert all(float(cell) >= 0 for cell in lines[-1].strip("| ").split("|"))


def test_sizes_of_every_study_are_valid():
    for _, rows in nmpc_study.STUDIES.values():
        for changes in rows:
            assert nmpc_study.swarm(nmpc_study.configured(**changes), 0).finite()
