"""Dual-horizon NMPC, eq. (11)-(38): one problem, its real-time solver and its reference solver."""

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.instance import Instance, Neighbour, make_instance
from companion.control.nmpc.rti import Nmpc

__all__ = [
    "Instance",
    "Neighbour",
    "Nmpc",
    "NmpcConfig",
    "make_instance",
]
