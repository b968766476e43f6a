"""`rambler state`: one file out, one in; what is refused changes nothing, and no failure leaves half of an import."""

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
from firmware_py.common.plan import Plan, PlanItem, PlanKind, to_text
from firmware_py.link.signing import KeyRecord, find_key
from firmware_py.link.signing import to_text as key_to_text
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
    stored_key,
)
from firmware_py.system.state_export import FORMAT, PENDING_IMPORT, BrokenExportError, Export, pack, unpack
from firmware_py.system.store import Store
from support.faulty_disk import CUTS, KINDS, FaultyDisk, sampled

MISSION, FENCE = PLAN_FILES[PlanKind.MISSION], PLAN_FILES[PlanKind.FENCE]
KEY, OTHER_KEY = bytes(range(1, 33)), bytes(range(2, 34))
OPEN_NAMES = tuple(name for name in STATE_NAMES if name != SIGNING_FILE)
DOUBT, COUNTS, REFUSED = "may find it nevertheless", "takes effect at the next start", "nothing was imported"


def mission(number):
    return to_text(Plan.of(PlanKind.MISSION, (PlanItem(16, 6, x=number, y=number),))).encode()


ENDED = endings_to_bytes(Endings({"killed": 2}, (Ending("killed", "SIGKILL", 1.8e9),), running=True))
OLD = {PARAMETER_FILE: b"CTL_K1 3\n", MISSION: mission(1), RESUME_FILE: b""}
NEW = {PARAMETER_FILE: b"CTL_K1 7\nWP_RADIUS 9\n", MISSION: mission(2), ENDINGS_FILE: ENDED}


def fill(directory, contents, key=None):
    directory.mkdir()
    store = Store(directory, private=(SIGNING_FILE,))
    for name, content in contents.items():
        if content:
            store.save(name, content)
    if key is not None:
        store.save(SIGNING_FILE, key_to_text(KeyRecord(key, 1000, {(255, 190, 0): 900})), both_slots=True)
    store.close()
    return directory


@pytest.fixture
def old(tmp_path):
    return fill(tmp_path / "old", OLD)


@pytest.fixture
def new(tmp_path):
    return fill(tmp_path / "new", NEW, KEY)


@pytest.fixture
def exported(new, tmp_path, capsys):
    path = tmp_path / "boat.state"
    assert main(["state", "export", str(path), "--state", str(new)]) == 0
    capsys.readouterr()
    return path


def contents(directory):
    return {name: StateFiles(directory).load(name) for name in OPEN_NAMES}


def import_it(path, directory):
    return main(["state", "import", str(path), "--state", str(directory)])


def refused(capsys, path, directory):
    before = {entry.name: entry.read_bytes() for entry in directory.iterdir()}
    assert import_it(path, directory) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    changed = {entry.name: entry.read_bytes() for entry in directory.iterdir() if entry.name != "lock"}
    assert changed == {name: content for name, content in before.items() if name != "lock"}
    return captured.err.splitlines()[-1]


def test_import_replaces_the_whole_state(exported, new, old, capsys):
    assert import_it(exported, old) == 0
    assert {**contents(old), ENDINGS_FILE: None} == {**contents(new), ENDINGS_FILE: None}
    kept, _ = from_bytes(contents(old)[ENDINGS_FILE])
    assert (kept.counts, kept.running) == ({"killed": 2}, False)  # the run under way is not that of the other computer
    assert "signing.key        not in the file, unchanged" in capsys.readouterr().out
    assert not (old / PENDING_IMPORT).exists()
    # Into one that had more: nothing of it is left.
    more = fill(old.parent / "more", {**OLD, FENCE: to_text(Plan.of(PlanKind.FENCE, ())).encode()})
    assert import_it(exported, more) == 0
    assert contents(more)[FENCE] is None
    assert StateFiles(more).examine(FENCE).damage == ""


def test_key_is_exported_only_with_key(exported, new, old, tmp_path, capsys):
    assert KEY.hex() not in exported.read_text()
    assert stat.S_IMODE(exported.stat().st_mode) == 0o640
    secret = tmp_path / "secret.state"
    assert main(["state", "export", str(secret), "--state", str(new), "--with-key", "--json"]) == 0
    assert SIGNING_FILE in json.loads(capsys.readouterr().out)["names"]
    assert KEY.hex() in secret.read_text()
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    assert import_it(secret, old) == 0
    taken = find_key(stored_key(old)).record
    assert taken.key == KEY
    assert taken.timestamp > 10**15 / 100  # of now, not of then: what was signed before is not heard again
    for slot in SLOTS:
        assert stat.S_IMODE(slot_path(old, SIGNING_FILE, slot).stat().st_mode) == 0o600
    assert not any(KEY.hex() in path.read_text("latin-1") for path in old.iterdir() if SIGNING_FILE not in path.name)


def test_import_without_key_keeps_the_key(exported, tmp_path):
    keyed = fill(tmp_path / "keyed", OLD, OTHER_KEY)
    assert import_it(exported, keyed) == 0
    assert find_key(stored_key(keyed)).record.key == OTHER_KEY


def test_damaged_file_is_refused(exported, old, capsys, tmp_path):
    whole = exported.read_bytes()
    bad = tmp_path / "bad"
    for place in range(0, len(whole), 29):
        bad.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert re.search("damaged|not an exported state|has format", refused(capsys, bad, old))
    for length in (0, 10, 60, len(whole) - 1):
        bad.write_bytes(whole[:length])
        assert re.search("damaged|not an exported state", refused(capsys, bad, old))
    bad.write_bytes(whole + b"\n")
    assert "damaged" in refused(capsys, bad, old)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({MISSION: b"no plan"}, "mission.plan"),
        ({MISSION: to_text(Plan.of(PlanKind.FENCE, ())).encode()}, "it is a fence"),
        ({RESUME_FILE: b"{}"}, "resume.record"),
        ({ENDINGS_FILE: b"[]"}, "endings.record"),
        ({SATELLITE_FILE: b"ledger"}, "satellite.record"),
        ({SIGNING_FILE: b"secret"}, "not a signing key"),
        ({"../passwd": b""}, "not a valid name"),
    ],
)
def test_unusable_content_is_refused(files, words, old, capsys, tmp_path):
    (tmp_path / "bad").write_bytes(pack(Export(files)))
    assert words in refused(capsys, tmp_path / "bad", old)


@pytest.mark.parametrize(("name", "value"), [(MISSION, 7), (ENDINGS_FILE, "no base64!")])
def test_content_that_is_not_text_is_refused(name, value, old, capsys, tmp_path):
    body = json.dumps({"about": {}, "files": {name: value}}).encode()
    head = f"# rambler exported state {FORMAT} {len(body)} {hashlib.sha256(body).hexdigest()}\n"
    (tmp_path / "bad").write_bytes(head.encode() + body)
    assert "is not an exported state of rambler: " in refused(capsys, tmp_path / "bad", old)


def test_newer_format_other_file_and_missing_file_are_refused(exported, old, capsys, tmp_path):
    newer = tmp_path / "newer"
    for number, remedy in ((FORMAT + 1, "use a newer version"), (FORMAT - 1, "export that state with this version")):
        newer.write_bytes(exported.read_bytes().replace(b"state %d " % FORMAT, b"state %d " % number, 1))
        assert f"has format {number}, this version reads {FORMAT}; {remedy}" in refused(capsys, newer, old)
    newer.write_bytes(b"# rambler state 1 0 00000000\n")
    assert "is not an exported state of rambler" in refused(capsys, newer, old)
    assert "No such file" in refused(capsys, tmp_path / "none", old)
    os.mkfifo(tmp_path / "pipe")
    assert "is a pipe" in refused(capsys, tmp_path / "pipe", old)


def test_names_and_parameters_of_another_version_are_reported(old, capsys, tmp_path):
    (tmp_path / "other").write_bytes(pack(Export({"sails.state": b"x", PARAMETER_FILE: b"CTL_K1 5\nNEW_ONE 1\n"})))
    assert import_it(tmp_path / "other", old) == 0
    output = capsys.readouterr().err
    assert "sails.state ignored: written by another version" in output
    assert "kept for another version" in output
    assert contents(old)[PARAMETER_FILE] == b"CTL_K1 5\nNEW_ONE 1\n"


def test_running_autopilot_is_exported_but_not_imported(exported, old, capsys, tmp_path):
    store = Store(old)
    assert "in use by another autopilot" in refused(capsys, exported, old)
    assert main(["state", "export", str(tmp_path / "out"), "--state", str(old)]) == 0
    store.close()
    assert unpack((tmp_path / "out").read_bytes()).content(MISSION) == OLD[MISSION]


def test_damaged_slot_is_reported_and_the_other_exported(new, tmp_path, capsys):
    store = Store(new)
    store.save(MISSION, mission(3))
    store.close()
    path = slot_path(new, MISSION, 1)
    path.write_bytes(path.read_bytes().replace(mission(3), mission(4)))
    assert main(["state", "export", str(tmp_path / "out"), "--state", str(new)]) == 1
    assert "mission.plan.1 is damaged: the other slot is used" in capsys.readouterr().err
    assert unpack((tmp_path / "out").read_bytes()).content(MISSION) == mission(2)


def test_empty_and_missing_directories_are_refused(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    for name, words in (("empty", "contains no state"), ("none", "does not exist")):
        assert main(["state", "export", str(tmp_path / "out"), "--state", str(tmp_path / name)]) == 2
        assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def attempt(exported, before, folder, monkeypatch, failing, capsys):
    """Import on a failing disk; return exit code, output, images of the disk, failed calls and all calls."""
    at, kind, lasting = failing
    shutil.copytree(before, folder / "state")
    with monkeypatch.context() as patches:
        disk = FaultyDisk(folder / "state", patches)
        for path in disk.directory.iterdir():
            disk.named[path.name], disk.durable[path.name] = None, path.read_bytes()
        disk.arm(at, kind, lasting=lasting)
        code = import_it(exported, disk.directory)
        failed, calls = list(disk.failed), disk.count
        shutil.copytree(disk.directory, folder / "killed")
        for pattern in CUTS:
            disk.cut(folder / pattern, pattern)
        disk.arm(None)
    images = []
    for name in ("killed", *CUTS):
        seen = contents(folder / name)
        Store(folder / name).close()
        assert contents(folder / name) == seen, "the next start finds the same as a reader"
        assert not (folder / name / PENDING_IMPORT).exists()
        images.append(seen)
    return code, capsys.readouterr().err, images, failed, calls


FAILINGS = [(kind, lasting) for lasting in (False, True) for kind in KINDS]
EVERY = [pytest.param(*one, True, marks=pytest.mark.proof) for one in FAILINGS]
SAMPLED = [(*one, False) for one in FAILINGS]


@pytest.mark.parametrize(("kind", "lasting", "every"), SAMPLED + EVERY)
def test_import_is_atomic_under_kills_and_errors(exported, old, tmp_path, monkeypatch, capsys, kind, lasting, every):
    before = contents(old)
    well = attempt(exported, old, tmp_path / "well", monkeypatch, (None, kind, False), capsys)
    code, _, (after, *_), _, calls = well
    assert (code, after[MISSION]) == (0, NEW[MISSION])
    outcomes = set()
    for at in itertools.count() if every else sampled(calls, 3, f"{kind} {lasting}"):
        folder = tmp_path / f"{at}"
        code, output, images, failed, _ = attempt(exported, old, folder, monkeypatch, (at, kind, lasting), capsys)
        wanted = [after] if code == 0 or COUNTS in output else [before, after] if DOUBT in output else [before]
        assert all(image in wanted for image in images), (at, failed, output, images)
        outcomes.add(code)
        shutil.rmtree(folder)
        if not failed:
            break
    assert outcomes == {0, 2} or not every


def test_damaged_pending_import_is_set_aside(old):
    (old / PENDING_IMPORT).write_bytes(b"# rambler exported state 2 5 ")
    store = Store(old)
    assert store.start_problem == f"Import not used: {PENDING_IMPORT} is damaged; set aside as {PENDING_IMPORT}.aside"
    assert store.failure == ""
    assert not (old / PENDING_IMPORT).exists()
    assert store.load(MISSION) == OLD[MISSION]
    store.close()


TEXTS = st.text(st.characters(codec="utf-8"), max_size=9).map(str.encode)


@settings(max_examples=15)
@given(
    st.fixed_dictionaries(
        {}, optional={name: st.none() | (st.binary() if name in RECORD_FILES else TEXTS) for name in STATE_NAMES}
    )
)
def test_any_content_round_trip(files):
    assert unpack(pack(Export(files, {"host": "a"}))) == Export(files, {"host": "a"})


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data):
    head = b"# rambler exported state %d " % FORMAT
    for one in (data, head + data):
        with pytest.raises(BrokenExportError):
            unpack(one)
