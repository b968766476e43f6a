"""When telemetry is due."""

import math

import pytest

from firmware_py.link.telemetry.streams import Streams
from firmware_py.link.telemetry.table import ROWS_OF, TABLE
from firmware_py.link.wire.urls import LinkClass

ATTITUDE, NAMED = 30, 251


def count(streams, number, *, rate_hz, seconds):
    row = ROWS_OF[number][0]
    sent = 0
    for tick in range(int(seconds * rate_hz)):
        now_s = tick / rate_hz
        for due in streams.due(now_s, 1.0 / rate_hz):
            sent += due == row
            streams.mark_sent(due, now_s)
    return sent


@pytest.mark.parametrize(("asked_hz", "rate_hz"), [(10, 10), (4, 10), (1, 10), (3, 50), (20, 50), (0.5, 10)])
def test_a_rate_is_kept_on_average(asked_hz, rate_hz):
    streams = Streams(LinkClass.FAST, 0.0)
    assert streams.set_interval(ATTITUDE, 1e6 / asked_hz, 0.0)
    assert count(streams, ATTITUDE, rate_hz=rate_hz, seconds=60) == pytest.approx(60 * asked_hz, abs=1.01)


def test_a_row_that_is_stretched_comes_so_many_times_less_often():
    streams = Streams(LinkClass.FAST, 0.0)
    row = ROWS_OF[ATTITUDE][0]
    sent = 0
    for tick in range(1000):
        for due in streams.due(0.1 * tick, 0.1):
            sent += due == row
            streams.mark_sent(due, 0.1 * tick, 5.0)
    assert sent == 200
    streams.make_all_due(100.0)
    assert row in streams.due(100.0, 0.1)
    assert ROWS_OF[235][0] not in streams.due(100.0, 0.1)  # HIGH_LATENCY2, which no peer has asked for


def test_a_rate_above_the_loop_gives_one_each_tick():
    streams = Streams(LinkClass.FAST, 0.0)
    assert streams.set_interval(ATTITUDE, 20_000, 0.0)
    assert count(streams, ATTITUDE, rate_hz=10, seconds=10) == 100


@pytest.mark.parametrize("interval_us", [math.nan, math.inf, -math.inf, -2.0, 1.0, 19_999.0, 1e30, 4e9])
def test_an_interval_out_of_range_changes_nothing(interval_us):
    streams = Streams(LinkClass.FAST, 0.0)
    assert not streams.set_interval(ATTITUDE, interval_us, 0.0)
    assert streams.interval_us(ATTITUDE) == 100_000


@pytest.mark.parametrize(
    ("link_class", "fastest_s"),
    [(LinkClass.FAST, 0.02), (LinkClass.RADIO, 0.02), (LinkClass.SATELLITE, 10.0), (LinkClass.MESSAGES, 600.0)],
)
def test_each_class_of_link_has_its_fastest_interval(link_class, fastest_s):
    streams = Streams(link_class, 0.0)
    assert streams.set_interval(ATTITUDE, 1e6 * fastest_s, 0.0)
    assert streams.interval_us(ATTITUDE) == 1e6 * fastest_s
    assert not streams.set_interval(ATTITUDE, 0.99e6 * fastest_s, 0.0)
    assert streams.set_interval(ATTITUDE, 3600e6, 0.0)


def test_off_and_default():
    streams = Streams(LinkClass.FAST, 0.0)
    assert streams.set_interval(ATTITUDE, -1, 0.0)
    assert streams.interval_us(ATTITUDE) == -1
    assert count(streams, ATTITUDE, rate_hz=10, seconds=5) == 0
    assert streams.set_interval(ATTITUDE, 0, 0.0)
    assert streams.interval_us(ATTITUDE) == 100_000


def test_the_heartbeat_cannot_be_touched_and_strangers_are_not_known():
    streams = Streams(LinkClass.FAST, 0.0)
    assert not streams.set_interval(0, -1, 0.0)
    assert not streams.set_interval(9999, 1e6, 0.0)
    assert streams.interval_us(9999) is None


def test_a_data_stream_moves_its_messages_and_no_others():
    streams = Streams(LinkClass.RADIO, 0.0)
    streams.set_stream(10, 5.0, 0.0)
    assert streams.interval_us(ATTITUDE) == 200_000
    assert streams.interval_us(74) == 1_000_000
    streams.set_stream(0, 0.0, 0.0)
    assert {streams.interval_us(row.number) for row in TABLE if row.stream is not None} == {-1}
    assert streams.interval_us(0) == 1_000_000


def test_all_named_values_move_together():
    streams = Streams(LinkClass.FAST, 0.0)
    streams.set_interval(NAMED, -1, 0.0)
    assert not set(ROWS_OF[NAMED]) & set(streams.due(100.0, 0.1))


def test_time_that_jumps_does_not_bring_a_burst():
    streams = Streams(LinkClass.FAST, 0.0)
    row = ROWS_OF[ATTITUDE][0]
    streams.mark_sent(row, 0.0)
    streams.mark_sent(row, 1000.0)
    assert row not in streams.due(1000.01, 0.1)


@pytest.mark.parametrize(("link_class", "seconds"), [(LinkClass.RADIO, 5.0), (LinkClass.FAST, 0.25)])
def test_what_a_station_asks_for_by_habit_leaves_room_on_a_radio(link_class, seconds):
    """MAVProxy asks for all streams at 4 Hz as it comes: over a radio that is no reason for slow values at 4 Hz."""
    streams = Streams(link_class, 0.0)
    streams.set_stream(0, 4.0, 0.0)
    assert streams.interval_us(ATTITUDE) == 250_000
    trim = next(index for index, row in enumerate(TABLE) if row.name == "NAMED_VALUE_FLOAT TRIM")
    streams.mark_sent(trim, 0.0)
    times = [0.05 * step for step in range(200) if trim in streams.due(0.05 * step, 0.0)]
    assert times[0] == pytest.approx(seconds, abs=0.06)
    streams.set_stream(0, 0.0, 0.0)
    assert streams.interval_us(ATTITUDE) == -1
