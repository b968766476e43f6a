import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py.log.disk import MIN_FREE_FILES, LocalDisk, log_files

NOW_S = 1_900_000_000.0


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


@pytest.mark.parametrize("name", ["9" * 251 + ".BIN", "\u0669" * 8 + ".BIN"])
def test_a_number_that_no_log_has_does_not_count(tmp_path, name):
    """The next one of 251 digits would be no name of a file, and no log would be written any more."""
    write(tmp_path, name, 3)
    assert closed(LocalDisk().create(tmp_path)) == "00000001.BIN"


def test_the_directory_is_made_but_not_its_parent(tmp_path):
    assert closed(LocalDisk().create(tmp_path / "logs")) == "00000001.BIN"
    with pytest.raises(FileNotFoundError):
        LocalDisk().create(tmp_path / "unplugged" / "logs")
    assert not (tmp_path / "unplugged").exists()


def test_the_oldest_files_are_removed(tmp_path):
    for number in (3, 10, 20):
        write(tmp_path, f"{number:08d}.BIN", 100)
    write(tmp_path, "notes.txt", 1000)
    LocalDisk().prune(tmp_path, 200)
    assert sorted(log_files(tmp_path)) == [10, 20]
    LocalDisk().prune(tmp_path, 0)
    assert log_files(tmp_path) == {}
    assert (tmp_path / "notes.txt").exists()


def aged(directory, name, size, days):
    path = directory / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"x" * size)
    os.utime(path, (NOW_S - days * 86_400, NOW_S - days * 86_400))
    return path


def left(directory):
    return sorted(str(path.relative_to(directory)) for path in directory.rglob("*") if path.is_file())


def test_a_log_is_listed_once_by_its_number_compressed_or_not(tmp_path):
    for name in ("00000001.BIN.gz", "00000002.BIN", "00000002.BIN.gz", "00000003.BIN", ".00000003.BIN.gz.part", "x.gz"):
        write(tmp_path, name, 3)
    names = {number: path.name for number, path in log_files(tmp_path).items()}
    assert names == {1: "00000001.BIN.gz", 2: "00000002.BIN", 3: "00000003.BIN"}
    assert closed(LocalDisk().create(tmp_path)) == "00000004.BIN"


def test_boxes_are_removed_last_and_parts_with_their_log(tmp_path):
    aged(tmp_path, "00000001.BIN", 100, 2.0)
    write(tmp_path, ".00000001.BIN.gz.part", 50)
    aged(tmp_path, "00000002.BIN.gz", 100, 1.0)
    aged(tmp_path, "boxes/00000001-end.BIN.gz", 20, 9.0)
    LocalDisk().prune(tmp_path, 270)
    assert len(left(tmp_path)) == 4
    LocalDisk().prune(tmp_path, 150)
    assert left(tmp_path) == ["00000002.BIN.gz", "boxes/00000001-end.BIN.gz"]
    LocalDisk().prune(tmp_path, 80)
    assert left(tmp_path) == ["boxes/00000001-end.BIN.gz"]
    LocalDisk().prune(tmp_path, 10)
    assert left(tmp_path) == []


def test_boxes_take_at_most_a_quarter_and_the_densest_are_removed(tmp_path):
    months = [aged(tmp_path, f"boxes/{number:08d}-end.BIN.gz", 10, 300.0 - 30.0 * number) for number in range(5)]
    for number in range(20):  # a restart every minute
        aged(tmp_path, f"boxes/{100 + number:08d}-end.BIN.gz", 10, 1.0 - number / 1440.0)
    LocalDisk().prune(tmp_path, 400)
    kept = left(tmp_path)
    assert len(kept) == 10
    assert {f"boxes/{path.name}" for path in months} < set(kept)
    assert "boxes/00000119-end.BIN.gz" in kept  # the newest


def test_the_newest_boxes_stay_of_a_computer_whose_clock_begins_at_1970_with_each_start(tmp_path):
    """Two voyages with the time of a receiver, then starts that ended before it had one."""
    voyages = [aged(tmp_path, f"boxes/{number:08d}-end.BIN.gz", 10, 60.0 - 20.0 * number) for number in (1, 2)]
    for number in range(3, 23):
        aged(tmp_path, f"boxes/{number:08d}-end.BIN.gz", 10, NOW_S / 86_400)
        severe = aged(tmp_path, f"boxes/{number:08d}-{3 * number}.BIN.gz", 10, (NOW_S - 10.0) / 86_400)
    LocalDisk().prune(tmp_path, 400)
    kept = left(tmp_path)
    assert len(kept) == 10
    assert {f"boxes/{path.name}" for path in (*voyages, severe)} < set(kept)
    assert "boxes/00000022-end.BIN.gz" in kept
    LocalDisk().prune(tmp_path, 40)
    assert left(tmp_path) == ["boxes/00000022-end.BIN.gz"]


def test_boxes_of_a_log_are_in_order_of_their_moments_whatever_their_names(tmp_path):
    """Without a clock only the names say which of them is newest, and those of moments are not of equal length."""
    for moment in ("9", "80", "700", "end"):
        aged(tmp_path, f"boxes/00000001-{moment}.BIN.gz", 10, NOW_S / 86_400)
    for moment in ("1000", "20"):
        aged(tmp_path, f"boxes/00000002-{moment}.BIN.gz", 10, NOW_S / 86_400)
    LocalDisk().prune(tmp_path, 80)
    assert {"boxes/00000002-1000.BIN.gz"} == {name for name in left(tmp_path) if "00000002" in name}
    LocalDisk().prune(tmp_path, 40)
    assert left(tmp_path) == ["boxes/00000002-1000.BIN.gz"]


def test_no_log_goes_for_files_that_the_file_system_does_not_count(tmp_path, monkeypatch):
    """As btrfs, which says 0 of 0."""
    write(tmp_path, "00000001.BIN", 100)
    found = [*os.statvfs(tmp_path)]
    found[5:8] = 0, 0, 0
    monkeypatch.setattr("os.statvfs", lambda _directory: os.statvfs_result(found))
    assert LocalDisk().free_files(tmp_path) == MIN_FREE_FILES


OUT_OF_FILES = """
import errno, os, sys
from pathlib import Path
from firmware_py.log.disk import LocalDisk, log_files
place = Path(sys.argv[1])
logs = place / "logs"
disk = LocalDisk(reserve_bytes=1000)
for _ in range(20):
    os.close(disk.create(logs)[0])
(place / "else").mkdir()
try:
    for number in range(100):
        (place / "else" / str(number)).touch()
except OSError as error:
    assert error.errno == errno.ENOSPC
assert disk.free_bytes(logs) > 500_000
disk.prune(logs, 10_000)
os.close(disk.create(logs)[0])
print(*sorted(log_files(logs)))
"""


def test_logging_goes_on_on_a_file_system_that_is_out_of_inodes(tmp_path):
    command = 'mount -t tmpfs -o nr_inodes=60,size=1m none "$2" && exec "$0" -c "$1" "$2"'
    words = ["unshare", "-rm", "sh", "-c", command, sys.executable, OUT_OF_FILES, str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if "unshare" in done.stderr or "mount" in done.stderr:
        pytest.skip(f"no file system of one's own here: {done.stderr.strip()}")
    assert done.stdout.split() == [str(number) for number in range(MIN_FREE_FILES + 1, 22)], done.stderr


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


def test_a_failed_directory_sync_leaves_no_file(tmp_path, monkeypatch):
    """The writer wants one each second: none may be left open, for then no device could be opened any more."""

    def ill(_directory):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("firmware_py.log.disk.sync_directory", ill)
    open_before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(OSError, match="Input/output"):
        LocalDisk().create(tmp_path)
    assert len(list(Path("/proc/self/fd").iterdir())) == open_before
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("ages_days", "now_s", "removed"),
    [
        ((40.0, 20.0, 1.0), NOW_S, 1),
        ((400.0,), 0.0, 0),  # the clock is wrong
        ((400.0,), 5e9, 0),
        ((40.0, 20.0, 1.0), NOW_S + 6e8, 1),  # years ahead: ages count from the newest log
        (((NOW_S - 1000.0) / 86_400,), NOW_S, 0),  # written with a wrong clock
    ],
)
def test_logs_are_removed_by_age_and_boxes_are_not(tmp_path, ages_days, now_s, removed):
    names = [aged(tmp_path, f"{number:08d}.BIN.gz", 10, days).name for number, days in enumerate(ages_days, start=1)]
    aged(tmp_path, "boxes/00000001-end.BIN.gz", 10, 40.0)
    LocalDisk(retention_days=30.0, utc_s=lambda: now_s).prune(tmp_path, 1000)
    assert left(tmp_path) == [*names[removed:], "boxes/00000001-end.BIN.gz"]


@pytest.mark.parametrize(
    ("method", "free", "reserve_bytes", "removed"),
    [
        ("free_bytes", 900, 850, 0),
        ("free_bytes", 750, 850, 1),
        ("free_bytes", 651, 850, 2),
        ("free_bytes", -151, 850, 0),  # without the logs there would not be enough: other files fill the disk
        ("free_files", MIN_FREE_FILES, 1, 0),
        ("free_files", MIN_FREE_FILES - 3, 1, 3),
        ("free_files", 0, 1, MIN_FREE_FILES),
        ("free_files", -3, 1, 0),
    ],
)
def test_the_oldest_logs_are_removed_to_restore_the_reserve(
    tmp_path, monkeypatch, method, free, reserve_bytes, removed
):
    for number in range(1, 11):
        write(tmp_path, f"{number:08d}.BIN", 100)
    disk = LocalDisk(reserve_bytes=reserve_bytes)
    monkeypatch.setattr(disk, method, lambda _directory: free)
    disk.prune(tmp_path, 10_000)
    assert sorted(log_files(tmp_path)) == [*range(removed + 1, 11)]
