"""A companion's setpoints take effect after the configured delay, also beyond one tick."""

import numpy as np

from mavlink_bridge.wire.messages import RateSetpoint
from sitl_sim.flight.runner import flight
from sitl_sim.scenarios.scenario import Scenario

SCENARIO = {
    "seed": 5,
    "drones": {"count": 2, "state": "gps"},
    "sensing": {"neighbours": "truth", "obstacles": "map"},
    "mission": {"time_limit": 10.0},
}


def test_setpoints_take_effect_after_the_delay_at_every_tick(tmp_path):
    timing = {"compute_delay": [0.1, 0.2], "compute_jitter": 0.02}
    scenario = Scenario.model_validate(SCENARIO | {"timing": timing})
    late: list[list[float]] = [[], []]
    with flight(scenario, tmp_path, in_process=True) as f:
        take = f._autopilots.receive

        def receive(i, received, link=None):
            if isinstance(received.message, RateSetpoint):
                clock = f.simulated_seconds + f._drones[i].boot_ms / 1e3
                late[i].append(clock - received.message.time)
            return take(i, received, link)

        f._autopilots.receive = receive
        f.write_inputs()
        f.launch()
        f.run()
        truth = f.truth.arrays()
    for delay, found in zip(f._delays.means, late, strict=True):
        assert len(found) > 15  # ten a second once it streams
        assert np.abs(np.array(found) - delay).max() <= 0.02 + 0.002
        assert np.ptp(found) > 0.02
    assert f._delays.means[0] != f._delays.means[1]
    # The truth says where each autopilot believes to be; the world, that targets count by it.
    assert f.world["targets_by"] == "estimate"
    assert 0.2 < np.abs(truth["estimate"] - truth["position"]).max() < 4.0
