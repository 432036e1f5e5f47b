"""Fuzzing targets: each takes any bytes, and must neither raise an error nor grow a buffer.

`pytest tests/fuzz` runs all of them on the corpus and on bytes from hypothesis; `guided.py` runs
one under atheris; `make fuzz` counts a million mutated frames of each protocol.

A target catches the errors that the product's own callers catch, and no others.
"""

import io
import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from companion.flightlog.reader import read_log, recover
from companion.flightlog.replay import replay
from companion.pipeline import Companion
from companion.process.signing_keys import Timestamps
from companion.settings.config import CompanionConfig, load_config
from companion.tick import TickInputs
from companion.types import Phase
from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.bridge import BetaflightBridge
from mavlink_bridge.betaflight.controller import QUESTIONS, query_controller
from mavlink_bridge.betaflight.polling import POLLED
from mavlink_bridge.shared.mcap_file import Follower, LogError, salvage, whole_records
from mavlink_bridge.shared.settings import SettingsError, assignments
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.dialect import FROM_WIRE
from mavlink_bridge.wire.dialect.layout import layout
from mavlink_bridge.wire.framing import framed
from mavlink_bridge.wire.messages import RateSetpoint, Source
from mavlink_bridge.wire.signing import Signing
from mavlink_bridge.wire.video import Frame, FrameClient, FrameServer, RecordStream, VideoError
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles
from tests.mavlink_bridge.betaflight.fake_controller import FakeController

CORPUS = Path(__file__).parent / "corpus"
KEY = bytes(range(32))
_HELD = 600  # bytes, most that a decoder keeps of an incomplete frame
_IDS = sorted(FROM_WIRE)


def frames_of(data):
    """Return frames of a vehicle with valid checksums: a byte selects the kind, payload follows."""
    out = bytearray()
    while data:
        message_id, data = _IDS[data[0] % len(_IDS)], data[1:]
        size = layout(message_id).form.size
        payload, data = data[:size].ljust(size, b"\0"), data[size:]
        out += framed(payload, message_id, 0, Source(1, 1), 0)
    return bytes(out)


def codec(data):
    """Decode MAVLink bytes in two halves, as a stream cut anywhere."""
    c = Codec(1, 191)
    half = len(data) // 2
    c.decode(data[:half])
    c.decode(data[half:])
    assert len(c._buffer) <= _HELD
    Codec(1, 191, allow=[Source(1, 1)], signing=Signing(KEY, 1)).decode_datagram(data)


def asked(data):
    """Return messages with valid checksums and any content, addressed to the vehicle."""
    out = Codec(1, 1).decode_datagram(frames_of(data))
    for r in out:
        for name in ("target_system", "target_component"):
            if hasattr(r.message, name):
                object.__setattr__(r.message, name, 1)
    return out


@lru_cache(1)
def _vehicles():
    """Return an emulated vehicle of each kind, on the ground."""
    made = []
    for flavour in ("px4", "ardupilot"):
        vehicles = Vehicles(Airframe(), np.zeros((1, 3)), 0.0)
        made.append((Autopilots(vehicles, [1], flavour), Codec(1, 1)))
    return made


def vehicle(data):
    """Send messages of a companion or ground station to the bridge and to emulated vehicles."""
    fake, wire = FakeController(), Codec(1, 1)
    bridge = BetaflightBridge(1, query_controller(fake.answer), ThrustMap(0.5, 1.75), 1.0)
    with np.errstate(all="ignore"):
        for n, received in enumerate(asked(data)):
            bridge.read(0.1 * n, fake.several(POLLED))
            bridge.receive(0.1 * n, received)
            wire.encode(bridge.cycle(0.1 * n).messages)
            for autopilots, codec_ in _vehicles():
                codec_.encode(autopilots.receive(0, received, "gcs"))
                autopilots.advance(autopilots.t + 0.02, np.zeros(3))
                codec_.encode(autopilots.telemetry(0, "gcs"))


def msp_stream(data):
    """Send MSP answers to a bridge in flight and to one that reads a setup."""
    decoder, fake, wire = msp.MspDecoder(), FakeController(), Codec(1, 1)
    bridge = BetaflightBridge(1, query_controller(fake.answer), ThrustMap(0.5, 1.75), 1.0)
    for n, reply in enumerate(decoder.decode(data)):
        for k, wrong in enumerate(POLLED):
            parts = [reply.payload if c == wrong else fake.answer(c) for c in POLLED]
            several = b"".join(bytes([len(p)]) + p for p in parts)
            with np.errstate(all="ignore"):
                bridge.read(n + 0.1 * k, msp.Reply(msp.Msp.MULTIPLE_MSP, several))
                wire.encode(bridge.cycle(n + 0.1 * k + 0.05).messages)
        for wrong in QUESTIONS:
            try:
                query_controller(
                    lambda q, w=wrong, r=reply: r.payload if q == w else fake.answer(q)
                )
            except msp.MspError as error:
                assert "\n" not in str(error)  # noqa: PT017
    assert len(decoder._buffer) <= 261


def config(data):
    """Read bytes as a drone's file, as a scenario and as an override on the command line."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "any.yaml"
        file.write_bytes(data)
        for load in (load_config, lambda f: scenarios.load(str(f), [])):
            try:
                load(file)
            except SettingsError as error:
                assert error.problems  # noqa: PT017
    try:
        assignments([data.decode("utf-8", "surrogateescape")])
    except SettingsError:
        return


def mcap(data):
    """Read, recover, follow and replay bytes as a flight log."""
    list(whole_records(io.BytesIO(data)))
    with tempfile.TemporaryDirectory() as folder:
        file, saved = Path(folder) / "any.mcap", Path(folder) / "saved.mcap"
        file.write_bytes(data)
        salvage(file, "/tick")
        Follower(file, "/tick").new()
        for use in (lambda: recover(file, saved), lambda: replay(read_log(file))):
            try:
                use()
            except (LogError, SettingsError):
                continue


class _Line:
    """A socket with these bytes, then its end."""

    def __init__(self, data):
        self._data = data

    def setsockopt(self, *args):
        pass

    def close(self):
        pass

    def recv_into(self, view):
        part, self._data = self._data[: len(view)], self._data[len(view) :]
        view[: len(part)] = part
        return len(part)


def record(data):
    """Return bytes as a record of the frame channel: a line of JSON, then the arrays."""
    head, _, rest = data.partition(b"\n")
    return b"SWF1" + len(head).to_bytes(4, "little") + head + rest


def video(data):
    """Read bytes as frames of a simulator and as answers of a companion."""
    for stream in (data, record(data)):
        server = object.__new__(FrameServer)
        server._stream = RecordStream(_Line(stream))
        server._stream.waits = lambda timeout: True
        while server.answer(0.0) is not None:
            pass
        client = object.__new__(FrameClient)
        client._stream = RecordStream(_Line(stream))
        try:
            while True:
                _fly_on([], client.receive())
        except VideoError:
            continue


@lru_cache(1)
def _companion():
    """Return a companion; it is made once, because its solver is compiled."""
    fields = {"sensing": {"neighbours": "truth", "obstacles": "map"}}
    return Companion(CompanionConfig.model_validate(fields), lambda: 0.0)


def _fly_on(received, frame):
    """Run the next tick in flight; check that its setpoint is finite and within limits."""
    c = _companion()
    c._supervision._phases.phase = Phase.FLY
    c._supervision._phases._releasing = False
    last = c._vehicle._time
    time = (last if np.isfinite(last) else 0.0) + 0.1
    if frame is not None:
        frame = replace(frame, time=time)  # a frame of another time is ignored
    with np.errstate(all="ignore"):
        made = c.tick(TickInputs(time, received, frame))
    Codec(1, 191).encode(made.packets[0])
    if made.setpoint is not None:
        assert np.isfinite(made.setpoint.omega).all()
        assert np.abs(made.setpoint.omega).max() <= 3.0
        assert 0.0 <= made.setpoint.thrust <= 1.0


def tick(data):
    """Run one tick in flight on damaged and valid telemetry and on any numbers of a frame."""
    received = Codec(1, 191).decode_datagram(data) + asked(data[len(data) // 2 :])
    own = [replace(r, source=Source(1, 1)) for r in received]
    rows = np.frombuffer(data[: len(data) // 48 * 48], dtype="<f8").reshape(-1, 6)[:20].copy()
    with np.errstate(all="ignore"):
        # Every other row passes the checks: a unit direction, and positive numbers of any size.
        rows[::2, :3] = np.nan_to_num(rows[::2, :3], posinf=1.0, neginf=-1.0).clip(-1.0, 1.0)
        rows[::2, :3] /= np.linalg.norm(rows[::2, :3], axis=1, keepdims=True)
        rows[::2, 3:] = 10.0 ** (4.0 * np.tanh(np.nan_to_num(rows[::2, 3:])))
    _fly_on(own, Frame(0.0, {"neighbours": rows, "trunks": rows}))


def timestamps(data):
    """Read bytes as the saved timestamps; damaged ones are ignored."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "signing.json"
        file.write_bytes(data)
        signing = Timestamps(KEY, 0, file).signing
        sent = Codec(1, 191, signing=signing).encode([RateSetpoint(0.0, np.zeros(3), 0.5, 1)])
        Codec(1, 1, signing=Signing(KEY, 1)).decode_datagram(sent)


TARGETS = {
    "codec": codec,
    "vehicle": vehicle,
    "msp": msp_stream,
    "config": config,
    "mcap": mcap,
    "video": video,
    "tick": tick,
    "timestamps": timestamps,
}
FOLDERS = {name: name for name in TARGETS} | {"codec": "mavlink", "tick": "mavlink"}


def seeds(name):
    """Return the corpus of a target."""
    return [f.read_bytes() for f in sorted((CORPUS / FOLDERS[name]).iterdir())]
