"""After any failed call, acknowledged state exists at the next start, refused state does not; failures are reported."""

import errno
import itertools
import os
import select
import shutil
import threading
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

import pytest

from firmware_py.assemble.stored_state import resume
from firmware_py.common.intents import (
    Arm,
    ForgetParameters,
    ReplacePlan,
    Request,
    SetHome,
    SetMode,
    SetParameter,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.reports import Home
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.resume import Moment
from firmware_py.core.state import State
from firmware_py.link.satellite import record as satellite
from firmware_py.link.satellite.messages import Window
from firmware_py.plans.items import Command
from firmware_py.system import endings
from firmware_py.system.endings import ENDINGS_FILE
from firmware_py.system.slots import SlotWriter, read_content
from firmware_py.system.state_directory import (
    PARAMETER_FILE,
    PLAN_FILES,
    RESUME_FILE,
    SATELLITE_FILE,
    SIGNING_FILE,
    KeyVault,
    StateDirectory,
    report_damage,
)
from firmware_py.system.store import Store
from support.faulty_disk import CUTS, KINDS, FaultyDisk, sample_calls

UTC_S = 1.8e9
UNCERTAIN = "the next start may find it nevertheless"
LONG_ITEMS = tuple(
    PlanItem(Command.WAYPOINT, 3, x=index, y=index) for index in range(60)
)  # more than the initial size of a slot


def plan(number):
    return Plan.of(
        PlanKind.MISSION, (PlanItem(Command.WAYPOINT, 6, x=number, y=number), *(LONG_ITEMS if number % 2 else ()))
    )


@dataclass
class Boat:
    """The parts of an autopilot that store state."""

    store: Store
    autopilot: Autopilot
    vault: KeyVault

    @classmethod
    def start(cls, directory, *, resumes=False):
        store = Store(directory, private=(SIGNING_FILE,))
        state_directory = StateDirectory(store, lambda _text: None)
        base = ParameterSet().replaced("BOOT_RESUME", 2 if resumes else 0)
        state = State.at_start(state_directory.apply_parameters(base), state_directory.plans())
        state = resume(state, state_directory.resume_record(), Moment(UTC_S), pytest.fail)
        return cls(store, Autopilot(state, state_directory), KeyVault(store))

    def wait(self, results):
        wait_for(self.store, lambda: results)
        return results[0]

    def end(self):
        self.store.close()
        return self


def wait_for(store, condition):
    while not condition():
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()


def set_parameter(boat, number):
    results = []
    boat.autopilot.decide(Request(0.0, SetParameter("CTL_K1", 70.0 + number)))
    boat.autopilot.when_stored(results.append)
    return boat.wait(results)


def clear_parameters(boat, number):
    """Set a parameter in the first two actions, clear all in the others."""
    if number < 2:
        return set_parameter(boat, 0)
    results = []
    boat.autopilot.decide(Request(0.0, ForgetParameters()))
    boat.autopilot.when_stored(results.append)
    return boat.wait(results)


def replace_plan(boat, number):
    results = []
    boat.autopilot.replace_plan(Request(0.0, ReplacePlan(plan(number))), results.append)
    return boat.wait(results).verdict is Verdict.ACCEPTED


def replace_plan_and_parameter(boat, number):
    """The writer may write both at once or one after the other; only the plan is checked."""
    boat.autopilot.decide(Request(0.0, SetParameter("CTL_K1", 70.0 + number)))
    return replace_plan(boat, number)


def set_key(boat, number):
    results = []
    boat.vault.save(b"key of number %d" % number, both_slots=True)
    boat.vault.when_stored(results.append)
    return boat.wait(results)


def save_record(boat, name, content):
    results = []
    boat.store.save(name, content)
    boat.store.when_stored((name,), results.append)
    return boat.wait(results)


def save_endings(boat, number):
    return save_record(boat, ENDINGS_FILE, endings.to_bytes(endings_record(number)))


def save_satellite_record(boat, number):
    return save_record(boat, SATELLITE_FILE, satellite.to_bytes(satellite_record(number)))


def endings_record(number):
    return endings.Endings({"killed": 1 + number}, running=True)


def satellite_record(number):
    return satellite.Record(window=Window(used=(1 + number,)))


def read_record(boat, name, decode):
    content = boat.store.load(name)
    return None if content is None else repr(decode(content))  # a record is not hashable


def send_order(boat, intent):
    """Send an order and wait until it is stored, as loop and link do before they acknowledge it."""
    results = []
    boat.autopilot.save_resume(0.0, UTC_S)
    assert boat.autopilot.decide(Request(0.0, intent)).verdict is Verdict.ACCEPTED
    boat.autopilot.when_orders_stored(results.append)
    return boat.wait(results)


def arm_or_disarm(boat, number):
    return send_order(boat, Arm(number % 2 == 0, force=True))


def set_mode(boat, number):
    return send_order(boat, SetMode(int(Mode.HOLD if number % 2 else Mode.MANUAL)))


def set_home(boat, number):
    return send_order(boat, SetHome(0.1 * number, 1.0))


# Each action with the functions that read its result from a boat and compute the expected result.
ACTIONS = {
    set_parameter: (lambda boat: boat.autopilot.parameters()["CTL_K1"], lambda number: 70.0 + number),
    clear_parameters: (
        lambda boat: boat.autopilot.parameters()["CTL_K1"],
        lambda number: ParameterSet()["CTL_K1"] if number >= 2 else 70.0,
    ),
    replace_plan: (lambda boat: boat.autopilot.plans().mission, plan),
    replace_plan_and_parameter: (lambda boat: boat.autopilot.plans().mission, plan),
    set_key: (lambda boat: boat.vault.load().content, lambda number: b"key of number %d" % number),
    save_endings: (
        lambda boat: read_record(boat, ENDINGS_FILE, endings.from_bytes),
        lambda number: repr((endings_record(number), ())),
    ),
    save_satellite_record: (
        lambda boat: read_record(boat, SATELLITE_FILE, satellite.from_bytes),
        lambda number: repr((satellite_record(number), ())),
    ),
    arm_or_disarm: (lambda boat: boat.autopilot.state.modes.armed, lambda number: number % 2 == 0),
    set_mode: (
        lambda boat: boat.autopilot.state.modes.mode,
        lambda number: Mode.HOLD if number % 2 else Mode.MANUAL,
    ),
    set_home: (lambda boat: boat.autopilot.state.home, lambda number: Home(0.1 * number, 1.0, 0.0)),
}
ORDERS = (arm_or_disarm, set_mode, set_home)
RECORDS = (save_endings, save_satellite_record)
PLANS = (replace_plan, replace_plan_and_parameter)
FAULTS = [(kind, lasting) for kind in KINDS for lasting in (False, True)]


RESULTS = {}  # by the content of the disk, because most faults leave the same content


def result_after_start(directory, action):
    """Return the result of an action that the next start loads."""
    image = (action, *sorted((path.name, path.read_bytes()) for path in directory.iterdir()))
    if image not in RESULTS:
        read, _ = ACTIONS[action]
        RESULTS[image] = read(Boat.start(directory, resumes=action in ORDERS).end())
    return RESULTS[image]


def result_in_copy(disk, copy, action):
    with disk.lock:
        shutil.copytree(disk.directory, copy)
    return result_after_start(copy, action)


def copy_images(disk, folder):
    """Copy the possible contents of the disk at the next start: after a kill, and after a power cut."""
    with disk.lock:
        shutil.copytree(disk.directory, folder / "killed")
        for pattern in CUTS:
            disk.cut(folder / pattern, pattern)
    return [folder / name for name in ("killed", *CUTS)]


def check_action(action, tmp_path, monkeypatch, number, fault, *, restart):
    """Do an action after `number` others on a failing disk, perhaps as the first of a run; return its call count."""
    at, (kind, lasting) = fault
    with monkeypatch.context() as patches:
        patches.setattr("firmware_py.system.store.RETRY_S", 1000.0)  # only explicit retries
        disk = FaultyDisk(tmp_path / "state", patches)
        boat = Boat.start(disk.directory, resumes=action in ORDERS)
        for earlier in range(number):
            assert action(boat, earlier)
        if restart:
            boat.end()
            boat = Boat.start(disk.directory, resumes=action in ORDERS)
        old = result_in_copy(disk, tmp_path / "old", action)
        disk.arm(at, kind, lasting=lasting)
        is_acknowledged = action(boat, number)
        failure, failed_calls, calls = boat.store.failure, list(disk.failed), disk.count
        results = {result_after_start(image, action) for image in copy_images(disk, tmp_path)}
        disk.arm(None)
        boat.end()
    new = ACTIONS[action][1](number)
    clears = action is clear_parameters and number >= 2
    has_failed = PLAN_FILES[PlanKind.MISSION] in failure if action in PLANS else bool(failure)
    assert not (has_failed and is_acknowledged)
    # After a failed clearing the parameters are saved again at once, possibly with success.
    assert has_failed or is_acknowledged or clears, "a failure is reported while it lasts"
    if is_acknowledged:
        assert results == {new}, f"acknowledged, but not stored: {failed_calls}"
    elif action is set_key or action in RECORDS:
        assert results <= {old, new}  # they are not refused
    elif UNCERTAIN not in failure:
        assert results == {old}, f"refused, but stored: {failed_calls}"
    else:
        assert lasting, "a single fault is never uncertain"
    # When the disk works again, the active state is stored; a refused plan is not active.
    assert boat.store.failure == ""
    is_refused = not is_acknowledged and (clears or action in PLANS)
    assert result_after_start(tmp_path / "state", action) == (old if is_refused else new)
    return calls


CASES = [
    *((action, number, False) for action in ACTIONS if action not in RECORDS for number in range(4)),
    *((action, 1, False) for action in RECORDS),
    *((action, 2, True) for action in (set_parameter, replace_plan, set_key, arm_or_disarm)),
]


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.proof)], ids=["sampled", "every"])
@pytest.mark.parametrize(("action", "number", "restart"), CASES, ids=lambda value: getattr(value, "__name__", None))
def test_after_a_failed_call_acknowledged_state_is_stored_and_refused_is_not(
    action, number, restart, every, tmp_path, monkeypatch
):
    def count_calls(at, fault):
        folder = tmp_path / "case"
        (folder / "state").mkdir(parents=True)
        calls = check_action(action, folder, monkeypatch, number, (at, fault), restart=restart)
        shutil.rmtree(folder)
        return calls

    cases, calls = 0, count_calls(None, FAULTS[0])
    for fault in FAULTS[:4] if restart else FAULTS:  # torn and short writes do not depend on a restart
        name = f"{action.__name__} {number} {restart} {fault}"
        for at in itertools.count() if every else sample_calls(calls, 1, name):
            if count_calls(at, fault) <= at:
                break
            cases += 1
    assert cases >= 2 * len(FAULTS) or not every  # at least a write and a sync


@pytest.fixture
def disk(tmp_path, monkeypatch):
    (tmp_path / "state").mkdir()
    return FaultyDisk(tmp_path / "state", monkeypatch)


def test_a_value_is_confirmed_only_when_it_is_stored_itself(disk, tmp_path):
    """The successful save of another name neither stores it nor ends its failure."""
    boat = Boat.start(disk.directory)
    assert set_parameter(boat, 0)
    disk.arm(0, lasting=True)
    assert not set_parameter(boat, 7)
    disk.arm(None)
    assert replace_plan(boat, 2)
    assert "parameters.param cannot be stored" in boat.store.failure
    results = []
    boat.autopilot.when_stored(results.append)  # as PARAM_SET with the active value does
    assert boat.wait(results)
    assert result_in_copy(disk, tmp_path / "killed", set_parameter) == 77.0
    assert boat.store.failure == ""
    boat.end()


def test_names_that_are_written_together_have_their_own_results(disk, tmp_path, monkeypatch):
    boat = Boat.start(disk.directory)
    assert set_parameter(boat, 0)
    assert replace_plan(boat, 0)
    write, gate = SlotWriter.write, threading.Event()

    def fail_for_parameters(writer, name, content):
        gate.wait(10.0)
        if name == PARAMETER_FILE:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        write(writer, name, content)

    monkeypatch.setattr(SlotWriter, "write", fail_for_parameters)
    plans, values = [], []
    boat.vault.save(b"key")  # blocks the writer until both are requested
    boat.autopilot.decide(Request(0.0, SetParameter("CTL_K1", 77.0)))
    boat.autopilot.replace_plan(Request(0.0, ReplacePlan(plan(2))), plans.append)
    boat.autopilot.when_stored(values.append)
    gate.set()
    assert boat.wait(plans).verdict is Verdict.ACCEPTED
    assert not boat.wait(values)
    assert result_in_copy(disk, tmp_path / "killed", replace_plan) == plan(2)
    monkeypatch.undo()
    boat.end()


def flip_bit(path):
    content = bytearray(path.read_bytes())
    content[content.index(b"\n") + 2] ^= 1
    path.write_bytes(content)


def fill_with_zeros(path):
    path.write_bytes(bytes(path.stat().st_size))


def truncate(path):
    path.write_bytes(path.read_bytes()[:30])


def empty(path):
    path.write_bytes(b"")


def replace_by_directory(path):
    path.unlink()
    path.mkdir()


DAMAGES = (flip_bit, fill_with_zeros, truncate, empty)
LOSSES = {
    **dict.fromkeys(DAMAGES, "is damaged"),
    replace_by_directory: "cannot be read (Is a directory)",
    Path.unlink: "is missing",
}
CONSEQUENCES = {
    PARAMETER_FILE: "the vehicle file's parameters are used",
    PLAN_FILES[PlanKind.MISSION]: "there is no mission",
    PLAN_FILES[PlanKind.FENCE]: "there is no fence",
    PLAN_FILES[PlanKind.RALLY]: "there are no rally points",
    RESUME_FILE: "not resumed",
}


def save_once(directory, name, content):
    store = Store(directory)
    store.save(name, content)
    store.close()


def damage_reports(directory):
    reports = []
    store = Store(directory)
    report_damage(store, reports.append)
    store.close()
    return reports


@pytest.mark.parametrize("name", CONSEQUENCES)
@pytest.mark.parametrize("lose", LOSSES, ids=lambda lose: lose.__name__)
def test_lost_slots_are_reported_with_the_consequence(name, lose, tmp_path):
    assert damage_reports(tmp_path) == []  # a new directory
    save_once(tmp_path, name, b"")
    assert damage_reports(tmp_path) == []
    for content in (b"# 1", b"# 2"):
        save_once(tmp_path, name, content)
    assert damage_reports(tmp_path) == []
    lose(tmp_path / f"{name}.0")
    damage = f"{name}.0 {LOSSES[lose]}"
    assert damage_reports(tmp_path) == [f"{damage}: the other slot is used, perhaps an older version"]
    if lose is Path.unlink:
        return
    lose(tmp_path / f"{name}.1")
    assert damage_reports(tmp_path) == [f"{damage}, {name}.1 {LOSSES[lose]}: {CONSEQUENCES[name]}"]


@pytest.mark.parametrize("lost", [(0,), (1,), (0, 1)])
@pytest.mark.parametrize("lose", DAMAGES, ids=lambda lose: lose.__name__)
def test_a_version_stored_after_a_loss_is_the_newest(lost, lose, tmp_path):
    for content in (b"1", b"2", b"3"):
        save_once(tmp_path, "a", content)
    for slot in lost:
        lose(tmp_path / f"a.{slot}")
    save_once(tmp_path, "a", b"new")
    assert read_content(tmp_path, "a") == b"new"


def test_a_queued_plan_is_not_replaced_by_the_previous_one(tmp_path):
    """Its acknowledgement would be for the other plan."""
    store, results = Store(tmp_path), []
    wake, store._wake = store._wake, SimpleQueue()  # delays the writer
    store.try_save("a", b"new", results.append)
    store.save_if_idle("a", b"old")
    store._wake = wake
    wake.put(False)
    wait_for(store, lambda: results)
    store.close()
    assert (results, read_content(tmp_path, "a")) == ([True], b"new")


@pytest.mark.parametrize("names", [("resume",), ("parameters", "resume")])
def test_callbacks_come_when_the_records_are_on_disk(tmp_path, names):
    store = Store(tmp_path, private=(SIGNING_FILE,))
    state_directory, results = StateDirectory(store, pytest.fail), []
    state_directory.save_resume(b"record")
    if names == ("resume",):
        state_directory.when_resume_stored(results.append)
    else:
        state_directory.save_parameters({"CTL_K1": 41.0})
        state_directory.when_parameters_stored(results.append)
    wait_for(store, lambda: results)
    assert results == [True]
    assert store.load(RESUME_FILE) == b"record"
    store.close()
