"""Row 42: the board loses power while a release is installed; a release is not as it was made.

Power is lost by SIGKILL just before each change that the installer makes to the file system. What
the disk had not yet written is kept here, so what is tested is the order of the changes, not fsync.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from companion.board.bundle import make_bundle
from companion.board.installer import SIGNERS, main
from companion.board.journal import HOME, JOURNAL
from companion.board.release_file import BundleError, fill_release, pack, sign, unpack
from companion.settings.config import load_config
from tests.companion.deployment import files_of, launched, small_wheel, write_drones

CHANGES = ("os.rename", "os.remove", "os.symlink", "os.mkdir", "os.rmdir", "subprocess.Popen")
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT
NEVER = 10**9


def install(bundle, root, last, *more):
    """Run the installer in a process that is killed before its change number `last`; its status."""
    process = os.fork()
    if process:
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    changes = 0

    def hook(event, given):
        nonlocal changes
        writes = event == "open" and isinstance(given[2], int) and given[2] & WRITES
        # An environment that is not yet used is one change: it is made by other processes.
        if (event in CHANGES or writes) and "/lib/python3" not in str(given[0]):
            if changes == last:
                os.kill(os.getpid(), signal.SIGKILL)
            changes += 1

    try:
        with open(os.devnull, "w") as nothing, contextlib.redirect_stdout(nothing):  # noqa: PTH123
            sys.addaudithook(hook)
            status = main([str(bundle), "--root", str(root), *more])
    except BaseException:
        status = 99
    os._exit(status)


def recover(root):
    """Do what the board does when it starts again (`swarm-recover.service`)."""
    script = root / HOME / "recover.py"
    if script.exists():
        subprocess.run([sys.executable, "-I", script, "--root", root], check=True)


def state(root):
    """Return what the board runs, and every file that this reads."""
    kept = {}
    for path in sorted((root / "etc").rglob("*")):
        name = str(path.relative_to(root))
        if "swarm-recover" not in name and not path.name.endswith(".part") and not path.is_dir():
            kept[name] = str(path.readlink()) if path.is_symlink() else path.read_bytes()
    launcher = root / HOME / "companion"
    return (launched(root) if launcher.exists() else None), kept


def lose_power(bundle, before, place, *more, until=None, stride=1):
    """Lose power before changes of an installation on a copy of `before`; return how often.

    until: a file below the root whose existence ends the part that is looked at. stride: 1: before
    each change; n: before each n-th.
    """
    whole = copied(before, place / "whole")
    assert install(bundle, whole, NEVER, *more) == 0
    allowed = [state(before), state(whole)]
    assert allowed[0] != allowed[1]
    step, status, ended = 0, None, False
    while status != 0 and not ended:
        root = copied(before, place / "cut")
        status = install(bundle, root, step, *more)
        assert status in (0, -signal.SIGKILL), status
        recover(root)
        assert state(root) in allowed, f"step {step}"
        assert not (root / JOURNAL).exists()
        ended = until is not None and any(root.glob(until))
        if status and step % (25 * stride) == 0:
            assert install(bundle, root, NEVER, *more) == 0
            assert state(root) == allowed[1], f"again after step {step}"
        step += stride
    return step // stride - 1


def copied(root, to):
    shutil.rmtree(to, ignore_errors=True)
    subprocess.run(["cp", "-a", root, to], check=True)
    return to


def with_release(root, other, to):
    """Copy a root, and add the releases of another one, made but not used."""
    copied(root, to)
    for release in (other / HOME / "releases").iterdir():
        if not (to / HOME / "releases" / release.name).exists():
            (to / HOME / "releases").mkdir(parents=True, exist_ok=True)
            shutil.copytree(release, to / HOME / "releases" / release.name, symlinks=True)
    for pip in (to / HOME / "releases").glob("*/lib/python3*/site-packages/*"):
        if "pip" in pip.name or "setuptools" in pip.name:
            shutil.rmtree(pip)  # a thousand files that are used no more
    return to


def row_42(note, stride=13):
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        write_drones(place / "drones", ["alpha", "beta"])
        bundles = {}
        for version in ("1.0", "2.0"):
            for file in files_of(place):
                file.write_text(file.read_text() + f"# as of {version}\n")
            wheel = small_wheel(place / version, version)
            release = fill_release(place / f"release-{version}", wheel)
            drones = [(f, load_config(f)) for f in files_of(place)]
            bundles[version] = make_bundle(place / f"bundle-{version}", drones, release)
        empty, first = place / "empty", place / "first"
        (empty / HOME).mkdir(parents=True)
        (empty / "etc").mkdir()
        assert install(bundles["1.0"], copied(empty, first), NEVER) == 0
        second = copied(first, place / "second")
        # While the release itself is made, nothing that runs is touched.
        making = lose_power(bundles["2.0"], first, place, until=f"{HOME}/releases/2.0-*/.complete")
        assert install(bundles["2.0"], second, NEVER) == 0

        fresh = with_release(empty, first, place / "fresh")
        steps = {"deployment": lose_power(bundles["1.0"], fresh, place, stride=stride)}
        old = with_release(first, second, place / "old")
        steps["upgrade"] = making + lose_power(bundles["2.0"], old, place, stride=stride)
        new = with_release(second, second, place / "new")
        steps["rollback"] = lose_power(bundles["2.0"], new, place, "--rollback", stride=stride)
        assert steps["deployment"] > 60 / stride
        assert steps["upgrade"] > 40 / stride
        assert steps["rollback"] > 10 / stride
        for name, count in steps.items():
            note(f"losses of power, {name}", count)
        a_changed_byte(place, note)


def a_changed_byte(place, note):
    """Change one byte in each file of a signed release."""
    key, signers = place / "key", place / SIGNERS.replace("/", "-")
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
    signers.write_text("release " + key.with_suffix(".pub").read_text())
    release, file, forged = place / "release-2.0", place / "release.tar", place / "forged.tar"
    sign(release, key)
    pack(release, file)
    unpack(file, place / "unpacked", signers)
    with tarfile.open(file) as archive:
        places = [m.offset_data + m.size // 2 for m in archive.getmembers() if m.size]
    said = []
    for n, where in enumerate(places):
        data = bytearray(file.read_bytes())
        data[where] ^= 1
        forged.write_bytes(data)
        try:
            unpack(forged, place / f"forged{n}", signers)
        except BundleError as error:
            said.append(str(error))
    accepted = len(places) - len(said)
    assert accepted == 0
    assert all(len(text.splitlines()) == 1 for text in said)
    note("changed releases taken", accepted)
