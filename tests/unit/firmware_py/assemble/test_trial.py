"""A version on trial says so, and has passed once it has sailed long enough; one that was taken back is told."""

import pytest

from firmware_py.assemble.trial import TrialWatch, link_of
from firmware_py.install.program_link import TRIAL_S, UPDATE_FILE, ProgramLink, passed_text
from firmware_py.system.store import Store


@pytest.fixture
def link(tmp_path):
    for name in ("old", "new"):
        (tmp_path / name / "bin").mkdir(parents=True)
    (tmp_path / "rambler").symlink_to(tmp_path / "old/bin/rambler")
    return ProgramLink(tmp_path / "rambler")


@pytest.fixture
def store(tmp_path):
    kept = Store(tmp_path / "state")
    yield kept
    kept.close()


def watch(link, store):
    said, notices = [], []
    made = TrialWatch(link, store, notices, said.append)
    assert [event.text for event in notices] == said
    return made, said, notices


def test_nothing_is_said_where_nothing_was_switched(link, store):
    for one in (link, None):
        made, said, _ = watch(one, store)
        made.update(None, 0.0)
        made.update(None, 10.0 * TRIAL_S)
        assert (made.text, said) == ("", [])
    store.settle()
    assert store.load(UPDATE_FILE) is None


def test_it_has_passed_when_it_has_sailed_long_enough(link, store, tmp_path):
    link.switch(program := tmp_path / "new/bin/rambler")
    (tmp_path / ".rambler.trial").write_text(f"{program}\nstart\nstart\n")
    made, said, notices = watch(link, store)
    assert made.text == "On trial: new, start 2 of 3"
    for now_s in (5.0, 4.9 + TRIAL_S):
        made.update(None, now_s)
    assert len(said) == 1
    made.update(None, 5.0 + TRIAL_S)
    made.update(None, 6.0 + TRIAL_S)
    assert said[1:] == [made.text] == ["Trial passed: new"]
    assert [event.text for event in notices] == said
    store.settle()
    assert store.load(UPDATE_FILE) == passed_text(program).encode()


def test_one_that_was_taken_back_is_told(link, store, tmp_path):
    (tmp_path / ".rambler.failed").write_text(f"{tmp_path}/new/bin/rambler\nstart\nstart\nstart\n")
    assert watch(link, store)[0].text == "Update rolled back: new failed 3 starts"


def test_a_program_that_was_not_started_by_a_link_has_no_trial(tmp_path, link):
    (tmp_path / "plain").touch()
    assert link_of(str(tmp_path / "plain")) is None
    assert link_of("rambler") is None
    assert link_of(str(link.path)).path == link.path
