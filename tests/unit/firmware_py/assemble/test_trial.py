"""Trial of an update: reports, success after the running time, roll-back."""

import pytest

from firmware_py.assemble.trial import TrialWatch, find_program_link
from firmware_py.install.program_link import UPDATE_FILE, ProgramLink, passed_line
from firmware_py.system.state_directory import RECORD_FILES
from firmware_py.system.store import Store

TRIAL_S = 120.0


@pytest.fixture
def link(tmp_path):
    for name in ("old", "new"):
        (tmp_path / name / "bin").mkdir(parents=True)
    (tmp_path / "rambler").symlink_to(tmp_path / "old/bin/rambler")
    return ProgramLink(tmp_path / "rambler")


@pytest.fixture
def store(tmp_path):
    store = Store(tmp_path / "state")
    yield store
    store.close()


def watch(link, store):
    texts, notices = [], []
    trial = TrialWatch(link, store, notices, texts.append)
    assert [event.text for event in notices] == texts
    return trial, texts, notices


def test_no_report_without_a_trial(link, store, monkeypatch):
    records = []
    monkeypatch.setattr(store, "set_aside", records.append)
    for program_link in (link, None):
        trial, texts, _ = watch(program_link, store)
        trial.update(None, 0.0)
        trial.update(None, 10.0 * TRIAL_S)
        assert (trial.text, texts) == ("", [])
    assert records == [RECORD_FILES] * 2
    store.settle()
    assert store.load(UPDATE_FILE) is None


def test_trial_passes_after_its_running_time(link, store, tmp_path, monkeypatch):
    records = []
    monkeypatch.setattr(store, "set_aside", records.append)
    link.switch(program := tmp_path / "new/bin/rambler")
    (tmp_path / ".rambler.trial").write_text(f"{program}\nstart\nstart\n")
    trial, texts, notices = watch(link, store)
    assert trial.text == "On trial: new, start 2 of 3"
    for now_s in (5.0, 4.9 + TRIAL_S):
        trial.update(None, now_s)
    assert (len(texts), records) == (1, [])  # the previous version may need its records again
    trial.update(None, 5.0 + TRIAL_S)
    assert records == [RECORD_FILES]
    trial.update(None, 6.0 + TRIAL_S)
    assert texts[1:] == [trial.text] == ["Trial passed: new"]
    assert [event.text for event in notices] == texts
    store.settle()
    assert store.load(UPDATE_FILE) == passed_line(program).encode()


def test_roll_back_is_reported(link, store, tmp_path):
    (tmp_path / ".rambler.failed").write_text(f"{tmp_path}/new/bin/rambler\nstart\nstart\nstart\n")
    assert watch(link, store)[0].text == "Update rolled back: new failed 3 starts"


def test_program_without_a_link_has_no_trial(tmp_path, link):
    (tmp_path / "plain").touch()
    assert find_program_link(str(tmp_path / "plain")) is None
    assert find_program_link("rambler") is None
    assert find_program_link(str(link.path)).path == link.path
