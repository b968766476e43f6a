"""The command line of `rambler-hil run`."""

import argparse
import contextlib
import itertools
import math
from dataclasses import replace
from pathlib import Path

import pytest

from hil.__main__ import main
from hil.cli import run as command
from hil.errors import UsageError
from hil.ship.disturbance_options import text_of
from hil.ship.disturbances import NO_DISTURBANCES
from hil.sim import run_directory
from hil.sim.goals import Goal
from hil.sim.logbook import recorded_run
from hil.sim.run_directory import prepare_directory, remove_earlier


def options(*words):
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return command.read_options(parser.parse_args([*words, "--out", "unused"]))


def test_defaults():
    found = options("tank")
    assert found.goals == (Goal(0.0, 0.0), Goal(120.0, 60.0), Goal(720.0, -90.0))
    assert (found.seconds, found.seed, found.speed) == (1320.0, 1, None)
    assert (found.vehicle.compass.driver, found.vehicle.rudder.driver) == ("nmea", "dynamixel")
    assert not found.lockstep


def test_options():
    found = options(
        *("sea", "--speed", "20", "--seed", "7", "--goal", "0:10,5:-20", "--compass", "pni", "--servo", "volz"),
        *("--link", "udpout:127.0.0.1:1", "tcpin:127.0.0.1:2", "--link", "udpin:0.0.0.0:3", "--set", "CTL_K1=30"),
    )
    assert found.speed == 20.0
    assert found.seconds == 305.0
    assert found.links == ("udpout:127.0.0.1:1", "tcpin:127.0.0.1:2", "udpin:0.0.0.0:3")
    assert found.settings == {"CTL_K1": 30.0}
    assert (found.vehicle.compass.driver, found.vehicle.rudder.driver) == ("pni_tcm", "volz")
    assert options("calm", "--speed", "max").speed == math.inf


def test_disturbances():
    found = options("swell", "--with", "float=0.3:0.6,leeway=8", "--with", "sway").scenario
    assert text_of(found.disturbances) == "float=0.3:0.6,leeway=8:0:0,sway=1"
    assert options("swell").scenario.disturbances == NO_DISTURBANCES


def test_goals_after_the_end_are_ignored_with_a_warning(capsys):
    assert len(options("tank", "--seconds", "300").goals) == 2
    assert "later goals are ignored" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["lake"],
        ["tank", "--speed", "fast"],
        ["tank", "--speed", "0"],
        ["tank", "--speed", "nan"],
        ["tank", "--seconds", "-1"],
        ["tank", "--seconds", "nan"],
        ["tank", "--seconds", "1e300"],
        ["tank", "--seed", "-1"],
        ["tank", "--seed", "x"],
        ["tank", "--goal", "noon:north"],
        ["tank", "--goal", "100:5", "--seconds", "50"],
        ["tank", "--set", "NO_SUCH=1"],
        ["tank", "--set", "CTL_K1=1e300"],
        ["tank", "--vehicle", "/nonexistent/boat.toml"],
        ["tank", "--compass", "astrolabe"],
        ["tank", "--with", "raft"],
        ["tank", "--with", ""],
        ["tank", "--with", "float=nan"],
        ["tank", "--with", "sway", "--with", "sway"],
        ["calm", "--with", "orbital"],
        ["tank+sway"],
        ["tank", "--nonsense"],
        [],
    ],
)
def test_bad_usage_is_one_line_and_code_2(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", *words]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    errors = [line for line in output.err.splitlines() if "ignored" not in line]
    assert len(errors) == 1
    assert errors[0].startswith("rambler-hil: ")


def test_unknown_command(capsys):
    assert main(["swim"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_output_directory_and_earlier_state(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    found = command.read_options(parser.parse_args(["calm", "--seed", "4"]))
    assert str(found.out) == "runs/calm-4"
    assert (tmp_path / "runs" / ".gitignore").read_text() == "*\n"
    kept = tmp_path / "mine" / "state" / "precious"
    kept.parent.mkdir(parents=True)
    kept.write_text("x")
    with pytest.raises(UsageError, match="not of an earlier run"):
        prepare_directory(tmp_path / "mine")
    assert kept.exists()
    (tmp_path / "mine" / "vehicle.toml").write_text("")  # as of a board, whose autopilot is of another program
    with pytest.raises(UsageError, match="not of an earlier run"):
        prepare_directory(tmp_path / "mine")
    (tmp_path / "mine" / "firmware.log").write_text("")
    prepare_directory(tmp_path / "mine")
    remove_earlier(tmp_path / "mine")
    assert list((tmp_path / "mine").iterdir()) == []


def test_a_run_does_not_overwrite_a_campaign(tmp_path):
    for name in ("campaign.json", "summary.json", "report.html"):
        (tmp_path / name).write_text("kept")
    with pytest.raises(UsageError, match="holds a campaign, which would be overwritten; give another --out"):
        prepare_directory(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["campaign.json", "report.html", "summary.json"]


def test_a_run_can_start_with_the_state_of_the_earlier_one(tmp_path):
    state = tmp_path / "state"
    state.mkdir()
    (state / "mission").write_text("x")
    for name in ("vehicle.toml", "firmware.log"):
        (tmp_path / name).write_text("")
    for _ in range(2):
        prepare_directory(tmp_path, state)
        remove_earlier(tmp_path)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["firmware.log", "state"]
        assert (state / "mission").read_text() == "x"
        (tmp_path / "vehicle.toml").write_text("")
    with pytest.raises(UsageError, match=r"mistyped does not exist; .* rambler plan load FILE --state .*mistyped$"):
        prepare_directory(tmp_path, tmp_path / "mistyped")
    with pytest.raises(UsageError, match=r"vehicle.toml cannot be copied: Not a directory"):
        prepare_directory(tmp_path, tmp_path / "vehicle.toml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["firmware.log", "state", "vehicle.toml"]
    assert (state / "mission").read_text() == "x"


def test_unusable_output_directory(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="give another --out"):
        prepare_directory(tmp_path / "file" / "out")


def test_a_copied_state_keeps_its_permissions(tmp_path):
    state = tmp_path / "state"
    state.mkdir()
    for name, mode in (("signing.key.0", 0o600), ("parameters.param.0", 0o640)):
        (state / name).write_bytes(b"x")
        (state / name).chmod(mode)
    run_directory.copy_state(state, tmp_path / "copy")
    assert (tmp_path / "copy/signing.key.0").stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "copy/parameters.param.0").read_bytes() == b"x"


def test_a_replaced_run_is_reported(tmp_path, monkeypatch, capsys):
    for names in (["truth.csv"], ["vehicle.toml"], ["run.json"], ["vehicle.toml", "run.json"]):
        for name in names:
            (tmp_path / name).write_text("{}")
        prepare_directory(tmp_path)
        assert capsys.readouterr().err == ""
        remove_earlier(tmp_path)
        line = f"rambler-hil: {tmp_path}: an earlier run is replaced; use another --out to keep both\n"
        assert capsys.readouterr().err == ("" if names == ["truth.csv"] else line)
    monkeypatch.setattr(run_directory.run_file, "read", lambda _out: argparse.Namespace(begun="yesterday"))
    (tmp_path / "vehicle.toml").touch()
    prepare_directory(tmp_path)
    remove_earlier(tmp_path)
    assert ": the run of yesterday is replaced;" in capsys.readouterr().err


def content(directory):
    return {str(path.relative_to(directory)): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


def earlier_run(directory):
    """Put files of a run into a directory and return their content."""
    (directory / "state/logs").mkdir(parents=True)
    for name in ("vehicle.toml", "firmware.log", "run.json", "truth.csv", "report.html", "state/logs/00000001.BIN"):
        (directory / name).write_text(f"earlier {name}")
    return content(directory)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--view", "0.0.0.0:9000"], "needs a token"),
        (["--link", "sbd:/dev/null"], "give a directory"),
        (
            ["--remote", "udpout:nowhere.invalid:1", "--compass-port", "/dev/null/x", "--speed", "real"],
            "--compass-port",
        ),
    ],
)
def test_a_rejected_run_keeps_the_earlier_one(tmp_path, capsys, words, reason):
    before = earlier_run(tmp_path)
    assert main(["run", "calm", "--speed", "max", "--out", str(tmp_path), *words]) == 2
    output = capsys.readouterr()
    assert reason in output.err
    assert (output.err + output.out).count("\n") == 1
    assert content(tmp_path) == before


def test_a_run_replaces_the_earlier_one_once_it_has_begun(tmp_path, capsys):
    earlier_run(tmp_path)
    options_here = replace(options("calm", "--speed", "max"), out=tmp_path)
    with contextlib.suppress(ZeroDivisionError), recorded_run(options_here, 0.0) as book:
        assert capsys.readouterr().err == ""
        book.begin()
        assert "an earlier run is replaced" in capsys.readouterr().err
        _ = 1 / 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.json", "truth.csv"]
    assert "ZeroDivisionError" in (tmp_path / "run.json").read_text()


@pytest.mark.parametrize("moved", [1, 9])
def test_a_run_killed_before_it_has_begun_keeps_the_earlier_one(tmp_path, monkeypatch, moved):
    before = earlier_run(tmp_path)
    rename, count = Path.rename, itertools.count()

    def killed(path, target):
        if next(count) == moved:
            raise KeyboardInterrupt
        rename(path, target)

    monkeypatch.setattr(Path, "rename", killed)
    with contextlib.suppress(KeyboardInterrupt):
        prepare_directory(tmp_path)
    monkeypatch.undo()
    (tmp_path / "run.json").touch()
    run_directory.restore_earlier(tmp_path)
    assert content(tmp_path) == before


@pytest.mark.parametrize("why", ["a state that is not there", "a campaign"])
def test_a_rejected_run_reports_no_replacement(tmp_path, capsys, why):
    (tmp_path / "vehicle.toml").touch()
    if why == "a campaign":
        (tmp_path / "campaign.json").touch()
    with pytest.raises(UsageError):
        prepare_directory(tmp_path, None if why == "a campaign" else tmp_path / "mistyped")
    assert capsys.readouterr().err == ""
    assert (tmp_path / "vehicle.toml").exists()
