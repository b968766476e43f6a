"""Messages as files: what is none is skipped, named once, and ends nothing."""

import os

import pytest

from hil.devices.message_post import FROM_BOAT, MessagePost

IMEI = "300234010753370"


@pytest.fixture
def post(tmp_path):
    return MessagePost(tmp_path, FROM_BOAT)


def name(number):
    return f"{IMEI}_{number:06d}.sbd"


def test_oldest_message_first(post):
    for number, age_s in ((1, 10), (2, 30), (3, 20)):
        post.put(IMEI, number, b"%d" % number)
        os.utime(post.directory / name(number), (1e9 - age_s, 1e9 - age_s))
    assert list(post.take()) == [(IMEI, 2, b"2"), (IMEI, 3, b"3"), (IMEI, 1, b"1")]
    assert list(post.take()) == []
    assert post.problems == []


def dangling(path):
    path.symlink_to("nowhere")


def looped(path):
    path.symlink_to(path.name)


def elsewhere(path):
    (path.parent / "secret").write_bytes(b"x")
    path.symlink_to("secret")


def directory(path):
    path.mkdir()


def pipe(path):
    os.mkfifo(path)


def too_long(path):
    path.write_bytes(bytes(1961))


@pytest.mark.parametrize("make", [dangling, looped, elsewhere, directory, pipe, too_long])
def test_other_files_are_reported_once(post, make):
    make(post.directory / name(1))
    post.put(IMEI, 2, b"two")
    assert list(post.take()) == [(IMEI, 2, b"two")]
    assert list(post.take()) == []
    assert post.problems == [f"{name(1)} is skipped: not a file of at most 1960 bytes"]


def test_files_that_cannot_be_moved(post):
    post.put(IMEI, 1, b"one")
    post.put(IMEI, 2, b"two")
    (post.directory / "taken" / name(1)).mkdir()
    assert list(post.take()) == [(IMEI, 2, b"two")]
    post.put(IMEI, 3, b"three")
    taking = post.take()
    (post.directory / name(3)).rename(post.directory / "gone")
    assert list(taking) == []
    assert post.problems == [f"{name(1)} is skipped: Is a directory"]


def test_missing_directory(post, tmp_path):
    post.directory.rename(tmp_path / "away")
    assert list(post.take()) == list(post.take()) == []
    assert post.problems == ["from-boat is skipped: No such file or directory"]
    (tmp_path / "away").rename(post.directory)
    post.put(IMEI, 1, b"one")
    assert list(post.take()) == [(IMEI, 1, b"one")]
