"""Intervals of telemetry messages."""

import math
from collections import Counter

import pytest

from firmware_py.link.telemetry.streams import Streams
from firmware_py.link.telemetry.table import ROWS_OF, TABLE
from firmware_py.link.wire.urls import LinkClass

HEARTBEAT, SYS_STATUS, ATTITUDE, VFR_HUD, HIGH_LATENCY2, NAMED_VALUE_FLOAT = 0, 1, 30, 74, 235, 251
UNKNOWN = 9999
ALL_STREAMS, EXTRA1 = 0, 10  # MAV_DATA_STREAM


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


# Message or named value, default rates on fast links and on radio links in Hz.
RATES = """
HEARTBEAT 1 1, SYS_STATUS 1 .5, SYSTEM_TIME 1 .1, GPS_RAW_INT 2 .5, ATTITUDE 10 2, LOCAL_POSITION_NED 2 0,
GLOBAL_POSITION_INT 4 1, SERVO_OUTPUT_RAW 4 1, MISSION_CURRENT 1 .5, NAV_CONTROLLER_OUTPUT 2 1, RC_CHANNELS 2 .5,
VFR_HUD 4 1, ATTITUDE_TARGET 2 .5, POSITION_TARGET_GLOBAL_INT 2 .2, BATTERY_STATUS 1 .2, FENCE_STATUS .5 .1,
MAG_CAL_PROGRESS .2 .05, MAG_CAL_REPORT .2 .05, EKF_STATUS_REPORT 1 .2, ESTIMATOR_STATUS 1 .2, WIND_COV 1 .2,
HOME_POSITION .2 .02, EXTENDED_SYS_STATE .2 .02, AIS_VESSEL 4 .2, CURRENT_MODE .5 .5, AVAILABLE_MODES_MONITOR .3 .05,
WATER_DEPTH 1 .2, RUDDER 4 1, RUD_EST 4 1, RUD_CMD 4 1, RUD_TEMP .5 .1, LATE_MS 1 .2, SKIPPED 1 .2, STO_WRITES .1 .01,
STO_MB .1 .01, RUD_TRAVEL .2 .02, RUD_REVERS .2 .02, HELM_SOFT .2 .02, RUD_WH .2 .02, RUD_WATT .2 .02, SOLAR_W .2 .02,
LOAD_W .2 .02, HDG_SRC .5 .02, HDG_SD .5 .02, HDG_INNOV 1 0, HDG_NIS .2 .02, TRIM .2 .02, YAW_DIFF .2 .02,
PRED_SQ .2 .02, WAVE_SD .2 .02, WAVE_T .2 .02, WATER_SPD .5 .05, CURR_N .2 .02, CURR_E .2 .02, CURR_SD .2 .02,
LEEWAY .2 .02
"""


@pytest.mark.parametrize(("link_class", "column"), [(LinkClass.FAST, 1), (LinkClass.RADIO, 2)])
def test_messages_are_sent_at_their_rates(link_class, column):
    streams, sent = Streams(link_class, 0.0), Counter()
    for tick in range(10_000):
        for row in streams.due_rows(0.1 * tick, 0.1):
            sent[TABLE[row].name.split()[-1]] += 1
            streams.schedule_next(row, 0.1 * tick)
    rates = {row[0]: float(row[column]) for row in map(str.split, RATES.replace("\n", "").split(","))}
    assert sent == {name: round(1000 * rate_hz) for name, rate_hz in rates.items() if rate_hz}


def test_rows_are_due_half_a_tick_early_in_the_order_of_their_times(streams):
    attitude, hud, status = (ROWS_OF[number][0] for number in (ATTITUDE, VFR_HUD, SYS_STATUS))
    for row in range(len(TABLE)):
        streams.schedule_next(row, 0.0)
    assert streams.due_rows(0.0499, 0.1) == ()
    assert streams.due_rows(0.05, 0.1) == [attitude]
    streams.schedule_next(attitude, 0.1)  # exactly one interval late
    assert attitude not in streams.due_rows(0.1, 0.0)
    assert streams.due_rows(0.2, 0.0) == [attitude]
    for number, now_s in ((ATTITUDE, 5.0), (VFR_HUD, 4.0), (SYS_STATUS, 3.0), (HIGH_LATENCY2, 2.0)):
        streams.make_due(number, now_s)
    assert [row for row in streams.due_rows(5.0, 0.0) if row in (attitude, hud, status)] == [status, hud, attitude]
    assert ROWS_OF[HIGH_LATENCY2][0] not in streams.due_rows(5.0, 0.0)  # it is off
    streams.postpone(ATTITUDE, 5.0)
    assert attitude not in streams.due_rows(5.09, 0.0)
    assert attitude in streams.due_rows(5.1, 0.0)
    streams.set_high_latency(60.0, 6.0)
    assert (streams.interval_us(HIGH_LATENCY2), ROWS_OF[HIGH_LATENCY2][0] in streams.due_rows(6.0, 0.0)) == (60e6, True)
    streams.set_high_latency(None, 6.0)
    assert (streams.interval_us(HIGH_LATENCY2), ROWS_OF[HIGH_LATENCY2][0] in streams.due_rows(1e6, 0.0)) == (-1, False)


@pytest.mark.parametrize("link_class", [LinkClass.SATELLITE, LinkClass.MESSAGES])
def test_stream_request_has_no_effect_by_satellite(link_class):
    streams = Streams(link_class, 0.0)
    streams.set_stream(ALL_STREAMS, 4.0, 0.0)
    assert streams.due_rows(1e6, 0.1) == ()


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


@pytest.mark.parametrize("interval_us", [math.nan, math.inf, -math.inf, -2.0, 1.0, 19_999.0, 1e30, 3601e6])
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
    assert not streams.set_interval(HEARTBEAT, -1, 0.0)
    assert not streams.set_interval(UNKNOWN, 1e6, 0.0)
    assert streams.interval_us(UNKNOWN) is None


def test_stream_request_changes_the_messages_of_the_stream_only():
    streams = Streams(LinkClass.RADIO, 0.0)
    streams.set_stream(EXTRA1, 5.0, 0.0)
    assert streams.interval_us(ATTITUDE) == 200_000
    assert streams.interval_us(VFR_HUD) == 1_000_000
    streams.set_stream(ALL_STREAMS, 0.0, 0.0)
    assert {streams.interval_us(row.number) for row in TABLE if row.stream is not None} == {-1}
    assert streams.interval_us(HEARTBEAT) == 1_000_000


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
    streams.set_stream(ALL_STREAMS, 4.0, 0.0)
    assert streams.interval_us(ATTITUDE) == 250_000
    trim = next(index for index, row in enumerate(TABLE) if row.name == "NAMED_VALUE_FLOAT TRIM")
    streams.schedule_next(trim, 0.0)
    times = [0.05 * step for step in range(200) if trim in streams.due_rows(0.05 * step, 0.0)]
    assert times[0] == pytest.approx(seconds, abs=0.06)
    streams.set_stream(ALL_STREAMS, 0.0, 0.0)
    assert streams.interval_us(ATTITUDE) == -1
