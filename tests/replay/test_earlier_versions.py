"""Logs and a state directory of earlier versions are read by this one, and logs are recomputed to the bit.

A change of the record layout alone must not show here. A change of behaviour, made on purpose, does: it is looked at
and then accepted in data/accepted.json, the name of the log with what `rambler replay LOG --json`
shows and why that is right:

    {"tank.BIN": {"first_difference": {...}, "notes": [...], "reason": "..."}}
"""

import json

import pytest

from firmware_py.__main__ import main
from firmware_py.assemble.stored_state import resume
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import PlanKind
from firmware_py.control import law
from firmware_py.core.resume import Moment
from firmware_py.core.state import State
from firmware_py.log.reader import read_log
from firmware_py.system.state_directory import RESUME_FILE, load_parameters, load_plans
from firmware_py.system.store import Store
from replay.relog import relogged
from support.paths import REPLAY

DATA = REPLAY
LOGS = {path.name: path for path in sorted(DATA.rglob("*.BIN"))}
ACCEPTED = json.loads((DATA / "accepted.json").read_text())
UNCHANGED = {"first_difference": None, "notes": []}


def replayed(path, capsys):
    code = main(["replay", str(path), "--json"])
    report = json.loads(capsys.readouterr().out)
    return code, report, {name: report[name] for name in UNCHANGED}


def expected(name, accepted):
    return {key: accepted.get(name, {}).get(key, value) for key, value in UNCHANGED.items()}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_is_recomputed_but_for_what_was_accepted(name, capsys):
    code, report, found = replayed(LOGS[name], capsys)
    assert found == expected(name, ACCEPTED)
    assert code == (found["first_difference"] is not None)
    assert report["compared"] == report["ticks"] > 190
    assert report["damaged"] == report["garbage_bytes"] == 0


def test_what_is_accepted_has_its_reason_and_its_log():
    assert ACCEPTED.keys() <= LOGS.keys()
    assert all(entry["reason"] for entry in ACCEPTED.values())


def test_another_change_of_behaviour_is_not_accepted(capsys, monkeypatch):
    right, factor = law.gains_of, 1.01
    monkeypatch.setattr(law, "gains_of", lambda *given: (gains := right(*given))._replace(k1=gains.k1 * factor))
    code, _, found = replayed(LOGS["tank_pni_volz.BIN"], capsys)
    accepted = {"tank_pni_volz.BIN": found | {"reason": "a larger gain"}}
    assert code == 1
    assert found["first_difference"]["tick"] > 0
    assert replayed(LOGS["tank_pni_volz.BIN"], capsys)[2] == expected("tank_pni_volz.BIN", accepted)
    factor = 1.02
    assert replayed(LOGS["tank_pni_volz.BIN"], capsys)[2] != expected("tank_pni_volz.BIN", accepted)


def test_a_log_computed_again_after_a_change_has_the_same_inputs_and_is_recomputed(capsys, monkeypatch, tmp_path):
    old, right = LOGS["tank_pni_volz.BIN"], law.gains_of
    monkeypatch.setattr(law, "gains_of", lambda *given: (gains := right(*given))._replace(k1=gains.k1 * 1.01))
    data, changed, notes = relogged(old.read_bytes())
    new = tmp_path / old.name
    new.write_bytes(data)
    assert changed > 20
    assert notes == ()
    assert [tick.inputs for tick in read_log(new)] == [tick.inputs for tick in read_log(old)]
    code, report, found = replayed(new, capsys)
    assert (code, found, report["compared"]) == (0, UNCHANGED, 400)


def test_a_boat_resumes_the_state_of_an_earlier_version(tmp_path):
    for path in (DATA / "state").iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    store, messages = Store(tmp_path), []
    values, unusable = load_parameters(store, messages.append)
    plans = load_plans(store, messages.append)
    parameters = ParameterSet().replaced("BOOT_RESUME", 2)
    ten_minutes_later = Moment(1767225600.0 + 600.0)
    state = resume(State.at_start(parameters, plans), store.load(RESUME_FILE), ten_minutes_later, messages.append)
    store.close()
    assert (values, unusable) == ({"STAT_BOOTCNT": 1.0}, {})
    assert (state.modes.mode, state.modes.armed) == (Mode.AUTO, True)
    assert (state.guidance.mission.index, state.guidance.mission.begun) == (2, True)
    assert state.guidance.mission.identity == plans.of(PlanKind.MISSION).identity == 2274171152
    assert state.home is not None
    assert state.greeting == "Resumed AUTO, 10 min old"
    assert messages == []
