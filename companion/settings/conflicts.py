"""What no single configuration can know: two drones that want the same thing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from companion.settings.config import CompanionConfig, bridge_of, is_bridge, is_layer, resolve
from mavlink_bridge.betaflight.config import BridgeConfig
from mavlink_bridge.shared.settings import Document, SettingsError, load_yaml, validate
from mavlink_bridge.wire.link import parse_endpoint


@dataclass(frozen=True)
class Drone:
    """A drone's file, its resolved document and what it says."""

    path: Path
    document: Document
    config: CompanionConfig

    def place(self, key: str) -> str:
        """Where it says `key`; its file where that is the built-in default."""
        return self.document.places.get(tuple(key.split(".")), str(self.path))


def read_drones(paths: Iterable[Path]) -> tuple[list[Drone], list[str]]:
    """Every drone among the files (layers are passed over), and what is wrong with the rest."""
    drones: list[Drone] = []
    problems: list[str] = []
    for path in dict.fromkeys(p for p in paths if not (is_layer(p) or is_bridge(p))):
        try:
            document = resolve(path)
            drones.append(Drone(path, document, validate(CompanionConfig, document, str(path))))
        except SettingsError as error:
            problems += error.problems
    return drones, problems


def conflicts(drones: Iterable[Drone]) -> list[str]:
    """A problem for each thing that a drone shares with one before it, at its place."""
    taken: dict[tuple[str, ...], tuple[Drone, str]] = {}
    problems = []
    for drone in drones:
        for key, (claim, text) in _claims(drone.config).items():
            place = drone.place(key)
            other = taken.setdefault(claim, (drone, place))
            if other[0] is not drone:
                problems.append(
                    f"{place}: {key}: {text} is taken by {other[0].config.name} ({other[1]})"
                )
    return problems


def bridge_problems(drone: Drone) -> list[str]:
    """Where a drone and its bridge do not fit together; the bridge's file need not be there."""
    link = drone.config.link
    problems = []
    if link.autopilot == "betaflight" and link.signing is not None:
        problems.append(
            f"{drone.place('link.signing')}: link.signing: mavlink-bridge does not "
            "sign, so a Betaflight would not be heard"
        )
    path = bridge_of(drone.path)
    if not path.exists():
        return problems
    try:
        document = load_yaml(path)
        bridge = validate(BridgeConfig, document, str(path))
    except SettingsError as error:
        return [*problems, *error.problems]
    kind, _, port = parse_endpoint(bridge.link.endpoint)
    if bridge.link.system_id != link.system_id:
        place = document.places.get(("link", "system_id"), path)
        problems.append(
            f"{place}: link.system_id: is {bridge.link.system_id}, "
            f"that of {drone.config.name} {link.system_id}"
        )
    mine, _, there = parse_endpoint(link.endpoint)
    if (kind, mine) == ("udpout", "udpin") and port != there:
        place = document.places.get(("link", "endpoint"), path)
        problems.append(
            f"{place}: link.endpoint: port {port}, {drone.config.name} listens on {there}"
        )
    airframe, throttle = drone.config.airframe, bridge.throttle
    for key, is_, name, wanted in (
        ("hover", throttle.hover, "hover_thrust", airframe.hover_thrust),
        ("exponent", throttle.exponent, "thrust_exponent", airframe.thrust_exponent),
    ):
        if is_ != wanted:  # the bridge passes thrust on as throttle
            place = document.places.get(("throttle", key), path)
            problems.append(
                f"{place}: throttle.{key}: is {is_}, airframe.{name} of "
                f"{drone.config.name} {wanted}"
            )
    return problems


def _claims(config: CompanionConfig) -> Mapping[str, tuple[tuple[str, ...], str]]:
    """By key: what a drone claims for itself, and how to say it.

    System ids and names are the swarm's, ports and devices those of one board.
    """
    board = config.board.host or ""
    return {
        "name": (("name", config.name), f"the name {config.name!r}"),
        "link.system_id": (
            ("system", str(config.link.system_id)),
            f"system id {config.link.system_id}",
        ),
        "link.endpoint": (
            ("port", board, *_port(config.link.endpoint)),
            f"the port of {config.link.endpoint}",
        ),
        "camera.source": (
            ("port", board, *_port(config.camera.source)),
            config.camera.source,
        ),
    }


def _port(endpoint: str) -> tuple[str, str]:
    """What an endpoint occupies: a UDP or TCP port whatever the address, else a device."""
    kind, _, address = endpoint.partition(":")
    _, _, port = address.rpartition(":")
    if kind.startswith(("udp", "tcp", "sim")) and port.isdigit():
        return kind, port if kind == "udpin" else address
    device = address.removesuffix(f":{port}") if port.isdigit() else address
    return "device", device
