"""An edited source must not fly with the machine code of its old text."""

import os
from pathlib import Path

import pytest

from sitl_sim import drop_stale_kernels


@pytest.mark.parametrize(("edited", "left"), [(50, 3), (150, 1), (250, 1)])
def test_kernels_older_than_a_source_are_removed(tmp_path: Path, edited: int, left: int) -> None:
    cache = tmp_path / "__pycache__"
    cache.mkdir()
    times = {"tables.py": edited, "__pycache__/paint.nbi": 100, "__pycache__/paint.1.nbc": 200}
    for name, time in {**times, "__pycache__/tables.cpython-311.pyc": 10}.items():
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (time, time))
    drop_stale_kernels(tmp_path)
    assert len(list(cache.iterdir())) == left


def test_a_newer_source_outside_the_package_removes_them_too(tmp_path: Path) -> None:
    kernel, other = tmp_path / "package" / "__pycache__" / "paint.nbi", tmp_path / "constants.py"
    kernel.parent.mkdir(parents=True)
    for path, time in ((kernel, 100), (other, 150)):
        path.touch()
        os.utime(path, (time, time))
    drop_stale_kernels(tmp_path / "package")
    assert kernel.exists()
    drop_stale_kernels(tmp_path / "package", other)
    assert not kernel.exists()
