"""A release as a file: a wheel, the installer, units, lock files, and their hashes, signed.

The same sources make the same bytes. The hashes are checked, and the signature where one is asked
for, before anything of a release is used: here by `unpack`, on the board by `transport.py`.
`ssh-keygen -Y` signs and verifies: it is on every machine that deploys or is deployed to.
"""

from __future__ import annotations

import base64
import filecmp
import hashlib
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

import companion
from companion.board import installer, journal
from companion.settings.packaged import data_folder
from mavlink_bridge.shared.archives import extract

SUMS, SIGNATURE = "SHA256SUMS", "SHA256SUMS.sig"
NAMESPACE, IDENTITY = "swarm-companion", "release"
UNITS = "etc/systemd/system"
RULES = "etc/udev/rules.d"
_LINE = 70  # characters of a line of a signature
_LOCKS = "companion/board/locks/"
_WHEEL_PARTS = 5  # at least; a build number is one more
_INSTALLER = (
    *("__init__.py", "account.py", "changes.py", "installer.py", "journal.py"),
    *("prune.py", "release.py", "services.py"),
)
# `python3 BUNDLE` is the installer.
_MAIN = "import sys\n\nfrom board.installer import main\n\nsys.exit(main())\n"
# By its real path: a running daemon must not see an upgrade.
_LAUNCHER = """#!/bin/sh
home=$(dirname "$(readlink -f "$0")")
exec "$(readlink -f "$home/current")/bin/python" -I -m {module} "$@"
"""


class BundleError(ValueError):
    """A file that cannot be shipped; the message says why."""


def build_wheel(folder: Path) -> Path:
    """Return the wheel of the checkout that this code runs from.

    Raises:
        BundleError: there is no checkout, or its wheel does not build.
    """
    checkout = Path(companion.__file__).parents[1]
    if not (checkout / "pyproject.toml").exists():
        raise BundleError("not run from a checkout: name the wheel to install with --wheel")
    options = ["--quiet", "--no-deps", "--wheel-dir", str(folder)]
    command = [sys.executable, "-m", "pip", "wheel", *options, str(checkout)]
    built = subprocess.run(command, capture_output=True, text=True)
    if built.returncode:
        raise BundleError(f"the wheel does not build: {built.stderr.strip()[-500:]}")
    return next(folder.glob("*.whl"))


def release_name(wheel: Path) -> str:
    """Return version and hash of a wheel: the same wheel is the same release.

    Raises:
        BundleError: there is no such file, or its name is not that of a wheel.
    """
    parts = wheel.name.split("-")
    if wheel.suffix != ".whl" or len(parts) < _WHEEL_PARTS:
        raise BundleError(
            f"--wheel {wheel}: must be named as a wheel, NAME-VERSION-PYTHON-ABI-PLATFORM.whl"
        )
    try:
        content = wheel.read_bytes()
    except OSError as error:
        raise BundleError(f"--wheel {wheel}: cannot be read: {error.strerror}") from error
    return f"{parts[1]}-{hashlib.sha256(content).hexdigest()[:10]}"


def fill_release(folder: Path, wheel: Path, wheelhouse: Path | None = None) -> Path:
    """Fill `folder` with a release, and return it.

    wheelhouse: wheels of all dependencies, for a board without internet.

    Raises:
        BundleError: no such wheel, or one without lock files.
    """
    release_name(wheel)
    for name in _INSTALLER:
        copy(Path(installer.__file__).with_name(name), folder / "board" / name)
    (folder / "__main__.py").write_text(_MAIN)
    copy(wheel, folder / "wheel" / wheel.name)
    with zipfile.ZipFile(wheel) as archive:
        locks = [n for n in archive.namelist() if n.startswith(_LOCKS)]
        if not locks:
            raise BundleError(f"--wheel {wheel}: has no lock files; build it from this version")
        (folder / "locks").mkdir()
        for name in locks:
            (folder / "locks" / Path(name).name).write_bytes(archive.read(name))
    if wheelhouse is not None:
        shutil.copytree(wheelhouse, folder / "wheelhouse")
    _put_units(folder / "owned")
    lines = [f"{_sha256(folder / name)}  {name}\n" for name in _files(folder)]
    (folder / SUMS).write_text("".join(lines))
    return folder


def _put_units(owned: Path) -> None:
    for source in sorted(data_folder("systemd").iterdir()):
        place = RULES if source.suffix == ".rules" else UNITS
        copy(source, owned / place / source.name)
    for name, module in (("companion", "companion"), ("mavlink-bridge", "mavlink_bridge")):
        launcher = owned / journal.HOME / name
        launcher.parent.mkdir(parents=True, exist_ok=True)
        launcher.write_text(_LAUNCHER.format(module=module))
        launcher.chmod(0o755)
        launcher.chmod(0o755)
    recover = owned / installer.RECOVERY[0]
    copy(Path(journal.__file__), recover)


def sign(folder: Path, key: Path) -> None:
    """Sign a release by an ssh key of type ed25519; its agent or ssh-keygen asks for a passphrase.

    Raises:
        BundleError: no such key, or ssh-keygen is missing.
    """
    (folder / SIGNATURE).unlink(missing_ok=True)
    _ssh_keygen(["-Y", "sign", "-q", "-f", str(key), "-n", NAMESPACE, str(folder / SUMS)], key)


def pack(folder: Path, file: Path) -> None:
    """Write a release into a tar file: names in order, no times, no owners."""
    with tarfile.open(file, "w", format=tarfile.USTAR_FORMAT) as archive:
        for name in [
            *_files(folder),
            SUMS,
            *([SIGNATURE] if (folder / SIGNATURE).exists() else []),
        ]:
            archive.add(folder / name, arcname=name, filter=plain)


def plain(member: tarfile.TarInfo) -> tarfile.TarInfo:
    """Return a member without what differs from one build to the next."""
    member.mtime, member.uid, member.gid, member.uname, member.gname = 0, 0, 0, "", ""
    member.mode = 0o755 if member.isdir() or member.mode & 0o100 else 0o644
    return member


def unpack(file: Path, folder: Path, signers: Path) -> Path:
    """Unpack a release whose signature and hashes hold, and return its folder.

    Raises:
        BundleError: a file that is missing, forged, or changed by one byte.
    """
    try:
        with tarfile.open(file) as archive:
            extract(archive, archive, folder)
    except (OSError, tarfile.TarError, EOFError) as error:
        raise BundleError(f"--release {file}: cannot be read: {error}") from error
    if not (folder / SUMS).is_file() or not (folder / SIGNATURE).is_file():
        raise BundleError(f"--release {file}: is not signed")
    sums = (folder / SUMS).read_bytes()
    command = ["-Y", "verify", "-f", str(signers), "-I", IDENTITY, "-n", NAMESPACE]
    _ssh_keygen(
        [*command, "-s", str(folder / SIGNATURE)],
        file,
        sums,
        f"--release {file}: is not signed by a key of {signers}",
    )
    named = {
        name: value for value, _, name in (s.partition("  ") for s in sums.decode().splitlines())
    }
    found = {name: _sha256(folder / name) for name in _files(folder)}
    for name in sorted({*named, *found}):
        if named.get(name) != found.get(name):
            raise BundleError(f"--release {file}: {name} is not as it was signed")
    # Headers and padding of the archive, which nothing signs, are as `pack` writes them.
    with tempfile.TemporaryDirectory() as place:
        again = Path(place) / "again.tar"
        pack(folder, again)
        same = filecmp.cmp(again, file, shallow=False)
    if not (same and _canonical((folder / SIGNATURE).read_text(errors="replace"))):
        raise BundleError(f"--release {file}: is not as it was made")
    return folder


def _canonical(signature: str) -> bool:
    """Return whether a signature is written as ssh-keygen writes it: one text for one signature."""
    begin, end = "-----BEGIN SSH SIGNATURE-----\n", "-----END SSH SIGNATURE-----\n"
    lines = signature.removeprefix(begin).removesuffix(end).splitlines()
    try:
        text = base64.b64encode(base64.b64decode("".join(lines), validate=True)).decode()
    except ValueError:
        return False
    wrapped = "".join(f"{text[i : i + _LINE]}\n" for i in range(0, len(text), _LINE))
    return signature == begin + wrapped + end


def copy(source: Path, to: Path) -> None:
    """Copy a file's bytes; the folders above are made."""
    to.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, to)


def _files(folder: Path) -> list[str]:
    """Return the names of all files that the hashes name, in order."""
    names = sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if not p.is_dir())
    return [name for name in names if name not in (SUMS, SIGNATURE)]


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _ssh_keygen(
    arguments: list[str], subject: Path, given: bytes = b"", said: str | None = None
) -> None:
    """Run ssh-keygen; said: what its failure means.

    Raises:
        BundleError: it failed, or is not there.
    """
    try:
        done = subprocess.run(["ssh-keygen", *arguments], input=given, capture_output=True)
    except OSError as error:
        raise BundleError(f"{subject}: ssh-keygen is needed (Debian: openssh-client)") from error
    if done.returncode:
        text = " ".join((done.stderr or done.stdout).decode(errors="replace").split())
        raise BundleError(said or f"--sign {subject}: {text}")
