"""Figures for papers: vectors, and the same bytes of the same flight."""

import pytest

from sitl_sim.__main__ import main
from tests.sitl_sim import flights


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return flights.write_run(tmp_path_factory.mktemp("run"))


def test_every_figure_is_a_vector_with_letters_that_stay_letters(folder, capsys):
    assert main(["figures", str(folder)]) == 0
    made = capsys.readouterr().out.split()
    assert made == [str(folder / f"figures/{n}.pdf") for n in ("flight", "network", "plans")]
    for path in made:
        content = (folder / path).read_bytes()
        assert content.startswith(b"%PDF")
        assert b"/Subtype /Image" not in content
        assert b"/FontType 42" in content or b"/Subtype /Type0" in content
        assert b"/Subtype /Type3" not in content


def test_the_same_flight_gives_the_same_bytes(folder, tmp_path):
    for place in ("one", "two"):
        assert main(["figures", str(folder), "--out", str(tmp_path / place)]) == 0
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


def test_the_paths_and_names_of_all_drones_are_in_the_figure(folder, tmp_path):
    assert main(["figures", str(folder), "--to", "svg", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "flight.svg").read_text()
    for word in (*flights.NAMES, "east [m]", "speed [m/s]", "contact"):
        assert f">{word}<" in text


def test_figures_without_matplotlib_name_their_extra(folder, monkeypatch, capsys):
    monkeypatch.setattr("sitl_sim.commands.extras.find_spec", lambda module: None)
    assert main(["figures", str(folder)]) == 2
    assert "swarm-companion[studies,sim]" in capsys.readouterr().err
