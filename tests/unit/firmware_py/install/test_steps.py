"""Installation on this computer: commands, errors of system programs, and files that the service cannot read."""

import subprocess
from pathlib import Path

import pytest

from firmware_py.install import steps
from firmware_py.install.service_files import Service, service_files
from firmware_py.install.steps import InstallError, install, remove, run_program

SERVICE = Service(("/opt/rambler/x",), Path("/etc/rambler/boat.toml"))


@pytest.fixture
def computer(tmp_path, monkeypatch):
    """Let the files of this computer be in a folder; return the folder and the commands."""
    commands = []
    monkeypatch.setattr(steps, "_path_in_root", lambda _root, path: tmp_path / path.relative_to("/"))
    monkeypatch.setattr(steps, "run_program", commands.append)
    monkeypatch.setattr(steps.shutil, "which", lambda name: None if name == "udevadm" else name)
    return tmp_path, commands


def test_installation_and_removal_call_the_programs_of_systemd(computer):
    folder, commands = computer
    lines = []
    install(SERVICE, Path("/"), lines.append)
    assert commands == [
        ["systemd-sysusers"],
        ["systemd-tmpfiles", "--create", "/etc/tmpfiles.d/rambler.conf"],
        ["systemctl", "daemon-reload"],
        ["systemctl", "--quiet", "enable", "rambler"],
    ]
    paths = [file.path for file in service_files(SERVICE)]
    assert lines == [f"wrote {path}" for path in paths]
    assert all((folder / path.relative_to("/")).is_file() for path in paths)
    commands.clear()
    lines.clear()
    remove(Path("/"), lines.append)
    assert commands == [["systemctl", "--quiet", "disable", "--now", "rambler"], ["systemctl", "daemon-reload"]]
    assert sorted(lines[:-1]) == sorted(f"removed {path}" for path in paths)
    assert lines[-1].startswith("kept: ")


@pytest.mark.parametrize(("has_program", "is_running"), [(True, True), (True, False), (False, True)])
def test_udev_reads_its_rules_again_if_it_runs(computer, monkeypatch, has_program, is_running):
    folder, commands = computer
    monkeypatch.setattr(steps.shutil, "which", lambda name: name if has_program else None)
    monkeypatch.setattr(steps, "_UDEV_CONTROL", folder if is_running else folder / "none")
    install(SERVICE, Path("/"), lambda _line: None)
    trigger = ["udevadm", "trigger", "--subsystem-match=tty", "--subsystem-match=watchdog"]
    expected = [["udevadm", "control", "--reload"], trigger] if has_program and is_running else []
    assert [command for command in commands if command[0] == "udevadm"] == expected


def test_program_that_hangs_is_ended_after_two_minutes(monkeypatch):
    def run(command, *, timeout, **_options):
        raise subprocess.TimeoutExpired(command, timeout)

    monkeypatch.setattr(steps.subprocess, "run", run)
    with pytest.raises(InstallError, match="timed out after 120"):
        run_program(["systemctl"])


def test_failed_program_is_an_error_with_its_last_line():
    assert run_program(["echo", "text"]) == "text\n"
    for command, text in (
        (["false"], "false: exit code 1"),
        (["sh", "-c", "echo one; echo two; exit 3"], "two"),
        (["sh", "-c", "echo out; echo err >&2; exit 3"], "err"),
        (["/no/such/program"], "not found; the service needs systemd"),
    ):
        with pytest.raises(InstallError, match=f"{text}$"):
            run_program(command)


def test_first_part_of_a_path_that_other_users_cannot_read_is_found(tmp_path):
    folder = tmp_path / "a/b"
    folder.mkdir(parents=True)
    file = folder / "boat.toml"
    file.touch()
    file.chmod(0o640)
    assert steps._find_unreadable_part(file) == file
    file.chmod(0o644)
    folder.chmod(0o754)  # readable, but it cannot be entered
    assert steps._find_unreadable_part(file) == folder
    folder.chmod(0o711)
    (tmp_path / "a").chmod(0o750)
    assert steps._find_unreadable_part(file) == tmp_path / "a"
    assert steps._find_unreadable_part(folder / "none") == folder / "none"
    assert steps._find_unreadable_part(Path("/usr")) is None


@pytest.mark.parametrize(
    ("error", "root", "remedy"),
    [
        (PermissionError(13, "Permission denied"), "/", "run it as root"),
        (OSError(30, "Read-only file system"), "/", "make it writable"),
        (OSError(30, "Read-only file system"), "/image", "use another --root"),
    ],
)
def test_file_that_cannot_be_written_has_a_remedy(computer, monkeypatch, error, root, remedy):
    def fail(*_arguments, **_options):
        raise error

    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(InstallError, match=remedy):
        install(SERVICE, Path(root), lambda _line: None)
