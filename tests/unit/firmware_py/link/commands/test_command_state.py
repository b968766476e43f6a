"""Commands on mode, arming and checks."""

import math

import pytest

from firmware_py.common.intents import Answer, SetMode, Verdict
from firmware_py.common.mode_table import Mode
from support.link import results

DENIED, UNSUPPORTED, FAILED = 2, 3, 4


@pytest.mark.parametrize("position", [(45.0, -120.0), (0.0, 1e-5), (math.inf, 0.0)])
def test_loiter_at_another_position_is_refused(rig, texts, position):
    replies = rig.command(17, 0, 0, 0, math.nan, *position)
    assert results(replies) == [DENIED]
    assert "DO_REPOSITION" in "".join(texts(replies))
    assert rig.request_handler.intents == []
    assert results(rig.command(17, 0, 0, 0, math.nan, math.nan, math.nan)) == [0]


@pytest.mark.parametrize(("number", "mode"), [(17, 5), (20, 11)])
def test_mode_has_its_own_command(rig, texts, number, mode):
    assert results(rig.command(number, math.nan)) == [0]
    assert rig.request_handler.intents == [SetMode(mode)]
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "RTL refused: no home")
    replies = rig.command(number)
    assert (results(replies), texts(replies)) == ([1], ["RTL refused: no home"])


def test_intended_mode_is_the_last_accepted_one(rig, of):
    rig.command(176, 1, 10)
    assert of(rig.tick(mode=Mode.LOITER), "CURRENT_MODE")[-1].intended_custom_mode == 10
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "no")
    rig.command(176, 1, 11)
    assert of(rig.tick(mode=Mode.AUTO), "CURRENT_MODE")[-1].intended_custom_mode == 10
    rig.request_handler.answer = Answer(Verdict.ACCEPTED)
    rig.command(192, 0, 1, 0, 0, 10, 10)
    assert of(rig.tick(mode=Mode.GUIDED), "CURRENT_MODE")[-1].intended_custom_mode == 15


@pytest.mark.parametrize(
    ("changes", "text"),
    [({}, "PreArm: all good"), ({"prearm_refusal": "no valid heading"}, "PreArm: no valid heading")],
)
def test_prearm_checks_report_the_reason(rig, texts, changes, text):
    rig.tick(armed=False, **changes)
    replies = rig.command(401)
    assert (results(replies), texts(replies)) == ([0], [text])


def test_prearm_checks_are_refused_armed_or_before_the_first_tick(rig, make_rig):
    assert results(rig.command(401)) == [1]
    assert results(make_rig().command(401)) == [1]


def test_banner_has_version_and_commit(rig, texts):
    assert texts(rig.command(42428)) == ["Rambler 0.1.0 (git 0123abcd)"]
