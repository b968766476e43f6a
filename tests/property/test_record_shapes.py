"""Records of any shape are read, or refused with ValueError."""

import functools
import itertools
import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.core.resume import Moment, restore, resume_of, to_bytes
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.log.reader import read_log
from firmware_py.plans.items import Command
from support import rig
from support.paths import REPLAY

MAX_NOTES = 50

LOG = REPLAY / "mid_run_checkpoint.BIN"
START = State.at_start(ParameterSet().replaced("BOOT_RESUME", 2))


def restore_start(data):
    return restore(START, data, Moment(1767225660.0))


@functools.cache
def checkpoint():
    return state_to_text(rig.on_a_mission().state)


def resume_record():
    return msgspec.msgpack.decode(to_bytes(resume_of(state_from_text(checkpoint())[0], Moment(1767225600.0))))


MISSION = Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT, x=number) for number in range(3)])
RECORDS = {
    "checkpoint": lambda: json.loads(checkpoint()),
    "resume": resume_record,
    "plan": lambda: json.loads(plan_to_text(MISSION)),
}
READERS = {
    "checkpoint": lambda plain: state_from_text(json.dumps(plain)),
    "resume": lambda plain: restore_start(msgspec.msgpack.encode(plain)),
    "plan": lambda plain: plan_from_text(json.dumps(plain)),
}
SCALARS = st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | st.floats() | st.text(max_size=5)
JSON_VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
)
KINDS = st.sampled_from(sorted(READERS))


def record_keys(data):
    """Yield each record and key of nested data."""
    if isinstance(data, dict):
        for name, value in data.items():
            yield data, name
            yield from record_keys(value)
    elif isinstance(data, list):
        for value in data:
            yield from record_keys(value)


def draw_keys(draw, data):
    keys = list(record_keys(data))
    return [keys[index] for index in draw(st.lists(st.integers(0, len(keys) - 1), min_size=1, max_size=8))]


@functools.cache
def first_inputs():
    return tuple(tick.inputs for tick in itertools.islice(read_log(LOG), 4))


def read_record(kind, data):
    try:
        record, notes = READERS[kind](data)
    except ValueError as error:
        assert len(str(error)) < 1000  # noqa: PT017 - an error is allowed
        return None, ()
    assert len(notes) <= MAX_NOTES + 1
    assert all(note and "\n" not in note for note in notes)
    return record, notes


@given(kind=KINDS, data=st.data())
def test_any_fields_can_be_missing(kind, data):
    content = RECORDS[kind]()
    dropped = set()
    for record, name in draw_keys(data.draw, content):
        record.pop(name, None)
        dropped.add(name)
    state, _ = read_record(kind, content)
    if kind == "checkpoint":
        assert state is not None or "version" in dropped


@given(kind=KINDS, data=st.data())
def test_any_fields_can_be_added(kind, data):
    content = RECORDS[kind]()
    for record, _ in draw_keys(data.draw, content):
        record[data.draw(st.text(max_size=8).filter(lambda name: name not in ("$", "version")))] = data.draw(
            JSON_VALUES
        )
    record, _ = read_record(kind, content)
    assert record is not None or kind != "checkpoint"


@given(data=st.data())
def test_autopilot_runs_after_a_resume_with_missing_fields(data):
    content = RECORDS["resume"]()
    for record, name in draw_keys(data.draw, content):
        record.pop(name, None)
    state, _ = read_record("resume", content)
    for inputs in first_inputs() if state is not None else ():
        state, _ = step(state, inputs)


@given(kind=KINDS, data=st.data())
def test_any_values_are_read_or_refused(kind, data):
    content = RECORDS[kind]()
    for record, name in draw_keys(data.draw, content):
        record[name] = data.draw(JSON_VALUES)
    read_record(kind, content)


@given(kind=KINDS, data=JSON_VALUES)
def test_other_json_is_refused(kind, data):
    with pytest.raises(ValueError):
        READERS[kind](data)
