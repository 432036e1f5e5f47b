"""Changes of files and links, and their undoing."""

from companion.board.changes import Changes


def test_files_that_are_put_back_are_as_they_were(tmp_path):
    launcher, key, new = (tmp_path / n for n in ("launcher", "key", "new"))
    for file, mode in ((launcher, 0o755), (key, 0o600)):
        file.write_bytes(b"old")
        file.chmod(mode)
    changes = Changes(tmp_path)
    for file in (launcher, key, new):
        changes.write(file, b"new")
    changes.link(key, "elsewhere")
    changes.undo()
    assert not new.exists()
    assert [f.read_bytes() for f in (launcher, key)] == [b"old", b"old"]
    assert [f.stat().st_mode & 0o777 for f in (launcher, key)] == [0o755, 0o600]
