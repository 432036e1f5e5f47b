"""From the source tree to the air: sdist and wheel, an empty root, a flight from there."""

import json
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from companion.__main__ import main
from tests.companion.deployment import contents
from tests.companion.patience import PATIENCE

SOURCE = Path(__file__).parents[3]
DEPLOYED = "opt/swarm-companion"
SIZE_MAX = 450e6  # bytes


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel as a user gets it: from the sdist, not from the checkout."""
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run([sys.executable, "-m", "build", "--outdir", folder, SOURCE], check=True)
    assert len(list(folder.glob("swarm_companion-*.tar.gz"))) == 1
    return next(folder.glob("*.whl"))


def changed(wheel, folder):
    """The same wheel with one line more: an upgrade."""
    folder.mkdir()
    other = folder / wheel.name
    with zipfile.ZipFile(wheel) as before, zipfile.ZipFile(other, "w") as after:
        for item in before.infolist():
            data = before.read(item)
            if item.filename == "companion/__init__.py":
                data += b"\nUPGRADED = True\n"
            after.writestr(item, data)
    return other


def upgraded(root):
    return (
        subprocess.run(
            [
                root / DEPLOYED / "current/bin/python",
                "-I",
                "-c",
                "import companion; print(hasattr(companion, 'UPGRADED'))",
            ],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        == "True"
    )


@pytest.mark.timeout(600)
def test_deployed_flown_upgraded_rolled_back(wheel, world, start_daemon, tmp_path, capsys):
    root = tmp_path / "root"
    root.mkdir()
    files = [world.config(i, auto=True) for i in (1, 2)]
    arguments = ["deploy", *map(str, files), "--root", str(root), "--allow-auto", "--json"]

    assert main([*arguments, "--wheel", str(wheel)]) == 0
    outcome = json.loads(capsys.readouterr().out)[0]
    assert outcome["changed"]
    size = sum(f.lstat().st_size for f in (root / DEPLOYED).rglob("*") if not f.is_symlink())
    assert size < SIZE_MAX, f"{size / 1e6:.0f} MB"

    # A packaged example is fine by the deployed release, far from any checkout.
    python = [root / DEPLOYED / "current/bin/python", "-I", "-m", "companion"]
    listed = subprocess.run([*python, "config", "examples"], capture_output=True, text=True)
    examples = listed.stdout.split()
    assert str(root) in examples[0]
    subprocess.run([*python, "check", *examples], check=True, cwd=tmp_path)

    # Both drones fly from there, each under its supervisor.
    daemons = [
        start_daemon(
            root / f"etc/swarm-companion/drone{i}/drone{i}.yaml",
            command=[root / DEPLOYED / "companion"],
            cwd=tmp_path,
        )
        for i in (1, 2)
    ]
    for daemon in daemons:
        assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    for daemon in daemons:
        daemon.until_phase("fly")

    # An upgrade under way does not reach into what flies; then one is rolled back.
    newer = changed(wheel, tmp_path / "newer")
    assert main([*arguments, "--wheel", str(newer)]) == 0
    assert upgraded(root)
    for daemon in daemons:
        daemon.process.send_signal(signal.SIGTERM)
        assert daemon.process.wait(PATIENCE) == 0, daemon.log()
    before = contents(root)
    assert main([*arguments, "--wheel", str(newer), "--rollback"]) == 0
    assert not upgraded(root)
    kept = contents(root)
    links = {f"{DEPLOYED}/current", f"{DEPLOYED}/previous"}
    assert {k: v for k, v in kept.items() if k not in links} == {
        k: v for k, v in before.items() if k not in links
    }
    shutil.rmtree(root)  # 360 MB that pytest would keep
