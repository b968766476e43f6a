"""Location and owner of the state directory."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import preflight
from firmware_py.cli.state_owner import state_directory_of
from firmware_py.install.service_files import Service, build_unit
from firmware_py.vehicle import load
from support.paths import ROOT

EXAMPLE = ROOT / "params/shared_port_volz.toml"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A home directory, a service with boat.toml, a link to boat.toml, and another vehicle file."""
    monkeypatch.setattr("firmware_py.cli.state_owner.UNIT", tmp_path / "rambler.service")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))
    for name in ("boat.toml", "other.toml"):
        (tmp_path / name).write_bytes(EXAMPLE.read_bytes())
    (tmp_path / "link.toml").symlink_to("boat.toml")
    service = Service((str(tmp_path / "bin/rambler"),), tmp_path / "boat.toml", Path("/srv/boat"))
    (tmp_path / "rambler.service").write_text(build_unit(service))
    return tmp_path


@pytest.mark.parametrize(("name", "is_of_service"), [("boat.toml", True), ("link.toml", True), ("other.toml", False)])
def test_state_directory_is_that_of_the_service_with_the_same_vehicle_file(folder, name, is_of_service):
    directory = state_directory_of(folder / name, load(EXAMPLE))
    assert (directory == Path("/srv/boat")) == is_of_service
    assert (folder / "home" in directory.parents) != is_of_service


def test_state_directory_without_service_is_that_of_the_user(folder):
    (folder / "rambler.service").unlink()
    assert folder / "home" in state_directory_of(folder / "boat.toml", load(EXAMPLE)).parents


def test_unreadable_state_is_a_permission_failure_not_a_lost_key(tmp_path, monkeypatch):
    monkeypatch.setattr(preflight.os, "access", lambda *_: False)
    (finding,) = preflight.check_state(tmp_path)
    assert (finding.level, "(sudo)" in finding.text) == (preflight.Level.FAIL, True)


@pytest.mark.parametrize(
    "words",
    [("plan", "show"), ("plan", "save", "OUT.plan"), ("state", "export", "OUT.state")],
    ids=lambda words: words[1],
)
def test_unreadable_state_is_refused_and_nothing_is_written(tmp_path, monkeypatch, capsys, words):
    monkeypatch.setattr("firmware_py.cli.state_owner.os.access", lambda *_: False)
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--state", str(tmp_path)]) == 2
    output = capsys.readouterr()
    assert "permission denied; run this as user" in output.err
    assert (output.err.count("\n"), output.out) == (1, "")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [("plan", "load"), ("state", "import")], ids=lambda words: words[0])
def test_only_the_owner_changes_the_state(tmp_path, monkeypatch, capsys, words):
    (tmp_path / "state").mkdir()
    file = tmp_path / "a.waypoints"
    file.write_text("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36\t121\t0\t1\n")
    monkeypatch.setattr("firmware_py.cli.state_owner.os.geteuid", lambda: 54321)
    assert main([*words, str(file), "--state", str(tmp_path / "state")]) == 2
    assert "run this as that user" in capsys.readouterr().err
    assert list((tmp_path / "state").iterdir()) == []


def test_damage_is_reported_once(tmp_path, capsys):
    (tmp_path / "mission.plan.0").write_text("spoilt")
    assert main(["plan", "show", "--state", str(tmp_path)]) == 0
    assert capsys.readouterr().err.count("no plan remains") == 1


def test_files_of_another_user_fail_the_check(tmp_path, monkeypatch):
    """Root leaves such files if it runs the autopilot by hand on the state of the service."""
    foreign_names, lstat = ["parameters.param.0", "00000001.BIN", "lost+found"], Path.lstat
    (tmp_path / "logs/thin").mkdir(parents=True)
    for name in ("parameters.param.0", "resume.state.0", "lost+found", "logs/00000001.BIN", "logs/thin/00000002.BIN"):
        (tmp_path / name).touch()
    assert "chown" not in str(list(preflight.check_state(tmp_path)))
    monkeypatch.setattr(
        Path, "lstat", lambda self: SimpleNamespace(st_uid=1) if self.name in foreign_names else lstat(self)
    )
    finding, *_ = preflight.check_state(tmp_path)
    assert finding.level is preflight.Level.FAIL
    assert f"{tmp_path / 'parameters.param.0'} and 1 more owned by user" in finding.text
    foreign_names[:] = ["lost+found"]
    assert "chown" not in str(list(preflight.check_state(tmp_path)))
