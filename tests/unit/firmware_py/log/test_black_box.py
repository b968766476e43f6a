"""Which bytes of one or two logs a black box contains."""

import gzip
import os

import pytest

from firmware_py.common.records import Tick
from firmware_py.log import schema
from firmware_py.log.black_box import (
    box_path,
    find_last_tick,
    find_next_tick,
    find_tick_offset,
    is_first_of_run,
    make_box,
)
from firmware_py.log.dataflash import header

HEADER = header((schema.TICK.type, schema.END), 0)
START_S = 1000.0


def tick_bytes(number, t_s=None):
    """Return the records of a tick; ticks have a distance of a second."""
    t_s = START_S + number if t_s is None else t_s
    return schema.append_end(schema.TICK.pack(t_s, Tick(number, t_s, 0.0, 0, 1.0)), 0.0, number)


TICK_BYTES = len(tick_bytes(0))


def ticks(first, end):
    return b"".join(map(tick_bytes, range(first, end)))


@pytest.fixture(scope="module")
def descriptor(tmp_path_factory):
    """An open log of 2500 ticks, more than the length of a linear search."""
    path = tmp_path_factory.mktemp("log") / "log"
    path.write_bytes(HEADER + ticks(0, 2500))
    assert path.stat().st_size > 1 << 17
    descriptor = os.open(path, os.O_RDONLY)
    yield descriptor
    os.close(descriptor)


@pytest.mark.parametrize("count", [1, 2, 900, 2500])
def test_ticks_are_found_by_time(descriptor, count):
    end = len(HEADER) + count * TICK_BYTES
    first = find_next_tick(descriptor, 0, end)
    assert first == (len(HEADER), 0, START_S)
    assert find_last_tick(descriptor, first, end) == (end - TICK_BYTES, count - 1, START_S + count - 1)
    for number in {0, count // 2, count - 1}:
        for t_s, expected in ((START_S + number, number), (START_S + number + 0.5, number + 1)):
            offset = find_tick_offset(descriptor, first, end, t_s)
            assert offset == len(HEADER) + expected * TICK_BYTES
    assert find_tick_offset(descriptor, first, end, 0.0) == len(HEADER)
    assert find_tick_offset(descriptor, first, end, 1e9) == end


def test_a_tick_is_found_at_any_distance(tmp_path):
    path, begin = tmp_path / "log", len(HEADER) + TICK_BYTES
    for distance in range(65_536 - 2 * TICK_BYTES, 65_536 + 2 * TICK_BYTES, 3):
        path.write_bytes(HEADER + tick_bytes(0) + bytes(distance) + ticks(1, 3))
        descriptor = os.open(path, os.O_RDONLY)
        assert find_next_tick(descriptor, begin, path.stat().st_size).number == 2  # tick 1 does not follow an END
        os.close(descriptor)


def test_the_last_tick_of_a_file_with_a_long_tail_is_found(tmp_path):
    path = tmp_path / "log"
    data = HEADER + ticks(0, 5)
    path.write_bytes(data + bytes(300_000))
    descriptor = os.open(path, os.O_RDONLY)
    size = path.stat().st_size
    first = find_next_tick(descriptor, 0, size)
    assert find_last_tick(descriptor, first, size).number == 4
    assert find_next_tick(descriptor, len(data) - TICK_BYTES, size) is None
    os.close(descriptor)


def test_a_tick_of_an_invalid_time_or_without_an_end_before_it_is_skipped(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(
        HEADER + tick_bytes(0) + tick_bytes(1, float("nan")) + tick_bytes(2)[:-1] + tick_bytes(3) + ticks(4, 6)
    )
    descriptor = os.open(path, os.O_RDONLY)
    found, tick = [], find_next_tick(descriptor, 0, path.stat().st_size)
    while tick is not None:
        found.append(tick.number)
        tick = find_next_tick(descriptor, tick.offset + 1, path.stat().st_size)
    assert found == [0, 2, 4, 5]
    os.close(descriptor)


def box_of(log, *moment):
    """Return the content of the box of a log."""
    for _ in make_box(log, "end" if not moment else "severe", *moment):
        pass
    path = box_path(log, "end" if not moment else "severe")
    return gzip.decompress(path.read_bytes()) if path.exists() else None


@pytest.fixture
def log(tmp_path):
    return tmp_path / "00000002.BIN"


def test_a_box_has_five_minutes_before_and_half_a_minute_after_the_event(log):
    log.write_bytes(HEADER + ticks(0, 900))
    assert box_of(log, START_S + 500.0) == HEADER + ticks(200, 530)
    assert box_of(log) == HEADER + ticks(599, 900)
    assert (log.parent / "boxes").stat().st_mode & 0o777 == 0o750
    assert box_path(log, "end").stat().st_mtime == log.stat().st_mtime


@pytest.mark.parametrize(
    ("previous", "number_from"),
    [
        (HEADER + ticks(0, 900), 700),
        (HEADER + ticks(800, 900), 800),
        (HEADER + ticks(0, 899), 900),  # a gap between the logs
        (HEADER + ticks(0, 901), 900),
        (b"no log", 900),
        (None, 900),
    ],
)
def test_a_box_of_a_short_log_has_the_end_of_the_previous_one_if_it_connects(log, previous, number_from):
    log.write_bytes(HEADER + ticks(900, 1001))
    if previous is not None:
        log.with_name("00000001.BIN").write_bytes(previous)
    assert box_of(log) == HEADER + ticks(number_from, 1001)


def test_an_existing_box_is_kept_and_a_log_without_a_tick_has_none(log):
    log.write_bytes(HEADER)
    assert box_of(log) is None
    log.write_bytes(HEADER + ticks(0, 3))
    first = box_of(log)
    log.write_bytes(HEADER + ticks(0, 9))
    assert box_of(log) == first == HEADER + ticks(0, 3)


@pytest.mark.parametrize(
    ("data", "is_first"), [(HEADER, True), (ticks(0, 2), True), (ticks(1, 2), False), (HEADER + ticks(1, 2), False)]
)
def test_the_first_log_of_a_run_starts_with_tick_0(log, data, is_first):
    log.write_bytes(data)
    assert is_first_of_run(log) is is_first
