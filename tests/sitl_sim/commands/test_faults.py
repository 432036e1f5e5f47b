"""`sitl-sim faults` lists every kind with what its amount means."""

from sitl_sim.__main__ import main
from sitl_sim.faults.catalogue import KINDS


def test_every_kind_is_listed_with_its_meaning(capsys):
    assert main(["faults"]) == 0
    listed = capsys.readouterr().out.splitlines()[1:]
    assert [line.split()[0] for line in listed] == list(KINDS)
    assert all(line.endswith(m.text) for line, m in zip(listed, KINDS.values(), strict=True))
