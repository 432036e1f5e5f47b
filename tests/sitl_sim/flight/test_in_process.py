"""Companions inside the simulator's process are lost as their processes would be."""

from companion.process.in_process import InProcessCompanion
from sitl_sim.flight.results import finish, table
from sitl_sim.flight.runner import flight
from sitl_sim.scenarios.scenario import Scenario


def test_a_companion_that_raises_is_lost_and_the_flight_falls_short(tmp_path, monkeypatch):
    def answer(self, frame):
        raise RuntimeError("a bug in flight")

    monkeypatch.setattr(InProcessCompanion, "answer", answer)
    scenario = Scenario.model_validate(
        {
            "drones": {"count": 1},
            "sensing": {"neighbours": "truth", "obstacles": "map"},
            "mission": {"time_limit": 2.0},
        }
    )
    with flight(scenario, tmp_path, in_process=True) as f:
        f.write_inputs()
        f.launch()
        f.run()
    metrics = finish(f, 0.0)
    assert metrics["companion_errors"] == {"drone1": 1}
    assert not metrics["ok"]
    assert "drone1's companion ended with an error, exit 1" in table(metrics, tmp_path)
    assert "a bug in flight" in (tmp_path / "drones" / "drone1" / "stderr.log").read_text()
