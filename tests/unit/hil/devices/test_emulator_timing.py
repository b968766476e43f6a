"""Clock, transmitter and receive buffer of the emulators; options of all of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.nmea_compass import NmeaCompassEmulator
from hil.devices.nmea_gps import NmeaGpsEmulator
from hil.devices.timing import MAX_PERIODS_PER_CALL, MAX_QUEUED_MESSAGES, Pace, ReceiveBuffer, Transmitter, transfer_s
from hil.devices.volz import VolzEmulator
from hil.ship.servo import ServoShaft


def test_pace_keeps_its_phase():
    pace = Pace(0.1, start_s=0.03)
    pace.take(86_400.0)
    assert pace.next_s == pytest.approx(86_400.03, abs=1e-9)


def test_pace_with_a_fast_clock_has_more_periods():
    pace, count = Pace(1.0, error_ppm=100.0), 0
    while pace.next_s <= 100_000.0:
        count += len(pace.take(pace.next_s))
    assert count == 100_011  # one at the start, and 100 ppm of 100 000 s


def test_late_call_of_pace_skips_periods():
    times_s = Pace(0.1).take(1000.0)
    assert len(times_s) == MAX_PERIODS_PER_CALL
    assert times_s[-1] == pytest.approx(1000.0)


@given(st.floats(1e-3, 10.0), st.floats(0.0, 1e6), st.integers(1, 50))
def test_pace_called_at_the_due_time_returns_it(period_s, start_s, count):
    pace = Pace(period_s, start_s=start_s)
    for _ in range(count):
        due_s = pace.next_s
        assert pace.take(due_s) == [due_s]
        assert pace.next_s > due_s


@pytest.mark.parametrize("period_s", [0.0, -1.0, math.nan, math.inf])
def test_pace_rejects_invalid_periods(period_s):
    with pytest.raises(ValueError, match="period"):
        Pace(period_s)


def test_messages_are_complete_after_their_transfer():
    line = Transmitter(4800)
    assert line.send(1.0, b"x" * 48) == pytest.approx(1.1)
    assert line.send(1.01, b"y" * 48) == pytest.approx(1.2)
    assert line.take(1.099) == b""
    assert line.take(1.1001) == b"x" * 48
    assert line.next_s() == pytest.approx(1.2)
    assert line.take(9.0) == b"y" * 48
    assert line.next_s() == math.inf


def test_full_queue_drops_the_newest_message():
    line = Transmitter(4800)
    for _ in range(MAX_QUEUED_MESSAGES):
        assert line.send(0.0, b"a") < math.inf
    assert line.send(0.0, b"b") == math.inf
    assert b"b" not in line.take(1e9)


@pytest.mark.parametrize(
    ("begin_s", "end_s", "is_occupied"), [(4.0, 5.0, False), (4.0, 5.1, True), (7.9, 8.5, True), (8.0, 8.5, False)]
)
def test_line_is_occupied_during_a_message(begin_s, end_s, is_occupied):
    line = Transmitter(10)
    line.send(5.0, b"abc")
    assert line.occupies(begin_s, end_s) == is_occupied


def test_transfer_of_a_byte_takes_ten_bits():
    assert transfer_s(6, 115_200) == pytest.approx(0.52e-3, rel=0.01)


def test_receive_buffer_is_cleared_after_a_pause():
    buffer = ReceiveBuffer(max_bytes=4, pause_s=0.01)
    buffer.append(1.0, b"ab")
    buffer.append(1.005, b"cde")
    assert buffer.data == b"bcde"
    buffer.append(1.1, b"f")
    assert buffer.data == b"f"


@pytest.mark.parametrize(
    ("emulator", "options"),
    [
        (NmeaCompassEmulator, {"rate_hz": 0.0}),
        (NmeaCompassEmulator, {"resolution_deg": 0.0}),
        (NmeaCompassEmulator, {"sentence": "XYZ"}),
        (NmeaCompassEmulator, {"baud": 0}),
        (NmeaGpsEmulator, {"rate_hz": -1.0}),
        (VolzEmulator, {"device_id": 256}),
        (VolzEmulator, {"limits_deg": (0.0, 101.0)}),
        (VolzEmulator, {"limits_deg": (5.0, 5.0)}),
        (DynamixelEmulator, {"device_id": 253}),
        (DynamixelEmulator, {"baud": 38_400}),
        (DynamixelEmulator, {"return_delay": 255}),
    ],
)
def test_emulator_rejects_invalid_options(emulator, options):
    with pytest.raises(ValueError):
        emulator(ServoShaft(), np.random.default_rng(1), **options)
