"""The link to the installed program, trials and roll-backs by the start script of the service."""

import subprocess

import pytest

from firmware_py.install.program_link import UPDATE_FILE, ProgramLink, Trial, passed_line
from firmware_py.install.service_files import build_trial_script
from firmware_py.system.store import Store

STARTS = 3


@pytest.fixture
def directory(tmp_path):
    for name in ("old", "new", "newer"):
        (tmp_path / name / "bin").mkdir(parents=True)
        (tmp_path / name / "bin/rambler").touch()
    (tmp_path / "bin").mkdir()
    (tmp_path / "state").mkdir()
    (tmp_path / "bin/rambler").symlink_to(tmp_path / "old/bin/rambler")
    (tmp_path / "trial").write_text(build_trial_script())
    return tmp_path


@pytest.fixture
def link(directory):
    return ProgramLink(directory / "bin/rambler")


@pytest.fixture
def start(directory):
    """Run the start script; return the installed program and the output."""

    def run_script():
        command = ["/bin/sh", str(directory / "trial"), str(directory / "bin/rambler"), str(directory / "state")]
        result = subprocess.run(command, capture_output=True, text=True, check=True)
        assert result.stderr == ""
        return (directory / "bin/rambler").resolve().parents[1].name, result.stdout

    return run_script


def program(directory, name):
    return directory / name / "bin/rambler"


def save_passed(directory, text):
    store = Store(directory / "state")
    store.save(UPDATE_FILE, text.encode())
    store.close()


def test_start_without_trial_changes_nothing(link, directory, start):
    assert start() == ("old", "")
    assert (link.target(), link.previous(), link.trial(), link.failed()) == (
        program(directory, "old"),
        None,
        None,
        None,
    )
    assert [path.name for path in (directory / "bin").iterdir()] == ["rambler"]


def test_failed_trial_is_rolled_back_after_its_starts(link, directory, start):
    link.switch(program(directory, "new"))
    assert (link.target(), link.previous()) == (program(directory, "new"), program(directory, "old"))
    for count in range(1, STARTS + 1):
        assert start() == ("new", "")
        assert link.trial() == Trial(program(directory, "new"), count)
    installed, output = start()
    assert installed == "old"
    assert f"has had {STARTS} starts" in output
    assert (link.trial(), link.previous()) == (None, None)
    assert link.failed() == Trial(program(directory, "new"), STARTS)
    assert link.failed().name == "new"
    (directory / "bin/.rambler.failed").write_text(f"{program(directory, 'new')}".ljust((1 << 16) + 1))
    assert link.failed() is None  # not written by the start script
    (directory / "bin/.rambler.failed").unlink()
    (directory / "copy").write_text(f"{program(directory, 'new')}\n")
    (directory / "bin/.rambler.failed").symlink_to(directory / "copy")
    assert link.failed() is None
    assert start() == ("old", "")


def test_passed_program_stays(link, directory, start):
    link.switch(program(directory, "new"))
    start()
    save_passed(directory, passed_line(program(directory, "new")))
    for _ in range(2 * STARTS):
        assert start() == ("new", "")
    assert (link.trial(), link.failed(), link.previous()) == (None, None, program(directory, "old"))


def test_passed_trial_of_another_program_does_not_count(link, directory, start):
    save_passed(directory, passed_line(program(directory, "newer")))
    save_passed(directory, passed_line(program(directory, "new") / "x"))
    save_passed(directory, "passed " + str(program(directory, "ne")) + "\n")
    link.switch(program(directory, "new"))
    assert [start()[0] for _ in range(STARTS + 1)] == ["new"] * STARTS + ["old"]


def test_next_switch_ends_the_earlier_trial(link, directory, start):
    link.switch(program(directory, "new"))
    for _ in range(STARTS + 1):
        start()
    link.switch(program(directory, "newer"))
    assert (link.failed(), link.trial()) == (None, Trial(program(directory, "newer"), 0))
    assert [start()[0] for _ in range(STARTS + 1)] == ["newer"] * STARTS + ["old"]


def test_switch_back_makes_the_new_program_the_previous_one(link, directory, start):
    link.switch(program(directory, "new"))
    link.end_trial()
    link.switch(link.previous())
    assert (link.target(), link.previous()) == (program(directory, "old"), program(directory, "new"))
    assert start()[0] == "old"


def test_trial_of_another_program_is_dropped(link, directory, start):
    """A switch was interrupted before its rename, or the link was changed."""
    link.switch(program(directory, "new"))
    (directory / "bin/rambler").unlink()
    (directory / "bin/rambler").symlink_to(program(directory, "newer"))
    assert link.trial() is None
    assert start() == ("newer", "")
    assert not (directory / "bin/.rambler.trial").exists()


@pytest.mark.parametrize("content", [b"", b"\n", b"nonsense", b"\0\0\0", b"/somewhere/else\n"])
def test_invalid_trial_record_is_dropped(link, directory, start, content):
    link.switch(program(directory, "new"))
    (directory / "bin/.rambler.trial").write_bytes(content)
    assert link.trial() is None
    assert [start()[0] for _ in range(2 * STARTS)] == ["new"] * (2 * STARTS)


def test_no_roll_back_without_previous_program(link, directory, start):
    link.switch(program(directory, "new"))
    (directory / "bin/.rambler.before").unlink()
    assert [start()[0] for _ in range(2 * STARTS)] == ["new"] * (2 * STARTS)


def test_an_invalid_state_does_not_delay_the_start(link, directory, start):
    link.switch(program(directory, "new"))
    (directory / "state" / f"{UPDATE_FILE}.0").mkdir()
    (directory / "state" / f"{UPDATE_FILE}.1").symlink_to("/dev/zero")
    assert [start()[0] for _ in range(STARTS + 1)] == ["new"] * STARTS + ["old"]


def test_names_with_spaces_work(tmp_path):
    (bin_directory := tmp_path / "a place").mkdir()
    for name in ("old one", "new one"):
        (tmp_path / name / "bin").mkdir(parents=True)
    link = ProgramLink(bin_directory / "rambler")
    link.path.symlink_to(tmp_path / "old one/bin/rambler")
    link.switch(tmp_path / "new one/bin/rambler")
    (tmp_path / "trial").write_text(build_trial_script())
    for _ in range(STARTS + 1):
        command = ["/bin/sh", str(tmp_path / "trial"), str(link.path), str(tmp_path)]
        subprocess.run(command, check=True, capture_output=True)
    assert link.target() == tmp_path / "old one/bin/rambler"


def test_only_a_link_can_be_switched(directory):
    with pytest.raises(FileNotFoundError, match=r"\[Errno 2\] is not a link"):
        ProgramLink(directory / "nothing").switch(program(directory, "new"))
