"""State and resume record: identical to the bit after a round trip, and readable when their fields change."""

import json
import math
import struct
import types
import typing
from enum import Enum

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from msgspec.structs import replace

from firmware_py.assemble.stored_state import resume
from firmware_py.common import record_codec
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.core.resume import Moment, Resume, from_bytes, restore, resume_of, to_bytes
from firmware_py.core.state import State
from firmware_py.core.state_codec import VERSION, state_from_text, state_to_text
from firmware_py.faults.latch import LatchState
from firmware_py.faults.table import Fault
from firmware_py.safety.failsafe import FailsafeState
from support import rig

UTC_S = 1767225600.0
FIELDS = typing.get_type_hints(State)


def under_way():
    """Return the state of a boat on a mission."""
    return rig.on_a_mission().state


def bits(value):
    """Return a value with its floats as bytes, so that NaN equals itself and -0.0 does not equal 0.0."""
    if isinstance(value, float):
        return struct.pack("<d", value)
    if isinstance(value, msgspec.Struct):
        return type(value), tuple(bits(getattr(value, name)) for name in value.__struct_fields__)
    if hasattr(value, "_fields"):
        return type(value), tuple(map(bits, value))
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, ParameterSet):
        return bits(value.values())
    if isinstance(value, Plan):
        return value.kind, value.identity, bits(value.items)
    return tuple(map(bits, value)) if isinstance(value, tuple) else (type(value), value)


FAULTS = st.integers(0, (1 << len(Fault)) - 1)
FLOATS = st.floats().map(lambda value: math.nan if math.isnan(value) else value)  # a text has only one NaN
TIMES = st.tuples(*[st.none() | FLOATS] * len(Fault))
SIMPLE = {
    float: FLOATS,
    int: st.integers(),
    bool: st.booleans(),
    str: st.text(max_size=3),
    bytes: st.binary(max_size=9),
    type(None): st.none(),
    ParameterSet: st.sampled_from(TABLE).map(lambda row: ParameterSet().replaced(row.name, row.maximum)),
    Plan: st.builds(
        lambda kind, params: Plan.of(kind, [PlanItem(16, params=params)]),
        st.sampled_from(PlanKind),
        st.tuples(*[st.floats(width=32)] * 4),
    ),
    LatchState: st.builds(LatchState, TIMES, TIMES, FAULTS),
    FailsafeState: st.builds(FailsafeState, FAULTS, FAULTS, st.none() | st.sampled_from(Fault)),
}


def _any_like(default, hint):
    """Return a strategy for the annotation of a field; for an array, with the shape of its default."""
    return arrays(float, default.shape, elements=FLOATS) if isinstance(default, np.ndarray) else any_of(hint)


def any_of(hint):
    """Return a strategy for an annotation, often with the default of a field, because a state has 500 of them."""
    if hint in SIMPLE:
        return SIMPLE[hint]
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return st.one_of(*map(any_of, parts))
    if origin is tuple and parts[1:] == (...,):
        return st.lists(any_of(parts[0]), max_size=2).map(tuple)
    if origin is tuple:
        return st.tuples(*map(any_of, parts))
    if issubclass(hint, Enum):
        return st.sampled_from(hint)
    hints = typing.get_type_hints(hint)
    if hasattr(hint, "_fields"):
        defaults = hint._field_defaults
        return st.builds(
            hint, **{name: st.just(defaults[name]) | _any_like(defaults[name], hints[name]) for name in hint._fields}
        )
    fields = {}
    for field in msgspec.structs.fields(hint):
        fields[field.name] = any_of(hints[field.name])
        if field.default is not msgspec.NODEFAULT:
            fields[field.name] = st.just(field.default) | fields[field.name]
    return st.builds(hint, **fields)


@pytest.mark.parametrize("name", State.__struct_fields__)
@settings(max_examples=settings().max_examples // 10, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_state_is_restored_bit_for_bit(name, data):
    state = replace(State(), **{name: data.draw(any_of(FIELDS[name]))})
    text = state_to_text(state)
    restored, notes = state_from_text(text)
    assert notes == ()
    assert bits(restored) == bits(state)
    assert text.isascii()


def test_state_of_a_mission_is_restored_bit_for_bit():
    text = state_to_text(under_way())
    assert text.startswith(f'{{"version":{VERSION},')
    assert bits(state_from_text(text)[0]) == bits(under_way())


def edit_state(change, state=None):
    """Return the state read from an edited text, and the notes."""
    plain = json.loads(state_to_text(under_way() if state is None else state))
    change(plain)
    return state_from_text(json.dumps(plain))


def test_additional_field_is_ignored_and_reported():
    def change(plain):
        plain["tide_m"] = 1.5
        plain["guidance"]["mission"]["laps"] = [1, 2]

    state, notes = edit_state(change)
    assert bits(state) == bits(under_way())
    assert notes == (
        "State: field 'tide_m' is not known here, ignored",
        "State.guidance.mission: field 'laps' is not known here, ignored",
    )


def test_missing_field_takes_its_default():
    def change(plain):
        del plain["timing"]["skipped_total"], plain["guidance"]["mission"]["jumps"], plain["energy_meter"]

    late = replace(under_way(), timing=replace(under_way().timing, skipped_total=7))
    state, notes = edit_state(change, late)
    assert (state.timing.skipped_total, notes) == (0, ())
    assert state.modes == under_way().modes


def test_each_field_of_the_state_has_a_default():
    assert state_from_text(f'{{"version":{VERSION}}}') == (State(), ())


@pytest.mark.parametrize(
    "name", [name for name, kind in FIELDS.items() if isinstance(kind, type) and issubclass(kind, msgspec.Struct)]
)
def test_renamed_fields_of_each_record_are_found(name, monkeypatch):
    record = getattr(under_way(), name)
    former_names = record_codec.FORMER_NAMES.get(type(record).__name__, {})
    renamed = {f"before_{field}": field for field in record.__struct_fields__}
    monkeypatch.setitem(record_codec.FORMER_NAMES, type(record).__name__, former_names | renamed)
    state, notes = edit_state(
        lambda plain: plain[name].update({old: plain[name].pop(field) for old, field in renamed.items()})
    )
    assert notes == ()
    assert bits(state) == bits(under_way())


def test_renamed_record_of_the_state_is_found(monkeypatch):
    monkeypatch.setitem(record_codec.FORMER_NAMES, "State", {"latch": "fault_latch"})
    state, notes = edit_state(lambda plain: plain.update(latch=plain.pop("fault_latch")), state_with_faults())
    assert (state.fault_latch, notes) == (state_with_faults().fault_latch, ())


@pytest.mark.parametrize(
    ("path", "value", "notes"),
    [
        ("modes.mode", 77, ["State.modes.mode: Invalid enum value 77, ignored"]),
        ("position.fix.fix", 77, [
            "State.position.fix.fix: Invalid enum value 77, ignored",
            "State.position.fix: Object missing required field `fix`, ignored",
        ]),
        ("guidance.task.type", "Drift", ["State.guidance.task: Invalid value 'Drift', ignored"]),
        ("position.fix.t_s", None, [
            "State.position.fix.t_s: Expected `float`, got `null`, ignored",
            "State.position.fix: Object missing required field `t_s`, ignored",
        ]),
        ("fault_latch.active", 3, ["State.fault_latch.active: Expected `int`, got `null`, ignored"]),
        ("fault_latch.since_s", [], ["State.fault_latch.since_s: Expected `array`, got `null`, ignored"]),
        ("parameters", 3, ["State.parameters: expected parameters by name, found 3, ignored"]),
        ("plans.fence.identity", 7, ["State.plans.fence: the checksum of the plan is wrong, ignored"]),
        ("plans.fence.author", 7, ["State.plans.fence: field 'author' is not known here, ignored"]),
    ],
)  # fmt: skip
def test_unusable_value_is_ignored_and_reported(path, value, notes):
    def change(plain):
        *parents, last = path.split(".")
        for name in parents:
            plain = plain[name]
        plain[last] = value

    _, texts = edit_state(change)
    assert list(texts) == notes


def test_parameters_of_another_version_take_their_defaults_if_invalid():
    state = replace(under_way(), parameters=ParameterSet().replaced("CTL_K1", 41.0).replaced("WP_RADIUS", 9.0))

    def change(plain):
        del plain["parameters"]["WP_RADIUS"]
        plain["parameters"] |= {"NEW_ONE": 3.5, "CTL_HOLD_S": 1e9, "BOOT_MODE": "AUTO"}

    read, notes = edit_state(change, state)
    assert read.parameters == ParameterSet().replaced("CTL_K1", 41.0)
    assert len(notes) == 3
    assert "State.parameters: parameter 'NEW_ONE' is not known here, ignored" in notes
    assert any("CTL_HOLD_S" in note and "its default is taken" in note for note in notes)
    assert any("BOOT_MODE" in note and "its default is taken" in note for note in notes)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "Expecting value"),
        ("{}", "State: no version number"),
        ("[1]", "expected a record of State"),
        ("[" * 100_000, "nested too deeply"),
        ('{"version":7', "Expecting"),
        ('{"version":6,"timing":{},"$":"State"}', "written as text by an early development version"),
    ],
)
def test_invalid_texts_are_refused(text, reason):
    with pytest.raises(ValueError, match=reason):
        state_from_text(text)


# ---------------------------------------------------------------------------------- faults

ACTIVE = (1 << Fault.COMPASS_SILENT) | (1 << Fault.STEERING_LOST)


def state_with_faults():
    since = tuple(0.1 * fault if ACTIVE >> fault & 1 else None for fault in Fault)
    failsafe = FailsafeState(ACTIVE, 1 << Fault.STEERING_LOST, Fault.STEERING_LOST, Mode.LOITER)
    state = under_way()
    supervisor = replace(state.supervisor, failsafe=failsafe)
    return replace(state, fault_latch=LatchState(since, since, ACTIVE), supervisor=supervisor)


def test_faults_are_written_by_name():
    plain = json.loads(state_to_text(state_with_faults()))
    assert plain["fault_latch"]["since_s"] == {"COMPASS_SILENT": 0.1 * 9, "STEERING_LOST": 0.1 * 23}
    assert plain["fault_latch"]["active"] == ["COMPASS_SILENT", "STEERING_LOST"]
    assert plain["supervisor"]["failsafe"]["active"] == ["COMPASS_SILENT", "STEERING_LOST"]
    assert plain["supervisor"]["failsafe"]["fault"] == "STEERING_LOST"
    restored, notes = state_from_text(state_to_text(state_with_faults()))
    assert (bits(restored), notes) == (bits(state_with_faults()), ())


def test_fault_named_twice_counts_once():
    state, notes = edit_state(lambda plain: plain["fault_latch"]["active"].append("STEERING_LOST"), state_with_faults())
    assert (state.fault_latch, notes) == (state_with_faults().fault_latch, ())


def test_unknown_fault_is_ignored_and_reported():
    def change(plain):
        latch, failsafe = plain["fault_latch"], plain["supervisor"]["failsafe"]
        latch["since_s"]["ICE_SEEN"] = 3.0
        latch["active"].append("ICE_SEEN")
        failsafe["calling"].append("ICE_SEEN")
        failsafe["fault"] = "ICE_SEEN"

    state, notes = edit_state(change, state_with_faults())
    assert state.fault_latch == state_with_faults().fault_latch
    failsafe = state_with_faults().supervisor.failsafe
    assert state.supervisor.failsafe == replace(failsafe, fault=None)
    places = ("fault_latch.since_s", "fault_latch.active", "supervisor.failsafe.calling", "supervisor.failsafe.fault")
    assert set(notes) == {f"State.{place}: fault 'ICE_SEEN' is not known here, ignored" for place in places}


# ---------------------------------------------------------------------------------- resume


def restore_record(data):
    return restore(State.at_start(ParameterSet().replaced("BOOT_RESUME", 2)), data, Moment(UTC_S + 60.0))


def edit_record(change=lambda _: None):
    """Return the edited resume record of the boat on a mission."""
    plain = msgspec.msgpack.decode(to_bytes(resume_of(under_way(), Moment(UTC_S))))
    change(plain)
    return msgspec.msgpack.encode(plain)


@settings(suppress_health_check=list(HealthCheck))
@given(any_of(Resume))
def test_any_resume_record_is_restored_bit_for_bit_or_refused(record):
    try:
        restored, notes = from_bytes(to_bytes(record))
    except (ValueError, OverflowError):  # for a number that is not finite, or too large for msgpack
        return
    assert notes == ()
    assert bits(restored) == bits(record)


def add_fields(plain):
    plain["tide_m"] = 1.5
    plain["modes"]["trim"] = 0.1


def drop_fields(plain):
    del plain["water"], plain["orbit"], plain["fence_enabled"], plain["mission"]["orbits"]


@pytest.mark.parametrize("change", [add_fields, drop_fields])
def test_resume_record_of_another_version_is_restored(change):
    complete, _ = restore_record(edit_record())
    state, notes = restore_record(edit_record(change))
    assert state.modes == complete.modes
    assert (state.modes.mode, state.modes.armed) == (Mode.AUTO, True)
    assert (state.guidance.mission, state.home) == (complete.guidance.mission, complete.home)
    assert state.guidance.task == complete.guidance.task is not None
    is_incomplete = change is add_fields
    assert bool(notes) == is_incomplete
    assert state.greeting == "Resumed AUTO, 60 s old" + (", incomplete" if is_incomplete else "")


def test_renamed_field_of_a_resume_record_is_found(monkeypatch):
    monkeypatch.setitem(record_codec.FORMER_NAMES, "Resume", {"order": "task"})
    state, notes = restore_record(edit_record(lambda plain: plain.update(order=plain.pop("task"))))
    assert (state.guidance.task, notes) == (under_way().guidance.task, ())


@pytest.mark.parametrize("name", ["utc_s", "modes", "mission"])
def test_error_of_an_incomplete_resume_record_names_the_missing_field(name):
    with pytest.raises(ValueError, match=f"Resume: Object missing required field `{name}`"):
        restore_record(edit_record(lambda plain: plain.pop(name)))


def test_unusable_resume_record_is_reported():
    texts, start = [], State.at_start(ParameterSet().replaced("BOOT_RESUME", 2))
    assert resume(start, edit_record(add_fields), Moment(UTC_S), texts.append).modes.mode is Mode.AUTO
    assert texts[0].endswith(": Resume: field 'tide_m' is not known here, ignored")
    assert resume(start, b"\x80", Moment(UTC_S), texts.append) == replace(start, greeting="Not resumed: invalid record")
    assert texts[-1].endswith(" ignored: Resume: no version number")
    resume(start, b'{"version":6,"utc_s":1.0,"$":"Resume"}', Moment(UTC_S), texts.append)
    assert "written as text by an early development version" in texts[-1]
