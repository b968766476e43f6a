"""State directories of an earlier version: texts are read; records are reported and renamed, but not changed."""

import itertools
import shutil

import pytest

from firmware_py.__main__ import main
from firmware_py.assemble.stored_state import read_state
from firmware_py.assemble.supervision import read_endings
from firmware_py.assemble.trial import TrialWatch
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import PlanKind
from firmware_py.install.program_link import UPDATE_FILE, ProgramLink
from firmware_py.install.update import _has_passed
from firmware_py.system.endings import ENDINGS_FILE, Ending, Endings, from_bytes, to_bytes
from firmware_py.system.slots import examine, read_content
from firmware_py.system.state_directory import BOOT_COUNT, RECORD_FILES, RESUME_FILE, SATELLITE_FILE
from firmware_py.system.state_export import Export, begin_import
from firmware_py.system.store import Store
from support.faulty_disk import CUTS, KINDS, FaultyDisk
from support.paths import DATA

TRIAL_S = 120.0

EARLIER = DATA / "earlier_state"  # of commit e343f391
RECORDS = {path.name: path.read_bytes() for path in EARLIER.glob("*.state.*") if path.name != f"{UPDATE_FILE}.0"}
REPORTS = [
    "resume.state.0 is of another version: not resumed",
    "endings.state.0 is of another version: records of earlier runs are lost",
    "satellite.state.0 is of another version: message budget reset, earlier messages are ignored",
]
NO_CONTENTS = dict.fromkeys(RECORD_FILES)
NEW_CONTENTS = {name: name.encode() for name in RECORD_FILES}


@pytest.fixture
def directory(tmp_path):
    shutil.copytree(EARLIER, tmp_path / "state")
    return tmp_path / "state"


@pytest.fixture
def link(tmp_path):
    """Return a link to a new program on trial."""
    for name in ("old", "new"):
        (tmp_path / name / "bin").mkdir(parents=True)
    (tmp_path / "rambler").symlink_to(tmp_path / "old/bin/rambler")
    ProgramLink(tmp_path / "rambler").switch(tmp_path / "new/bin/rambler")
    return ProgramLink(tmp_path / "rambler")


def earlier_records(directory, suffix=""):
    names = {path.name.removesuffix(suffix): path for path in directory.iterdir() if path.name.endswith(suffix)}
    return {name: path.read_bytes() for name, path in names.items() if name in RECORDS}


def run(directory, link=None, *, run_s=0.0, contents=()):
    """Start, save some records and run for a time; return the reports and the content of each record at the start."""
    store, reports = Store(directory), []
    state_directory, plans = read_state(directory, store, reports.append)
    loaded = {name: store.load(name) for name in RECORD_FILES}
    trial = TrialWatch(link, store, [], lambda _text: None)
    for name, content in dict(contents).items():
        store.save(name, content)
    for t_s in (0.0, run_s):
        trial.update(None, t_s)
    store.close()
    assert len(plans.of(PlanKind.MISSION).items) == 8
    assert state_directory.apply_parameters(ParameterSet())[BOOT_COUNT] >= 3
    return reports, loaded


def test_texts_are_read_and_records_are_reported_and_renamed(directory):
    assert run(directory, contents=NEW_CONTENTS) == (REPORTS, NO_CONTENTS)
    assert earlier_records(directory) == {}
    assert earlier_records(directory, ".old") == RECORDS
    assert run(directory) == ([], NEW_CONTENTS)


def test_check_status_and_export_report_the_records(directory, tmp_path, capsys):
    example = tmp_path / "boat.toml"
    assert main(["example", str(example)]) == 0
    main(["check", str(example), "--state", str(directory)])
    output = capsys.readouterr().out
    assert all(report in output for report in REPORTS)
    main(["status", "--state", str(directory)])
    assert "endings.state.0 is of another version" in capsys.readouterr().out
    assert main(["state", "export", str(tmp_path / "out"), "--state", str(directory)]) == 1
    assert "resume.state.0 is of another version" in capsys.readouterr().err
    assert earlier_records(directory) == RECORDS


def test_during_a_trial_the_records_stay_for_the_roll_back(directory, link):
    for _ in range(2):  # records of the previous start are not read: a roll-back may have happened in between
        assert run(directory, link, run_s=TRIAL_S - 1.0, contents=NEW_CONTENTS) == (REPORTS, NO_CONTENTS)
        assert earlier_records(directory) == RECORDS
    assert run(directory, link, run_s=TRIAL_S, contents=NEW_CONTENTS) == (REPORTS, NO_CONTENTS)
    assert earlier_records(directory, ".old") == RECORDS
    link.end_trial()
    assert run(directory, link) == ([], NEW_CONTENTS)


def test_both_versions_read_that_a_trial_was_passed(directory, link):
    assert read_content(directory, UPDATE_FILE) == b"passed /opt/rambler-0.1.0/bin/rambler\n"
    run(directory, link, run_s=TRIAL_S)
    assert read_content(directory, UPDATE_FILE) == f"passed {link.target()}\n".encode()
    assert _has_passed(directory, link.target())


def test_records_from_before_a_roll_back_are_not_read_after_it(directory):
    run(directory, contents=NEW_CONTENTS)
    shutil.copytree(EARLIER, directory, dirs_exist_ok=True)  # the earlier version has run
    assert run(directory) == (REPORTS, NO_CONTENTS)
    assert run(directory) == ([], NO_CONTENTS)


def test_imported_records_are_read(directory):
    begin_import(directory, Export({RESUME_FILE: b"imported", ENDINGS_FILE: None}))
    assert examine(directory, RESUME_FILE).content == b"imported"
    loaded = {**NO_CONTENTS, RESUME_FILE: b"imported"}
    assert run(directory) == (REPORTS[2:], loaded)
    assert run(directory) == ([], loaded)


def test_earlier_endings_are_refused_and_a_new_record_starts(directory):
    with pytest.raises(ValueError, match="early development version"):
        from_bytes(RECORDS["endings.state.0"].split(b"\n", 1)[1])
    assert from_bytes(to_bytes(Endings(last=(Ending("killed"),))))[1] == ()
    store, notices = Store(directory), []
    assert read_endings(store, None, 0.0, notices) == Endings()
    store.close()
    assert notices == []


def saved_records(directory):
    return {name: read_content(directory, name) for name in (RESUME_FILE, SATELLITE_FILE)}


FAULTS = [(kind, lasting) for lasting in (False, True) for kind in KINDS]
QUICK = (("late", False), ("refused", True))


@pytest.mark.parametrize(
    ("kind", "lasting"), [pytest.param(*fault, marks=() if fault in QUICK else pytest.mark.proof) for fault in FAULTS]
)
def test_after_a_failed_call_no_older_record_is_read(kind, lasting, tmp_path, monkeypatch):
    """Of two records from before a roll-back, this start saves one."""
    for at in itertools.count():
        folder = tmp_path / f"{at}"
        shutil.copytree(EARLIER, folder / "state")
        with monkeypatch.context() as patches:
            patches.setattr("firmware_py.system.store.RETRY_S", 1000.0)
            disk = FaultyDisk(folder / "state", patches)
            store = Store(disk.directory)
            for name in (RESUME_FILE, SATELLITE_FILE):
                store.save(name, b"older")
            store.close()
            for path in disk.directory.iterdir():
                disk.names[path.name], disk.durable[path.name] = None, path.read_bytes()
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
                records = saved_records(folder / image)
                assert records[RESUME_FILE] == b"new" or (failed and records[RESUME_FILE] is None), (failed, image)
                assert records[SATELLITE_FILE] is None, (failed, image)
            disk.arm(None)
            store.close()  # retries
        assert saved_records(disk.directory) == {RESUME_FILE: b"new", SATELLITE_FILE: None}
        assert earlier_records(disk.directory) == {}
        assert earlier_records(disk.directory, ".old") == RECORDS
        shutil.rmtree(folder)
        if not failed:
            break
    assert at > 8
