"""Volz driver with a simulated servo."""

import math

import pytest

from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand
from support.servo_registers import Volz

COUNT_RAD = math.radians(100.0) / 1920


@pytest.fixture
def servo(fakes):
    return fakes.volz()


@pytest.fixture
def line(fakes, servo):
    return fakes.line(servo)


@pytest.fixture
def rig(fakes, line):
    return fakes.rig(volz_rudder(line, VolzOptions()))


def test_position_is_sent_and_feedback_returned(rig, servo, line):
    feedback = rig.ticks(5, shaft_deg=20.0)
    assert servo.requests[:2] == [Volz.READ_VOLTAGE, Volz.SET_POSITION]  # the first position is sent in the first tick
    assert servo.position == 2048 + 384
    last = feedback[-1]
    assert last.shaft_rad == pytest.approx(384 * COUNT_RAD)
    assert last.voltage_v == pytest.approx(28.0)
    assert last.current_a == pytest.approx(0.6)
    assert last.temperature_c == 31.0
    assert last.torque_on is True
    health = rig.health()
    assert (health.role, health.state, health.rejected) == (DeviceRole.RUDDER, DeviceState.RUNNING, 0)


def test_tick_is_a_position_and_one_reading_in_turn(rig, servo):
    rig.ticks(3)
    servo.requests.clear()
    rig.ticks(99)
    readings = (Volz.READ_CURRENT, Volz.READ_TEMPERATURE, Volz.READ_VOLTAGE) * 33
    assert servo.requests == [code for reading in readings for code in (Volz.SET_POSITION, reading)]


def test_positions_are_sent_if_replies_are_read_only_at_ticks(fakes, servo, line):
    rig = fakes.rig(volz_rudder(line, VolzOptions()), slack=0)
    rig.ticks(30)
    servo.requests.clear()
    rig.ticks(30)
    assert servo.requests.count(Volz.SET_POSITION) >= 18
    assert len(set(servo.requests)) == 4


def test_prompt_io_is_needed_after_the_position_and_not_after_the_reading(servo, fakes):
    line = fakes.line()
    rudder = volz_rudder(line, VolzOptions())
    rudder.command(RudderCommand(0.1, True), 1.0)
    assert rudder.needs_prompt_io()
    line.inbox += servo.handle(line.written[-1])
    rudder.receive(1.002)
    assert len(line.written) == 2
    assert not rudder.needs_prompt_io()


@pytest.mark.parametrize("is_reopened", [False, True])
def test_servo_is_used_again_after_silence_and_on_a_reopened_line(rig, servo, line, is_reopened):
    rig.ticks(5)
    if is_reopened:
        line.plug()
    else:
        servo.powered = False
        assert rig.ticks(8) == []
        assert rig.health().state is DeviceState.SILENT
        servo.powered = True
    first = rig.ticks(1, shaft_deg=-30.0)[0]
    assert rig.health().state is DeviceState.RUNNING
    # Values from before are discarded; one may have been read since.
    assert [first.voltage_v, first.current_a, first.temperature_c].count(None) >= 2
    rig.ticks(1, shaft_deg=-30.0)
    assert servo.position == 2048 - 576


def test_one_lost_reply_changes_nothing(rig, line):
    rig.ticks(3)
    for _ in range(10):
        line.lose_replies = 1
        assert rig.ticks(2)
        assert rig.health().state is DeviceState.RUNNING


def test_released_servo_is_read_without_positions(rig, servo):
    rig.ticks(3, shaft_deg=5.0)
    servo.requests.clear()
    feedback = rig.ticks(6, shaft_deg=30.0, torque_on=False)
    assert Volz.SET_POSITION not in servo.requests
    assert len(servo.requests) >= 6
    assert feedback[-1].torque_on is None
    assert feedback[-1].shaft_rad is None
    assert feedback[-1].voltage_v == pytest.approx(28.0)
    assert "no position sent" in rig.health().text


def test_only_readings_are_sent_before_the_first_command(servo, line):
    rudder = volz_rudder(line, VolzOptions())
    for tick in range(100):
        rudder.receive(0.02 * tick)
    assert Volz.SET_POSITION not in servo.requests
    assert 3 <= len(servo.requests) < 40
    assert rudder.health(2.0).state is DeviceState.RUNNING


def test_values_out_of_range_are_rejected(rig, servo):
    rig.ticks(4)
    servo.values[Volz.READ_TEMPERATURE] = (255, 0)
    servo.values[Volz.READ_VOLTAGE] = (0, 0)
    feedback = rig.ticks(3)
    assert feedback[-1].temperature_c is None
    assert feedback[-1].voltage_v is None
    assert rig.health().rejected == 2
