"""No content of the state directory prevents a start: invalid entries are renamed, the others are read."""

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
from firmware_py.system.state_directory import PARAMETER_FILE, PLAN_FILES, STATE_NAMES, read_parameters
from firmware_py.system.state_export import FORMAT, PENDING_IMPORT, Export, pack
from firmware_py.system.store import Store

MAX_UNUSABLE_PARAMETERS = 200

MISSION = PLAN_FILES[PlanKind.MISSION]
TEMPORARY_FILES = (".import.done", f".{PENDING_IMPORT}.new")


def make_full_directory(path):
    path.mkdir()
    (path / "more").write_text("more")


def make_large_file(path):
    path.touch()
    os.truncate(path, (64 << 20) + 1)


def make_socket(path):
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(path))


ENTRIES = {
    "large file": make_large_file,
    "pipe": os.mkfifo,
    "directory": make_full_directory,
    "link": lambda path: path.symlink_to("/dev/zero"),
    "link to itself": lambda path: path.symlink_to(path),
    "socket": make_socket,
    "random bytes": lambda path: path.write_bytes(bytes(range(256))),
}


@pytest.fixture
def state(tmp_path):
    store = Store(tmp_path / "state")
    store.save(PARAMETER_FILE, b"CTL_K1 3\n")
    store.close()
    return tmp_path / "state"


def export_of(files, about=None):
    """Return the content of an export file with arbitrary members."""
    body = json.dumps({"about": about or {}, "files": files}).encode()
    return f"# rambler exported state {FORMAT} {len(body)} {hashlib.sha256(body).hexdigest()}\n".encode() + body


def run(state):
    """Start a store and save all names; return the stored parameters and the start problem."""
    store = Store(state)
    result = store.load(PARAMETER_FILE), store.start_problem
    for name in STATE_NAMES:
        store.save(name, b"new")
    store.close()
    assert store.failure == ""
    return result


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("name", ["lock", PENDING_IMPORT, *TEMPORARY_FILES])
def test_an_invalid_entry_in_place_of_a_file_is_renamed(name, entry, state):
    (state / "lock").unlink()
    ENTRIES[entry](state / name)
    content, start_problem = run(state)
    assert content == b"CTL_K1 3\n"
    assert (f"set aside as {PENDING_IMPORT}.aside" in start_problem) == (name == PENDING_IMPORT)
    # Of these files the content is not read.
    is_valid = name != PENDING_IMPORT and (entry == "random bytes" or (entry == "large file" and name == "lock"))
    assert os.path.lexists(state / f"{name}.aside") is not is_valid
    Store(state).close()


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("name", STATE_NAMES)
def test_an_invalid_entry_in_place_of_a_slot_is_renamed(name, entry, state):
    for slot in (0, 1):
        (state / f"{name}.{slot}").unlink(missing_ok=True)
        ENTRIES[entry](state / f"{name}.{slot}")
    for _ in range(2):  # each run writes one slot
        run(state)
    assert Store(state).examine(name).content == b"new"
    # A damaged slot of a secret is overwritten.
    assert os.path.lexists(state / f"{name}.0.aside") or (is_secret(name) and entry == "random bytes")


def test_the_number_of_renamed_entries_is_limited(state):
    for number in range(30):
        (state / PENDING_IMPORT).write_bytes(b"%d" % number)
        Store(state).close()
    assert [path.read_bytes() for path in state.glob(f"{PENDING_IMPORT}*")] == [b"29"]
    for _ in range(12):  # a directory cannot replace an entry
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
def test_an_export_with_an_invalid_member_is_refused_and_renamed_in_the_state_directory(files, state, tmp_path, capsys):
    (tmp_path / "bad").write_bytes(export_of(files))
    assert main(["state", "import", str(tmp_path / "bad"), "--state", str(state)]) == 2
    assert len(capsys.readouterr().err.splitlines()[-1]) < 500
    assert not (state / PENDING_IMPORT).exists()
    (state / PENDING_IMPORT).write_bytes(export_of(files))
    content, start_problem = run(state)
    assert content == b"CTL_K1 3\n"
    assert start_problem.startswith("Import not used: ")


def test_the_description_in_an_export_is_limited(state, tmp_path):
    about = {f"{number}": "\ud800é" * 100_000 for number in range(3)}
    (tmp_path / "long").write_bytes(export_of({PARAMETER_FILE: "CTL_K1 4\n"}, about))
    assert main(["state", "import", str(tmp_path / "long"), "--state", str(state)]) == 0
    assert run(state) == (b"CTL_K1 4\n", "")


def test_hostile_endings_are_limited_and_printable(state, tmp_path, capsys):
    hostile = Endings({"killed": (1 << 64) - 1, "\x1b[31m": -5}, (Ending("\x1b]0;x\x07", "a\nb", float("inf")),))
    endings, _ = from_bytes(to_bytes(hostile))
    assert to_bytes(endings.with_added((Ending("killed"),)))  # the count still fits
    assert all(text.isprintable() for text in (*endings.counts, endings.last[0].why, endings.last[0].text))
    (tmp_path / "hostile").write_bytes(pack(Export({ENDINGS_FILE: to_bytes(hostile)})))
    assert main(["state", "import", str(tmp_path / "hostile"), "--state", str(state)]) == 0
    assert main(["status", "--state", str(state), "--json"]) == 1
    assert "\\u001b" not in capsys.readouterr().out


@pytest.mark.parametrize("ledger", [Ledger(day=1 << 40), Ledger(day=3_000_000), Ledger(total=(1 << 64) - 1)])
def test_a_satellite_ledger_with_impossible_numbers_is_refused(ledger):
    with pytest.raises(ValueError, match="out of range"):
        satellite_from_bytes(satellite_to_bytes(Record(ledger)))


def test_invalid_parameters_are_reported_in_a_limited_number_of_lines():
    reports = []
    values, unusable = read_parameters(b"CTL_K1 7\n" + b"X 1\nrubbish\n" * 50_000, reports.append)
    assert (values, unusable) == ({"CTL_K1": 7.0}, {"X": 1.0})
    assert len(reports) == MAX_UNUSABLE_PARAMETERS + 1
