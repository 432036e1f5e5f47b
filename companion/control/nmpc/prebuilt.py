"""Kernels that a wheel brings compiled, so that no board needs a compiler.

`make kernels` builds them into `kernels/`, one for each kind of processor and each set of its
instructions, and a wheel that is built afterwards holds them. A file's name ends with the hash of
its source: one that was built from another problem, or by another CasADi, is never loaded.
"""

from __future__ import annotations

import ctypes
import hashlib
import platform
from dataclasses import dataclass
from pathlib import Path

from companion.control.nmpc.kernel import SIZES

FOLDER = Path(__file__).parent / "kernels"
# No -ffast-math: the order of operations is the same on every run.
FLAGS = (
    *("-O3", "-fno-math-errno", "-fPIC", "-shared"),
    *(f"-D{name}={size}" for name, size in SIZES.items()),
)


@dataclass(frozen=True)
class Level:
    """Instructions that a kernel uses: the compiler's options, and the processor's flags needed."""

    name: str
    options: tuple[str, ...]
    needs: frozenset[str]


_V2 = frozenset(["cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3"])
_V3 = _V2 | frozenset(["abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"])
_V4 = _V3 | frozenset(["avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"])
# Best first. Flags as Linux names them in /proc/cpuinfo.
LEVELS = {
    "x86_64": (
        Level("v4", ("-march=x86-64-v4",), _V4),
        Level("v3", ("-march=x86-64-v3",), _V3),
        Level("v2", ("-march=x86-64-v2",), _V2),
    ),
    "aarch64": (
        # Raspberry Pi 5, Orin: cores that start four and more instructions at once.
        Level("v8.2", ("-march=armv8.2-a", "-mtune=cortex-a76"), frozenset({"asimdrdm", "dcpop"})),
        Level("v8.0", ("-march=armv8-a", "-mtune=cortex-a72"), frozenset({"asimd"})),
    ),
}


def load(source: str) -> ctypes.CDLL | None:
    """Return the best kernel for this source and this processor; None: there is none."""
    machine, flags = platform.machine(), processor_flags(_cpuinfo())
    for level in LEVELS.get(machine, ()):
        path = FOLDER / file_name(machine, level, source)
        if level.needs <= flags and path.exists():
            try:
                return ctypes.CDLL(str(path))
            except OSError:  # needs a newer C library than this machine's
                continue
    return None


def file_name(machine: str, level: Level, source: str) -> str:
    """Return the name of the kernel of a source."""
    key = "\n".join([source, *FLAGS])
    return f"{machine}-{level.name}-{hashlib.sha256(key.encode()).hexdigest()[:20]}.so"


def processor_flags(cpuinfo: str) -> frozenset[str]:
    """Return what the processor can do, of the text of /proc/cpuinfo."""
    for line in cpuinfo.splitlines():
        name, _, value = line.partition(":")
        if name.strip() in ("flags", "Features"):
            return frozenset(value.split())
    return frozenset()


def _cpuinfo() -> str:
    information = Path("/proc/cpuinfo")
    return information.read_text() if information.exists() else ""
