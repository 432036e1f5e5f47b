"""Where the flight log and the state file go."""

from datetime import UTC, datetime
from pathlib import Path

from companion.process.directories import StateFile, log_path


def test_where_the_log_goes():
    now = datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC)
    board = {"LOGS_DIRECTORY": "/var/log/x"}
    stamped = "flight-20260304T050607Z.mcap"
    assert log_path("flight-{time}.mcap", board, now) == Path("/var/log/x") / stamped
    assert log_path("flight-{time}.mcap", {}, now) == Path(stamped)
    assert log_path("/mnt/card/a.mcap", board, now) == Path("/mnt/card/a.mcap")


def test_the_state_file(tmp_path):
    state = StateFile({"RUNTIME_DIRECTORY": str(tmp_path)})
    assert state.write(phase="fly", armed=True)
    file = tmp_path / "state.json"
    assert '"armed": true' in file.read_text()
    first = file.stat().st_mtime_ns
    assert not state.write(phase="fly", armed=True)
    assert file.stat().st_mtime_ns == first
    StateFile({"RUNTIME_DIRECTORY": str(tmp_path / "gone")}).write(phase="fly")  # and no error
