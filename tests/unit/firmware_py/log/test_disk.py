import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py.log.disk import LocalDisk, log_files, newest_log_time_s

MIN_FREE_FILES = 8

NOW_S = 1_900_000_000.0
DAY_S = 86_400.0
AT_1970 = NOW_S / DAY_S  # the age in days of a file written at 1970-01-01


def write(directory, *names, size=3, age_days=0.0):
    """Write files and return their names."""
    for name in names:
        path = directory / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"x" * size)
        os.utime(path, (NOW_S - age_days * DAY_S,) * 2)
    return names


def create(directory):
    """Create the next log and return its name."""
    descriptor, path = LocalDisk().create(directory)
    os.close(descriptor)
    return path.name


def names_below(directory):
    return sorted(str(path.relative_to(directory)) for path in directory.rglob("*") if path.is_file())


def test_numbers_continue_from_the_highest_and_no_file_is_overwritten(tmp_path):
    write(tmp_path, "00000007.BIN", "0000009.BIN", "notes.txt")
    assert [create(tmp_path), create(tmp_path)] == ["00000008.BIN", "00000009.BIN"]
    assert (tmp_path / "00000007.BIN").read_bytes() == b"xxx"


def test_an_existing_name_is_skipped(tmp_path, monkeypatch):
    write(tmp_path, "00000001.BIN")
    monkeypatch.setattr("firmware_py.log.disk.log_files", lambda directory: {})
    assert create(tmp_path) == "00000002.BIN"


@pytest.mark.parametrize("name", ["9" * 251 + ".BIN", "\u0669" * 8 + ".BIN"])
def test_a_number_of_another_program_does_not_count(tmp_path, name):
    """After 251 digits, the name of the next log would be too long."""
    write(tmp_path, name)
    assert create(tmp_path) == "00000001.BIN"


def test_the_directory_is_created_but_not_its_parent(tmp_path):
    assert create(tmp_path / "logs") == "00000001.BIN"
    with pytest.raises(FileNotFoundError):
        LocalDisk().create(tmp_path / "unplugged" / "logs")
    assert not (tmp_path / "unplugged").exists()


def test_a_log_is_listed_once_by_its_number(tmp_path):
    write(
        tmp_path, "00000001.BIN.gz", "00000002.BIN", "00000002.BIN.gz", "00000003.BIN", ".00000003.BIN.gz.part", "x.gz"
    )
    names = {number: path.name for number, path in log_files(tmp_path).items()}
    assert names == {1: "00000001.BIN.gz", 2: "00000002.BIN", 3: "00000003.BIN"}
    assert create(tmp_path) == "00000004.BIN"


def test_the_oldest_logs_are_removed_and_other_files_are_not(tmp_path):
    write(tmp_path, *(f"{number:08d}.BIN" for number in (3, 10, 20)), size=100)
    write(tmp_path, "notes.txt", size=1000)
    LocalDisk().prune(tmp_path, 200)
    assert sorted(log_files(tmp_path)) == [10, 20]
    LocalDisk().prune(tmp_path, 0)
    assert names_below(tmp_path) == ["notes.txt"]
    LocalDisk().prune(tmp_path / "none", 0)  # a missing directory is no error


def test_boxes_are_removed_last_and_partial_archives_with_their_log(tmp_path):
    write(tmp_path, "00000001.BIN", size=100, age_days=2.0)
    write(tmp_path, ".00000001.BIN.gz.part", size=50)
    write(tmp_path, "00000002.BIN.gz", size=100, age_days=1.0)
    write(tmp_path, "boxes/00000001-end.BIN.gz", size=20, age_days=9.0)
    LocalDisk().prune(tmp_path, 270)
    assert len(names_below(tmp_path)) == 4
    for max_log_bytes, names in (
        (269, ["00000002.BIN.gz", "boxes/00000001-end.BIN.gz"]),
        (80, ["boxes/00000001-end.BIN.gz"]),
        (10, []),
    ):
        LocalDisk().prune(tmp_path, max_log_bytes)
        assert names_below(tmp_path) == names


def test_boxes_occupy_at_most_a_quarter_and_the_densest_are_removed(tmp_path):
    monthly = [f"boxes/{number:08d}-end.BIN.gz" for number in range(5)]
    for number, name in enumerate(monthly):
        write(tmp_path, name, size=10, age_days=300.0 - 30.0 * number)
    for number in range(20):  # a restart every minute
        write(tmp_path, f"boxes/{100 + number:08d}-end.BIN.gz", size=10, age_days=1.0 - number / 1440.0)
    LocalDisk().prune(tmp_path, 400)
    names = names_below(tmp_path)
    assert len(names) == 10
    assert {*monthly, "boxes/00000119-end.BIN.gz"} < set(names)


def test_at_most_200_boxes_are_kept(tmp_path):
    write(tmp_path, *(f"boxes/{number:08d}-end.BIN.gz" for number in range(201)), size=0)
    LocalDisk().prune(tmp_path, 10_000)
    assert len(names_below(tmp_path)) == 200
    LocalDisk().prune(tmp_path, 10_000)
    assert len(names_below(tmp_path)) == 200


def test_free_space_is_that_of_the_directory_or_its_parent(tmp_path, monkeypatch):
    paths = []
    status = os.statvfs_result((4096, 512, 9, 8, 7, 6, 5, 4, 0, 255))
    monkeypatch.setattr("os.statvfs", lambda path: paths.append(path) or status)
    assert LocalDisk().free_bytes(tmp_path) == LocalDisk().free_bytes(tmp_path / "none") == 7 * 512
    assert LocalDisk().free_files(tmp_path) == 4
    assert paths == [tmp_path, tmp_path, tmp_path]


def test_time_of_the_newest_log_of_any_kind(tmp_path):
    assert newest_log_time_s(tmp_path / "none") == 0.0
    assert newest_log_time_s(tmp_path) == 0.0
    write(tmp_path, "00000001.BIN", age_days=2.0)
    write(tmp_path, "00000002.BIN", age_days=3.0)
    assert newest_log_time_s(tmp_path) == NOW_S - 2.0 * DAY_S
    write(tmp_path, "thin/00000001.BIN.gz", age_days=1.0)
    assert newest_log_time_s(tmp_path) == NOW_S - DAY_S
    (tmp_path / "thin/00000001.BIN.gz").unlink()
    assert newest_log_time_s(tmp_path) == NOW_S - 2.0 * DAY_S


def test_the_newest_box_stays_if_the_clock_starts_at_1970(tmp_path):
    """Two runs with a clock set by a receiver are followed by runs that ended before it was set."""
    dated = [f"boxes/{number:08d}-end.BIN.gz" for number in (1, 2)]
    for number, name in enumerate(dated):
        write(tmp_path, name, size=10, age_days=40.0 - 20.0 * number)
    for number in range(3, 23):
        write(tmp_path, f"boxes/{number:08d}-end.BIN.gz", size=10, age_days=AT_1970)
        severe = f"boxes/{number:08d}-{3 * number}.BIN.gz"
        write(tmp_path, severe, size=10, age_days=AT_1970 - 10.0 / DAY_S)
    LocalDisk().prune(tmp_path, 400)
    names = names_below(tmp_path)
    assert len(names) == 10
    assert {*dated, severe, "boxes/00000022-end.BIN.gz"} < set(names)
    LocalDisk().prune(tmp_path, 40)
    assert names_below(tmp_path) == ["boxes/00000022-end.BIN.gz"]


def test_boxes_are_ordered_by_their_event_times_as_numbers(tmp_path):
    write(
        tmp_path,
        *(f"boxes/00000001-{moment}.BIN.gz" for moment in ("9", "80", "700", "end")),
        size=10,
        age_days=AT_1970,
    )
    write(tmp_path, *(f"boxes/00000002-{moment}.BIN.gz" for moment in ("1000", "20")), size=10, age_days=AT_1970)
    LocalDisk().prune(tmp_path, 80)
    assert [name for name in names_below(tmp_path) if "00000002" in name] == ["boxes/00000002-1000.BIN.gz"]
    LocalDisk().prune(tmp_path, 40)
    assert names_below(tmp_path) == ["boxes/00000002-1000.BIN.gz"]


def test_a_file_system_that_does_not_count_files_has_enough(tmp_path, monkeypatch):
    """Btrfs reports 0 files of 0."""
    status = [*os.statvfs(tmp_path)]
    status[5:8] = 0, 0, 0
    monkeypatch.setattr("os.statvfs", lambda _directory: os.statvfs_result(status))
    assert LocalDisk().free_files(tmp_path) == MIN_FREE_FILES


FILL_INODES = """
import errno, os, sys
from pathlib import Path
from firmware_py.log.disk import LocalDisk, log_files
directory = Path(sys.argv[1])
logs = directory / "logs"
disk = LocalDisk(reserve_bytes=1000)
for _ in range(20):
    os.close(disk.create(logs)[0])
(directory / "else").mkdir()
try:
    for number in range(100):
        (directory / "else" / str(number)).touch()
except OSError as error:
    assert error.errno == errno.ENOSPC
assert disk.free_bytes(logs) > 500_000
disk.prune(logs, 10_000)
os.close(disk.create(logs)[0])
print(*sorted(log_files(logs)))
"""


def test_logging_continues_on_a_file_system_without_free_inodes(tmp_path):
    command = 'mount -t tmpfs -o nr_inodes=60,size=1m none "$2" && exec "$0" -c "$1" "$2"'
    arguments = ["unshare", "-rm", "sh", "-c", command, sys.executable, FILL_INODES, str(tmp_path)]
    result = subprocess.run(arguments, capture_output=True, text=True, check=False)
    if "unshare" in result.stderr or "mount" in result.stderr:
        pytest.skip(f"a file system cannot be mounted here: {result.stderr.strip()}")
    assert result.stdout.split() == [str(number) for number in range(MIN_FREE_FILES + 1, 22)], result.stderr


def test_sync_of_a_removed_file_is_an_error(tmp_path):
    disk = LocalDisk()
    descriptor, path = disk.create(tmp_path)
    assert disk.write(descriptor, memoryview(b"abc")) == 3
    disk.sync(descriptor)
    assert path.read_bytes() == b"abc"
    disk.remove(path)
    with pytest.raises(FileNotFoundError):
        disk.sync(descriptor)
    disk.close(descriptor)


def test_a_failed_directory_sync_leaves_no_file_and_no_descriptor(tmp_path, monkeypatch):
    """The writer retries every second; leaked descriptors would exhaust the process."""

    def fail(_directory):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("firmware_py.log.disk.sync_directory", fail)
    open_count = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(OSError, match="Input/output"):
        LocalDisk().create(tmp_path)
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("ages_days", "now_s", "removed"),
    [
        ((31.0, 30.0, 0.0), NOW_S, 1),
        ((400.0,), 0.0, 0),  # the clock is wrong
        ((400.0,), 5e9, 0),
        ((40.0, 20.0, 1.0), NOW_S + 6e8, 1),  # years ahead: ages count from the newest log
        (((NOW_S - 1000.0) / DAY_S,), NOW_S, 0),  # written with a wrong clock
    ],
)
def test_logs_are_removed_by_age_and_boxes_are_not(tmp_path, ages_days, now_s, removed):
    names = [f"{number:08d}.BIN.gz" for number, _ in enumerate(ages_days, start=1)]
    for name, age_days in zip(names, ages_days, strict=True):
        write(tmp_path, name, size=10, age_days=age_days)
    write(tmp_path, "boxes/00000001-end.BIN.gz", size=10, age_days=40.0)
    LocalDisk(retention_days=30.0, utc_s=lambda: now_s).prune(tmp_path, 1000)
    assert names_below(tmp_path) == [*names[removed:], "boxes/00000001-end.BIN.gz"]


@pytest.mark.parametrize(
    ("method", "free", "reserve_bytes", "removed"),
    [
        ("free_bytes", 900, 850, 0),
        ("free_bytes", 750, 850, 1),
        ("free_bytes", 651, 850, 2),
        ("free_bytes", -151, 850, 0),  # not enough without the logs either: other files fill the disk
        ("free_files", MIN_FREE_FILES, 1, 0),
        ("free_files", MIN_FREE_FILES - 3, 1, 3),
        ("free_files", 0, 1, MIN_FREE_FILES),
        ("free_files", MIN_FREE_FILES - 10, 1, 10),  # all logs
        ("free_files", -3, 1, 0),
    ],
)
def test_the_oldest_logs_are_removed_to_restore_the_reserve(
    tmp_path, monkeypatch, method, free, reserve_bytes, removed
):
    write(tmp_path, *(f"{number:08d}.BIN" for number in range(1, 11)), size=100)
    disk = LocalDisk(reserve_bytes=reserve_bytes)
    monkeypatch.setattr(disk, method, lambda _directory: free)
    disk.prune(tmp_path, 10_000)
    assert sorted(log_files(tmp_path)) == [*range(removed + 1, 11)]
