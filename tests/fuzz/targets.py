"""What may be fed anything: each target takes bytes and must neither raise nor grow.

`python tests/fuzz/targets.py codec -max_total_time=600` runs one under atheris (the extra
`fuzz`), from the corpus beside it; `pytest tests/fuzz` runs all of them on the corpus and on
what hypothesis makes up; `make fuzz` counts a million mutated frames of each protocol.
"""

import io
import json
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "mavlink_bridge"))
from fake_controller import FakeController

from companion.config import CompanionConfig
from companion.inputs import InputsError, decode
from companion.phases import Phase
from companion.pipeline import Pipeline, TickInputs
from mavlink_bridge import msp
from mavlink_bridge.betaflight_bridge import POLLED, BetaflightBridge
from mavlink_bridge.codec import Codec
from mavlink_bridge.controller import QUESTIONS, interview
from mavlink_bridge.mcapfile import whole_records
from mavlink_bridge.messages import RateSetpoint, Source
from mavlink_bridge.settings import SettingsError, parse_yaml, validate
from mavlink_bridge.signing import Signing
from mavlink_bridge.thrust import ThrustMap
from mavlink_bridge.video import Frame

CORPUS = Path(__file__).parent / "corpus"
KEY = bytes(range(32))
_HELD = 600  # bytes, most that a decoder keeps of what may be a frame


def codec(data):
    """MAVLink bytes in two halves: a stream may be cut anywhere."""
    c = Codec(1, 191)
    half = len(data) // 2
    c.decode(data[:half])
    c.decode(data[half:])
    assert len(c._buffer) <= _HELD
    Codec(1, 191, allow=[Source(1, 1)], signing=Signing(KEY, 1)).decode_datagram(data)


def msp_stream(data):
    """MSP answers, as a bridge in flight takes them and one that asks for a set-up."""
    decoder, fake = msp.MspDecoder(), FakeController()
    bridge = BetaflightBridge(1, interview(fake.answer), ThrustMap(0.5, 1.75), 1.0)
    for n, reply in enumerate(decoder.decode(data)):
        for k, wrong in enumerate(POLLED):
            parts = [reply.payload if c == wrong else fake.answer(c) for c in POLLED]
            several = b"".join(bytes([len(p)]) + p for p in parts)
            with np.errstate(all="ignore"):
                bridge.read(n + 0.1 * k, msp.Reply(msp.Msp.MULTIPLE_MSP, several))
                bridge.cycle(n + 0.1 * k + 0.05)
        for wrong in QUESTIONS:
            try:
                interview(lambda q, w=wrong, r=reply: r.payload if q == w else fake.answer(q))
            except msp.MspError as error:
                assert "\n" not in str(error)  # noqa: PT017
    assert len(decoder._buffer) <= 261


def config(data):
    """A drone's file."""
    try:
        validate(CompanionConfig, parse_yaml(data.decode("utf-8"), "f"), "f")
    except (SettingsError, UnicodeDecodeError):
        return


def mcap(data):
    """A flight log, cut or damaged anywhere."""
    for record in whole_records(io.BytesIO(data)):
        payload = getattr(record, "data", None)
        if isinstance(payload, bytes):
            try:
                decode(payload)
            except InputsError:
                continue


@lru_cache(1)
def _pipeline():
    """A pipeline that believes that it flies; made once, for it is compiled."""
    fields = {"sensing": {"neighbours": "truth", "obstacles": "map"}}
    return Pipeline(CompanionConfig.model_validate(fields), lambda: 0.0)


def tick(data):
    """One tick in flight: bytes of MAVLink, and a frame's numbers."""
    p = _pipeline()
    p._phases.phase = Phase.FLY
    p._phases._releasing = False
    time = (p._time if np.isfinite(p._time) else 0.0) + 0.1
    received = Codec(1, 191).decode_datagram(data)
    own = [replace(r, source=Source(1, 1)) for r in received]
    rows = np.frombuffer(data[: len(data) // 48 * 48], dtype="<f8").reshape(-1, 6)[:20].copy()
    with np.errstate(all="ignore"):
        # Every other one gets past the door: a direction and numbers of any size that may be.
        rows[::2, :3] = np.nan_to_num(rows[::2, :3], posinf=1.0, neginf=-1.0).clip(-1.0, 1.0)
        rows[::2, :3] /= np.linalg.norm(rows[::2, :3], axis=1, keepdims=True)
        rows[::2, 3:] = 10.0 ** (4.0 * np.tanh(np.nan_to_num(rows[::2, 3:])))
        out = p.tick(TickInputs(time, own, Frame(time, {"neighbours": rows, "trunks": rows})))
    for m in out.messages:
        if isinstance(m, RateSetpoint):
            assert np.isfinite(m.omega).all()
            assert np.abs(m.omega).max() <= 3.0
            assert 0.0 <= m.thrust <= 1.0


TARGETS = {"codec": codec, "msp": msp_stream, "config": config, "mcap": mcap, "tick": tick}
FOLDERS = {"codec": "mavlink", "msp": "msp", "config": "config", "mcap": "mcap", "tick": "mavlink"}


def seeds(name):
    """The corpus of a target."""
    return [f.read_bytes() for f in sorted((CORPUS / FOLDERS[name]).iterdir())]


def main():
    """Under atheris."""
    import atheris

    name = sys.argv.pop(1)
    atheris.instrument_all()
    atheris.Setup([*sys.argv, str(CORPUS / FOLDERS[name])], TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in TARGETS:
        main()
    else:
        sys.exit(json.dumps({"usage": "targets.py TARGET [libFuzzer options]",
                             "targets": list(TARGETS)}))  # fmt: skip
