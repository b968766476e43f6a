"""What is acknowledged is there after a restart, what is refused is not, and nothing is silent: at every failure."""

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
from firmware_py.system import endings
from firmware_py.system.endings import ENDINGS_FILE
from firmware_py.system.slots import SlotWriter, stored_content
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
from support.faulty_disk import CUTS, KINDS, FaultyDisk, sampled

UTC_S = 1.8e9
DOUBT = "the next start may find it nevertheless"
LONG = tuple(PlanItem(16, 3, x=index, y=index) for index in range(60))  # more than a slot's first size


def plan(number):
    return Plan.of(PlanKind.MISSION, (PlanItem(16, 6, x=number, y=number), *(LONG if number % 2 else ())))


@dataclass
class Boat:
    """An autopilot over a state directory, as far as keeping goes."""

    store: Store
    autopilot: Autopilot
    vault: KeyVault

    @classmethod
    def start(cls, directory, *, resumes=False):
        store = Store(directory, private=(SIGNING_FILE,))
        kept = StateDirectory(store, lambda _text: None)
        base = ParameterSet().replaced("BOOT_RESUME", 2 if resumes else 0)
        state = State.at_start(kept.parameters_over(base), kept.plans())
        autopilot = Autopilot(resume(state, kept.resume_record(), Moment(UTC_S), pytest.fail), kept)
        return cls(store, autopilot, KeyVault(store))

    def wait(self, answers):
        while not answers:
            assert select.select([self.store.fileno()], [], [], 10.0)[0]
            self.store.service()
        return answers[0]

    def end(self):
        self.store.close()
        return self


def set_parameter(boat, number):
    answers = []
    boat.autopilot.decide(Request(0.0, SetParameter("CTL_K1", 70.0 + number)))
    boat.autopilot.when_stored(answers.append)
    return boat.wait(answers)


def clear_parameters(boat, number):
    """Set it and forget it by turns, so that there is something to forget at the third act."""
    if number < 2:
        return set_parameter(boat, 0)
    answers = []
    boat.autopilot.decide(Request(0.0, ForgetParameters()))
    boat.autopilot.when_stored(answers.append)
    return boat.wait(answers)


def replace_plan(boat, number):
    answers = []
    boat.autopilot.replace_plan(Request(0.0, ReplacePlan(plan(number))), answers.append)
    return boat.wait(answers).verdict is Verdict.ACCEPTED


def replace_plan_beside_a_parameter(boat, number):
    """Both in one round of the writer or in two; only the plan is judged."""
    boat.autopilot.decide(Request(0.0, SetParameter("CTL_K1", 70.0 + number)))
    return replace_plan(boat, number)


def set_key(boat, number):
    answers = []
    boat.vault.save(b"key of number %d" % number, both_slots=True)
    boat.vault.when_stored(answers.append)
    return boat.wait(answers)


def keep_endings(boat, number):
    return save_record(boat, ENDINGS_FILE, endings.to_bytes(endings_of(number)))


def keep_satellite_record(boat, number):
    return save_record(boat, SATELLITE_FILE, satellite.to_bytes(satellite_record_of(number)))


def save_record(boat, name, content):
    answers = []
    boat.store.save(name, content)
    boat.store.when_stored((name,), answers.append)
    return boat.wait(answers)


def endings_of(number):
    return endings.Endings({"killed": 1 + number}, running=True)


def satellite_record_of(number):
    return satellite.Record(window=Window(used=(1 + number,)))


def record_in(boat, name, read):
    content = boat.store.load(name)
    return None if content is None else repr(read(content))  # counts have no hash


def give_order(boat, intent):
    """Give an order and wait until it is acknowledged, as the loop and the link do."""
    answers = []
    boat.autopilot.save_resume(0.0, UTC_S)
    assert boat.autopilot.decide(Request(0.0, intent)).verdict is Verdict.ACCEPTED
    boat.autopilot.when_orders_stored(answers.append)
    return boat.wait(answers)


def arm_or_disarm(boat, number):
    return give_order(boat, Arm(number % 2 == 0, force=True))


def set_mode(boat, number):
    return give_order(boat, SetMode(int(Mode.HOLD if number % 2 else Mode.MANUAL)))


def set_home(boat, number):
    return give_order(boat, SetHome(0.1 * number, 1.0))


ACTS = {
    set_parameter: lambda boat: boat.autopilot.parameters()["CTL_K1"],
    clear_parameters: lambda boat: boat.autopilot.parameters()["CTL_K1"],
    replace_plan: lambda boat: boat.autopilot.plans().mission,
    replace_plan_beside_a_parameter: lambda boat: boat.autopilot.plans().mission,
    set_key: lambda boat: boat.vault.load().content,
    keep_endings: lambda boat: record_in(boat, ENDINGS_FILE, endings.from_bytes),
    keep_satellite_record: lambda boat: record_in(boat, SATELLITE_FILE, satellite.from_bytes),
    arm_or_disarm: lambda boat: boat.autopilot.state.modes.armed,
    set_mode: lambda boat: boat.autopilot.state.modes.mode,
    set_home: lambda boat: boat.autopilot.state.home,
}
ORDERS = (arm_or_disarm, set_mode, set_home)
RECORDS = (keep_endings, keep_satellite_record)
PLANS = (replace_plan, replace_plan_beside_a_parameter)
FAULTS = [(kind, lasting) for kind in KINDS for lasting in (False, True)]


FOUND = {}  # by what lies on the disk: most faults leave the same as others


def found(directory, act):
    """Return the state that the next start loads."""
    image = (act, *sorted((path.name, path.read_bytes()) for path in directory.iterdir()))
    if image not in FOUND:
        FOUND[image] = ACTS[act](Boat.start(directory, resumes=act in ORDERS).end())
    return FOUND[image]


def images(disk, folder):
    """Return the possible states at the next start: after a kill, and after a power cut."""
    with disk.still:
        shutil.copytree(disk.directory, folder / "killed")
        for pattern in CUTS:
            disk.cut(folder / pattern, pattern)
    return [folder / name for name in ("killed", *CUTS)]


def judge(act, tmp_path, monkeypatch, before, failing, *, restart):
    """Do one act on a failing disk, perhaps the first one of a run; return the number of its calls."""
    at, (kind, lasting) = failing
    with monkeypatch.context() as patches:
        patches.setattr("firmware_py.system.store.RETRY_S", 1000.0)  # only what is asked for is tried again
        disk = FaultyDisk(tmp_path / "state", patches)
        boat = Boat.start(disk.directory, resumes=act in ORDERS)
        for number in range(before):
            assert act(boat, number)
        if restart:
            boat.end()
            boat = Boat.start(disk.directory, resumes=act in ORDERS)
        old = found_beside(disk, tmp_path / "old", act)
        disk.arm(at, kind, lasting=lasting)
        stored = act(boat, before)
        failure, failed, calls = boat.store.failure, list(disk.failed), disk.count
        results = [found(image, act) for image in images(disk, tmp_path)]
        disk.arm(None)
        boat.end()
    new = found_after(act, before)
    forgets = act is clear_parameters and before >= 2
    mine = PLAN_FILES[PlanKind.MISSION] in failure if act in PLANS else bool(failure)
    assert not (mine and stored), "what is stored has not failed"
    # After a failed clearing the parameters are saved again at once, possibly with success.
    assert mine or stored or forgets, "a failure is reported while it lasts"
    if stored:
        assert set(results) == {new}, f"acknowledged, and not there: {failed}"
    elif act is set_key or act in RECORDS:
        assert set(results) <= {old, new}  # it is in force: nothing was refused
    elif DOUBT not in failure:
        assert set(results) == {old}, f"refused, and there: {failed}"
    else:
        assert lasting, "one fault leaves no doubt"
    # The disk works again: what is in force, and a plan that was refused is not, is there.
    assert boat.store.failure == ""
    in_force = old if not stored and (forgets or act in PLANS) else new
    assert found(tmp_path / "state", act) == in_force
    return calls


def found_beside(disk, copy, act):
    with disk.still:
        shutil.copytree(disk.directory, copy)
    return found(copy, act)


def found_after(act, number):
    values = {
        set_parameter: 70.0 + number,
        clear_parameters: ParameterSet()["CTL_K1"] if number >= 2 else 70.0,
        replace_plan: plan(number),
        replace_plan_beside_a_parameter: plan(number),
        set_key: b"key of number %d" % number,
        keep_endings: repr((endings_of(number), ())),
        keep_satellite_record: repr((satellite_record_of(number), ())),
        arm_or_disarm: number % 2 == 0,
        set_mode: Mode.HOLD if number % 2 else Mode.MANUAL,
        set_home: Home(0.1 * number, 1.0, 0.0),
    }
    return values[act]


def cases():
    """All acts in a run with earlier acts, and each kind of act as the first one of a run."""
    yield from ((act, before, False) for act in ACTS if act not in RECORDS for before in range(4))
    yield from ((act, 1, False) for act in RECORDS)
    yield from ((act, 2, True) for act in (set_parameter, replace_plan, set_key, arm_or_disarm))


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.proof)], ids=["sampled", "every"])
@pytest.mark.parametrize(("act", "before", "restart"), list(cases()), ids=lambda word: getattr(word, "__name__", None))
def test_at_a_failing_call_acknowledged_is_there_and_refused_is_not(act, before, restart, every, tmp_path, monkeypatch):
    def calls_of(at, fault):
        folder = tmp_path / "case"
        (folder / "state").mkdir(parents=True)
        calls = judge(act, folder, monkeypatch, before, (at, fault), restart=restart)
        shutil.rmtree(folder)
        return calls

    cases, calls = 0, calls_of(None, FAULTS[0])
    for fault in FAULTS[:4] if restart else FAULTS:  # what is torn or short is the same then
        for at in itertools.count() if every else sampled(calls, 1, f"{act.__name__} {before} {restart} {fault}"):
            if calls_of(at, fault) <= at:
                break
            cases += 1
    print(f"{cases} cases")
    assert cases >= 2 * len(FAULTS) or not every  # writing and forcing to disk, at the least


@pytest.fixture
def disk(tmp_path, monkeypatch):
    (tmp_path / "state").mkdir()
    return FaultyDisk(tmp_path / "state", monkeypatch)


def test_a_value_that_is_in_force_but_not_on_disk_is_confirmed_only_when_it_is(disk, tmp_path):
    """Another save that goes well does not make it stored, nor end the fault."""
    boat = Boat.start(disk.directory)
    assert set_parameter(boat, 0)
    disk.arm(0, lasting=True)
    assert not set_parameter(boat, 7)
    disk.arm(None)
    assert replace_plan(boat, 2)
    assert "parameters.param cannot be stored" in boat.store.failure
    again = []
    boat.autopilot.when_stored(again.append)  # as PARAM_SET of the value in force does
    assert boat.wait(again)
    assert found_beside(disk, tmp_path / "killed", set_parameter) == 77.0
    assert boat.store.failure == ""
    boat.end()


def test_a_name_that_failed_is_stored_by_itself_when_the_disk_works_again(disk, tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_py.system.store.RETRY_S", 0.01)
    boat = Boat.start(disk.directory)
    disk.arm(0, lasting=True)
    assert not set_parameter(boat, 7)
    disk.arm(None)
    while boat.store.failure:
        assert select.select([boat.store.fileno()], [], [], 10.0)[0]
        boat.store.service()
    assert found_beside(disk, tmp_path / "killed", set_parameter) == 77.0
    boat.end()


def test_each_name_of_one_round_has_its_own_result(disk, tmp_path, monkeypatch):
    boat = Boat.start(disk.directory)
    assert set_parameter(boat, 0)
    assert replace_plan(boat, 0)
    write, gate = SlotWriter.write, threading.Event()

    def write_all_but_parameters(writer, name, content):
        gate.wait(10.0)
        if name == PARAMETER_FILE:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        write(writer, name, content)

    monkeypatch.setattr(SlotWriter, "write", write_all_but_parameters)
    plans, values = [], []
    boat.vault.save(b"key")  # holds the writer up until both are asked for
    boat.autopilot.decide(Request(0.0, SetParameter("CTL_K1", 77.0)))
    boat.autopilot.replace_plan(Request(0.0, ReplacePlan(plan(2))), plans.append)
    boat.autopilot.when_stored(values.append)
    gate.set()
    assert boat.wait(plans).verdict is Verdict.ACCEPTED
    assert not boat.wait(values)
    assert found_beside(disk, tmp_path / "killed", replace_plan) == plan(2)
    monkeypatch.undo()
    boat.end()


def damaged(path):
    content = bytearray(path.read_bytes())
    content[content.index(b"\n") + 2] ^= 1
    path.write_bytes(content)


def zeroed(path):
    path.write_bytes(bytes(path.stat().st_size))


def torn(path):
    path.write_bytes(path.read_bytes()[:30])


def emptied(path):
    path.write_bytes(b"")


def unreadable(path):
    path.unlink()
    path.mkdir()


LOSSES = {
    damaged: "is damaged",
    zeroed: "is damaged",
    torn: "is damaged",
    emptied: "is damaged",
    unreadable: "cannot be read (Is a directory)",
    Path.unlink: "is missing",
}
INSTEAD = {
    PARAMETER_FILE: "the vehicle file's parameters are used",
    PLAN_FILES[PlanKind.MISSION]: "there is no mission",
    PLAN_FILES[PlanKind.FENCE]: "there is no fence",
    PLAN_FILES[PlanKind.RALLY]: "there are no rally points",
    RESUME_FILE: "not resumed",
}


def reported(directory):
    reports = []
    store = Store(directory)
    report_damage(store, reports.append)
    store.close()
    return reports


@pytest.mark.parametrize("name", INSTEAD)
@pytest.mark.parametrize("lose", LOSSES, ids=lambda lose: lose.__name__)
def test_lost_slots_are_reported_by_name_with_the_replacement(name, lose, tmp_path):
    store = Store(tmp_path)
    store.save(name, b"")
    store.close()
    assert reported(tmp_path) == []
    for content in (b"# 1", b"# 2"):
        store = Store(tmp_path)
        store.save(name, content)
        store.close()
    assert reported(tmp_path) == []
    lose(tmp_path / f"{name}.0")
    damage = f"{name}.0 {LOSSES[lose]}"
    assert reported(tmp_path) == [f"{damage}: the other slot is used, perhaps an older version"]
    if lose is Path.unlink:
        return
    lose(tmp_path / f"{name}.1")
    assert reported(tmp_path) == [f"{damage}, {name}.1 {LOSSES[lose]}: {INSTEAD[name]}"]


def test_a_state_directory_that_is_new_has_lost_nothing(tmp_path):
    assert reported(tmp_path / "state") == []


@pytest.mark.parametrize("lost", [(0,), (1,), (0, 1)])
@pytest.mark.parametrize("lose", [damaged, zeroed, torn, emptied])
def test_what_is_stored_after_a_loss_wins(lost, lose, tmp_path):
    for content in (b"1", b"2", b"3"):
        store = Store(tmp_path)
        store.save("a", content)
        store.close()
    for slot in lost:
        lose(tmp_path / f"a.{slot}")
    store = Store(tmp_path)
    store.save("a", b"new")
    store.close()
    assert stored_content(tmp_path, "a") == b"new"


def mission_in(directory):
    return stored_content(directory, PLAN_FILES[PlanKind.MISSION])


@pytest.mark.parametrize("since_the_start", [True, False])
@pytest.mark.parametrize("holds", [True, False])
def test_another_disk_gets_the_plan_in_force_unless_it_holds_one_and_none_was_set(
    since_the_start, holds, tmp_path, monkeypatch
):
    """As a partition that comes back empty under way: the next start would have neither fence nor mission."""
    monkeypatch.setattr("firmware_py.system.store.RETRY_S", 0.01)
    contents = []
    for number in (2, 1):
        boat = Boat.start(tmp_path / f"{number}")
        assert replace_plan(boat, number)
        boat.end()
        contents.append(mission_in(tmp_path / f"{number}"))
    other, in_force = contents
    boat = Boat.start(tmp_path / "1")
    if since_the_start:
        assert replace_plan(boat, 1)
    (tmp_path / "1").rename(tmp_path / "gone")
    boat.store.save("a", b"")  # whatever is stored next finds out
    if holds:
        (tmp_path / "2").rename(tmp_path / "1")
    else:
        (tmp_path / "1").mkdir()
    reports = []
    boat.store.when_stored(("a",), reports.append)
    while boat.store.failure or not reports:
        assert select.select([boat.store.fileno()], [], [], 10.0)[0]
        boat.store.service()
    boat.end()
    assert mission_in(tmp_path / "1") == (other if holds and not since_the_start else in_force)


def test_a_plan_that_is_being_stored_is_not_replaced_by_the_one_before(tmp_path):
    """Else its acknowledgement would be that of the other."""
    store, answers = Store(tmp_path), []
    wake, store._wake = store._wake, SimpleQueue()  # the writer does not begin yet
    store.try_save("a", b"new", answers.append)
    store.save_if_idle("a", b"old")
    store._wake = wake
    wake.put(False)
    while not answers:
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()
    store.close()
    assert (answers, stored_content(tmp_path, "a")) == ([True], b"new")
