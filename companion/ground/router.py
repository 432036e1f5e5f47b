"""The file of mavlink-router on a board: one autopilot, its companion, and two ground stations.

Source: https://github.com/mavlink-router/mavlink-router, examples/config.sample.
"""

from __future__ import annotations

from companion.settings.config import CompanionConfig
from mavlink_bridge.wire.link import parse_endpoint

QGROUNDCONTROL, GROUND = 14550, 14560  # UDP ports of the ground stations
_COMPANION = 14541  # UDP port of a companion whose file has a serial line
_DEVICE, _BAUD = "/dev/autopilot", 921600  # of an autopilot whose companion's file has none


def router_config(drone: CompanionConfig, address: str) -> str:
    """Return the file for a drone's board; address: of the computer with the ground stations."""
    kind, host, number = parse_endpoint(drone.link.endpoint)
    serial = kind == "serial"
    device, baud = (host, number) if serial else (_DEVICE, _BAUD)
    port = number if kind == "udpin" else _COMPANION
    note = ""
    if kind != "udpin":
        note = f'# The companion\'s own file then has link.endpoint: "udpin:127.0.0.1:{port}"\n'
    parts = [
        f"# {drone.name}: /etc/mavlink-router/main.conf on its board\n{note}[General]\n"
        "TcpServerPort = 0\n",
        f"[UartEndpoint autopilot]\nDevice = {device}\nBaud = {baud}\n",
        _udp("companion", "127.0.0.1", port),
        _udp("qgroundcontrol", address, QGROUNDCONTROL),
        _udp("ground", address, GROUND),
    ]
    return "\n".join(parts)


def _udp(name: str, address: str, port: int) -> str:
    return f"[UdpEndpoint {name}]\nMode = Normal\nAddress = {address}\nPort = {port}\n"
