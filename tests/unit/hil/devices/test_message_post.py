"""Messages as files: other files are skipped and reported once."""

import os

import pytest

from hil.devices.message_post import FROM_BOAT, MessagePost

IMEI = "300234010753370"


@pytest.fixture
def post(tmp_path):
    return MessagePost(tmp_path, FROM_BOAT)


def name(number):
    return f"{IMEI}_{number:06d}.sbd"


def test_oldest_message_is_taken_first(post):
    for number, age_s in ((1, 10), (2, 30), (3, 20)):
        post.put(IMEI, number, b"%d" % number)
        os.utime(post.directory / name(number), (1e9 - age_s, 1e9 - age_s))
    assert list(post.take()) == [(IMEI, 2, b"2"), (IMEI, 3, b"3"), (IMEI, 1, b"1")]
    assert list(post.take()) == []
    assert post.problems == []


@pytest.mark.parametrize(
    "create",
    [
        lambda path: path.symlink_to("missing"),
        lambda path: path.symlink_to(path.name),
        lambda path: path.symlink_to("other"),
        lambda path: path.mkdir(),
        os.mkfifo,
        lambda path: path.write_bytes(bytes(1961)),
    ],
    ids=["dangling-link", "link-to-itself", "link", "directory", "pipe", "too-long"],
)
def test_other_files_are_reported_once(post, create):
    (post.directory / "other").write_bytes(b"x")
    create(post.directory / name(1))
    post.put(IMEI, 2, b"two")
    assert list(post.take()) == [(IMEI, 2, b"two")]
    assert list(post.take()) == []
    assert post.problems == [f"{name(1)} is skipped: not a file of at most 1960 bytes"]


def test_files_that_cannot_be_moved_are_skipped(post):
    post.put(IMEI, 1, b"one")
    post.put(IMEI, 2, b"two")
    (post.directory / "taken" / name(1)).mkdir()
    assert list(post.take()) == [(IMEI, 2, b"two")]
    post.put(IMEI, 3, b"three")
    messages = post.take()
    (post.directory / name(3)).rename(post.directory / "gone")
    assert list(messages) == []
    assert post.problems == [f"{name(1)} is skipped: Is a directory"]


def test_missing_directory_is_reported_once(post, tmp_path):
    post.directory.rename(tmp_path / "moved")
    assert list(post.take()) == list(post.take()) == []
    assert post.problems == ["from-boat is skipped: No such file or directory"]
    (tmp_path / "moved").rename(post.directory)
    post.put(IMEI, 1, b"one")
    assert list(post.take()) == [(IMEI, 1, b"one")]
