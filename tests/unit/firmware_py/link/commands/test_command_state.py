"""Mode, arming and checks by command."""

import math

import pytest

from firmware_py.common.intents import Answer, Arm, Restart, SetMode, Verdict
from firmware_py.common.mode_table import Mode

DENIED, UNSUPPORTED, FAILED = 2, 3, 4


def results(messages):
    return [message.result for message in messages if message.get_type() == "COMMAND_ACK"]


@pytest.mark.parametrize("mode", [0, 4, 15, 0x7FFF0000, 4294967040])
def test_the_mode_number_is_taken_whole(rig, mode):
    rig.command(176, 1, mode)
    assert rig.request_handler.intents == [SetMode(mode)]


@pytest.mark.parametrize(
    ("base_mode", "mode"),
    [(1, math.nan), (1, math.inf), (1, -1), (1, 0.5), (1, 1e30), (0, 4), (math.nan, 4), (128, 4), (1e9, 4), (-1, 4)],
)
def test_a_mode_that_is_none_is_denied(rig, base_mode, mode):
    assert results(rig.command(176, base_mode, mode)) == [DENIED]
    assert rig.request_handler.intents == []


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
    assert rig.request_handler.intents == [expected]


@pytest.mark.parametrize("first", [2, -1, 0.5, math.nan, math.inf, 3e38])
def test_neither_arm_nor_disarm_is_denied(rig, first):
    assert results(rig.command(400, first)) == [DENIED]
    assert rig.request_handler.intents == []


@pytest.mark.parametrize("place", [(45.0, -120.0), (0.0, 1e-5), (math.inf, 0.0)])
def test_loiter_at_another_place_is_refused(rig, texts, place):
    replies = rig.command(17, 0, 0, 0, math.nan, *place)
    assert results(replies) == [DENIED]
    assert "DO_REPOSITION" in "".join(texts(replies))
    assert rig.request_handler.intents == []
    assert results(rig.command(17, 0, 0, 0, math.nan, math.nan, math.nan)) == [0]


@pytest.mark.parametrize(("number", "mode"), [(17, 5), (20, 11)])
def test_a_mode_by_its_own_command(rig, texts, number, mode):
    assert results(rig.command(number, math.nan)) == [0]
    assert rig.request_handler.intents == [SetMode(mode)]
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "RTL refused: no home")
    replies = rig.command(number)
    assert (results(replies), texts(replies)) == ([1], ["RTL refused: no home"])


def test_standard_modes(rig):
    assert results(rig.command(262, 6)) == results(rig.command(262, 5)) == [0]
    assert rig.request_handler.intents == [SetMode(10), SetMode(11)]
    for standard in (0, 1, 7, 99, -1, 0.5, math.nan, math.inf):
        assert results(rig.command(262, standard)) == [FAILED]
    assert len(rig.request_handler.intents) == 2


def test_the_intended_mode_is_the_last_that_was_entered(rig, of):
    rig.command(176, 1, 10)
    assert of(rig.tick(mode=Mode.LOITER), "CURRENT_MODE")[-1].intended_custom_mode == 10
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "no")
    rig.command(176, 1, 11)
    assert of(rig.tick(mode=Mode.AUTO), "CURRENT_MODE")[-1].intended_custom_mode == 10
    rig.request_handler.answer = Answer(Verdict.ACCEPTED)
    rig.command(192, 0, 1, 0, 0, 10, 10)
    assert of(rig.tick(mode=Mode.GUIDED), "CURRENT_MODE")[-1].intended_custom_mode == 15


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((1,), Restart()),
        ((2,), Restart(shutdown=True)),
        ((1, math.nan, math.nan), Restart()),
        ((1, 0, 0, 0, 0, 20190226), Restart(force=True)),
        ((1, 0, 0, 0, 0, 20190225), Restart()),
    ],
)
def test_restart(rig, values, expected):
    assert results(rig.command(246, *values)) == [0]
    assert rig.request_handler.intents == [expected]


@pytest.mark.parametrize(
    ("values", "result"),
    [
        ((0,), 0), ((3,), DENIED), ((4,), DENIED), ((math.nan,), DENIED), ((-1,), DENIED), ((1, 1), UNSUPPORTED),
        ((0, 2), UNSUPPORTED), ((1, 0, 1), UNSUPPORTED), ((1, math.inf), UNSUPPORTED),
    ],
)  # fmt: skip
def test_what_is_no_restart_of_the_autopilot_does_nothing(rig, values, result):
    assert results(rig.command(246, *values)) == [result]
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"armed": False}, "PreArm: all good"),
        ({"armed": False, "prearm_refusal": "no valid heading"}, "PreArm: no valid heading"),
    ],
)
def test_the_checks_say_what_is_wrong(rig, texts, changes, text):
    rig.tick(**changes)
    replies = rig.command(401)
    assert results(replies) == [0]
    assert texts(replies) == [text]


def test_no_checks_while_armed_or_before_the_first_tick(rig, make_rig):
    assert results(rig.command(401)) == [1]
    assert results(make_rig().command(401)) == [1]


def test_the_banner_names_version_and_commit(rig, texts):
    assert texts(rig.command(42428)) == ["Rambler 0.1.0 (git 0123abcd)"]
