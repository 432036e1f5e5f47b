"""Command line of the simulator."""

from __future__ import annotations

import argparse
import gc
import importlib.util
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from sitl_sim.commands import faults as fault_commands  # noqa: E402  # numpy must find those variables

if TYPE_CHECKING:
    from sitl_sim.flight.runner import Flight

EXIT_OK, EXIT_FELL_SHORT, EXIT_BAD_INPUT = 0, 1, 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as a shell says it


def main(arguments: list[str] | None = None) -> int:
    """Entry point of `sitl-sim`."""
    from sitl_sim.commands.campaign import add_arguments as campaign_arguments
    from sitl_sim.commands.campaign import fly_campaign
    from sitl_sim.commands.scenarios import add_arguments as scenario_arguments
    from sitl_sim.commands.scenarios import show_scenarios
    from sitl_sim.commands.study import add_arguments as study_arguments
    from sitl_sim.commands.study import run_study

    parser = argparse.ArgumentParser(prog="sitl-sim", description="The simulated world.")
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="fly one scenario")
    serve = commands.add_parser("serve", help="the world alone; companions connect themselves")
    for command in (run, serve):
        command.add_argument("scenario", help="a name (forest, …) or a YAML file")
        command.add_argument("--drones", type=int, metavar="N")
        command.add_argument("--seed", type=int, metavar="S")
        command.add_argument("--out", type=Path, metavar="DIR", help="run folder")
        command.add_argument(
            "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides"
        )
    run.add_argument("--real-time", action="store_true", help="nobody waits for anybody")
    run.add_argument(
        "--in-process", action="store_true", help="companions in this process: for studies"
    )
    run.add_argument("--json", action="store_true", help="print metrics.json instead of a table")
    campaign = commands.add_parser("campaign", help="fly a scenario many times, a seed each")
    campaign.add_argument("scenario", help="a name (forest, …) or a YAML file")
    campaign.add_argument("--drones", type=int, metavar="N")
    campaign.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides"
    )
    campaign_arguments(campaign)
    for command in (run, campaign):
        command.add_argument("--controller", metavar="NAME", help="nmpc, or one to compare it with")
    study_arguments(commands.add_parser("study", help="campaigns side by side: table and plot"))
    scenario_arguments(commands.add_parser("scenarios", help="list them; draw their plans"))
    report = commands.add_parser(
        "report", help="one page about a flight, or about a folder of flights"
    )
    report.add_argument("folder", type=Path, metavar="DIR", help="run folder, or folder of them")
    frames = commands.add_parser("frames", help="render labelled frames, to measure perception on")
    frames.add_argument("folder", type=Path, metavar="DIR")
    frames.add_argument("--seed", type=int, default=0, metavar="S")
    frames.add_argument("--count", type=int, default=200, help="clean frames (200)")
    frames.add_argument("--looks", choices=["marked", "bare", "tree", "mixed"], default="marked",
                        help="of the drones (marked)")  # fmt: skip
    fault_commands.add_arguments(commands)
    view = commands.add_parser("view", help="replay a flight in the browser")
    view.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    run.add_argument("--view", action="store_true", help="show the flight in the browser, live")
    for command in (run, view):
        command.add_argument("--port", type=int, default=8080, help="of the page (8080)")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # children are ended, flights kept
    try:
        if options.command == "report":
            return _report(options)
        if options.command == "view":
            return _view(options)
        if options.command == "frames":
            return _frames(options)
        if options.command == "campaign":
            fine = fly_campaign(options, _overrides(options))
            return EXIT_OK if fine else EXIT_FELL_SHORT
        if options.command == "study":
            return EXIT_OK if run_study(options) else EXIT_FELL_SHORT
        if options.command == "scenarios":
            show_scenarios(options)
            return EXIT_OK
        if options.command == "faults":
            print(fault_commands.list_faults())
            return EXIT_OK
        if options.command == "soak":
            return EXIT_OK if fault_commands.run_soak(options) else EXIT_FELL_SHORT
        return _fly(options, serve=options.command == "serve")
    except _bad_input() as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED


def _bad_input() -> tuple[type[Exception], ...]:
    from mavlink_bridge.shared.settings import SettingsError
    from mavlink_bridge.wire.link import EndpointError
    from mavlink_bridge.wire.video import VideoError
    from sitl_sim.external.external_sitl import ExternalError
    from sitl_sim.external.namespace import NamespaceError
    from sitl_sim.recording.run_folder import RunError

    return ExternalError, NamespaceError, SettingsError, EndpointError, VideoError, RunError


def _frames(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from sitl_sim.sensors.labelled_frames import write

    degraded, flights = options.count // 4, max(options.count // 20, 1)
    with tqdm(unit=" frames", disable=not sys.stderr.isatty()) as bar:
        made = write(options.folder, options.seed, options.count, degraded, flights, options.looks,
                     lambda _: bar.update())  # fmt: skip
    print(f"{options.folder}: {made} frames")
    return EXIT_OK


def _view(options: argparse.Namespace) -> int:
    from sitl_sim.recording.run_folder import load_run

    _need_viser()
    run = load_run(options.folder)
    from sitl_sim.viewer import Page, Replay

    page = Page(Replay(run), port=options.port)
    print(f"{page.url}  (Ctrl-C ends it)", flush=True)
    try:
        page.run()
    except KeyboardInterrupt:
        page.close()
    return EXIT_OK


@contextmanager
def _live_page(f: Flight, options: argparse.Namespace) -> Iterator[Callable[[float], None]]:
    """What to call with each simulated time; shows the flight in the browser where wanted."""
    if not getattr(options, "view", False):
        yield lambda t: None
        return
    from sitl_sim.viewer import Live, Page

    live = Live(f.scenario, f.world, f.folder)
    page = Page(live, port=options.port)
    print(f"live: {page.url}", file=sys.stderr, flush=True)
    page.start()
    try:
        yield lambda t: live.update(t, f.vehicles.p, f.vehicles.q)
    finally:
        page.close()


def _both(
    first: Callable[[float], None], second: Callable[[float], None]
) -> Callable[[float], None]:
    """One callback that calls two."""

    def call(t: float) -> None:
        first(t)
        second(t)

    return call


def _need_viser() -> None:
    """Viewing is an extra; say so at once."""
    from mavlink_bridge.shared.settings import SettingsError

    if importlib.util.find_spec("viser") is None:
        raise SettingsError(["viewing needs viser: pip install 'swarm-companion[view]'"])


def _report(options: argparse.Namespace) -> int:
    from sitl_sim.campaigns.report import is_campaign, make_campaign_report
    from sitl_sim.figures.report import make_report
    from sitl_sim.recording.run_folder import load_run

    gc.disable()  # millions of records that live to the end: looking for rubbish costs a second
    if is_campaign(options.folder):
        print(make_campaign_report(options.folder))
    else:
        print(make_report(load_run(options.folder)))
    return EXIT_OK


def _fly(options: argparse.Namespace, serve: bool) -> int:
    import cv2

    from sitl_sim.flight.results import finish, table
    from sitl_sim.flight.runner import flight
    from sitl_sim.recording.code_version import commit
    from sitl_sim.scenarios import scenario as scenarios

    cv2.setNumThreads(1)
    commit()  # looked up now: what is committed during the flight did not fly
    if getattr(options, "view", False):
        _need_viser()
    overrides = _overrides(options)
    if options.seed is not None:
        overrides.append(f"seed={options.seed}")
    scenario = scenarios.load(options.scenario, overrides)
    folder = options.out or Path("runs") / f"{scenario.name}-{scenario.seed}"
    started = time.monotonic()
    real_time = serve or options.real_time
    in_process = getattr(options, "in_process", False)
    with flight(scenario, folder, real_time, in_process, anew=options.out is None) as f:
        f.write_inputs()
        print("\n".join(f.wire_table()), file=sys.stderr)
        if not serve:
            f.launch()
            try:
                f.wait_for_companions()
            except RuntimeError as error:
                print(error, file=sys.stderr)
                return EXIT_FELL_SHORT
        ready = time.monotonic() - started
        try:
            with (
                progress_bar(scenario.mission.time_limit) as advance,
                _live_page(f, options) as show,
            ):
                f.run(_both(advance, show))
        except KeyboardInterrupt:
            print("interrupted: what was flown is kept", file=sys.stderr)
    metrics = finish(f, ready)
    if getattr(options, "json", False):
        print(json.dumps(metrics, indent=1))
    else:
        print(table(metrics, folder))
    return EXIT_OK if metrics["ok"] else EXIT_FELL_SHORT


def _overrides(options: argparse.Namespace) -> list[str]:
    """What --set, --drones and --controller say, as path.to.key=value."""
    overrides = list(options.overrides)
    if options.drones is not None:
        overrides.append(f"drones.count={options.drones}")
    if getattr(options, "controller", None) is not None:
        overrides.append(f"companion.controller={options.controller}")
    return overrides


class progress_bar:
    """A bar over simulated seconds where a person watches; a line every ten where not."""

    def __init__(self, total: float) -> None:
        from tqdm import tqdm

        self._watched = sys.stderr.isatty()
        self._bar = tqdm(
            total=total,
            unit="s",
            disable=not self._watched,
            leave=False,
            bar_format="{l_bar}{bar}| {n:.0f}/{total:.0f} s flown [{elapsed}]",
        )
        self._said = 0.0

    def __enter__(self) -> progress_bar:
        return self

    def __exit__(self, *exc: object) -> None:
        self._bar.close()

    def __call__(self, t: float) -> None:
        """Simulated time is now t [s]."""
        if self._watched:
            self._bar.update(t - self._bar.n)
        elif t - self._said >= 10.0:
            self._said = t
            print(f"{t:.0f} s flown", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
