"""The committed dialect is what pymavlink generates; a base install needs no pymavlink."""

import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as theirs

from mavlink_bridge.wire.dialect import common
from mavlink_bridge.wire.dialect.layout import CRC_EXTRA, layout, message
from mavlink_bridge.wire.dialect.pack import packed
from tests.mavlink_bridge.wire import dialect_file

ROOT = Path(__file__).parents[3]


def test_the_dialect_is_as_its_generator_writes_it():
    assert dialect_file.text() == Path(common.__file__).read_text(), "run `make dialect`"


@pytest.mark.parametrize("number", sorted(theirs.mavlink_map))
def test_each_message_is_laid_out_as_by_pymavlink(number):
    kind, ours = theirs.mavlink_map[number], layout(number)
    assert ours.form.format == kind.unpacker.format
    assert CRC_EXTRA[number] == kind.crc_extra
    assert list(ours.read._fields) == kind.ordered_fieldnames
    assert list(ours.sent._fields) == kind.fieldnames
    assert ours.lengths == kind.lengths
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    texts = [n for n, name in enumerate(kind.ordered_fieldnames) if types[name] == "char"]
    assert ours.texts == texts


@pytest.mark.parametrize("number", sorted(theirs.mavlink_map))
def test_each_message_is_packed_as_by_pymavlink(number):
    kind, ours = theirs.mavlink_map[number], layout(number)
    required = len(kind.fieldnames) - len(ours.sent._field_defaults)
    lengths = dict(zip(kind.ordered_fieldnames, ours.lengths, strict=True))
    values = []
    for n, name in enumerate(kind.fieldnames[:required]):
        length = lengths[name]
        text = kind.ordered_fieldnames.index(name) in ours.texts
        values.append(b"x" if text else n + 1 if length == 1 else list(range(1, length + 1)))
    frame = kind(*values).pack(theirs.MAVLink(None, 1, 1))
    whole = packed(message(kind.msgname)(*values))
    assert frame[10 : 10 + frame[1]] == whole.rstrip(b"\0")
    assert len(whole) == kind.unpacker.size


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
