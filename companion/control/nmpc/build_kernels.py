"""Builds the kernels that a wheel brings (`prebuilt.py`): `make kernels`."""

from __future__ import annotations

import platform
import shutil
import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

from companion.control.nmpc.compiled import compile_kernel, program_source, source
from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.generated import encoded, generate
from companion.control.nmpc.generated import file_name as stage_file
from companion.control.nmpc.prebuilt import FOLDER, LEVELS, file_name


def build(folder: Path, machines: Sequence[str]) -> Iterator[Path]:
    """Build the kernels for some kinds of processor; yield each file.

    They are that of the default problem, with its code (`generated.py`), and that of the quadratic
    program alone, for any sizes.

    Raises:
        FileNotFoundError: a compiler is missing; the error names it.
        SubprocessError: it fails.
    """
    made = generate(NmpcConfig())
    sources = (source(made.code), program_source())
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    kept = folder / stage_file(NmpcConfig())
    kept.write_text(encoded(made))
    yield kept
    code = folder / "nmpc.c"
    for machine in machines:
        compiler = "gcc" if machine == platform.machine() else f"{machine}-linux-gnu-gcc"
        if shutil.which(compiler) is None:
            raise FileNotFoundError(f"{compiler} is not installed (Debian: {_package(machine)})")
        for level, text in product(LEVELS[machine], sources):
            code.write_text(text)
            built = folder / file_name(machine, level, text)
            compile_kernel(compiler, level.options, code, built)
            yield built
    code.unlink()


def main() -> int:
    """Build all kernels into the package; 0, or 2 with what is missing."""
    try:
        for built in build(FOLDER, tuple(LEVELS)):
            print(f"{built.name}  {built.stat().st_size // 1024} kB")
    except FileNotFoundError as error:
        print(f"make kernels: {error}", file=sys.stderr)
        return 2
    return 0


def _package(machine: str) -> str:
    name = machine.replace("_", "-")
    return "gcc" if machine == platform.machine() else f"gcc-{name}-linux-gnu"


if __name__ == "__main__":
    sys.exit(main())
