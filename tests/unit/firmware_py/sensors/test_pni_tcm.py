"""The PNI driver sets its module up, keeps at it, and gives only sound headings."""

import itertools
import math
import struct
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_py.common.records import DeviceState, NorthReference
from firmware_py.sensors.pni_tcm import COMMAND_INTERVAL_S, DATA_TIMEOUT_S, PniCompass, PniOptions
from hil.devices.pni_tcm import PniTcmEmulator

DATA, CONFIG_DONE, POWER_UP, ACQUISITION_DONE = 5, 19, 23, 26


def ids(written):
    return [frame[2] for frame in written]


@pytest.fixture
def compass(line):
    return PniCompass(line, PniOptions())


@pytest.fixture
def set_up(line, compass):
    """Run the set-up through, from 0 s; the time after it."""
    now_s = 0.0
    while len(line.written) < 7:
        compass.receive(now_s)
        now_s += COMMAND_INTERVAL_S
    return now_s


def test_the_set_up_is_what_the_manual_asks(line, compass, pni, set_up):
    assert line.written == [
        pni(22),  # stop pushing
        pni(6, bytes([6, 1])),  # numbers big endian
        pni(6, bytes([2, 0])),  # headings from magnetic north
        pni(6, bytes([15, 0])),  # in degrees
        pni(3, bytes([5, 5, 24, 25, 8, 7])),
        bytes.fromhex("000F180000000000003DCCCCCDF971"),  # the vector of the design notes: push every 0.1 s
        bytes.fromhex("000515BD61"),
    ]


def test_one_command_at_a_time_and_never_a_flood(line, compass):
    times = []
    for step in range(3000):  # 30 s in steps of 10 ms, without replies
        before = len(line.written)
        compass.receive(step / 100)
        times += [step / 100] * (len(line.written) - before)
    assert all(later - earlier >= COMMAND_INTERVAL_S - 1e-9 for earlier, later in itertools.pairwise(times))
    rounds = 30 / (6 * COMMAND_INTERVAL_S + DATA_TIMEOUT_S)
    assert rounds - 2 <= len(times) / 7 <= rounds + 1
    assert ids(line.written[:14]) == [22, 6, 6, 6, 3, 24, 21] * 2
    modes = [frame[3] for frame in line.written if frame[2] == 24]
    assert modes[:4] == [0, 1, 0, 1]  # the manuals do not agree which one pushes


def test_a_confirmation_brings_the_next_command_at_once(line, compass, pni):
    compass.receive(0.0)
    compass.receive(COMMAND_INTERVAL_S)
    line.inbox += pni(CONFIG_DONE)
    compass.receive(COMMAND_INTERVAL_S + 0.004)
    assert ids(line.written) == [22, 6, 6]
    assert compass.health(COMMAND_INTERVAL_S).text == "connected, no heading yet"
    line.inbox += pni(ACQUISITION_DONE) * 50
    compass.receive(COMMAND_INTERVAL_S + 0.008)
    assert ids(line.written) == [22, 6, 6, 6]


def test_headings_are_magnetic(line, compass, pni_heading, set_up, near):
    line.inbox += pni_heading(98.5)
    compass.receive(set_up)
    (sample,) = compass.poll()
    assert near(sample.heading_rad, 98.5)
    assert near(sample.pitch_rad, 1.5)
    assert near(sample.roll_rad, -2.5)
    assert (sample.t_s, sample.reference, sample.temperature_c) == (set_up, NorthReference.MAGNETIC, 18.0)
    assert (sample.variation_rad, sample.yaw_rate_rad_s, sample.source) == (None, None, 0)
    assert compass.health(set_up).state is DeviceState.RUNNING
    line.inbox += pni_heading(360.0)
    compass.receive(set_up)
    assert compass.poll()[0].heading_rad == 0.0


def test_nothing_is_sent_while_headings_come(line, compass, pni_heading, set_up):
    for tenth in range(100):
        line.inbox += pni_heading(98.5)
        compass.receive(set_up + tenth / 10)
    assert len(line.written) == 7
    assert len(compass.poll()) == 100


def test_a_module_that_lost_its_power_is_set_up_again(line, compass, pni, pni_heading, set_up):
    line.inbox += pni_heading(98.5)
    compass.receive(set_up)
    compass.receive(set_up + DATA_TIMEOUT_S - 0.01)
    assert len(line.written) == 7
    compass.receive(set_up + DATA_TIMEOUT_S)
    assert ids(line.written[7:]) == [22]
    line.inbox += pni(POWER_UP)
    compass.receive(set_up + DATA_TIMEOUT_S + 0.01)
    assert ids(line.written[7:]) == [22, 22]  # it said that it has just come up: from the beginning, at once
    assert compass.health(set_up + 3.0).state is DeviceState.SILENT


def test_data_without_a_heading_is_no_excuse(line, compass, pni, set_up):
    for tenth in range(30):
        line.inbox += pni(DATA, bytes([1, 7]) + struct.pack(">f", 20.0))
        compass.receive(set_up + tenth / 10)
    assert len(line.written) > 7
    assert compass.health(set_up + 3.0).text == "data without heading"
    assert compass.poll() == ()


@pytest.mark.parametrize("push_mode", [0, 1])
def test_with_an_emulator_that_was_written_from_the_manual(line, compass, push_mode):
    emulator = PniTcmEmulator(
        SimpleNamespace(heading_rad=lambda: math.radians(98.5), yaw_rate_rad_s=lambda: 0.0),
        np.random.default_rng(1),
        noise_deg=0.0,
        push_mode=push_mode,
    )
    times = []
    for step in range(1000):  # 10 s in steps of 10 ms, the power cut for a second after 5 s
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
    begun_s = next(time_s for time_s in times if time_s < 5.0)
    back_s = next(time_s for time_s in times if time_s > 5.1)
    assert begun_s < 0.5 + 1.5 * push_mode
    # Power and 0.3 s of boot, at worst a round that came just too early, and one more in the mode that worked.
    assert back_s < 6.3 + DATA_TIMEOUT_S + 7 * COMMAND_INTERVAL_S + 0.15
    assert len(times) == pytest.approx(10.0 * (5.0 - begun_s + 10.0 - back_s), abs=4)
    assert compass.health(10.0).rejected == 0


def test_a_port_that_comes_back_is_set_up_at_once(line, compass, pni_heading, set_up):
    line.inbox += pni_heading(98.5)[:7]
    compass.receive(set_up)
    line.unplug()
    compass.receive(set_up + 0.1)
    assert (len(line.written), compass.fileno()) == (7, -1)
    assert compass.health(set_up).state is DeviceState.ABSENT
    line.plug()
    compass.receive(set_up + 0.2)
    assert ids(line.written[7:]) == [22]
    assert compass.health(set_up).state is DeviceState.STARTING


def test_a_full_line_repeats_the_command(line, compass):
    line.full = True
    compass.receive(0.0)
    line.full = False
    compass.receive(COMMAND_INTERVAL_S / 2)
    assert line.written == []
    compass.receive(COMMAND_INTERVAL_S)
    assert ids(line.written) == [22]


@pytest.mark.parametrize("values", [(math.nan,), (400.0,), (1.0, math.inf)])
def test_absurd_values_are_refused_and_reported(line, compass, pni_heading, set_up, values):
    line.inbox += pni_heading(*values)
    compass.receive(set_up)
    health = compass.health(set_up)
    assert compass.poll() == ()
    assert (health.rejected, health.state) == (1, DeviceState.STARTING)
    assert "out of range" in health.text


def test_a_distorted_field_is_a_fault_of_the_device_and_the_heading_is_given(line, compass, pni_heading, set_up):
    line.inbox += pni_heading(98.5, distortion=1)
    compass.receive(set_up)
    assert len(compass.poll()) == 1
    health = compass.health(set_up)
    assert (health.state, health.text) == (DeviceState.FAULTY, "magnetic field distorted")
    line.inbox += pni_heading(98.5)
    compass.receive(set_up)
    assert compass.health(set_up).state is DeviceState.RUNNING


def test_every_bit_flip_of_a_frame_is_refused(line, compass, pni_heading, set_up):
    frame = pni_heading(98.5)
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        line.inbox += damaged + frame  # the good one behind it must be found
        compass.receive(set_up)
        samples = compass.poll()
        assert [round(math.degrees(sample.heading_rad), 4) for sample in samples] == [98.5], bit
    assert compass.health(set_up).accepted == 8 * len(frame)


def test_a_rate_that_cannot_be_is_refused(line):
    for rate_hz in (0.0, -1.0, math.nan, math.inf, 1e300):
        with pytest.raises(ValueError, match="rate_hz"):
            PniCompass(line, PniOptions(rate_hz=rate_hz))
    slow = PniCompass(line, PniOptions(rate_hz=0.5))
    for step in range(8):
        slow.receive(step * COMMAND_INTERVAL_S)
    assert struct.unpack(">f", line.written[5][9:13]) == (2.0,)
