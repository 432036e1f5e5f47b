"""The file transfer protocol of a vehicle that has no files to give: it lists and refuses.

Source: mavlink.io/en/services/ftp.html. Each request is answered at once, so that a client goes on
without files: MAVProxy then lists the parameters, MAVSDK finds no logs.
"""

from __future__ import annotations

import struct

from mavlink_bridge.wire.messages import FileTransfer, Source
from sitl_sim.vehicles.firmware.ids import FtpError, FtpOpcode

_HEADER = struct.Struct("<HBBBBBBI")  # sequence, session, opcode, size, request, burst, pad, offset
_FOLDERS = {"/": ("Dfs",), "/fs": ("Dmicrosd",), "/fs/microsd": ("Dlog",), "/fs/microsd/log": ()}
_PAYLOAD = 251


def answer_file_request(source: Source, m: FileTransfer) -> list[FileTransfer]:
    """Answer one request; a payload too short for a header has no answer."""
    if len(m.payload) < _HEADER.size:
        return []
    sequence, session, opcode, size, _, _, _, offset = _HEADER.unpack_from(m.payload)
    if opcode in (FtpOpcode.ACK, FtpOpcode.NAK):
        return []
    data = m.payload[_HEADER.size : _HEADER.size + size]
    error, content = _done(opcode, data, offset)
    answered = FtpOpcode.NAK if error else FtpOpcode.ACK
    if error:
        content = bytes([error])
    header = _HEADER.pack(
        (sequence + 1) & 0xFFFF, session, answered, len(content), opcode, 0, 0, offset
    )
    payload = (header + content).ljust(_PAYLOAD, b"\0")
    return [FileTransfer(source.system, source.component, payload)]


def _done(opcode: int, data: bytes, offset: int) -> tuple[int, bytes]:
    """Return the error of a request (0: none) and the content of its answer."""
    if opcode in (FtpOpcode.NONE, FtpOpcode.TERMINATE_SESSION, FtpOpcode.RESET_SESSIONS):
        return 0, b""
    if opcode == FtpOpcode.LIST_DIRECTORY:
        path = data.split(b"\0", 1)[0].decode("utf-8", "replace")
        entries = _FOLDERS.get("/" + path.strip("/"))
        if entries is None:
            return FtpError.FILE_NOT_FOUND, b""
        if offset >= len(entries):
            return FtpError.END_OF_FILE, b""
        return 0, b"".join(e.encode() + b"\0" for e in entries[offset:])
    if opcode in (FtpOpcode.OPEN_FILE_READ, FtpOpcode.CALCULATE_CHECKSUM):
        return FtpError.FILE_NOT_FOUND, b""
    if opcode in (FtpOpcode.READ_FILE, FtpOpcode.BURST_READ_FILE):
        return FtpError.INVALID_SESSION, b""
    return FtpError.UNKNOWN_COMMAND, b""
