"""`rambler state`: export and import; a refused import changes nothing, and no failure leaves half of an import."""

import hashlib
import itertools
import json
import os
import re
import shutil
import stat

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.__main__ import main
from firmware_py.cli import state as state_command
from firmware_py.common.plan import Plan, PlanItem, PlanKind, to_text
from firmware_py.link.signing import KeyRecord, find_key
from firmware_py.link.signing import to_text as key_to_text
from firmware_py.plans.items import Command
from firmware_py.system.endings import ENDINGS_FILE, Ending, Endings, from_bytes
from firmware_py.system.endings import to_bytes as endings_to_bytes
from firmware_py.system.slots import SLOTS, slot_path
from firmware_py.system.state_directory import (
    PARAMETER_FILE,
    PLAN_FILES,
    RECORD_FILES,
    RESUME_FILE,
    SATELLITE_FILE,
    SIGNING_FILE,
    STATE_NAMES,
    StateFiles,
    read_key,
)
from firmware_py.system.state_export import FORMAT, PENDING_IMPORT, BrokenExportError, Export, pack, unpack
from firmware_py.system.store import Store
from support.faulty_disk import CUTS, KINDS, FaultyDisk, sample_calls

MISSION, FENCE = PLAN_FILES[PlanKind.MISSION], PLAN_FILES[PlanKind.FENCE]
KEY, OTHER_KEY = bytes(range(1, 33)), bytes(range(2, 34))
FILE_NAMES = tuple(name for name in STATE_NAMES if name != SIGNING_FILE)
# Texts of errors after which the import may take effect at the next start, or does.
MAY_TAKE_EFFECT, TAKES_EFFECT = "may find it nevertheless", "takes effect at the next start"


def mission(number):
    return to_text(Plan.of(PlanKind.MISSION, (PlanItem(Command.WAYPOINT, 6, x=number, y=number),))).encode()


NO_FENCE = to_text(Plan.of(PlanKind.FENCE, ())).encode()
RUNNING = endings_to_bytes(Endings({"killed": 2}, (Ending("killed", "SIGKILL", 1.8e9),), running=True))
OLD = {PARAMETER_FILE: b"CTL_K1 3\n", MISSION: mission(1), RESUME_FILE: b""}
NEW = {PARAMETER_FILE: b"CTL_K1 7\nWP_RADIUS 9\n", MISSION: mission(2), ENDINGS_FILE: RUNNING}


def make_state(directory, files, key=None):
    directory.mkdir()
    store = Store(directory, private=(SIGNING_FILE,))
    for name, content in files.items():
        if content:
            store.save(name, content)
    if key is not None:
        store.save(SIGNING_FILE, key_to_text(KeyRecord(key, 1000, {(255, 190, 0): 900})), both_slots=True)
    store.close()
    return directory


@pytest.fixture
def old(tmp_path):
    return make_state(tmp_path / "old", OLD)


@pytest.fixture
def new(tmp_path):
    return make_state(tmp_path / "new", NEW, KEY)


def export_state(path, directory, *words):
    return main(["state", "export", str(path), "--state", str(directory), *words])


def import_state(path, directory):
    return main(["state", "import", str(path), "--state", str(directory)])


@pytest.fixture
def exported(new, tmp_path, capsys):
    path = tmp_path / "boat.state"
    assert export_state(path, new) == 0
    capsys.readouterr()
    return path


def read_files(directory):
    return {name: StateFiles(directory).load(name) for name in FILE_NAMES}


def mode_of(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture
def refused(old, tmp_path, capsys):
    """Import bytes or a file into the old state, which it must not change; return the last line of the error."""

    def raw_files():
        return {path.name: path.read_bytes() for path in old.iterdir() if path.name != "lock"}

    def run(source):
        path = source
        if isinstance(source, bytes):
            path = tmp_path / "invalid"
            path.write_bytes(source)
        previous = raw_files()
        assert import_state(path, old) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert raw_files() == previous
        return captured.err.splitlines()[-1]

    return run


def test_import_replaces_the_whole_state(exported, new, old, capsys):
    assert import_state(exported, old) == 0
    assert read_files(old) | {ENDINGS_FILE: None} == read_files(new) | {ENDINGS_FILE: None}
    exported_endings = read_files(old)[ENDINGS_FILE]
    endings, _ = from_bytes(exported_endings)
    assert (endings.counts, endings.running) == ({"killed": 2}, False)  # the present run stays on the other computer
    first, *lines = capsys.readouterr().out.splitlines()
    assert first == "signing.key        not in the file, unchanged"
    sizes = {"parameters.param": f"{len(NEW[PARAMETER_FILE])} bytes, instead of {len(OLD[PARAMETER_FILE])}"}
    sizes[MISSION] = f"{len(NEW[MISSION])} bytes, instead of {len(OLD[MISSION])}"
    sizes[ENDINGS_FILE] = f"{len(exported_endings)} bytes"
    assert lines == [f"{name:<18} {sizes.get(name, 'nothing')}" for name in FILE_NAMES]
    assert not (old / PENDING_IMPORT).exists()
    fenced = make_state(old.parent / "fenced", OLD | {FENCE: NO_FENCE})
    assert import_state(exported, fenced) == 0
    assert read_files(fenced)[FENCE] is None
    assert StateFiles(fenced).examine(FENCE).damage == ""


def test_key_is_exported_only_with_key(exported, new, old, tmp_path, capsys):
    assert KEY.hex() not in exported.read_text()
    assert set(unpack(exported.read_bytes()).files) == set(FILE_NAMES)
    assert export_state(tmp_path / "no_key.state", old, "--with-key") == 0
    assert set(unpack((tmp_path / "no_key.state").read_bytes()).files) == set(FILE_NAMES)
    capsys.readouterr()
    assert mode_of(exported) == 0o640
    path = tmp_path / "with_key.state"
    assert export_state(path, new, "--with-key", "--json") == 0
    assert SIGNING_FILE in json.loads(capsys.readouterr().out)["names"]
    assert KEY.hex() in path.read_text()
    assert mode_of(path) == 0o600
    assert import_state(path, old) == 0
    record = find_key(read_key(old)).record
    assert record.key == KEY
    assert record.timestamp > 10**15 / 100  # the present time, so that frames signed earlier are not accepted
    assert {mode_of(slot_path(old, SIGNING_FILE, slot)) for slot in SLOTS} == {0o600}
    assert not any(KEY.hex() in path.read_text("latin-1") for path in old.iterdir() if SIGNING_FILE not in path.name)


def test_import_without_key_keeps_the_key(exported, tmp_path):
    directory = make_state(tmp_path / "keyed", OLD, OTHER_KEY)
    assert import_state(exported, directory) == 0
    assert find_key(read_key(directory)).record.key == OTHER_KEY


def test_damaged_file_is_refused(exported, refused):
    content = exported.read_bytes()
    for position in range(0, len(content), 29):
        flipped = content[:position] + bytes([content[position] ^ 1]) + content[position + 1 :]
        assert re.search("damaged|not an exported state|has format", refused(flipped))
    for length in (0, 10, 60, len(content) - 1):
        assert re.search("damaged|not an exported state", refused(content[:length]))
    assert "damaged" in refused(content + b"\n")


@pytest.mark.parametrize(
    ("files", "text"),
    [
        ({MISSION: b"no plan"}, "mission.plan"),
        ({MISSION: NO_FENCE}, "it is a fence"),
        ({RESUME_FILE: b"{}"}, "resume.record"),
        ({ENDINGS_FILE: b"[]"}, "endings.record"),
        ({SATELLITE_FILE: b"ledger"}, "satellite.record"),
        ({SIGNING_FILE: b"secret"}, "not a signing key"),
        ({"../passwd": b""}, "not a valid name"),
    ],
    ids=["no plan", "wrong plan", "resume", "endings", "satellite", "key", "name"],
)
def test_unusable_content_is_refused(files, text, refused):
    assert text in refused(pack(Export(files)))


@pytest.mark.parametrize(("name", "value"), [(MISSION, 7), (ENDINGS_FILE, "no base64!")])
def test_content_that_is_not_text_is_refused(name, value, refused):
    body = json.dumps({"about": {}, "files": {name: value}}).encode()
    header = f"# rambler exported state {FORMAT} {len(body)} {hashlib.sha256(body).hexdigest()}\n"
    assert "is not an exported state of rambler: " in refused(header.encode() + body)


def test_other_format_other_file_and_missing_file_are_refused(exported, refused, tmp_path):
    for number, remedy in ((FORMAT + 1, "use a newer version"), (FORMAT - 1, "export that state with this version")):
        content = exported.read_bytes().replace(b"state %d " % FORMAT, b"state %d " % number, 1)
        assert f"has format {number}, this version reads {FORMAT}; {remedy}" in refused(content)
    assert "is not an exported state of rambler" in refused(b"# rambler state 1 0 00000000\n")
    assert "No such file" in refused(tmp_path / "none")
    os.mkfifo(tmp_path / "pipe")
    assert "is a pipe" in refused(tmp_path / "pipe")


def test_names_and_parameters_of_another_version_are_reported(old, capsys, tmp_path):
    path, parameters = tmp_path / "other", b"CTL_K1 5\nNEW_ONE 1\n"
    path.write_bytes(pack(Export({"sails.state": b"x", PARAMETER_FILE: parameters})))
    assert import_state(path, old) == 0
    error = capsys.readouterr().err
    assert "sails.state ignored: written by another version" in error
    assert "kept for another version" in error
    assert read_files(old)[PARAMETER_FILE] == parameters


def test_state_of_a_running_autopilot_is_exported_but_not_replaced(exported, old, refused, tmp_path):
    store = Store(old)
    assert "in use by another autopilot" in refused(exported)
    assert export_state(tmp_path / "out", old) == 0
    store.close()
    assert unpack((tmp_path / "out").read_bytes()).content(MISSION) == OLD[MISSION]


def test_damaged_slot_is_reported_and_the_other_exported(new, tmp_path, capsys):
    store = Store(new)
    store.save(MISSION, mission(3))
    store.close()
    path = slot_path(new, MISSION, 1)
    path.write_bytes(path.read_bytes().replace(mission(3), mission(4)))
    assert export_state(tmp_path / "out", new) == 1
    assert "mission.plan.1 is damaged: the other slot is used" in capsys.readouterr().err
    assert unpack((tmp_path / "out").read_bytes()).content(MISSION) == mission(2)


def test_export_of_an_empty_or_missing_directory_is_refused(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    for name, text in (("empty", "contains no state"), ("none", "does not exist")):
        assert export_state(tmp_path / "out", tmp_path / name) == 2
        assert text in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def import_on_faulty_disk(exported, directory, folder, monkeypatch, failure, capsys):
    """Import on a failing disk.

    Return exit code, error text, files after a kill and after each kind of power cut, failed calls, number of calls.
    """
    number, kind, lasting = failure
    shutil.copytree(directory, folder / "state")
    with monkeypatch.context() as patches:
        disk = FaultyDisk(folder / "state", patches)
        for path in disk.directory.iterdir():
            disk.names[path.name], disk.durable[path.name] = None, path.read_bytes()
        disk.arm(number, kind, lasting=lasting)
        code = import_state(exported, disk.directory)
        failed_calls, call_count = list(disk.failed), disk.count
        shutil.copytree(disk.directory, folder / "killed")
        for pattern in CUTS:
            disk.cut(folder / pattern, pattern)
        disk.arm(None)
    images = []
    for name in ("killed", *CUTS):
        images.append(read_files(folder / name))
        Store(folder / name).close()
        assert read_files(folder / name) == images[-1], "the next start must find the same files as a reader"
        assert not (folder / name / PENDING_IMPORT).exists()
    return code, capsys.readouterr().err, images, failed_calls, call_count


FAILURES = [(kind, lasting) for lasting in (False, True) for kind in KINDS]
ALL_CALLS = [pytest.param(*failure, True, marks=pytest.mark.proof) for failure in FAILURES]
SAMPLED_CALLS = [(*failure, False) for failure in FAILURES]


@pytest.mark.parametrize(("kind", "lasting", "all_calls"), SAMPLED_CALLS + ALL_CALLS)
def test_import_is_atomic_under_kills_and_errors(
    exported, old, tmp_path, monkeypatch, capsys, kind, lasting, all_calls
):
    previous = read_files(old)
    undisturbed = import_on_faulty_disk(exported, old, tmp_path / "none", monkeypatch, (None, kind, False), capsys)
    code, _, (new, *_), _, call_count = undisturbed
    assert (code, new[MISSION]) == (0, NEW[MISSION])
    codes = set()
    for number in itertools.count() if all_calls else sample_calls(call_count, 3, f"{kind} {lasting}"):
        folder, failure = tmp_path / f"{number}", (number, kind, lasting)
        code, error, images, failed_calls, _ = import_on_faulty_disk(
            exported, old, folder, monkeypatch, failure, capsys
        )
        is_committed = code == 0 or TAKES_EFFECT in error
        allowed = [new] if is_committed else [previous, new] if MAY_TAKE_EFFECT in error else [previous]
        assert all(image in allowed for image in images), (number, failed_calls, error, images)
        codes.add(code)
        shutil.rmtree(folder)
        if not failed_calls:
            break
    assert codes == {0, 2} or not all_calls


def test_damaged_pending_import_is_set_aside(old):
    (old / PENDING_IMPORT).write_bytes(b"# rambler exported state 2 5 ")
    store = Store(old)
    assert store.start_problem == f"Import not used: {PENDING_IMPORT} is damaged; set aside as {PENDING_IMPORT}.aside"
    assert store.failure == ""
    assert not (old / PENDING_IMPORT).exists()
    assert store.load(MISSION) == OLD[MISSION]
    store.close()


TEXTS = st.text(st.characters(codec="utf-8"), max_size=9).map(str.encode)
CONTENTS = {name: st.none() | (st.binary() if name in RECORD_FILES else TEXTS) for name in STATE_NAMES}


@settings(max_examples=15)
@given(st.fixed_dictionaries({}, optional=CONTENTS))
def test_any_content_round_trip(files):
    assert unpack(pack(Export(files, {"host": "a"}))) == Export(files, {"host": "a"})


@given(st.binary(max_size=200))
def test_other_bytes_are_refused(data):
    header = b"# rambler exported state %d " % FORMAT
    for content in (data, header + data):
        with pytest.raises(BrokenExportError):
            unpack(content)


@pytest.mark.parametrize(
    ("previous", "new", "text"),
    [
        (None, None, "nothing"),
        (b"abc", None, "nothing, instead of 3 bytes"),
        (None, b"ab", "2 bytes"),
        (b"ab", b"ab", "2 bytes, as before"),
        (b"abc", b"ab", "2 bytes, instead of 3"),
    ],
)
def test_change_of_a_file_by_an_import_is_described(previous, new, text):
    assert state_command._describe_change(previous, new) == text
