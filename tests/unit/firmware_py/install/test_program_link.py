"""The link to the installed program, trials and roll-backs by the start script of the service."""

import subprocess

import pytest

from firmware_py.install.program_link import STARTS, UPDATE_FILE, ProgramLink, Trial, passed_text
from firmware_py.install.service_files import trial_text
from firmware_py.system.store import Store


@pytest.fixture
def place(tmp_path):
    for name in ("old", "new", "newer"):
        (tmp_path / name / "bin").mkdir(parents=True)
        (tmp_path / name / "bin/rambler").touch()
    (tmp_path / "bin").mkdir()
    (tmp_path / "state").mkdir()
    (tmp_path / "bin/rambler").symlink_to(tmp_path / "old/bin/rambler")
    (tmp_path / "trial").write_text(trial_text())
    return tmp_path


@pytest.fixture
def link(place):
    return ProgramLink(place / "bin/rambler")


@pytest.fixture
def start(place):
    """Run the start script; return the installed program and the output."""

    def started():
        words = ["/bin/sh", str(place / "trial"), str(place / "bin/rambler"), str(place / "state")]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return (place / "bin/rambler").resolve().parents[1].name, done.stdout

    return started


def program(place, name):
    return place / name / "bin/rambler"


def keep_passed(place, text):
    store = Store(place / "state")
    store.save(UPDATE_FILE, text.encode())
    store.close()


def test_start_without_trial_changes_nothing(link, place, start):
    assert start() == ("old", "")
    assert (link.target(), link.before(), link.trial(), link.failed()) == (program(place, "old"), None, None, None)
    assert [path.name for path in (place / "bin").iterdir()] == ["rambler"]


def test_failed_trial_is_rolled_back_after_its_starts(link, place, start):
    link.switch(program(place, "new"))
    assert (link.target(), link.before()) == (program(place, "new"), program(place, "old"))
    for count in range(1, STARTS + 1):
        assert start() == ("new", "")
        assert link.trial() == Trial(program(place, "new"), count)
    in_force, output = start()
    assert in_force == "old"
    assert f"has had {STARTS} starts" in output
    assert (link.trial(), link.before()) == (None, None)
    assert link.failed() == Trial(program(place, "new"), STARTS)
    assert link.failed().name == "new"
    assert start() == ("old", "")


def test_passed_program_stays(link, place, start):
    link.switch(program(place, "new"))
    start()
    keep_passed(place, passed_text(program(place, "new")))
    for _ in range(2 * STARTS):
        assert start() == ("new", "")
    assert (link.trial(), link.failed(), link.before()) == (None, None, program(place, "old"))


def test_passed_trial_of_another_program_does_not_count(link, place, start):
    keep_passed(place, passed_text(program(place, "newer")))
    keep_passed(place, passed_text(program(place, "new") / "x"))
    keep_passed(place, "passed " + str(program(place, "ne")) + "\n")
    link.switch(program(place, "new"))
    assert [start()[0] for _ in range(STARTS + 1)] == ["new"] * STARTS + ["old"]


def test_next_switch_ends_the_earlier_trial(link, place, start):
    link.switch(program(place, "new"))
    for _ in range(STARTS + 1):
        start()
    link.switch(program(place, "newer"))
    assert (link.failed(), link.trial()) == (None, Trial(program(place, "newer"), 0))
    assert [start()[0] for _ in range(STARTS + 1)] == ["newer"] * STARTS + ["old"]


def test_switch_forward_and_back(link, place, start):
    link.switch(program(place, "new"))
    link.end_trial()
    link.switch(link.before())
    assert (link.target(), link.before()) == (program(place, "old"), program(place, "new"))
    assert start()[0] == "old"


def test_trial_of_another_program_is_dropped(link, place, start):
    """The switch was interrupted before its rename, or the link was changed."""
    link.switch(program(place, "new"))
    (place / "bin/rambler").unlink()
    (place / "bin/rambler").symlink_to(program(place, "newer"))
    assert link.trial() is None
    assert start() == ("newer", "")
    assert not (place / "bin/.rambler.trial").exists()


@pytest.mark.parametrize("content", [b"", b"\n", b"nonsense", b"\0\0\0", b"/somewhere/else\n"])
def test_invalid_trial_record_is_dropped(link, place, start, content):
    link.switch(program(place, "new"))
    (place / "bin/.rambler.trial").write_bytes(content)
    assert link.trial() is None
    assert [start()[0] for _ in range(2 * STARTS)] == ["new"] * (2 * STARTS)


def test_no_roll_back_without_previous_program(link, place, start):
    link.switch(program(place, "new"))
    (place / "bin/.rambler.before").unlink()
    assert [start()[0] for _ in range(2 * STARTS)] == ["new"] * (2 * STARTS)


def test_missing_or_odd_state_does_not_delay_the_start(link, place, start):
    link.switch(program(place, "new"))
    (place / "state" / f"{UPDATE_FILE}.0").mkdir()
    (place / "state" / f"{UPDATE_FILE}.1").symlink_to("/dev/zero")
    assert [start()[0] for _ in range(STARTS + 1)] == ["new"] * STARTS + ["old"]


def test_names_with_spaces_work(tmp_path):
    (bin_directory := tmp_path / "a place").mkdir()
    for name in ("old one", "new one"):
        (tmp_path / name / "bin").mkdir(parents=True)
    link = ProgramLink(bin_directory / "rambler")
    link.path.symlink_to(tmp_path / "old one/bin/rambler")
    link.switch(tmp_path / "new one/bin/rambler")
    (tmp_path / "trial").write_text(trial_text())
    for _ in range(STARTS + 1):
        subprocess.run(
            ["/bin/sh", str(tmp_path / "trial"), str(link.path), str(tmp_path)], check=True, capture_output=True
        )
    assert link.target() == tmp_path / "old one/bin/rambler"


def test_only_a_link_can_be_switched(place):
    with pytest.raises(FileNotFoundError):
        ProgramLink(place / "nothing").switch(program(place, "new"))
