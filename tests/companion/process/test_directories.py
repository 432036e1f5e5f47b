"""Where the flight log and the state file go."""

from datetime import UTC, datetime
from pathlib import Path

from companion.process.directories import ControlMark, StateFile, log_path


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


def test_a_daemon_that_is_cut_off_in_control_leaves_a_mark(tmp_path):
    board = {"STATE_DIRECTORY": str(tmp_path)}
    first = ControlMark(board)
    assert not first.left_behind
    first.note(False)
    assert not ControlMark(board).left_behind
    first.note(True)
    assert ControlMark(board).left_behind
    first.note(False)  # given back
    assert not ControlMark(board).left_behind
    first.note(True)
    second = ControlMark(board)  # the first one was killed
    second.note(False)
    assert ControlMark(board).left_behind  # it has neither flown nor been stopped
    second.clear()
    assert not ControlMark(board).left_behind


def test_without_a_state_directory_there_is_no_mark(tmp_path):
    for board in ({}, {"STATE_DIRECTORY": str(tmp_path / "gone")}):
        mark = ControlMark(board)
        mark.note(True)  # and no error
        assert not ControlMark(board).left_behind
        mark.clear()
