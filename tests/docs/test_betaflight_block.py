"""The CLI block of the hobbyist's page is a setup that the bridge accepts, switch by switch."""

import re

import pytest

from mavlink_bridge.betaflight.controller import QUESTIONS, read_controller
from mavlink_bridge.betaflight.msp import MspError
from tests.docs.tutorial import ROOT
from tests.mavlink_bridge.betaflight.fake_controller import FakeController

PAGE = ROOT / "docs" / "tutorials" / "hobbyist.md"


def block():
    text = PAGE.read_text("utf-8")
    return re.search(r'```text title="betaflight.txt"\n(.*?)```', text, re.S)[1].splitlines()


def controller_of(lines):
    """A Betaflight 2026.6 with the switches and rates of these lines, and nothing else."""
    fake = FakeController(only_receiver=False)
    settings = dict(line[4:].split(" = ") for line in lines if line.startswith("set "))
    ranges = []
    for line in lines:
        if line.startswith("aux "):
            _, box, aux, low, high, *_ = map(int, line.split()[1:])
            ranges.append((box, aux, (low - 900) // 25, (high - 900) // 25))
    fake.ranges = ranges
    if not int(settings.get("msp_override_channels_mask", 0)):
        fake.boxes = [0, 1]  # Betaflight offers MSP OVERRIDE with a mask only
    kind = {"BETAFLIGHT": 0, "ACTUAL": 3, "QUICK": 4}[settings["rates_type"]]
    srates = [int(settings[f"{axis}_srate"]) for axis in ("roll", "pitch", "yaw")]
    fake.rates = (int(settings["roll_rc_rate"]), int(settings["roll_expo"]), *srates, kind)
    return read_controller({q: fake.answer(q) for q in QUESTIONS}), settings


def test_the_bridge_accepts_the_block_and_its_mask_holds_what_it_moves():
    controller, settings = controller_of(block())
    assert not controller.only_receiver  # a pilot stands by
    mask = int(settings["msp_override_channels_mask"])
    (advice,) = [line for line in controller.report() if "msp_override_channels_mask" in line]
    assert mask == int(re.search(r"mask = (\d+)", advice)[1])
    override = 4 + 2  # AUX3: the pilot's switch must stay the pilot's
    assert not mask & (1 << override)
    assert controller.rate_sticks([6.981317, 0.0, 0.0])[0] == pytest.approx(1.0, abs=0.01)
    assert block()[-1] == "save"


@pytest.mark.parametrize(
    ("left_out", "said"),
    [
        ("aux 0 0 0", "no switch for mode ARM"),
        ("aux 1 1 1", "no switch for mode ANGLE"),
        ("aux 2 50 2", "neither feature RX_MSP nor a switch"),
        ("set msp_override_channels_mask", "is not available"),
    ],
)
def test_every_switch_of_the_block_is_needed(left_out, said):
    lines = [line for line in block() if not line.startswith(left_out)]
    assert len(lines) == len(block()) - 1
    with pytest.raises(MspError, match=said):
        controller_of(lines)
