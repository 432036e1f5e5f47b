"""Roots with a release of two drones, alpha and beta."""

import shutil

import pytest

from tests.companion.deployment import deploy, small_wheel, write_drones


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A root with version 1.0 of two drones; copied by the tests that change it."""
    folder = tmp_path_factory.mktemp("first")
    files = write_drones(folder / "drones", ["alpha", "beta"])
    root = folder / "root"
    root.mkdir()
    assert deploy(files, small_wheel(folder / "1", "1.0"), root) == 0
    return folder


@pytest.fixture
def board(first, tmp_path):
    shutil.copytree(first / "root", tmp_path / "root", symlinks=True)
    shutil.copytree(first / "drones", tmp_path / "drones")
    shutil.copytree(first / "1", tmp_path / "1")
    return tmp_path
