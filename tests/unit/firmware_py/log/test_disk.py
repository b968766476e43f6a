import os

import pytest

from firmware_py.log.disk import LocalDisk, log_files


def write(directory, name, size):
    (directory / name).write_bytes(b"x" * size)


def closed(made):
    descriptor, path = made
    os.close(descriptor)
    return path.name


def test_numbers_go_on_from_the_highest_and_nothing_is_overwritten(tmp_path):
    write(tmp_path, "00000007.BIN", 3)
    write(tmp_path, "0000009.BIN", 3)
    write(tmp_path, "notes.txt", 3)
    assert closed(LocalDisk().create(tmp_path)) == "00000008.BIN"
    assert closed(LocalDisk().create(tmp_path)) == "00000009.BIN"
    assert (tmp_path / "00000007.BIN").read_bytes() == b"xxx"


def test_a_name_taken_by_something_else_is_passed_over(tmp_path, monkeypatch):
    write(tmp_path, "00000001.BIN", 3)
    monkeypatch.setattr("firmware_py.log.disk.log_files", lambda directory: {})
    assert closed(LocalDisk().create(tmp_path)) == "00000002.BIN"


def test_the_directory_is_made_but_not_its_parent(tmp_path):
    assert closed(LocalDisk().create(tmp_path / "logs")) == "00000001.BIN"
    with pytest.raises(FileNotFoundError):
        LocalDisk().create(tmp_path / "unplugged" / "logs")
    assert not (tmp_path / "unplugged").exists()


def test_the_oldest_files_go(tmp_path):
    for number in (3, 10, 20):
        write(tmp_path, f"{number:08d}.BIN", 100)
    write(tmp_path, "notes.txt", 1000)
    LocalDisk().prune(tmp_path, 200)
    assert sorted(log_files(tmp_path)) == [10, 20]
    LocalDisk().prune(tmp_path, 0)
    assert log_files(tmp_path) == {}
    assert (tmp_path / "notes.txt").exists()


def test_pruning_a_directory_that_is_not_there_is_nothing(tmp_path):
    LocalDisk().prune(tmp_path / "none", 0)


def test_a_file_that_was_removed_is_noticed(tmp_path):
    disk = LocalDisk()
    descriptor, path = disk.create(tmp_path)
    assert disk.write(descriptor, memoryview(b"abc")) == 3
    disk.sync(descriptor)
    assert path.read_bytes() == b"abc"
    disk.remove(path)
    with pytest.raises(FileNotFoundError):
        disk.sync(descriptor)
    disk.close(descriptor)
