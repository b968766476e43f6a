"""Intervals of telemetry messages."""

import math

import pytest

from firmware_py.link.telemetry.streams import Streams
from firmware_py.link.telemetry.table import ROWS_OF, TABLE
from firmware_py.link.wire.urls import LinkClass

ATTITUDE, HIGH_LATENCY2, NAMED_VALUE_FLOAT = 30, 235, 251


@pytest.fixture
def streams():
    return Streams(LinkClass.FAST, 0.0)


def count_sent(streams, *, loop_hz, seconds, interval_factor=1.0):
    row = ROWS_OF[ATTITUDE][0]
    sent = 0
    for tick in range(int(seconds * loop_hz)):
        now_s = tick / loop_hz
        for due_row in streams.due_rows(now_s, 1.0 / loop_hz):
            sent += due_row == row
            streams.schedule_next(due_row, now_s, interval_factor)
    return sent


@pytest.mark.parametrize(("rate_hz", "loop_hz"), [(10, 10), (4, 10), (1, 10), (3, 50), (20, 50), (0.5, 10)])
def test_requested_rate_is_the_average(streams, rate_hz, loop_hz):
    assert streams.set_interval(ATTITUDE, 1e6 / rate_hz, 0.0)
    assert count_sent(streams, loop_hz=loop_hz, seconds=60) == pytest.approx(60 * rate_hz, abs=1.01)


def test_interval_factor_divides_the_rate_until_all_rows_are_made_due(streams):
    assert count_sent(streams, loop_hz=10, seconds=100, interval_factor=5.0) == 200
    streams.make_all_due(100.0)
    assert ROWS_OF[ATTITUDE][0] in streams.due_rows(100.0, 0.1)
    assert ROWS_OF[HIGH_LATENCY2][0] not in streams.due_rows(100.0, 0.1)  # it is off by default


def test_rate_above_that_of_the_loop_sends_one_message_per_tick(streams):
    assert streams.set_interval(ATTITUDE, 20_000, 0.0)
    assert count_sent(streams, loop_hz=10, seconds=10) == 100


@pytest.mark.parametrize("interval_us", [math.nan, math.inf, -math.inf, -2.0, 1.0, 19_999.0, 1e30, 4e9])
def test_interval_out_of_range_is_rejected(streams, interval_us):
    assert not streams.set_interval(ATTITUDE, interval_us, 0.0)
    assert streams.interval_us(ATTITUDE) == 100_000


@pytest.mark.parametrize(
    ("link_class", "min_interval_s"),
    [(LinkClass.FAST, 0.02), (LinkClass.RADIO, 0.02), (LinkClass.SATELLITE, 10.0), (LinkClass.MESSAGES, 600.0)],
)
def test_each_link_class_has_a_minimum_interval(link_class, min_interval_s):
    streams = Streams(link_class, 0.0)
    assert streams.set_interval(ATTITUDE, 1e6 * min_interval_s, 0.0)
    assert streams.interval_us(ATTITUDE) == 1e6 * min_interval_s
    assert not streams.set_interval(ATTITUDE, 0.99e6 * min_interval_s, 0.0)
    assert streams.set_interval(ATTITUDE, 3600e6, 0.0)


def test_interval_is_turned_off_and_restored(streams):
    assert streams.set_interval(ATTITUDE, -1, 0.0)
    assert streams.interval_us(ATTITUDE) == -1
    assert count_sent(streams, loop_hz=10, seconds=5) == 0
    assert streams.set_interval(ATTITUDE, 0, 0.0)
    assert streams.interval_us(ATTITUDE) == 100_000


def test_intervals_of_heartbeat_and_unknown_messages_cannot_be_set(streams):
    assert not streams.set_interval(0, -1, 0.0)
    assert not streams.set_interval(9999, 1e6, 0.0)
    assert streams.interval_us(9999) is None


def test_stream_request_changes_the_messages_of_the_stream_only():
    streams = Streams(LinkClass.RADIO, 0.0)
    streams.set_stream(10, 5.0, 0.0)
    assert streams.interval_us(ATTITUDE) == 200_000
    assert streams.interval_us(74) == 1_000_000
    streams.set_stream(0, 0.0, 0.0)
    assert {streams.interval_us(row.number) for row in TABLE if row.stream is not None} == {-1}
    assert streams.interval_us(0) == 1_000_000


def test_interval_applies_to_all_named_values(streams):
    streams.set_interval(NAMED_VALUE_FLOAT, -1, 0.0)
    assert not set(ROWS_OF[NAMED_VALUE_FLOAT]) & set(streams.due_rows(100.0, 0.1))


def test_jump_of_the_clock_causes_no_burst(streams):
    row = ROWS_OF[ATTITUDE][0]
    streams.schedule_next(row, 0.0)
    streams.schedule_next(row, 1000.0)
    assert row not in streams.due_rows(1000.01, 0.1)


@pytest.mark.parametrize(("link_class", "seconds"), [(LinkClass.RADIO, 5.0), (LinkClass.FAST, 0.25)])
def test_stream_request_does_not_raise_slow_rates_on_a_radio_link(link_class, seconds):
    """MAVProxy requests all streams at 4 Hz when it connects."""
    streams = Streams(link_class, 0.0)
    streams.set_stream(0, 4.0, 0.0)
    assert streams.interval_us(ATTITUDE) == 250_000
    trim = next(index for index, row in enumerate(TABLE) if row.name == "NAMED_VALUE_FLOAT TRIM")
    streams.schedule_next(trim, 0.0)
    times = [0.05 * step for step in range(200) if trim in streams.due_rows(0.05 * step, 0.0)]
    assert times[0] == pytest.approx(seconds, abs=0.06)
    streams.set_stream(0, 0.0, 0.0)
    assert streams.interval_us(ATTITUDE) == -1
