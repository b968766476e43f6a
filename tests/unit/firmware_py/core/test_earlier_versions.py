"""Every field of earlier versions finds its place, also those that no recording happens to fill."""

import json
from collections import Counter

import pytest

from firmware_py.core import resume
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.guidance.tasks import GoTo, HoldHeading, HoldStation, Orbit
from firmware_py.modes import HeadingGoal, PositionGoal
from support.paths import REPLAY

TEXTS = (REPLAY / "first_layout" / "every_field.jsonl").read_text().splitlines()
STATES = [text for text in TEXTS if json.loads(text)["$"] == "State"]
RESUMES = [text for text in TEXTS if json.loads(text)["$"] == "Resume"]
FOURTH = (REPLAY / "fourth_layout" / "every_field.jsonl").read_text().splitlines()
# Given up: the filter of nine states, whose numbers mean nothing to another, the second estimate of the water, and
# the sums of a steering monitor that judged otherwise.
FILTER = ("x", "p", "sensitivity")
TURNS, SUMS = ("block", "turn_square", "blocks"), ("expected_rad_s", "expected_square", "product")
JUDGE = ("answer", "rate_rad_s", "slow_rate_rad_s", "telling_s", "expected_rad", "turned_rad")
WATER = ("covariance", "noise", "outliers", "block", "average", "leg")
TASKS = [HoldHeading, GoTo, HoldStation, Orbit]
GOALS = [HeadingGoal, PositionGoal, HeadingGoal, PositionGoal]


def numbers(data):
    """The numbers at any depth that the fixture gave but once, whatever field they stand in."""
    if isinstance(data, dict):
        return sum((numbers(value) for name, value in data.items() if name != "parameters"), Counter())
    if isinstance(data, list):
        return sum(map(numbers, data), Counter())
    return Counter([data] if isinstance(data, float) or (type(data) is int and data > 1000) else [])


@pytest.mark.parametrize(("text", "kinds"), list(zip(STATES, zip(TASKS, GOALS, strict=True), strict=True)))
def test_a_state_loses_no_number_and_no_task_its_kind(text, kinds):
    state, notes = state_from_text(text)
    before = json.loads(text)
    del before["position"]  # it stood in the estimate of the position, too
    gone = (before["lookout"]["waves"], FILTER), (before["current"], WATER), (before["watch"], TURNS)
    for record, given_up in (*gone, (before["watch"]["authority"], SUMS)):
        for name in given_up:
            del record[name]
    del before["lookout"]["waves"]["learned"]["information"]
    del before["watch"]["authority"]["slow_rate_rad_s"]
    assert notes == ()
    assert not numbers(before) - numbers(json.loads(state_to_text(state)))
    mission = state.guidance.mission
    assert {type(state.guidance.task), type(mission.task)} == {kinds[0]}
    assert type(mission.pause_task) is HoldStation
    assert type(state.modes.goal) is kinds[1]


@pytest.mark.parametrize(("text", "task"), list(zip(RESUMES, TASKS, strict=True)))
def test_a_resume_record_loses_no_number_and_no_task_its_kind(text, task):
    record, notes = resume.from_text(text)
    assert notes == ()
    assert not numbers(json.loads(text)) - numbers(json.loads(resume.to_text(record)))
    assert type(record.task) is task


@pytest.mark.parametrize("text", FOURTH)
def test_a_record_of_the_fourth_version_loses_no_number(text):
    before = json.loads(text)
    read, write = {"State": (state_from_text, state_to_text), "Resume": (resume.from_text, resume.to_text)}[before["$"]]
    record, notes = read(text)
    assert notes == ()
    assert len(numbers(before)) > {"State": 450, "Resume": 30}[before["$"]]
    for name in JUDGE if before["$"] == "State" else ():
        del before["supervisor"]["steering_monitor"][name]
    assert not numbers(before) - numbers(json.loads(write(record)))
