"""Tests marked `row(name)` are rows of the fault matrix; `--fault-table FILE` writes what came."""

import signal
import subprocess
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, however slow the machine; `make fuzz` looks for new ones.
settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")

HERE = Path(__file__).parent
_HEAD = HERE / "closed_loop" / "matrix" / "matrix.md"
_WITHOUT = "| without "  # how a line of the second table begins
_MADE = "Made at "  # how the line begins that says by which tests
_tests = {}  # of each test that counts, by its name: (outcome, properties)


def pytest_sessionstart():
    """Let Ctrl-C reach the programs under test, also where a job in the background ignores it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    parser.addoption("--fault-table", metavar="FILE", help="write rows and results of the matrix")


@pytest.fixture(autouse=True)
def _row(request, record_property):
    marker = request.node.get_closest_marker("row")
    if marker is not None:
        record_property("row", marker.args[0])


@pytest.fixture
def note(record_property):
    """What a row measured: note("slow", 0.4); None where there is no time to tell.

    Of many flights the table shows the worst: the largest, or the smallest of what is `least …`.
    """

    def say(what, value):
        record_property("measured", (what, None if value is None else float(value)))

    return say


def pytest_runtest_logreport(report):
    found = {k: [v for name, v in report.user_properties if name == k]
             for k in ("row", "measured", "forest", "alone", "without")}  # fmt: skip
    counts = report.when == "call" or report.outcome != "passed"
    if counts and (found["row"] or found["without"]):
        _tests[report.nodeid] = (report.outcome, found)


def pytest_sessionfinish(session):
    target = session.config.getoption("--fault-table", default=None)
    if target and _tests:
        # The table can be made in pieces: what earlier runs found stands until it is run again.
        commit = _commit()
        now = {
            name: (outcome, found | {"commit": commit}) for name, (outcome, found) in _tests.items()
        }
        kept = session.config.cache.get("faults", {}) | now
        session.config.cache.set("faults", kept)
        _tests.update(kept)
        page = Path(target)
        before = page.read_text(encoding="utf-8") if page.exists() else ""
        page.write_text(_page(_HEAD.read_text(encoding="utf-8"), before), encoding="utf-8")


def _page(text, before):
    """The page with a result behind each row; its rows begin with `| number |`.

    A row of which nothing was run now keeps what the page before says, so do the mutations.
    """
    out, old = [], {}
    for line in before.splitlines():
        cells = line.split(" | ")
        if line.startswith("|") and len(cells) == 7:
            old[cells[0].strip("| ")] = " | ".join(cells[4:])
    for line in text.splitlines():
        number = line.split("|")[1].strip() if line.startswith("|") else ""
        if number.isdigit():
            line = f"{line.rstrip()} {_cells(number) or old.get(number, 'not run | – | – |')}"
        if line.startswith(_MADE):
            line = f"{_MADE}{_made()}."
        out += _mutations(before) if line.startswith(_WITHOUT) else [line]
    return "\n".join(out) + "\n"


def _commit():
    """The commit that is tested; + where the tree differs from it."""

    def git(*args):
        return subprocess.run(["git", *args], cwd=HERE, capture_output=True, text=True).stdout

    changed = git("status", "--porcelain", "--untracked-files=no", ":/", ":!/docs")
    return git("rev-parse", "--short", "HEAD").strip() + "+" * bool(changed.strip())


def _made():
    """By how many tests, at which commits."""
    commits = {found["commit"] for _, found in _tests.values()}
    failed = sum(outcome == "failed" for outcome, _ in _tests.values())
    return f"{', '.join(sorted(commits))}: {len(_tests)} tests, {failed} failed"


def _cells(number):
    """Result and number of tests, flights in the forest, what was measured at worst."""
    tests = [(outcome, found) for outcome, found in _tests.values()
             if any(r.split("_")[0] == number for r in found["row"])]  # fmt: skip
    if not tests:
        return ""
    worst = {"passed": "holds", "skipped": "skipped", "failed": "**fails**"}
    outcome = next(o for o in ("failed", "skipped", "passed") if any(t[0] == o for t in tests))
    failed = sum(t[0] == "failed" for t in tests)
    count = f"{failed} of {len(tests)}" if failed else f"{len(tests)}"
    flights = [tuple(f) for _, found in tests for f in found["forest"]]
    three, nine = ({f for f in flights if f[0] == n} for n in (3, 9))
    alone = {seed for _, found in tests for seed in found["alone"]}
    shown = [
        f"{len({seed for _, seed in three})} seeds" if three else "",
        f"{len(nine)} × 9" if nine else "",
        f"alone: {len(alone)} seeds" if alone else "",
    ]
    forest = "; ".join(filter(None, shown)) or "–"
    least = {}
    for what, value in (m for _, found in tests for m in found["measured"]):
        pick = min if what.startswith("least") else max
        least[what] = value if least.get(what) is None else pick(least[what], value)
    measured = "; ".join(w if v is None else f"{w}: {v:.2f}" for w, v in least.items())
    return f"{worst[outcome]} ({count}) | {forest} | {measured or '–'} |"


def _mutations(before):
    """A line for each mechanism that was taken out: what its row said then."""
    now = [f"{_WITHOUT}{name} | {said} |" if outcome == "passed" else
           f"{_WITHOUT}{name} | **the row holds all the same** |"
           for outcome, found in _tests.values()
           for name, said in found["without"]]  # fmt: skip
    old = [line for line in before.splitlines() if line.startswith(_WITHOUT)]
    return now or old or [f"{_WITHOUT}anything | not run |"]
