"""Mode, arming and checks by command."""

import math

import pytest

from firmware_py.intents import Arm, SetMode

DENIED = 2


def results(messages):
    return [message.result for message in messages if message.get_type() == "COMMAND_ACK"]


@pytest.mark.parametrize("mode", [0, 4, 15, 0x7FFF0000, 4294967040])
def test_the_mode_number_is_taken_whole(rig, mode):
    rig.command(176, 1, mode)
    assert rig.authority.intents == [SetMode(mode)]


@pytest.mark.parametrize(
    ("base_mode", "mode"),
    [(1, math.nan), (1, math.inf), (1, -1), (1, 0.5), (1, 1e30), (0, 4), (math.nan, 4), (128, 4), (1e9, 4), (-1, 4)],
)
def test_a_mode_that_is_none_is_denied(rig, base_mode, mode):
    assert results(rig.command(176, base_mode, mode)) == [DENIED]
    assert rig.authority.intents == []


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (1, 0, Arm(True)),
        (0, 0, Arm(False)),
        (1, math.nan, Arm(True)),
        (1, 21196, Arm(True, force=True)),
        (0, 21196, Arm(False, force=True)),
        (1, 2989, Arm(True)),
    ],
)
def test_arming(rig, first, second, expected):
    rig.command(400, first, second)
    assert rig.authority.intents == [expected]


@pytest.mark.parametrize("first", [2, -1, 0.5, math.nan, math.inf, 3e38])
def test_neither_arm_nor_disarm_is_denied(rig, first):
    assert results(rig.command(400, first)) == [DENIED]
    assert rig.authority.intents == []


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"armed": False}, "PreArm: all good"),
        ({"armed": False, "heading_ok": False}, "PreArm: no valid heading"),
        ({"armed": False, "rudder_ok": False}, "PreArm: rudder servo does not answer"),
    ],
)
def test_the_checks_say_what_is_wrong(rig, texts, changes, text):
    rig.tick(**changes)
    said = rig.command(401)
    assert results(said) == [0]
    assert texts(said) == [text]


def test_no_checks_while_armed_or_before_the_first_tick(rig, make_rig):
    assert results(rig.command(401)) == [1]
    assert results(make_rig().command(401)) == [1]
