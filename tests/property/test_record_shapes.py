"""Records of any other shape are read, or refused with ValueError and nothing else."""

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
from firmware_py.common.reading_notes import MAX_NOTES
from firmware_py.core.resume import Moment, restore, resume_of, to_bytes
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.log.reader import read_log
from support import rig
from support.paths import REPLAY

LOG = REPLAY / "mid_run_checkpoint.BIN"
START = State.at_start(ParameterSet().replaced("BOOT_RESUME", 2))


def wake(data):
    return restore(START, data, Moment(1767225660.0))


@functools.cache
def checkpoint():
    return state_to_text(rig.on_a_mission().state)


def resume_record():
    return msgspec.msgpack.decode(to_bytes(resume_of(state_from_text(checkpoint())[0], Moment(1767225600.0))))


MISSION = Plan.of(PlanKind.MISSION, [PlanItem(16, x=number) for number in range(3)])
WRITTEN = {
    "checkpoint": lambda: json.loads(checkpoint()),
    "resume": resume_record,
    "plan": lambda: json.loads(plan_to_text(MISSION)),
}
READ = {
    "checkpoint": lambda plain: state_from_text(json.dumps(plain)),
    "resume": lambda plain: wake(msgspec.msgpack.encode(plain)),
    "plan": lambda plain: plan_from_text(json.dumps(plain)),
}
scalars = st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | st.floats() | st.text(max_size=5)
junk = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
)
kinds = st.sampled_from(sorted(READ))


def places(data):
    """Every key of every record, at any depth."""
    if isinstance(data, dict):
        for name, value in data.items():
            yield data, name
            yield from places(value)
    elif isinstance(data, list):
        for value in data:
            yield from places(value)


def chosen(draw, data):
    found = list(places(data))
    return [found[index] for index in draw(st.lists(st.integers(0, len(found) - 1), min_size=1, max_size=8))]


@functools.cache
def some_inputs():
    return tuple(tick.inputs for tick in itertools.islice(read_log(LOG), 4))


def read(kind, data):
    try:
        record, notes = READ[kind](data)
    except ValueError as error:
        assert len(str(error)) < 1000  # noqa: PT017 -- both ways are right
        return None, ()
    assert len(notes) <= MAX_NOTES + 1
    assert all(note and "\n" not in note for note in notes)
    return record, notes


@given(kind=kinds, data=st.data())
def test_any_fields_can_be_dropped(kind, data):
    text = WRITTEN[kind]()
    dropped = set()
    for record, name in chosen(data.draw, text):
        record.pop(name, None)
        dropped.add(name)
    state, _ = read(kind, text)
    if kind == "checkpoint":
        assert state is not None or "version" in dropped


@given(kind=kinds, data=st.data())
def test_any_fields_can_be_added(kind, data):
    text = WRITTEN[kind]()
    for record, _ in chosen(data.draw, text):
        record[data.draw(st.text(max_size=8).filter(lambda name: name not in ("$", "version")))] = data.draw(junk)
    record, _ = read(kind, text)
    assert record is not None or kind != "checkpoint"


@given(data=st.data())
def test_a_boat_that_wakes_with_less_goes_on(data):
    text = WRITTEN["resume"]()
    for record, name in chosen(data.draw, text):
        record.pop(name, None)
    state, _ = read("resume", text)
    for inputs in some_inputs() if state is not None else ():
        state, _ = step(state, inputs)


@given(kind=kinds, data=st.data())
def test_any_values_can_be_anything(kind, data):
    text = WRITTEN[kind]()
    for record, name in chosen(data.draw, text):
        record[name] = data.draw(junk)
    read(kind, text)


@given(kind=kinds, data=junk)
def test_any_other_text_is_refused(kind, data):
    with pytest.raises(ValueError):
        READ[kind](data)
