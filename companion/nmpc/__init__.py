"""Dual-horizon NMPC, eq. (11)-(38): one problem, a real-time solver and a reference solver."""

from companion.nmpc.config import NmpcConfig
from companion.nmpc.instance import Instance, Neighbour, make_instance
from companion.nmpc.ipopt import IpoptNmpc
from companion.nmpc.result import Result, Status
from companion.nmpc.rti import Nmpc

__all__ = [
    "Instance",
    "IpoptNmpc",
    "Neighbour",
    "Nmpc",
    "NmpcConfig",
    "Result",
    "Status",
    "make_instance",
]
