"""Files are replaced as a whole or not at all, and nothing but files is replaced."""

import os
import stat

import pytest

from spin_rl import files


def fail(file):
    file.write(b"half of")
    raise OSError(28, "No space left on device")


def test_a_failure_names_the_file_and_leaves_the_old_one_alone(tmp_path):
    path = tmp_path / "result.json"
    files.write_text(path, "old")
    with pytest.raises(OSError, match="No space left") as error:
        files.write_atomically(path, fail)
    assert files.reason(error.value) == f"{path}: No space left on device"
    assert path.read_text() == "old" and [*tmp_path.iterdir()] == [path]


def test_of_a_link_the_target_is_replaced(tmp_path):
    target, link = tmp_path / "there" / "target", tmp_path / "link"
    link.symlink_to(target)
    for text in ("first", "second"):
        files.write_text(link, text)
        assert link.is_symlink() and target.read_text() == text


@pytest.mark.parametrize(
    "kind", ["fifo", "device", "folder", "long name", "below a file", "link to a device"]
)
def test_what_is_no_file_is_refused_and_stays(tmp_path, kind):
    path = {"device": "/dev/null", "long name": tmp_path / ("a" * 300)}.get(kind, tmp_path / "x")
    path = type(tmp_path)(path)
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "below a file":
        path.touch()
        path = path / "y"
    elif kind == "link to a device":
        path.symlink_to("/dev/null")
    for write in (files.check_writable, lambda at: files.write_text(at, "text")):
        with pytest.raises(OSError) as error:
            write(path)
        assert str(path) in files.reason(error.value)
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    assert not [*tmp_path.glob(".*.tmp")]


def test_two_writers_do_not_share_a_temporary_file(tmp_path):
    path = tmp_path / "x"

    def write(file):
        files.write_text(path, "inner")  # another process, as it were
        file.write(b"outer")

    files.write_atomically(path, write)
    assert path.read_text() == "outer" and [*tmp_path.iterdir()] == [path]


def test_what_a_killed_process_left_is_removed(tmp_path):
    left = files.temporary_beside(tmp_path / "last.pt")
    left.touch()
    (tmp_path / ".lock").touch()
    files.remove_temporary(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]
