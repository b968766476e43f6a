"""Nothing that lies in the state directory keeps the boat from starting: it is set aside, and the rest is used."""

import hashlib
import json
import os
import socket

import pytest

from firmware_py.__main__ import main
from firmware_py.common.plan import PlanKind
from firmware_py.link.satellite.record import Ledger, Record
from firmware_py.link.satellite.record import from_bytes as satellite_from_bytes
from firmware_py.link.satellite.record import to_bytes as satellite_to_bytes
from firmware_py.system.endings import ENDINGS_FILE, Ending, Endings, from_bytes, to_bytes
from firmware_py.system.slots import is_secret
from firmware_py.system.state_directory import (
    MAX_UNUSABLE_PARAMETERS,
    PARAMETER_FILE,
    PLAN_FILES,
    STATE_NAMES,
    read_parameters,
)
from firmware_py.system.state_export import FORMAT, PENDING_IMPORT, Export, pack
from firmware_py.system.store import Store

MISSION = PLAN_FILES[PlanKind.MISSION]
LEFT_OVER = (".import.done", f".{PENDING_IMPORT}.new")


def full(path):
    path.mkdir()
    (path / "more").write_text("more")


def gigabytes(path):
    path.touch()
    os.truncate(path, 3 << 30)


def bound(path):
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


ODD = {
    "a pipe": os.mkfifo,
    "a directory": full,
    "a link": lambda path: path.symlink_to("/dev/zero"),
    "a link to itself": lambda path: path.symlink_to(path),
    "gigabytes": gigabytes,
    "a socket": bound,
    "rubbish": lambda path: path.write_bytes(bytes(range(256))),
}


@pytest.fixture
def state(tmp_path):
    store = Store(tmp_path / "state")
    store.save(PARAMETER_FILE, b"CTL_K1 3\n")
    store.close()
    return tmp_path / "state"


def exported(files, about=None):
    """Return an export as anybody can make one, whatever is in it."""
    body = json.dumps({"about": about or {}, "files": files}).encode()
    return f"# rambler exported state {FORMAT} {len(body)} {hashlib.sha256(body).hexdigest()}\n".encode() + body


def started(state):
    """Return the stored parameters and the start problem of a store."""
    store = Store(state)
    found = store.load(PARAMETER_FILE), store.start_problem
    for name in STATE_NAMES:
        store.save(name, b"new")
    store.close()
    assert store.failure == ""
    return found


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("name", ["lock", PENDING_IMPORT, *LEFT_OVER])
def test_an_invalid_entry_in_place_of_a_file_is_set_aside(name, odd, state):
    (state / "lock").unlink()
    ODD[odd](state / name)
    content, start_problem = started(state)
    assert content == b"CTL_K1 3\n"
    assert (f"set aside as {PENDING_IMPORT}.aside" in start_problem) == (name == PENDING_IMPORT)
    as_it_is = odd == "rubbish" or (odd == "gigabytes" and name == "lock")  # a file, whose content is not looked at
    assert os.path.lexists(state / f"{name}.aside") != (as_it_is and name != PENDING_IMPORT)
    Store(state).close()


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("name", STATE_NAMES)
def test_an_invalid_entry_in_place_of_a_slot_is_set_aside(name, odd, state):
    for slot in (0, 1):
        (state / f"{name}.{slot}").unlink(missing_ok=True)
        ODD[odd](state / f"{name}.{slot}")
    started(state)
    started(state)  # into the other slot
    assert Store(state).examine(name).content == b"new"
    aside = os.path.lexists(state / f"{name}.0.aside")
    # The slots of a secret say by themselves that it was lost, and hold nothing to look into.
    assert aside or (is_secret(name) and odd == "rubbish")


def test_repeated_setting_aside_does_not_fill_the_directory(state):
    for number in range(30):
        (state / PENDING_IMPORT).write_bytes(b"%d" % number)
        Store(state).close()
    assert [path.read_bytes() for path in state.glob(f"{PENDING_IMPORT}*")] == [b"29"]
    for _ in range(12):  # a directory replaces nothing
        (state / PENDING_IMPORT).mkdir(exist_ok=True)
        Store(state).close()
    assert len(list(state.glob(f"{PENDING_IMPORT}*"))) == 11


@pytest.mark.parametrize(
    "files",
    [
        {PARAMETER_FILE: "# comment\n" * 200_000},
        {MISSION: " " * (5 << 20)},
        {"satellite.record": "AAAA" * (1 << 20)},
        {"signing.key": "k" * (1 << 17)},
        {"parameters.param": "\ud800"},
        {"endings.record": "\ud800"},
        {"endings.record": 10**400},
        {"parameters.param": [[[]]]},
    ],
    ids=range(8),
)
def test_a_member_that_no_slot_takes_is_refused_and_one_that_is_staged_is_set_aside(files, state, tmp_path, capsys):
    (tmp_path / "bad").write_bytes(exported(files))
    assert main(["state", "import", str(tmp_path / "bad"), "--state", str(state)]) == 2
    assert len(capsys.readouterr().err.splitlines()[-1]) < 500
    assert not (state / PENDING_IMPORT).exists()
    (state / PENDING_IMPORT).write_bytes(exported(files))
    content, start_problem = started(state)
    assert content == b"CTL_K1 3\n"
    assert start_problem.startswith("Import not used: ")


def test_what_an_export_says_of_itself_is_bounded(state, tmp_path):
    about = {f"{number}": "\ud800é" * 100_000 for number in range(3)}
    (tmp_path / "long").write_bytes(exported({PARAMETER_FILE: "CTL_K1 4\n"}, about))
    assert main(["state", "import", str(tmp_path / "long"), "--state", str(state)]) == 0
    assert started(state) == (b"CTL_K1 4\n", "")


def test_numbers_beyond_all_bounds_in_the_endings_are_none(state, tmp_path, capsys):
    hostile = Endings({"killed": (1 << 64) - 1, "\x1b[31m": -5}, (Ending("\x1b]0;x\x07", "a\nb", float("inf")),))
    kept, _ = from_bytes(to_bytes(hostile))
    assert to_bytes(kept.with_added((Ending("killed"),)))  # can be stored after one more
    assert all(word.isprintable() for word in (*kept.counts, kept.last[0].why, kept.last[0].text))
    (tmp_path / "hostile").write_bytes(pack(Export({ENDINGS_FILE: to_bytes(hostile)})))
    assert main(["state", "import", str(tmp_path / "hostile"), "--state", str(state)]) == 0
    assert main(["status", "--state", str(state), "--json"]) == 1
    assert "\\u001b" not in capsys.readouterr().out


@pytest.mark.parametrize("ledger", [Ledger(day=1 << 40), Ledger(day=3_000_000), Ledger(total=(1 << 64) - 1)])
def test_a_ledger_with_an_invalid_date_is_started_again(ledger):
    with pytest.raises(ValueError, match="beyond all bounds"):
        satellite_from_bytes(satellite_to_bytes(Record(ledger)))


def test_invalid_parameters_are_reported_in_a_limited_number_of_lines():
    reports = []
    values, unusable = read_parameters(b"CTL_K1 7\n" + b"X 1\nrubbish\n" * 50_000, reports.append)
    assert (values, unusable) == ({"CTL_K1": 7.0}, {"X": 1.0})
    assert len(reports) == MAX_UNUSABLE_PARAMETERS + 1
