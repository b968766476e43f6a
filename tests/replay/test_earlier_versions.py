"""This version reads logs and a state directory of earlier versions, and recomputes the logs bit for bit.

A change of the record layout alone must not fail here. An intended change of behaviour fails until it is accepted in
data/accepted.json, with the name of the log, the result of `rambler replay LOG --json` and the reason:

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
from replay.relog import recompute_log
from support.paths import REPLAY

DATA = REPLAY
LOGS = {path.name: path for path in sorted(DATA.rglob("*.BIN"))}
ACCEPTED = json.loads((DATA / "accepted.json").read_text())
UNCHANGED = {"first_difference": None, "notes": []}


def replay(path, capsys):
    code = main(["replay", str(path), "--json"])
    report = json.loads(capsys.readouterr().out)
    return code, report, {name: report[name] for name in UNCHANGED}


def expected_result(name, accepted):
    return {key: accepted.get(name, {}).get(key, value) for key, value in UNCHANGED.items()}


@pytest.mark.parametrize("name", LOGS)
def test_log_is_recomputed_except_for_accepted_changes(name, capsys):
    code, report, result = replay(LOGS[name], capsys)
    assert result == expected_result(name, ACCEPTED)
    assert code == (result["first_difference"] is not None)
    assert report["compared"] == report["ticks"] > 190
    assert report["damaged"] == report["garbage_bytes"] == 0


def test_accepted_change_has_a_reason_and_a_log():
    assert ACCEPTED.keys() <= LOGS.keys()
    assert all(entry["reason"] for entry in ACCEPTED.values())


def test_other_change_of_behaviour_is_not_accepted(capsys, monkeypatch):
    gains_of, factor = law.gains_of, 1.01
    monkeypatch.setattr(
        law, "gains_of", lambda *arguments: (gains := gains_of(*arguments))._replace(k1=gains.k1 * factor)
    )
    code, _, result = replay(LOGS["tank_pni_volz.BIN"], capsys)
    accepted = {"tank_pni_volz.BIN": result | {"reason": "a larger gain"}}
    assert code == 1
    assert result["first_difference"]["tick"] > 0
    assert replay(LOGS["tank_pni_volz.BIN"], capsys)[2] == expected_result("tank_pni_volz.BIN", accepted)
    factor = 1.02
    assert replay(LOGS["tank_pni_volz.BIN"], capsys)[2] != expected_result("tank_pni_volz.BIN", accepted)


def test_recomputed_log_has_the_same_inputs_and_replays_identically(capsys, monkeypatch, tmp_path):
    path, gains_of = LOGS["tank_pni_volz.BIN"], law.gains_of
    monkeypatch.setattr(
        law, "gains_of", lambda *arguments: (gains := gains_of(*arguments))._replace(k1=gains.k1 * 1.01)
    )
    log, changed_count, notes = recompute_log(path.read_bytes())
    new_path = tmp_path / path.name
    new_path.write_bytes(log)
    assert changed_count > 20
    assert notes == ()
    assert [tick.inputs for tick in read_log(new_path)] == [tick.inputs for tick in read_log(path)]
    code, report, result = replay(new_path, capsys)
    assert (code, result, report["compared"]) == (0, UNCHANGED, 400)


def test_state_of_an_earlier_version_is_resumed(tmp_path):
    for path in (DATA / "state").iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    store, messages = Store(tmp_path), []
    parameters_of_state, unusable = load_parameters(store, messages.append)
    plans = load_plans(store, messages.append)
    parameters = ParameterSet().replaced("BOOT_RESUME", 2)
    ten_minutes_later = Moment(1767225600.0 + 600.0)
    state = resume(State.at_start(parameters, plans), store.load(RESUME_FILE), ten_minutes_later, messages.append)
    store.close()
    assert (parameters_of_state, unusable) == ({"STAT_BOOTCNT": 1.0}, {})
    assert (state.modes.mode, state.modes.armed) == (Mode.AUTO, True)
    assert (state.guidance.mission.index, state.guidance.mission.begun) == (2, True)
    assert state.guidance.mission.identity == plans.of(PlanKind.MISSION).identity == 2274171152
    assert state.home is not None
    assert state.greeting == "Resumed AUTO, 10 min old"
    assert messages == []
