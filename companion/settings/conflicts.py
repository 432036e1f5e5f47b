"""Conflicts between configurations: two drones that claim the same name, id or port."""

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
    """A drone's file, its resolved document and its configuration."""

    path: Path
    document: Document
    config: CompanionConfig

    def place(self, key: str) -> str:
        """Return the place of `key`; the file where the value is the built-in default."""
        return self.document.places.get(tuple(key.split(".")), str(self.path))


def read_drones(paths: Iterable[Path]) -> tuple[list[Drone], list[str]]:
    """Return the valid drones among the files, and the problems of the others.

    Layers and bridges are passed over.
    """
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
    """Return a problem, with its place, for each claim that an earlier drone has made already."""
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
    """Return where a drone and its bridge do not fit together; a drone may have no bridge."""
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
        ("exponent", throttle.exponent, "thrust_exponent", airframe.exponent),
    ):
        if is_ != wanted:  # the bridge passes thrust on as throttle
            place = document.places.get(("throttle", key), path)
            problems.append(
                f"{place}: throttle.{key}: is {is_}, airframe.{name} of "
                f"{drone.config.name} {wanted}"
            )
    return problems


def _claims(config: CompanionConfig) -> Mapping[str, tuple[tuple[str, ...], str]]:
    """Return what a drone claims for itself, by key, and its name in messages.

    Names and system ids are unique in the swarm, ports and devices on one board.
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
    """Return the port, at any address, or the device that an endpoint occupies."""
    kind, _, address = endpoint.partition(":")
    _, _, port = address.rpartition(":")
    if kind.startswith(("udp", "tcp", "sim")) and port.isdigit():
        return kind, port if kind == "udpin" else address
    device = address.removesuffix(f":{port}") if port.isdigit() else address
    return "device", device
