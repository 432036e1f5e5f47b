"""Plain files out of an archive: with their times, and nothing else."""

import io
import tarfile

import pytest

from mavlink_bridge.shared.archives import extract


def archive(*members):
    """An archive of (name, type, mode, time, content)."""
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as tar:
        for name, kind, mode, time, content in members:
            member = tarfile.TarInfo(name)
            member.type, member.mode, member.mtime, member.size = kind, mode, time, len(content)
            member.linkname = "/etc/passwd"
            tar.addfile(member, io.BytesIO(content))
    file.seek(0)
    return tarfile.open(fileobj=file)


def test_files_have_their_content_times_and_whether_they_run(tmp_path):
    plain, runs = ("a.txt", b"0", 0o4600, 1000, b"x\ny"), ("b/c.sh", b"0", 0o6711, 2000, b"")
    with archive(plain, runs) as tar:
        extract(tar, tar, tmp_path)
    a, c = tmp_path / "a.txt", tmp_path / "b/c.sh"
    assert (a.read_bytes(), c.read_bytes()) == (b"x\ny", b"")
    assert (a.stat().st_mtime, c.stat().st_mtime) == (1000, 2000)
    assert (a.stat().st_mode & 0o7777, c.stat().st_mode & 0o7777) == (0o644, 0o755)


@pytest.mark.parametrize(
    ("name", "kind"),
    [("../a", b"0"), ("b/../../a", b"0"), ("a", b"1"), ("a", b"2"), ("a", b"5"), ("a", b"6")],
)
def test_what_is_no_plain_file_or_leads_elsewhere_is_refused(tmp_path, name, kind):
    place = tmp_path / "place"
    place.mkdir()
    with (
        archive((name, kind, 0o644, 0, b"")) as tar,
        pytest.raises(tarfile.TarError, match="is no plain file"),
    ):
        extract(tar, tar, place)
    assert [p.name for p in tmp_path.rglob("*")] == ["place"]


def test_only_the_members_named_are_written(tmp_path):
    with archive(("a", b"0", 0o644, 0, b"1"), ("b", b"0", 0o644, 0, b"2")) as tar:
        extract(tar, [tar.getmember("b")], tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["b"]
