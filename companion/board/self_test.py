"""Loads all that a flight and the solver's bench load, and prints the libraries that this took.

It runs in a release on a board: `python -I -m companion.board.self_test`. The installer keeps these
libraries of CasADi's (`prune.py`).
"""

from __future__ import annotations

import sys
from pathlib import Path


def main() -> int:
    """Solve a problem by each solver that is installed; 0, or an error of what does not work."""
    import companion.process.daemon  # noqa: F401  (all that a daemon imports)
    from companion.control.nmpc import NmpcConfig
    from companion.control.nmpc.generated import generate
    from companion.control.nmpc.instance_file import load, stored
    from companion.control.nmpc.ipopt import IpoptNmpc

    config = NmpcConfig()
    generate(config)  # what a C compiler gets
    instance = load(stored(), config)[0].instances[0]
    plan = IpoptNmpc(config).solve(instance)
    if not plan.usable:
        print(f"IPOPT finds no plan: {plan.status.name}", file=sys.stderr)
        return 1
    lines = Path("/proc/self/maps").read_text().splitlines()
    mapped = {line.split(maxsplit=5)[5] for line in lines if "/" in line}
    print("\n".join(sorted(path for path in mapped if "/casadi/" in path)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
