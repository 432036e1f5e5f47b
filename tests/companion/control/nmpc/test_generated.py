"""The code of the stage functions is made once, kept, and read without CasADi."""

import json
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest

from companion.control.nmpc import Nmpc, NmpcConfig, generated, prebuilt
from companion.control.nmpc.layout import Piece
from tests.companion.control.nmpc.scenes import CONFIG, random_scene


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, and no wheel's files."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(prebuilt, "FOLDER", tmp_path / "none")
    return tmp_path / "swarm-companion"


def same(a, b):
    """Return whether two layouts are the same."""
    for name in (f.name for f in fields(a)):
        x, y = getattr(a, name), getattr(b, name)
        if isinstance(x, Piece):
            if x.offset != y.offset or not np.array_equal(x.rows, y.rows):
                return False
            if not np.array_equal(x.columns, y.columns):
                return False
        elif x != y:
            return False
    return True


def test_what_is_kept_is_what_was_made(cache):
    made = generated.generated(CONFIG)
    (kept,) = cache.glob("stage-*.json")
    assert kept.name == generated.file_name(CONFIG)
    read = generated.generated(CONFIG)
    assert read.code == made.code
    assert same(read.layout, made.layout)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"code": "int x;"}', '{"code": 1, "size": "a"}'])
def test_a_file_that_is_no_such_code_is_made_anew(cache, text):
    cache.mkdir()
    path = cache / generated.file_name(CONFIG)
    path.write_text(text)
    assert "linearise" in generated.generated(CONFIG).code
    assert "linearise" in json.loads(path.read_text())["code"]


def test_the_code_depends_on_no_setting_beside_the_sizes():
    code = generated.generate(CONFIG).code
    for name, value in CONFIG.model_dump().items():
        if name in generated.SIZES or isinstance(value, bool) or not isinstance(value, int | float):
            continue
        other = CONFIG.model_copy(update={name: value + 1})
        assert generated.generate(other).code == code, name
        assert generated.file_name(other) == generated.file_name(CONFIG), name


@pytest.mark.parametrize("name", generated.SIZES)
def test_another_size_is_another_file(name):
    other = CONFIG.model_copy(update={name: getattr(CONFIG, name) + 1})
    assert generated.file_name(other) != generated.file_name(CONFIG)


def test_another_casadi_or_another_problem_is_another_file(monkeypatch):
    before = generated.file_name(CONFIG)
    for change in (
        lambda: monkeypatch.setattr(generated.metadata, "version", lambda name: "0.0"),
        lambda: monkeypatch.setattr(generated, "_SOURCES", generated._SOURCES[1:]),
    ):
        with monkeypatch.context():
            change()
            generated._recipe.cache_clear()
            assert generated.file_name(CONFIG) != before
        monkeypatch.undo()
        generated._recipe.cache_clear()
    assert generated.file_name(CONFIG) == before


def test_a_second_start_does_not_load_casadi(cache):
    if Nmpc(NmpcConfig()).backend != "compiled":
        pytest.skip("needs a C compiler")
    program = (
        "import sys; from companion.control.nmpc import Nmpc, NmpcConfig;"
        "import companion.process.daemon;"
        "assert Nmpc(NmpcConfig()).backend == 'compiled'; print('casadi' in sys.modules)"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=300
    )
    assert run.stdout.strip() == "False"


def test_kept_code_solves_as_new_code_does(cache):
    plans = [Nmpc(NmpcConfig()).solve(random_scene(3, NmpcConfig())) for _ in range(2)]
    np.testing.assert_array_equal(plans[0].u, plans[1].u)
