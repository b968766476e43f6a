"""PNI driver: set-up, recovery, valid headings and reported faults."""

import itertools
import math
import struct
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_py.common.records import CalibrationState, DeviceState, NorthReference
from firmware_py.sensors.pni_tcm import PniCompass, PniOptions
from hil.devices.pni_tcm import PniTcmEmulator

COMMAND_INTERVAL_S = 0.05
DATA_TIMEOUT_S = 1.0

# Frame ids.
MODULE_INFO, DATA, CONFIG_DONE, POWER_UP, ACQUISITION_DONE = 2, 5, 19, 23, 26
STOP, START, COMPONENTS, CONFIG, ACQUISITION, STOP_CAL = 22, 21, 3, 6, 24, 11


def frame_ids(frames):
    return [frame[2] for frame in frames]


@pytest.fixture
def compass(line):
    return PniCompass(line, PniOptions())


@pytest.fixture
def set_up_s(compass):
    """Complete the set-up from 0 s on; return the time after it."""
    now_s = 0.0
    for _ in range(7):
        compass.receive(now_s)
        now_s += COMMAND_INTERVAL_S
    return now_s


def test_set_up_is_that_of_the_manual(line, pni, set_up_s):
    assert line.written == [
        pni(STOP),  # stop sending
        pni(CONFIG, bytes([6, 1])),  # big endian
        pni(CONFIG, bytes([2, 0])),  # magnetic north
        pni(CONFIG, bytes([15, 0])),  # degrees
        pni(COMPONENTS, bytes([5, 5, 24, 25, 8, 7])),  # 5 components
        bytes.fromhex("000F180000000000003DCCCCCDF971"),  # send every 0.1 s
        bytes.fromhex("000515BD61"),
    ]


def test_set_up_without_replies_is_repeated_with_both_push_modes(line, compass):
    times = []
    for step in range(3000):  # 30 s in steps of 10 ms
        sent = len(line.written)
        compass.receive(step / 100)
        times += [step / 100] * (len(line.written) - sent)
    assert all(later - earlier >= COMMAND_INTERVAL_S - 1e-9 for earlier, later in itertools.pairwise(times))
    rounds = 30 / (6 * COMMAND_INTERVAL_S + DATA_TIMEOUT_S)
    assert rounds - 2 <= len(times) / 7 <= rounds + 1
    assert frame_ids(line.written[:14]) == [STOP, CONFIG, CONFIG, CONFIG, COMPONENTS, ACQUISITION, START] * 2
    assert [frame[3] for frame in line.written if frame[2] == ACQUISITION][:4] == [0, 1, 0, 1]


def test_confirmation_is_followed_by_the_next_command_at_once(line, deliver, compass, pni):
    compass.receive(0.0)
    compass.receive(COMMAND_INTERVAL_S)
    deliver(compass, pni(CONFIG_DONE), now_s=COMMAND_INTERVAL_S + 0.004)
    assert frame_ids(line.written) == [STOP, CONFIG, CONFIG]
    assert compass.health(COMMAND_INTERVAL_S).text == "connected, no heading yet"
    deliver(compass, pni(ACQUISITION_DONE) * 50, now_s=COMMAND_INTERVAL_S + 0.008)
    assert frame_ids(line.written) == [STOP, CONFIG, CONFIG, CONFIG]
    deliver(compass, pni(MODULE_INFO, b"TCM51208"), now_s=COMMAND_INTERVAL_S + 0.012)  # confirms nothing
    assert frame_ids(line.written) == [STOP, CONFIG, CONFIG, CONFIG]


def test_headings_are_magnetic(deliver, compass, pni_heading, set_up_s, near):
    (sample,) = deliver(compass, pni_heading(98.5), now_s=set_up_s)
    assert near(sample.heading_rad, 98.5)
    assert near(sample.pitch_rad, 1.5)
    assert near(sample.roll_rad, -2.5)
    assert (sample.t_s, sample.reference, sample.temperature_c) == (set_up_s, NorthReference.MAGNETIC, 18.0)
    assert (sample.variation_rad, sample.yaw_rate_rad_s, sample.source) == (None, None, 0)
    assert compass.health(set_up_s).state is DeviceState.RUNNING
    assert deliver(compass, pni_heading(360.0), now_s=set_up_s)[0].heading_rad == 0.0


def test_nothing_is_sent_while_headings_arrive(line, deliver, compass, pni, pni_heading, set_up_s):
    deliver(compass, pni(CONFIG_DONE), now_s=set_up_s)
    samples = [deliver(compass, pni_heading(98.5), now_s=set_up_s + tenth / 10) for tenth in range(100)]
    assert [len(batch) for batch in samples] == [1] * 100
    assert len(line.written) == 7


def test_module_is_set_up_again_after_silence_and_after_power_up(line, deliver, compass, pni, pni_heading, set_up_s):
    deliver(compass, pni_heading(98.5), now_s=set_up_s)
    compass.receive(set_up_s + DATA_TIMEOUT_S - 0.01)
    assert len(line.written) == 7
    compass.receive(set_up_s + DATA_TIMEOUT_S)
    assert frame_ids(line.written[7:]) == [STOP]
    deliver(compass, pni(POWER_UP), now_s=set_up_s + DATA_TIMEOUT_S + 0.01)
    assert frame_ids(line.written[7:]) == [STOP, STOP]
    assert compass.calibration().state is CalibrationState.NONE
    for step in range(400):  # in the mode that gave headings
        compass.receive(set_up_s + 2.0 + step / 100)
    assert [frame[3] for frame in line.written if frame[2] == ACQUISITION] == [0] * 4
    assert compass.health(set_up_s + 3.0).state is DeviceState.SILENT


def test_data_without_a_heading_do_not_prevent_the_set_up(line, deliver, compass, pni, pni_heading, set_up_s):
    for tenth in range(30):
        data = pni(DATA, bytes([1, 7]) + struct.pack(">f", 20.0))
        assert deliver(compass, data, now_s=set_up_s + tenth / 10) == ()
    assert len(line.written) > 7
    assert compass.health(set_up_s + 3.0).text == "data without heading"
    deliver(compass, pni_heading(98.5), now_s=set_up_s + 3.0)
    assert compass.health(set_up_s + 3.0).text == ""


@pytest.mark.parametrize("push_mode", [0, 1])
def test_driver_with_emulator_recovers_after_a_power_cut(line, compass, push_mode):
    boat = SimpleNamespace(heading_rad=lambda: math.radians(98.5), yaw_rate_rad_s=lambda: 0.0)
    emulator = PniTcmEmulator(boat, np.random.default_rng(1), noise_deg=0.0, push_mode=push_mode)
    times = []
    for step in range(1000):  # 10 s in steps of 10 ms; without power from 5 s to 6 s
        now_s = step / 100
        if step == 500:
            emulator.power_cycle(now_s, 1.0)
        sent = len(line.written)
        compass.receive(now_s)
        emulator.receive(now_s, b"".join(line.written[sent:]))
        if emulator.next_output_s() <= now_s:
            line.inbox += emulator.take_output(now_s)
        samples = compass.poll()
        assert [round(math.degrees(sample.heading_rad), 3) for sample in samples] == [98.5] * len(samples)
        times += [sample.t_s for sample in samples]
    start_s = next(time_s for time_s in times if time_s < 5.0)
    recovered_s = next(time_s for time_s in times if time_s > 5.1)
    assert start_s < 0.5 + 1.5 * push_mode
    # After 0.3 s of boot, at most one set-up that was sent too early, and the next one in the mode that worked before.
    assert recovered_s < 6.3 + DATA_TIMEOUT_S + 7 * COMMAND_INTERVAL_S + 0.15
    assert len(times) == pytest.approx(10.0 * (5.0 - start_s + 10.0 - recovered_s), abs=4)
    assert compass.health(10.0).rejected == 0


def test_reopened_port_is_set_up_at_once(line, deliver, compass, pni_heading, set_up_s):
    deliver(compass, pni_heading(98.5), pni_heading(98.5)[:7], now_s=set_up_s)
    line.unplug()
    compass.receive(set_up_s + 0.1)
    assert (len(line.written), compass.fileno()) == (7, -1)
    assert compass.health(set_up_s).state is DeviceState.ABSENT
    line.plug()
    compass.receive(set_up_s + 0.2)
    assert frame_ids(line.written[7:]) == [STOP]
    assert compass.health(set_up_s).state is DeviceState.STARTING
    for step in range(400):  # without headings since then, the push modes are used in turn
        compass.receive(set_up_s + 0.2 + step / 100)
    assert [frame[3] for frame in line.written if frame[2] == ACQUISITION][:4] == [0, 0, 1, 0]


def test_set_up_begins_again_after_a_cancelled_calibration(line, compass):
    compass.receive(0.0)
    compass.receive(COMMAND_INTERVAL_S)
    assert compass.calibrate(0.06)
    assert compass.calibration().state is CalibrationState.RUNNING
    compass.cancel()
    compass.receive(0.2)
    assert frame_ids(line.written) == [STOP, CONFIG, STOP_CAL, STOP]


def test_command_is_repeated_after_a_blocked_line(line, compass):
    line.full = True
    compass.receive(0.0)
    line.full = False
    compass.receive(COMMAND_INTERVAL_S / 2)
    assert line.written == []
    compass.receive(COMMAND_INTERVAL_S)
    assert frame_ids(line.written) == [STOP]


def test_values_out_of_range_are_rejected_and_reported(deliver, compass, pni_heading, set_up_s):
    assert deliver(compass, pni_heading(400.0), now_s=set_up_s) == ()
    health = compass.health(set_up_s)
    assert (health.rejected, health.state) == (1, DeviceState.STARTING)
    assert "out of range" in health.text


def test_distorted_magnetic_field_is_a_fault_and_the_heading_is_used(deliver, compass, pni_heading, set_up_s):
    assert len(deliver(compass, pni_heading(98.5, distortion=1), now_s=set_up_s)) == 1
    health = compass.health(set_up_s)
    assert (health.state, health.text) == (DeviceState.FAULTY, "magnetic field distorted")
    deliver(compass, pni_heading(98.5), now_s=set_up_s)
    assert compass.health(set_up_s).state is DeviceState.RUNNING


def test_frames_with_one_wrong_bit_are_rejected_and_the_next_ones_decoded(deliver, compass, pni_heading, set_up_s):
    frame = pni_heading(98.5)
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        samples = deliver(compass, bytes(damaged), frame, now_s=set_up_s)
        assert [round(math.degrees(sample.heading_rad), 4) for sample in samples] == [98.5], bit
    assert compass.health(set_up_s).accepted == 8 * len(frame)


def test_rate_is_checked_and_sets_the_interval_and_the_timeouts(line, deliver, pni_heading):
    assert PniOptions(rate_hz=100.0).rate_hz == 100.0
    for rate_hz in (0.49, -1.0, 100.1, math.nan, math.inf):
        with pytest.raises(ValueError, match="rate_hz"):
            PniOptions(rate_hz=rate_hz)
    compass = PniCompass(line, PniOptions(rate_hz=0.5))
    for step in range(8):
        compass.receive(step * COMMAND_INTERVAL_S)
    assert struct.unpack(">f", line.written[5][9:13]) == (2.0,)
    deliver(compass, pni_heading(98.5), now_s=1.0)  # the next three headings are due until 7 s
    assert [compass.health(now_s).state for now_s in (7.0, 7.1)] == [DeviceState.RUNNING, DeviceState.SILENT]
    compass.receive(6.9)
    assert len(line.written) == 7
    compass.receive(7.0)
    assert len(line.written) == 8
