"""The committed dialect is what pymavlink generates; a base install needs no pymavlink."""

import subprocess
import sys
from pathlib import Path

from pymavlink.dialects.v20 import common as theirs
from pymavlink.generator import mavgen

from mavlink_bridge.wire.dialect import common

ROOT = Path(__file__).parents[3]


def test_the_dialect_is_as_its_generator_writes_it(tmp_path):
    made = tmp_path / "common.py"
    options = mavgen.Opts(str(made), wire_protocol="2.0", language="Python3", validate=False)
    mavgen.mavgen(options, [str(Path(theirs.__file__).with_suffix(".xml"))])
    assert made.read_text() == Path(common.__file__).read_text(), "run `make dialect`"


def test_a_message_is_decoded_without_pymavlink():
    code = """
import sys
sys.modules["pymavlink"] = None
from mavlink_bridge.wire.codec import Codec
frame = bytes.fromhex("fd090000000101000000000000000203510403e71e")
(heard,) = Codec(2, 1).decode(frame)
print(heard.source.system, type(heard.message).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "1 Heartbeat\n", done.stderr
