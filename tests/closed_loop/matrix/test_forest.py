"""Every fault that concerns flight, in the paper's forest: three drones, 30 s, ten seeds; and nine.

Nobody healthy collides with anything, whatever becomes of the mission. Slow: an hour of one core.
"""

import pytest
from inprocess import InProcess

from sitl_sim import scenario as scenarios

AT = {"at": 9.0}
SOME = {"drone": "drone2", **AT}
FAULTS = {
    "7": {"kind": "telemetry_stale", **SOME},
    "8": {"kind": "position_jump", "amount": 3.0, **SOME},
    "9": {"kind": "link_loss", "amount": 0.5},
    "13": {"kind": "mode", "to": "position", **SOME},
    "14": {"kind": "reboot", **SOME},
    "15": {"kind": "camera_dead", **SOME},
    "16": {"kind": "missed", "amount": 0.3},
    "17_stop": {"kind": "stop", **SOME},
    "17_turn": {"kind": "turn_into", **SOME},
    "17_kill": {"kind": "kill", **SOME},
    "19": {"kind": "pause", "amount": 0.2, "for": 2.0, **AT},
    "22_gust": {"kind": "gust", "amount": 5.0, "for": 3.0, **AT},
    "22_motor": {"kind": "motor", "amount": 0.8, **SOME},
}
# Leaves its drone without control, or its companion without a say: not among the healthy.
LOST = {"7", "8", "13", "14", "17_stop", "17_turn", "17_kill"}


def fly(row, seed, drones, seconds):
    scenario = scenarios.load(
        "forest",
        [f"drones.count={drones}", f"seed={seed}", f"mission.time_limit={seconds}",
         "sensing.neighbours=truth", "sensing.obstacles=map"],
    )  # fmt: skip
    faults = [scenarios.fault.FaultConfig.model_validate(FAULTS[row])]
    f = InProcess(scenario.model_copy(update={"faults": faults}))
    try:
        f.run()
    finally:
        f.close()
    return f


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("row", [pytest.param(r, marks=pytest.mark.row(r)) for r in FAULTS])
def test_three_drones(row, seed):
    f = fly(row, seed, 3, 30.0)
    f.check_always(healthy=[i for i in range(3) if row not in LOST or i != 1])


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("row", [pytest.param(r, marks=pytest.mark.row(r)) for r in FAULTS])
def test_nine_drones(row):
    f = fly(row, 0, 9, 40.0)
    f.check_always(healthy=[i for i in range(9) if row not in LOST or i != 1])
