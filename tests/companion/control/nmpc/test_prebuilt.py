"""Kernels that come compiled: chosen by what the processor can do, and solving as others do."""

import platform
import shutil
from pathlib import Path

import numpy as np
import pytest

from companion.control.nmpc import Nmpc, NmpcConfig, compiled, prebuilt
from companion.control.nmpc.build_kernels import build
from companion.control.nmpc.prebuilt import LEVELS, load, processor_flags
from tests.companion.control.nmpc.scenes import CONFIG, random_scene

HERE = platform.machine()
# As `cat /proc/cpuinfo` prints on them.
PI_4 = "processor\t: 0\nFeatures\t: fp asimd evtstrm crc32 cpuid\nCPU part\t: 0xd08\n"
PI_5 = (
    "processor\t: 0\nFeatures\t: fp asimd evtstrm aes pmull sha1 sha2 crc32 atomics fphp asimdhp "
    "cpuid asimdrdm lrcpc dcpop asimddp\nCPU part\t: 0xd0b\n"
)
NEHALEM = "processor\t: 0\nflags\t\t: fpu sse sse2 ssse3 cx16 sse4_1 sse4_2 popcnt lahf_lm\n"


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    """A folder with the kernels of this machine's kind of processor."""
    if HERE not in LEVELS or shutil.which("gcc") is None:
        pytest.skip(f"needs gcc on one of {', '.join(LEVELS)}")
    folder = tmp_path_factory.mktemp("wheel") / "kernels"
    built = [path.suffix for path in build(folder, [HERE])]
    assert (built.count(".so"), built.count(".json")) == (2 * len(LEVELS[HERE]), 1)
    return folder


@pytest.fixture
def no_compiler(kernels, monkeypatch):
    """A machine with a wheel's kernels and without a compiler."""
    monkeypatch.setattr(prebuilt, "FOLDER", kernels)
    monkeypatch.setattr(compiled.shutil, "which", lambda name: None)


@pytest.mark.parametrize(
    ("machine", "cpuinfo", "best"),
    [
        ("aarch64", PI_4, "v8.0"),
        ("aarch64", PI_5, "v8.2"),
        ("x86_64", NEHALEM, "v2"),
        ("x86_64", "no flags at all", None),
        ("riscv64", "isa : rv64imafdc", None),
    ],
)
def test_the_best_kernel_that_the_processor_can_run(machine, cpuinfo, best, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(prebuilt.ctypes, "CDLL", lambda path: opened.append(Path(path).name))
    monkeypatch.setattr(prebuilt.platform, "machine", lambda: machine)
    monkeypatch.setattr(prebuilt, "_cpuinfo", lambda: cpuinfo)
    monkeypatch.setattr(prebuilt, "FOLDER", tmp_path)
    for level in LEVELS.get(machine, ()):
        (tmp_path / prebuilt.file_name(machine, level, "code")).touch()
    load("other code")
    load("code")
    assert [name.rsplit("-", 1)[0] for name in opened] == (
        [] if best is None else [f"{machine}-{best}"]
    )


def test_every_kernel_that_this_processor_can_run_solves_as_the_fallback_does(
    no_compiler, monkeypatch
):
    flags = processor_flags(Path("/proc/cpuinfo").read_text())
    able = [level for level in LEVELS[HERE] if level.needs <= flags]
    assert able, "no kernel for this processor"
    config = NmpcConfig(work_max=100_000)  # PIQP takes more iterations
    plans = []
    for level in able:
        monkeypatch.setitem(LEVELS, HERE, (level,))
        nmpc = Nmpc(config)
        assert nmpc.backend == "compiled"
        plans.append(nmpc.solve(random_scene(3, config)))
    monkeypatch.setattr(prebuilt, "FOLDER", Path("none"))
    fallback = Nmpc(config, compiled=False)
    assert fallback.backend == "piqp"
    plans.append(fallback.solve(random_scene(3, config)))
    assert all(plan.usable for plan in plans)
    for plan in plans[:-1]:
        np.testing.assert_allclose(plan.u, plans[-1].u, atol=0.05)


def test_programmes_of_any_size_are_solved_by_the_wheel(no_compiler, monkeypatch):
    """Without a kernel of the problem, CasADi's virtual machine does the rest."""
    config = NmpcConfig(cylinders=CONFIG.cylinders + 1, N=25, work_max=100_000)
    wheel = Nmpc(config)
    monkeypatch.setattr(prebuilt, "FOLDER", Path("none"))
    fallback = Nmpc(config)
    assert (wheel.backend, fallback.backend) == ("wheel", "piqp")
    for seed in range(3):
        instance = random_scene(seed, config)
        found, expected = wheel.solve(instance), fallback.solve(instance)
        wheel.reset()
        fallback.reset()
        np.testing.assert_allclose(found.u, expected.u, atol=0.05)


def test_a_kernel_that_cannot_be_opened_is_passed_over(kernels, tmp_path, no_compiler, monkeypatch):
    spoilt = shutil.copytree(kernels, tmp_path / "kernels")
    monkeypatch.setattr(prebuilt, "FOLDER", spoilt)
    for path in spoilt.glob("*.so"):
        path.write_text("not a library")
    assert Nmpc(CONFIG).backend == "piqp"
