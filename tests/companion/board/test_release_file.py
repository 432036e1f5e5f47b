"""A release as a file: the same bytes each time, signed; one changed byte is refused."""

import shutil
import subprocess
import tarfile

import pytest

from companion.__main__ import main
from companion.board.release_file import BundleError, unpack
from tests.companion.deployment import contents, deploy, launched, small_wheel, write_drones

pytestmark = pytest.mark.skipif(
    shutil.which("ssh-keygen") is None, reason="ssh-keygen is missing (Debian: openssh-client)"
)


def make_key(folder, name):
    """Make an ssh key, and a file that trusts it; return both."""
    key = folder / name
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
    signers = folder / f"{name}.signers"
    signers.write_text("release " + key.with_suffix(".pub").read_text())
    return key, signers


def make_release(folder, name, wheel, key=None):
    file = folder / name
    signing = ["--sign", str(key)] if key else []
    command = ["deploy", "--make-release", str(file), "--wheel", str(wheel), *signing]
    assert main(command) == 0
    return file


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A wheel, a key that is trusted, and a signed release."""
    folder = tmp_path_factory.mktemp("made")
    wheel = small_wheel(folder / "wheels", "2.0")
    key, signers = make_key(folder, "key")
    return folder, wheel, key, signers, make_release(folder, "release.tar", wheel, key)


def deploy_release(drones, release, signers, root, *more):
    arguments = ["--release", str(release), "--signers", str(signers), "--root", str(root)]
    return main(["deploy", *map(str, drones), *arguments, *more])


def test_the_same_sources_make_the_same_bytes(made):
    folder, wheel, key, _, release = made
    again = make_release(folder, "again.tar", wheel, key)
    assert again.read_bytes() == release.read_bytes()


def test_a_signed_release_is_deployed_and_its_signers_are_kept(made, tmp_path, capsys):
    _, wheel, _, signers, release = made
    drones = write_drones(tmp_path / "drones", ["alpha"])
    root = tmp_path / "root"
    root.mkdir()
    assert deploy_release(drones, release, signers, root) == 0
    assert launched(root) == "version 2.0"
    assert (root / "etc/swarm-companion/signers").read_text() == signers.read_text()

    # From now on this board takes no release that is not signed, and none of another key.
    before = contents(root)
    assert deploy(drones, wheel, root) == 1
    assert "is not signed, and" in capsys.readouterr().err
    other, others = make_key(tmp_path, "other")
    forged = make_release(tmp_path, "forged.tar", wheel, other)
    assert deploy_release(drones, forged, others, root) == 1
    assert "is not signed by a key of" in capsys.readouterr().err
    assert contents(root) == before


def changed_byte(release, member, to):
    """Write the release with the last byte of one of its files changed."""
    with (
        tarfile.open(release) as before,
        tarfile.open(to, "w", format=tarfile.USTAR_FORMAT) as after,
    ):
        for item in before.getmembers():
            data = bytearray(before.extractfile(item).read())
            if item.name == member:
                data[-1] ^= 1
            part = to.with_name("member")
            part.write_bytes(data)
            with part.open("rb") as content:
                after.addfile(item, content)
    return to


MEMBERS = (
    "__main__.py",
    "board/installer.py",
    "wheel/swarm_companion-2.0-py3-none-any.whl",
    "owned/etc/systemd/system/companion@.service",
    "SHA256SUMS",
    "SHA256SUMS.sig",
)


@pytest.mark.parametrize("member", MEMBERS)
def test_a_changed_byte_is_refused_with_one_line(made, tmp_path, capsys, member):
    _, _, _, signers, release = made
    drones = write_drones(tmp_path / "drones", ["alpha"])
    root = tmp_path / "root"
    root.mkdir()
    forged = changed_byte(release, member, tmp_path / "forged.tar")
    assert deploy_release(drones, forged, signers, root) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"--release {forged}: ")
    assert not list(root.iterdir())


def test_any_changed_byte_is_refused(made, tmp_path):
    """Contents, names, headers, padding, signature: bytes all over the file."""
    _, _, _, signers, release = made
    good = release.read_bytes()
    forged = tmp_path / "forged.tar"
    for n, place in enumerate(range(0, len(good), len(good) // 60)):
        data = bytearray(good)
        data[(place + n % 97) % len(data)] ^= 1 << n % 8
        forged.write_bytes(data)
        with pytest.raises(BundleError, match=rf"^--release {forged}: "):
            unpack(forged, tmp_path / str(n), signers)
    forged.write_bytes(good)
    unpack(forged, tmp_path / "good", signers)


def test_a_file_more_or_less_is_refused(made, tmp_path, capsys):
    _, _, _, signers, release = made
    drones = write_drones(tmp_path / "drones", ["alpha"])
    more = tmp_path / "more.tar"
    shutil.copy(release, more)
    (tmp_path / "json.py").write_text("what Python would import first")
    with tarfile.open(more, "a") as archive:
        archive.add(tmp_path / "json.py", arcname="json.py")
    assert deploy_release(drones, more, signers, tmp_path / "root") == 2
    assert "json.py is not as it was signed" in capsys.readouterr().err
    less = tmp_path / "less.tar"
    less.write_bytes(release.read_bytes()[:4096])
    assert deploy_release(drones, less, signers, tmp_path / "root") == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("kind", ["link", "name"])
def test_an_archive_writes_nothing_elsewhere(made, tmp_path, kind):
    _, _, _, signers, _ = made
    forged = tmp_path / "in/forged.tar"
    forged.parent.mkdir()
    with tarfile.open(forged, "w") as archive:
        item = tarfile.TarInfo("board" if kind == "link" else "../outside")
        item.type, item.linkname = (tarfile.SYMTYPE if kind == "link" else tarfile.REGTYPE), "/etc"
        archive.addfile(item)
    with pytest.raises(BundleError, match="is no plain file"):
        unpack(forged, tmp_path / "in/folder", signers)
    assert not (tmp_path / "in/outside").exists()


def test_a_release_that_is_not_signed_or_not_asked_about_is_refused(made, tmp_path, capsys):
    _, wheel, _, signers, release = made
    drones = write_drones(tmp_path / "drones", ["alpha"])
    plain = make_release(tmp_path, "plain.tar", wheel)
    capsys.readouterr()
    assert deploy_release(drones, plain, signers, tmp_path / "root") == 2
    assert capsys.readouterr().err == f"--release {plain}: is not signed\n"
    root = ["--root", str(tmp_path / "root")]
    assert main(["deploy", *map(str, drones), "--release", str(release), *root]) == 2
    assert "--release needs --signers" in capsys.readouterr().err
