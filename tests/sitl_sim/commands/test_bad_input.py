"""Arguments that cannot be used are one clear line and status 2."""

import pytest

from sitl_sim.__main__ import main


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["frames", "frames", "--seed", "-1"], "--seed: must be at least 0, got -1"),
        (["soak", "--seed", "-1"], "--seed: must be at least 0"),
        (["soak", "--hours", "0"], "--hours: must be at least 0.001"),
        (["soak", "--minutes", "nan"], "--minutes: must be at least 0.01"),
    ],
)
def test_an_impossible_argument_is_one_clear_line(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert words in line
