"""`rambler service`: files printed, program found, status of systemd; installation: install/test_service_files.py."""

import json
import sys
from pathlib import Path

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import service as command

PROPERTIES = {
    "LoadState": "loaded", "UnitFileState": "enabled", "ActiveState": "active", "SubState": "running",
    "Result": "success", "NRestarts": "2", "MainPID": "7", "StatusText": "HOLD", "ActiveEnterTimestamp": "Mon",
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "code", "text"),
    [
        ({}, 0, "enabled, active (running) since Mon, 2 restarts, last result success\nHOLD\n"),
        ({"ActiveState": "failed", "ActiveEnterTimestamp": "", "StatusText": ""}, 1,
         "enabled, failed (running) since never, 2 restarts, last result success\n"),
        ({"LoadState": "not-found", "ActiveState": "inactive"}, 1, "not installed\n"),
    ],
)  # fmt: skip
def test_status_of_the_service_is_printed_and_sets_the_exit_code(monkeypatch, capsys, changes, code, text):
    values = PROPERTIES | changes
    commands = []

    def run_program(words):
        commands.append(words)
        return "\n".join(f"{name}={value}" for name, value in values.items()) + "\nno property\n"

    monkeypatch.setattr(command, "run_program", run_program)
    assert main(["service", "status"]) == code
    assert capsys.readouterr().out == text
    assert main(["service", "status", "--json"]) == code
    status = json.loads(capsys.readouterr().out)
    assert (status["active"], status["restarts"], status["pid"]) == (values["ActiveState"], "2", "7")
    assert commands[0] == ["systemctl", "show", "rambler", "--property", ",".join(PROPERTIES)]


@pytest.mark.parametrize("name", ["rambler", "other", None])
def test_service_runs_the_program_by_its_name_or_the_module(monkeypatch, capsys, tmp_path, name):
    script = tmp_path / str(name)
    if name is not None:
        script.touch(mode=0o755)
    monkeypatch.setattr(sys, "argv", [str(script)])
    monkeypatch.chdir(tmp_path)
    assert main(["service", "print", "boat.toml", "--state", "state"]) == 0
    program = str(script) if name == "rambler" else f"{sys.executable} -m firmware_py"
    assert f"ExecStart={program} run {tmp_path}/boat.toml --state {tmp_path}/state" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("is_root", "root", "is_refused"), [(False, "/", True), (True, "/", False), (False, ".", False)]
)
def test_only_root_changes_the_system_but_anyone_an_image(monkeypatch, is_root, root, is_refused):
    removed = []
    monkeypatch.setattr(command, "is_root", lambda: is_root)
    monkeypatch.setattr(command, "remove", lambda root, _report: removed.append(root))
    assert main(["service", "remove", "--root", root]) == (2 if is_refused else 0)
    assert removed == ([] if is_refused else [Path(root)])
