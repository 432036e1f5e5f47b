"""`companion bench`: speed and quality of the solver and of perception on this machine."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from companion.bench import perception_table
from mavlink_bridge.shared.options import count, natural

if TYPE_CHECKING:
    from companion.control.nmpc.instance_file import Run

HELP = "measure solver and perception; record instances for the solver from flight logs"
EXIT_BAD_INPUT = 2
_SOLVERS = ("rti", "rti-vm", "ipopt-sx", "ipopt-mx")  # as bench.SOLVERS, which is slow to import


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    what = parser.add_subparsers(dest="what", required=True)
    nmpc = what.add_parser("nmpc", help="real-time solver and IPOPT on the same instances")
    nmpc.add_argument(
        "--instances", type=Path, help="set of instances (npz; default: the stored one)"
    )
    nmpc.add_argument(
        "--solver", action="append", choices=_SOLVERS, help="only this solver; repeatable"
    )
    nmpc.add_argument("--every", type=count, default=1, metavar="K", help="only each K-th sequence")
    nmpc.add_argument(
        "--ticks", type=natural, default=10_000, help="length of the longest run (10000)"
    )
    nmpc.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    nmpc.add_argument(
        "--cpu-time", action="store_true", help="CPU time of the thread, for busy machines"
    )
    nmpc.add_argument("--json", action="store_true", help="for machines")
    perception = what.add_parser(
        "perception", help="detection, tracking and trunks, by range and conditions"
    )
    perception_table.add_arguments(perception)
    tick = what.add_parser("tick", help="each stage of a tick, by a recorded flight")
    tick.add_argument("log", type=Path, nargs="?", help="a flight log (MCAP; default: stored)")
    tick.add_argument("--rounds", type=count, default=3, metavar="K", help="times each (3)")
    tick.add_argument(
        "--against",
        metavar="PYTHON",
        help="interpreter of another release's environment; both fly it in turn",
    )
    tick.add_argument("--json", action="store_true", help="for machines")
    board = what.add_parser("board", help="whether this machine is fast enough for a companion")
    board.add_argument("config", type=Path, nargs="?", help="drone's YAML (default: all defaults)")
    board.add_argument("--json", action="store_true", help="for machines")
    record = what.add_parser("record", help="a set of instances from flight logs, by situation")
    record.add_argument("file", type=Path, help="npz to write")
    record.add_argument("log", nargs="+", metavar="FLIGHT=LOG", help="name and flight log (MCAP)")
    record.add_argument("--each", type=count, default=6, help="windows of each flight and kind (6)")
    record.add_argument("--seed", type=natural, default=0, help="of the random draw")


def run(options: argparse.Namespace) -> int:
    """Measure or record; return the exit status."""
    if options.what == "perception":
        return perception_table.run(options)
    from companion.control.nmpc.instance_file import InstancesError
    from companion.perception.camera import CalibrationError
    from companion.perception.detectors import ModelError
    from mavlink_bridge.shared.mcap_file import LogError
    from mavlink_bridge.shared.settings import SettingsError

    of = {"nmpc": _nmpc, "tick": _tick, "board": _board, "record": _record}
    try:
        return of[options.what](options)
    except (CalibrationError, InstancesError, LogError, ModelError, SettingsError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT


def _nmpc(options: argparse.Namespace) -> int:
    from companion.bench.solver import bench
    from companion.bench.solver_table import table
    from companion.control.nmpc import NmpcConfig
    from companion.control.nmpc.instance_file import load, stored
    from mavlink_bridge.shared.settings import assignments, validate

    config = validate(NmpcConfig, assignments(options.overrides), "--set")
    runs = load(options.instances or stored(), config)[:: options.every]
    report = bench(
        runs,
        config,
        solvers=options.solver or _SOLVERS,
        ticks=options.ticks,
        clock=time.thread_time if options.cpu_time else time.perf_counter,
        progress=_progress(sum(len(r.instances) for r in runs)),
    )
    print(json.dumps(report, indent=1) if options.json else table(report))
    return 0


def _progress(total: int) -> Callable[[str, int], None]:
    """Return a function that shows the progress, where stderr is a terminal."""
    if not sys.stderr.isatty():
        return lambda solver, done: None

    def show(solver: str, done: int) -> None:
        end = "\n" if done == total else ""
        print(f"\r{solver}: {done}/{total}", end=end, file=sys.stderr, flush=True)

    return show


def _tick(options: argparse.Namespace) -> int:
    from companion.bench.tick import stage_costs, stage_costs_of, stored
    from mavlink_bridge.shared.stage_costs import Costs, medians, table

    log = options.log or stored()
    ours: list[Costs] = []
    theirs: list[Costs] = []
    for _ in range(options.rounds):
        ours.append(stage_costs(log))
        if options.against:
            theirs.append(stage_costs_of(options.against, log))
    found = [medians(costs) for costs in (ours, theirs) if costs]
    print(json.dumps(found, indent=1) if options.json else table(*found))
    return 0


def _board(options: argparse.Namespace) -> int:
    """Measure; exit status 1 where a tick does not fit."""
    from dataclasses import asdict

    from companion.bench.board import cheaper, measure
    from companion.settings.config import CompanionConfig, load_config

    config = CompanionConfig() if options.config is None else load_config(options.config)
    board = measure(config)
    lower = None if board.verdict == "fits" else cheaper(config, board)
    if options.json:
        lowered = None if lower is None else {"set": lower[0], "tick": lower[2].tick}
        print(json.dumps(asdict(board) | {"verdict": board.verdict, "lower": lowered}, indent=1))
        return int(board.verdict == "does not fit")
    for name, (p50, p99) in (("pictures", board.see), ("all other stages", board.rest)):
        print(f"{name:<18}p50 {p50:5.1f} ms   p99 {p99:5.1f} ms")
    print(f"{'memory':<18}{board.memory:.0f} MB")
    print(f"{'start':<18}{board.start:.1f} s until a companion is built")
    print(f"{board.verdict}: a tick takes {board.tick:.0f} of {board.period:.0f} ms at p99")
    if lower is not None:
        settings, price, then = lower
        print(f"{' '.join(f'--set {s}' for s in settings)}: {then.tick:.0f} ms; {price}")
    elif board.verdict != "fits":
        print("no setting that is tried makes it fit: a faster board, or fewer processes")
    return int(board.verdict == "does not fit")


def _record(options: argparse.Namespace) -> int:
    from companion.bench.situations import drawn
    from companion.control.nmpc.instance_file import InstancesError, save

    if not options.file.parent.is_dir():  # checked now, not after minutes
        raise InstancesError(f"{options.file}: cannot be written: no folder {options.file.parent}")
    runs = drawn(_windows(options.log), options.each, options.seed)
    save(options.file, runs)
    for flight, kind in sorted({(r.flight, r.kind) for r in runs}):
        count = sum(len(r.instances) for r in runs if (r.flight, r.kind) == (flight, kind))
        print(f"{flight:<12}{kind:<10}{count:5}")
    return 0


def _windows(logs: list[str]) -> Iterator[Run]:
    from companion.bench.situations import windows
    from companion.flightlog.reader import read_log
    from companion.flightlog.replay import configured, flown
    from mavlink_bridge.shared.mcap_file import LogError

    for named in logs:
        flight, _, path = named.partition("=")
        if not path:
            raise LogError(f"{named}: give FLIGHT=LOG, such as forest=drones/1/flight.mcap")
        log = read_log(Path(path))
        config = configured(log)
        ticks = (tick.planned.instance for tick in flown(config, log.inputs))
        yield from windows(flight, [i for i in ticks if i is not None], config.nmpc)
