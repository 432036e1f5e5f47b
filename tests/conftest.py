"""Tests marked `row(name)` are rows of the fault matrix; `--fault-table FILE` writes what came."""

from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, however slow the machine; `make fuzz` looks for new ones.
settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")

HERE = Path(__file__).parent
_HEAD = HERE / "closed_loop" / "matrix" / "matrix.md"
_results = {}  # row → [(test, outcome, seconds, [what was measured])]


def pytest_addoption(parser):
    parser.addoption("--fault-table", metavar="FILE", help="write rows and results of the matrix")


@pytest.fixture(autouse=True)
def _row(request, record_property):
    marker = request.node.get_closest_marker("row")
    if marker is not None:
        record_property("row", marker.args[0])


@pytest.fixture
def note(record_property):
    """What a row measured: note("slow", 0.4); None where there is no time to tell."""

    def say(what, value):
        record_property("measured", what if value is None else f"{what}: {value:.2f}")

    return say


def pytest_runtest_logreport(report):
    rows = [v for k, v in report.user_properties if k == "row"]
    if rows and (report.when == "call" or report.outcome != "passed"):
        measured = [v for k, v in report.user_properties if k == "measured"]
        name = report.nodeid.split("/")[-1]
        _results.setdefault(str(rows[0]), []).append((name, report.outcome, measured))


def pytest_sessionfinish(session):
    target = session.config.getoption("--fault-table", default=None)
    if target and _results:
        page = Path(target)
        before = page.read_text(encoding="utf-8") if page.exists() else ""
        page.write_text(_table(_HEAD.read_text(encoding="utf-8"), before), encoding="utf-8")


def _table(text, before):
    """The page with a result behind each row; its rows begin with `| number |`.

    A row of which nothing was run now keeps what the page before says.
    """
    out, old = [], {}
    for line in before.splitlines():
        cells = line.split(" | ")
        if line.startswith("|") and len(cells) == 6:
            old[cells[0].strip("| ")] = " | ".join(cells[4:])
    for line in text.splitlines():
        number = line.split("|")[1].strip() if line.startswith("|") else ""
        if number.isdigit():
            line = f"{line.rstrip()} {_cell(number) or old.get(number, 'not run | |')}"
        out.append(line)
    return "\n".join(out) + "\n"


def _cell(number):
    tests = [t for row, ts in _results.items() for t in ts if row.split("_")[0] == number]
    if not tests:
        return ""
    worst = {"passed": "holds", "skipped": "skipped", "failed": "**fails**"}
    outcome = next(o for o in ("failed", "skipped", "passed") if any(t[1] == o for t in tests))
    measured = dict.fromkeys(m for t in tests for m in t[2])
    return f"{worst[outcome]} ({len(tests)}) | {'; '.join(measured) or '–'} |"
