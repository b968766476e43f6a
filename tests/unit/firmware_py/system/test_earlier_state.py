"""A state directory of an earlier version: its texts are read, its records reported and set aside, and kept whole."""

import itertools
import shutil

import pytest

from firmware_py.__main__ import main
from firmware_py.assemble.stored_state import read_state
from firmware_py.assemble.supervision import read_endings
from firmware_py.assemble.trial import TrialWatch
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import PlanKind
from firmware_py.install.program_link import TRIAL_S, UPDATE_FILE, ProgramLink
from firmware_py.install.update import _has_passed
from firmware_py.system.endings import ENDINGS_FILE, Ending, Endings, from_bytes, to_bytes
from firmware_py.system.slots import examine, stored_content
from firmware_py.system.state_directory import BOOT_COUNT, RECORD_FILES, RESUME_FILE, SATELLITE_FILE
from firmware_py.system.state_export import Export, begin_import
from firmware_py.system.store import Store
from support.faulty_disk import CUTS, KINDS, FaultyDisk
from support.paths import DATA

EARLIER = DATA / "earlier_state"  # of commit e343f391
RECORDS = {path.name: path.read_bytes() for path in EARLIER.glob("*.state.*") if path.name != f"{UPDATE_FILE}.0"}
FORGOTTEN = "message budget reset, earlier messages are ignored"
REPORTS = [
    "resume.state.0 is of another version: not resumed",
    "endings.state.0 is of another version: records of earlier runs are lost",
    f"satellite.state.0 is of another version: {FORGOTTEN}",
]


@pytest.fixture
def directory(tmp_path):
    shutil.copytree(EARLIER, tmp_path / "state")
    return tmp_path / "state"


@pytest.fixture
def link(tmp_path):
    """A link to a new program on trial."""
    for name in ("old", "new"):
        (tmp_path / name / "bin").mkdir(parents=True)
    (tmp_path / "rambler").symlink_to(tmp_path / "old/bin/rambler")
    ProgramLink(tmp_path / "rambler").switch(tmp_path / "new/bin/rambler")
    return ProgramLink(tmp_path / "rambler")


def records_in(directory, ending=""):
    names = {path.name.removesuffix(ending): path for path in directory.iterdir() if path.name.endswith(ending)}
    return {name: path.read_bytes() for name, path in names.items() if name in RECORDS}


def start(directory, link=None, *, run_s=0.0, contents=()):
    """Start, save some records and run for a time; return the reports and what was read of each record."""
    store, reports = Store(directory), []
    kept, plans = read_state(directory, store, reports.append)
    found = {name: store.load(name) for name in RECORD_FILES}
    trial = TrialWatch(link, store, [], lambda _text: None)
    for name, content in dict(contents).items():
        store.save(name, content)
    for t_s in (0.0, run_s):
        trial.update(None, t_s)
    store.close()
    assert len(plans.of(PlanKind.MISSION).items) == 8
    assert kept.parameters_over(ParameterSet())[BOOT_COUNT] >= 3
    return reports, found


NOTHING = dict.fromkeys(RECORD_FILES)
OURS = {name: name.encode() for name in RECORD_FILES}


def test_texts_are_read_and_records_are_reported_and_set_aside(directory):
    assert start(directory, contents=OURS) == (REPORTS, NOTHING)
    assert records_in(directory) == {}
    assert records_in(directory, ".old") == RECORDS
    assert start(directory) == ([], OURS)


def test_preflight_status_and_export_report_them_too(directory, tmp_path, capsys):
    example = tmp_path / "boat.toml"
    assert main(["example", str(example)]) == 0
    main(["check", str(example), "--state", str(directory)])
    output = capsys.readouterr().out
    assert all(text in output for text in REPORTS)
    main(["status", "--state", str(directory)])
    assert "endings.state.0 is of another version" in capsys.readouterr().out
    assert main(["state", "export", str(tmp_path / "out"), "--state", str(directory)]) == 1
    assert "resume.state.0 is of another version" in capsys.readouterr().err
    assert records_in(directory) == RECORDS


def test_on_trial_they_stay_for_the_roll_back(directory, link):
    for _ in range(2):  # what the start before has saved is not read either: the roll-back may have come between
        assert start(directory, link, run_s=TRIAL_S - 1.0, contents=OURS) == (REPORTS, NOTHING)
        assert records_in(directory) == RECORDS
    assert start(directory, link, run_s=TRIAL_S, contents=OURS) == (REPORTS, NOTHING)
    assert records_in(directory, ".old") == RECORDS
    link.end_trial()
    assert start(directory, link) == ([], OURS)


def test_that_a_trial_was_passed_is_read_by_both_versions(directory, link):
    assert stored_content(directory, UPDATE_FILE) == b"passed /opt/rambler-0.1.0/bin/rambler\n"
    start(directory, link, run_s=TRIAL_S)
    assert stored_content(directory, UPDATE_FILE) == f"passed {link.target()}\n".encode()
    assert _has_passed(directory, link.target())


def test_records_of_before_a_roll_back_are_not_read_after_it(directory):
    start(directory, contents=OURS)
    shutil.copytree(EARLIER, directory, dirs_exist_ok=True)  # the earlier version has run
    assert start(directory) == (REPORTS, NOTHING)
    assert start(directory) == ([], NOTHING)  # nothing was saved instead


def test_what_is_imported_counts(directory):
    begin_import(directory, Export({RESUME_FILE: b"imported", ENDINGS_FILE: None}))
    assert examine(directory, RESUME_FILE).content == b"imported"
    reports, found = start(directory)
    assert reports == REPORTS[2:]
    assert found == {**NOTHING, RESUME_FILE: b"imported"}
    assert start(directory) == ([], found)


def test_endings_begin_again(directory):
    store, notices = Store(directory), []
    assert read_endings(store, None, 0.0, notices) == Endings()
    store.close()
    assert notices == []


def image_of(directory):
    return {name: stored_content(directory, name) for name in (RESUME_FILE, SATELLITE_FILE)}


FAULTS = [(kind, lasting) for lasting in (False, True) for kind in KINDS]
QUICK = (("late", False), ("refused", True))


@pytest.mark.parametrize(
    ("kind", "lasting"), [pytest.param(*one, marks=() if one in QUICK else pytest.mark.proof) for one in FAULTS]
)
def test_at_every_failing_call_no_older_record_counts(kind, lasting, tmp_path, monkeypatch):
    """One record is saved at this start, the other is not."""
    monkeypatch.setattr("firmware_py.system.store.RETRY_S", 1000.0)
    for at in itertools.count():
        folder = tmp_path / f"{at}"
        shutil.copytree(EARLIER, folder / "state")
        disk = FaultyDisk(folder / "state", monkeypatch)
        store = Store(disk.directory)
        for name in (RESUME_FILE, SATELLITE_FILE):
            store.save(name, b"older")  # as before a roll-back
        store.close()
        for path in disk.directory.iterdir():
            disk.named[path.name], disk.durable[path.name] = None, path.read_bytes()
        store = Store(disk.directory)
        disk.arm(at, kind, lasting=lasting)
        store.save(RESUME_FILE, b"new")
        store.set_aside(RECORD_FILES)
        store.settle()
        failure, failed = store.failure, list(disk.failed)
        assert "cannot be set aside" in failure or "cannot be stored" in failure or not lasting or not failed
        shutil.copytree(disk.directory, folder / "killed")
        for pattern in CUTS:
            disk.cut(folder / pattern, pattern)
        for image in ("killed", *CUTS):
            found = image_of(folder / image)
            assert found[RESUME_FILE] == b"new" or (failed and found[RESUME_FILE] is None), (failed, image)
            assert found[SATELLITE_FILE] is None, (failed, image)
        disk.arm(None)
        store.close()  # tries again
        assert image_of(disk.directory) == {RESUME_FILE: b"new", SATELLITE_FILE: None}
        assert records_in(disk.directory) == {}
        assert records_in(disk.directory, ".old") == RECORDS
        monkeypatch.undo()
        monkeypatch.setattr("firmware_py.system.store.RETRY_S", 1000.0)
        shutil.rmtree(folder)
        if not failed:
            break
    assert at > 8


def test_endings_are_not_misread():
    with pytest.raises(ValueError, match="early development version"):
        from_bytes(RECORDS["endings.state.0"].split(b"\n", 1)[1])
    assert from_bytes(to_bytes(Endings(last=(Ending("killed"),))))[1] == ()
