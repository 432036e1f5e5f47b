"""The compiled path is cached, shared between weights, and never required."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from companion.control.nmpc import Nmpc, NmpcConfig, compiled, prebuilt
from tests.companion.control.nmpc.scenes import CONFIG, random_scene


@pytest.fixture(autouse=True)
def no_kernels_of_a_wheel(tmp_path, monkeypatch):
    monkeypatch.setattr(prebuilt, "FOLDER", tmp_path / "none")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "swarm-companion"


def needs_compiler():
    if Nmpc(CONFIG).backend != "compiled":
        pytest.skip("no C compiler")


def test_without_a_compiler_piqp_solves(monkeypatch):
    monkeypatch.setattr(compiled.shutil, "which", lambda name: None)
    nmpc = Nmpc(CONFIG)
    assert nmpc.backend == "piqp"
    assert nmpc.solve(random_scene(1)).usable


def test_a_compiler_that_fails_counts_as_none(cache, monkeypatch):
    monkeypatch.setattr(compiled.shutil, "which", lambda name: "/bin/false")
    assert Nmpc(CONFIG).backend == "piqp"


def test_a_cache_that_cannot_be_written_counts_as_none(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert Nmpc(CONFIG).backend == "piqp"


def test_a_user_without_a_home_has_no_cache(monkeypatch):
    def unknown():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", unknown)
    assert Nmpc(CONFIG).backend == "piqp"


def test_one_library_serves_all_weights(cache, monkeypatch):
    needs_compiler()
    assert Nmpc(CONFIG).backend == "compiled"
    assert sorted(p.suffix for p in cache.iterdir()) == [".json", ".so"]

    def refuse(*args: object, **kwargs: object) -> None:
        raise subprocess.SubprocessError

    monkeypatch.setattr(compiled.subprocess, "run", refuse)
    other = NmpcConfig(w_mig=2.0, speed=1.0, penalty=60.0, M=8, delta_omega_max=1.0)
    assert Nmpc(other).backend == "compiled"
    assert Nmpc(NmpcConfig(cylinders=4)).backend == "piqp"


def test_processes_that_start_together_compile_once(cache):
    needs_compiler()
    start = (
        "from companion.control.nmpc import Nmpc, NmpcConfig;"
        "print(Nmpc(NmpcConfig(cylinders=5)).backend)"
    )
    calls = cache.parent / "calls"
    wrapper = cache.parent / "cc"
    wrapper.write_text(f'#!/bin/sh\necho >> {calls}\nexec gcc "$@"\n')
    wrapper.chmod(0o755)
    command = [sys.executable, "-c", start]
    environment = os.environ | {"CC": str(wrapper)}
    running = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) for _ in range(3)]
    assert [p.communicate()[0] for p in running] == [b"compiled\n"] * 3
    assert len(calls.read_text().splitlines()) == 1


def test_a_broken_library_is_compiled_again(cache, monkeypatch):
    if shutil.which("gcc") is None and shutil.which("cc") is None:
        pytest.skip("no C compiler")
    proper = compiled._compile

    def broken(compiler: str, source: str, path: Path) -> None:
        path.write_text("not a library")

    monkeypatch.setattr(compiled, "_compile", broken)
    assert Nmpc(CONFIG).backend == "piqp"
    monkeypatch.setattr(compiled, "_compile", proper)
    assert Nmpc(CONFIG).backend == "compiled"


@pytest.mark.parametrize(
    "sizes",
    [
        {"N": 10, "M": 5, "M_constraint": 10},
        {"N": 40},
        {"neighbours": 0},
        {"neighbours": 9},
        {"cylinders": 0, "planes": 2},
        {"cylinders": 16},
        {"M": 20, "M_constraint": 20},
    ],
)
def test_both_paths_agree_at_other_sizes(sizes):
    config = NmpcConfig(
        **sizes,
        sqp_iterations_cold=100,
        step_tolerance=1e-3,
        work_max=100_000,
    )
    instance = random_scene(3, config)
    a, b = Nmpc(config).solve(instance), Nmpc(config, compiled=False).solve(instance)
    assert a.usable
    assert b.usable
    assert a.x.shape == (config.N + 1, 10)
    np.testing.assert_allclose(a.u, b.u, atol=0.05)
