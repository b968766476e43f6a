"""Written with one shape and read with another: checkpoint, resume record, parameters, plans."""

import functools
import json
from enum import IntEnum

import pytest
from msgspec.structs import replace

from firmware_py.assemble.earlier_runs import resume
from firmware_py.common.json_codec import Codec
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet, format_file
from firmware_py.common.plan import HOOK as PLAN_HOOK
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.core.resume import Moment, restore
from firmware_py.core.state import State
from firmware_py.core.state_codec import (
    BYTES_HOOK,
    CHANGES,
    PARAMETER_HOOK,
    fault_fields,
    state_from_text,
    state_to_text,
)
from firmware_py.core.step import step
from firmware_py.faults.latch import LatchState
from firmware_py.faults.table import Fault
from firmware_py.log.reader import read_log
from firmware_py.safety.failsafe import FailsafeState
from firmware_py.system.slots import stored_content
from firmware_py.system.state_directory import PARAMETER_FILE, PLAN_FILES, load_parameters, load_plans
from firmware_py.system.store import Store
from support.paths import REPLAY

DATA = REPLAY / "first_layout"
UTC_S = 1767225600.0


@functools.cache
def first_checkpoint():
    """The state of a boat under way, as version 1 wrote it."""
    return next(iter(read_log(DATA / "mid_run_checkpoint.BIN"))).checkpoint


@functools.cache
def first_resume():
    return stored_content(DATA / "state", "resume.state").decode()


def under_way():
    state, notes = state_from_text(first_checkpoint())
    assert notes == ()
    return state


def edited(text, change):
    data = json.loads(text)
    change(data)
    return json.dumps(data)


def woken(text):
    return restore(State.at_start(ParameterSet().replaced("BOOT_RESUME", 2)), text, Moment(UTC_S + 60.0))


def stored(directory, name, content):
    """A store that an earlier run has left."""
    before = Store(directory)
    before.save(name, content)
    before.close()
    return Store(directory)


# ------------------------------------------------------------------------------ checkpoint


def test_a_checkpoint_of_today_has_its_version_and_comes_back():
    text = state_to_text(under_way())
    assert text.startswith('{"version":6,')
    again, notes = state_from_text(text)
    assert notes == ()
    assert again == under_way()
    assert state_to_text(again) == text  # the sign of zero too


def test_a_field_more_is_ignored_and_reported():
    def change(data):
        data["tide_m"] = 1.5
        data["guidance"]["mission"]["laps"] = [1, 2]

    state, notes = state_from_text(edited(state_to_text(under_way()), change))
    assert state_to_text(state) == state_to_text(under_way())
    assert notes == (
        "State: field 'tide_m' is not known here, ignored",
        "State.guidance.mission: field 'laps' is not known here, ignored",
    )


def test_a_field_less_takes_its_default():
    def change(data):
        del data["timing"]["skipped_total"], data["guidance"]["mission"]["jumps"], data["energy_meter"]

    late = replace(under_way(), timing=replace(under_way().timing, skipped_total=7))
    state, notes = state_from_text(edited(state_to_text(late), change))
    assert (state.timing.skipped_total, notes) == (0, ())
    assert state.modes == under_way().modes


def test_every_field_of_the_state_can_be_done_without():
    assert state_from_text('{"$":"State"}') == (State(), ())


def test_a_record_that_lacks_what_it_needs_takes_the_default_of_its_field():
    def change(data):
        del data["position"]["fix"]["t_s"]

    state, notes = state_from_text(edited(state_to_text(under_way()), change))
    assert state.position.fix is None
    assert notes == ("State.position.fix: field 't_s' is missing; State.position.fix takes its default",)


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (("modes", "mode"), 77, "State.modes.mode: expected a number of Mode, found 77"),
        (("position", "fix", "fix"), 77, "State.position.fix.fix: expected a number of FixType, found 77"),
        (("heading_estimator", "sources", "in_use"), 77, "State.heading_estimator.sources.in_use: expected a number"),
        (("guidance", "task", "$"), "Drift", "State.guidance.task: expected one of HoldHeading, GoTo, "),
    ],
)
def test_a_value_of_another_version_takes_a_default_and_is_reported(path, value, says):
    def change(data):
        for name in path[:-1]:
            data = data[name]
        data[path[-1]] = value

    _, notes = state_from_text(edited(state_to_text(under_way()), change))
    assert [note for note in notes if note.startswith(says)] == list(notes) != []


def test_parameters_of_another_version():
    state = replace(under_way(), parameters=ParameterSet().replaced("CTL_K1", 41.0).replaced("WP_RADIUS", 9.0))

    def change(data):
        del data["parameters"]["WP_RADIUS"]
        data["parameters"] |= {"NEW_ONE": 3.5, "CTL_HOLD_S": 1e9, "BOOT_MODE": "AUTO"}

    read, notes = state_from_text(edited(state_to_text(state), change))
    assert read.parameters == ParameterSet().replaced("CTL_K1", 41.0)
    assert len(notes) == 3
    assert "State.parameters: parameter 'NEW_ONE' is not known here, ignored" in notes
    assert any("CTL_HOLD_S" in note and "its default is taken" in note for note in notes)
    assert any("BOOT_MODE" in note and "its default is taken" in note for note in notes)


# ---------------------------------------------------------------------------------- faults

LATER = IntEnum("Later", [("ICE_SEEN", 0), *((fault.name, fault.value + 1) for fault in Fault)])
EARLIER = IntEnum(
    "Earlier", [(fault.name, number) for number, fault in enumerate(Fault) if fault is not Fault.STEERING_LOST]
)
SET = (1 << Fault.COMPASS_SILENT) | (1 << Fault.STEERING_LOST)


def codec_of(faults):
    return Codec([State], [PARAMETER_HOOK, PLAN_HOOK, BYTES_HOOK], fault_fields(faults), CHANGES)


def troubled():
    since = tuple(0.1 * fault if SET >> fault & 1 else None for fault in Fault)
    failsafe = FailsafeState(SET, 1 << Fault.STEERING_LOST, Fault.STEERING_LOST, Mode.LOITER)
    state = under_way()
    supervisor = replace(state.supervisor, failsafe=failsafe)
    return replace(state, fault_latch=LatchState(since, since, SET), supervisor=supervisor)


def test_faults_are_written_by_name():
    data = json.loads(state_to_text(troubled()))
    assert data["fault_latch"]["since_s"] == {"COMPASS_SILENT": 0.1 * 9, "STEERING_LOST": 0.1 * 23}
    assert data["fault_latch"]["active"] == ["COMPASS_SILENT", "STEERING_LOST"]
    assert data["supervisor"]["failsafe"]["active"] == ["COMPASS_SILENT", "STEERING_LOST"]
    assert data["supervisor"]["failsafe"]["fault"] == "STEERING_LOST"
    assert state_from_text(state_to_text(troubled())) == (troubled(), ())


def test_faults_of_the_first_version_get_their_names():
    def change(data):
        times = [0.1 * number if SET >> number & 1 else None for number in range(24)]
        data["monitor"] |= {"since_s": times, "stood_s": times, "active": SET}
        data["watch"]["failsafe"] |= {"known": SET, "calling": 1 << 23, "fault": 23, "mode": Mode.LOITER.value}

    state, notes = state_from_text(edited(first_checkpoint(), change))
    assert notes == ()
    assert state.fault_latch == troubled().fault_latch
    assert state.supervisor.failsafe == troubled().supervisor.failsafe


def test_a_fault_more_was_never_set_and_moves_no_other():
    state, notes = codec_of(LATER).read(state_to_text(troubled()))
    assert notes == ()
    assert state.fault_latch.since_s[LATER.ICE_SEEN] is None
    assert state.fault_latch.since_s[LATER.COMPASS_SILENT] == 0.1 * 9
    assert state.fault_latch.active == (1 << LATER.COMPASS_SILENT) | (1 << LATER.STEERING_LOST)
    assert state.supervisor.failsafe.fault is LATER.STEERING_LOST


def test_a_fault_less_is_ignored_and_reported():
    state, notes = codec_of(EARLIER).read(state_to_text(troubled()))
    assert state.fault_latch.active == state.supervisor.failsafe.active == 1 << EARLIER.COMPASS_SILENT
    assert (state.supervisor.failsafe.calling, state.supervisor.failsafe.fault) == (0, None)
    assert len(state.fault_latch.since_s) == len(EARLIER)
    assert "State.fault_latch.active: fault 'STEERING_LOST' is not known here, ignored" in notes


# ---------------------------------------------------------------------------------- resume


def add_fields(data):
    data["tide_m"] = 1.5
    data["modes"]["trim"] = 0.1


def drop_fields(data):
    del data["water"], data["orbit"], data["fence_enabled"], data["mission"]["orbits"]


@pytest.mark.parametrize("change", [add_fields, drop_fields])
def test_a_boat_wakes_as_she_was_after_an_update(change):
    whole, _ = woken(first_resume())
    state, notes = woken(edited(first_resume(), change))
    assert state.modes == whole.modes
    assert (state.modes.mode, state.modes.armed) == (Mode.AUTO, True)
    assert (state.guidance.mission, state.home) == (whole.guidance.mission, whole.home)
    assert state.guidance.task == whole.guidance.task is not None
    lost = change is add_fields
    assert bool(notes) == lost
    assert state.greeting == "Resumed AUTO, 60 s old" + (", not whole" if lost else "")


@pytest.mark.parametrize("name", ["utc_s", "modes", "mission"])
def test_a_resume_record_without_what_it_needs_names_it(name):
    with pytest.raises(ValueError, match=f"Resume: field '{name}' is missing"):
        woken(edited(first_resume(), lambda data: data.pop(name)))


def test_what_cannot_be_resumed_is_said():
    said, start = [], State.at_start(ParameterSet().replaced("BOOT_RESUME", 2))
    record = edited(first_resume(), add_fields).encode()
    assert resume(start, record, Moment(UTC_S), said.append).modes.mode is Mode.AUTO
    assert said[0] == "stored resume.record: Resume: field 'tide_m' is not known here, ignored"
    assert resume(start, b"{}", Moment(UTC_S), said.append) == replace(
        start, greeting="Not resumed: the record is no good"
    )
    assert said[-1].startswith("stored resume.record left out: expected one of Resume")


# --------------------------------------------------------------------- parameters and plans


def test_load_parameters_of_another_version_stay_in_the_store(tmp_path):
    said = []
    text = b"CTL_K1 41\nNEW_ONE 3.5\nCTL_HOLD_S 1e+09\nno line at all\nODD_ONE nan\n"
    store = stored(tmp_path, PARAMETER_FILE, text)
    values, unusable = load_parameters(store, said.append)
    assert values == {"CTL_K1": 41.0}
    assert unusable == {"NEW_ONE": 3.5, "CTL_HOLD_S": 1e9}
    assert ["kept for another version" in line for line in said] == [True, True, False, False]
    store.close()
    store = stored(tmp_path, PARAMETER_FILE, format_file(unusable | values).encode())
    assert load_parameters(store, said.append) == (values, unusable)
    store.close()


MISSION = Plan.of(PlanKind.MISSION, (PlanItem(16, 3, params=(0.0, 5.0, 0.0, 0.0), x=350000000, y=1390000000),))


def test_a_plan_with_a_field_more_is_read_and_told(tmp_path):
    def change(data):
        data["plan"]["author"] = "the office"
        data["tide_m"] = 1.0

    text = edited(plan_to_text(MISSION), change)
    assert plan_from_text(text)[0] == MISSION
    store, said = stored(tmp_path, PLAN_FILES[PlanKind.MISSION], text.encode()), []
    assert load_plans(store, said.append).mission == MISSION
    store.close()
    assert said == [
        "stored mission.plan: _Stored: field 'tide_m' is not known here, ignored",
        "stored mission.plan: _Stored.plan: field 'author' is not known here, ignored",
    ]


@pytest.mark.parametrize("name", ["kind", "identity", "items"])
def test_a_plan_without_what_it_needs_is_refused(name):
    with pytest.raises(ValueError, match="no plan"):
        plan_from_text(edited(plan_to_text(MISSION), lambda data: data["plan"].pop(name)))


def test_a_plan_written_before_there_were_versions_is_read():
    text = stored_content(DATA / "state", "mission.plan").decode()
    assert '"version"' not in text
    plan, notes = plan_from_text(text)
    assert (plan.kind, plan.identity, notes) == (PlanKind.MISSION, 3441694929, ())


def without_lookout(data):
    del data["lookout"]


def with_a_fix_and_no_filter(data):
    del data["lookout"]["waves"]["x"], data["lookout"]["waves"]["p"]
    assert data["lookout"]["waves"]["fix_t_s"] is not None


@pytest.mark.parametrize("change", [without_lookout, with_a_fix_and_no_filter])
def test_a_boat_whose_checkpoint_lacks_something_goes_on(change):
    ticks = list(read_log(DATA / "mid_run_checkpoint.BIN"))[:5]
    state, _ = state_from_text(edited(first_checkpoint(), change))
    for tick in ticks:
        state, _ = step(state, tick.inputs)
    assert state.timing.t_s == ticks[-1].inputs.tick.t_s


def test_what_earlier_versions_left_unknown_and_the_fewer_faults_they_had():
    before = {"$": "AuthorityState", "lost": True, "slow_rudder_rad": None}
    text = json.dumps({"$": "State", "watch": {"$": "WatchState", "authority": before}})
    state, notes = state_from_text(text)
    assert (state.supervisor.steering_monitor.answer.missing, notes) == (True, ())
    oscillation = {"$": "OscillationState", "softness": 4.0, "softened_at": 3}
    supervisor = {"$": "SupervisorState", "oscillation": oscillation}
    state, notes = state_from_text(json.dumps({"version": 3, "$": "State", "supervisor": supervisor}))
    assert (state.supervisor.oscillation.softness, notes) == (4.0, ())
    latch = {"$": "MonitorState", "since_s": [None, 2.5], "stood_s": [None, None], "active": 2}
    state, notes = state_from_text(json.dumps({"$": "State", "monitor": latch}))
    assert (state.fault_latch.since_s[Fault.POSITION_LOST], notes) == (2.5, ())
