"""The Volz driver against a small servo."""

import math

import pytest

from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand

COUNT_RAD = math.radians(100.0) / 1920


@pytest.fixture
def servo(fakes):
    return fakes.volz()


@pytest.fixture
def line(fakes, servo):
    return fakes.line(servo)


@pytest.fixture
def sail(fakes, line):
    return fakes.sail(volz_rudder(line, VolzOptions()))


def test_steers_and_reads(sail, servo, line):
    feedback = sail.ticks(5, shaft_deg=20.0)
    assert servo.requests[:2] == [0xB1, 0xDC]  # the first position is sent in the first tick
    assert servo.position == 2048 + 384
    last = feedback[-1]
    assert last.shaft_rad == pytest.approx(384 * COUNT_RAD)
    assert last.voltage_v == pytest.approx(28.0)
    assert last.current_a == pytest.approx(0.6)
    assert last.temperature_c == 31.0
    assert last.torque_on is True
    health = sail.health()
    assert (health.role, health.state, health.rejected) == (DeviceRole.RUDDER, DeviceState.RUNNING, 0)


def test_a_tick_is_a_position_and_one_reading_in_turn(sail, servo):
    sail.ticks(3)
    servo.requests.clear()
    sail.ticks(6)
    assert servo.requests == [0xDC, 0xB0, 0xDC, 0xC0, 0xDC, 0xB1] * 2


def test_the_position_is_the_first_frame_of_every_tick(sail, servo):
    sail.ticks(3)
    for _ in range(100):
        servo.requests.clear()
        sail.ticks(1)
        assert servo.requests[0] == 0xDC
        assert len(servo.requests) == 2


def test_a_bus_served_at_ticks_only_delays_no_position(fakes, servo, line):
    sail = fakes.sail(volz_rudder(line, VolzOptions()), slack=0)
    sail.ticks(30)
    servo.requests.clear()
    sail.ticks(30)
    assert servo.requests.count(0xDC) >= 18
    assert len(set(servo.requests)) == 4


def test_the_reply_to_the_position_is_waited_for_and_that_to_the_reading_is_not(servo, fakes):
    line = fakes.line()
    rudder = volz_rudder(line, VolzOptions())
    rudder.command(RudderCommand(0.1, True), 1.0)
    assert rudder.needs_prompt_io()
    line.inbox += servo.handle(line.written[-1])
    rudder.receive(1.002)
    assert len(line.written) == 2
    assert not rudder.needs_prompt_io()


def test_silence_and_return(sail, servo):
    sail.ticks(5)
    servo.powered = False
    assert sail.ticks(8) == []
    assert sail.health().state is DeviceState.SILENT
    servo.powered = True
    feedback = sail.ticks(1, shaft_deg=-30.0)
    assert sail.health().state is DeviceState.RUNNING
    assert feedback[0].voltage_v is None  # from before the loss: not shown any more
    sail.ticks(1, shaft_deg=-30.0)
    assert servo.position == 2048 - 576


def test_one_lost_reply_changes_nothing(sail, line):
    sail.ticks(3)
    for _ in range(10):
        line.lose_replies = 1
        assert sail.ticks(2)
        assert sail.health().state is DeviceState.RUNNING


def test_released_it_is_read_and_not_steered(sail, servo):
    sail.ticks(3, shaft_deg=5.0)
    servo.requests.clear()
    feedback = sail.ticks(6, shaft_deg=30.0, torque_on=False)
    assert 0xDC not in servo.requests
    assert len(servo.requests) >= 6
    assert feedback[-1].torque_on is None
    assert feedback[-1].shaft_rad is None
    assert feedback[-1].voltage_v == pytest.approx(28.0)
    assert "no position sent" in sail.health().text


def test_only_readings_before_the_first_command(servo, line):
    rudder = volz_rudder(line, VolzOptions())
    for tick in range(100):
        rudder.receive(0.02 * tick)
    assert 0xDC not in servo.requests
    assert 3 <= len(servo.requests) < 40
    assert rudder.health(2.0).state is DeviceState.RUNNING


def test_impossible_values_are_refused(sail, servo):
    sail.ticks(4)
    servo.values[0xC0] = (255, 0)
    servo.values[0xB1] = (0, 0)
    feedback = sail.ticks(3)
    assert feedback[-1].temperature_c is None
    assert feedback[-1].voltage_v is None
    assert sail.health().rejected == 2


def test_late_replies_are_refused(sail, line, fakes):
    sail.ticks(4)
    line.inbox += fakes.volz_frame(0x2C, 1, 8, 0)
    sail.rudder.receive(sail.now_s)
    assert sail.health().rejected == 1
    assert sail.rudder.poll() == ()
