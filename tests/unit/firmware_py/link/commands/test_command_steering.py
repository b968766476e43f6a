"""Heading and position goals by command."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import SteerHeading, SteerPosition

NAN = math.nan
DENIED = 2
BAD = (NAN, math.inf, -math.inf, 1e30, -3.4e38)


def degrees(angle_deg):
    return pytest.approx(math.radians(angle_deg))


def results(messages):
    return [message.result for message in messages if message.get_type() == "COMMAND_ACK"]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((90, NAN, 0, 0), SteerHeading(degrees(90))),
        ((350, 10, 1, 0), SteerHeading(degrees(350), turn=1)),
        ((350, 0, -1, 0), SteerHeading(degrees(350), turn=-1)),
        ((360, 0, 0, 0), SteerHeading(degrees(360))),
        ((20, 0, 1, 1), SteerHeading(degrees(20), relative=True, turn=1)),
        ((20, 0, -1, 1), SteerHeading(degrees(-20), relative=True, turn=-1)),
        ((80, 0, 0, 1), SteerHeading(degrees(80), relative=True)),
        ((-20, 0, 0, 1), SteerHeading(degrees(-20), relative=True)),
    ],
)
def test_condition_yaw(rig, values, expected):
    assert results(rig.command(115, *values, NAN, NAN, NAN)) == [0]
    assert rig.request_handler.intents == [expected]


@pytest.mark.parametrize(
    "values",
    [
        *((bad, 0, 0, 0) for bad in BAD),
        *((90, 0, bad, 0) for bad in BAD),
        *((90, 0, 0, bad) for bad in BAD),
        (361, 0, 0, 0),
        (-1, 0, 0, 0),
        (-1, 0, 1, 1),
        (90, 0, 0.5, 0),
        (90, 0, 2, 0),
        (90, 0, 0, 0.5),
    ],
)
def test_a_bad_condition_yaw_is_denied(rig, values):
    assert results(rig.command(115, *values)) == [DENIED]
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((0, 45, NAN), SteerHeading(degrees(45), over_ground=True)),
        ((1, 359.5, 3), SteerHeading(degrees(359.5))),
    ],
)
def test_guided_change_heading(rig, values, expected):
    assert results(rig.command(43002, *values)) == [0]
    assert rig.request_handler.intents == [expected]


@pytest.mark.parametrize("values", [*((1, bad) for bad in BAD), *((bad, 1) for bad in BAD), (2, 1), (1, 361), (1, -1)])
def test_a_bad_guided_change_heading_is_denied(rig, values):
    assert results(rig.command(43002, *values)) == [DENIED]
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((-30, NAN, 1), SteerHeading(degrees(-30), relative=True)),
        ((270, 2, 0), SteerHeading(degrees(270))),
    ],
)
def test_nav_set_yaw_speed(rig, values, expected):
    assert results(rig.command(213, *values)) == [0]
    assert rig.request_handler.intents == [expected]


@pytest.mark.parametrize("values", [*((bad, 0, 0) for bad in BAD), *((1, 0, bad) for bad in BAD), (400, 0, 0)])
def test_a_bad_nav_set_yaw_speed_is_denied(rig, values):
    assert results(rig.command(213, *values)) == [DENIED]
    assert rig.request_handler.intents == []


def reposition(x, y, *, frame=6, flags=1.0):
    return mavlink.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, -1, flags, 0, NAN, x, y, NAN)


def test_reposition_by_command_int_and_long(rig):
    expected = SteerPosition(degrees(40.1), degrees(-11.5), change_mode=True)
    assert results(rig.tell(reposition(401_000_000, -115_000_000))) == [0]
    assert results(rig.command(192, -1, 0, 0, NAN, 40.0, -11.5, NAN)) == [0]
    assert rig.request_handler.intents == [expected, SteerPosition(degrees(40), degrees(-11.5))]


@pytest.mark.parametrize(
    "message",
    [
        reposition(2**31 - 1, 2**31 - 1),
        reposition(900_000_001, 0),
        reposition(0, 0),
        mavlink.MAVLink_command_long_message(1, 1, 192, 0, -1, 1, 0, 0, 0, 0, 0),
        reposition(0, -(2**31)),
        reposition(1, 1, frame=1),
        reposition(1, 1, flags=NAN),
        reposition(1, 1, flags=-1.0),
        *(mavlink.MAVLink_command_long_message(1, 1, 192, 0, -1, 0, 0, 0, bad, 0, 0) for bad in BAD),
        *(mavlink.MAVLink_command_long_message(1, 1, 192, 0, -1, 0, 0, 0, 0, bad, 0) for bad in BAD),
    ],
)
def test_a_bad_reposition_is_denied(rig, message):
    assert results(rig.tell(message)) == [DENIED]
    assert rig.request_handler.intents == []
