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


def test_defaults_are_three_goals_in_real_time():
    result = options("tank")
    assert result.goals == (Goal(0.0, 0.0), Goal(120.0, 60.0), Goal(720.0, -90.0))
    assert (result.seconds, result.seed, result.speed) == (1320.0, 1, None)
    assert (result.vehicle.compass.driver, result.vehicle.rudder.driver) == ("nmea", "dynamixel")
    assert not result.lockstep


def test_options_are_read():
    result = options(
        *("sea", "--speed", "20", "--seed", "7", "--goal", "0:10,5:-20", "--compass", "pni", "--servo", "volz"),
        *("--link", "udpout:127.0.0.1:1", "tcpin:127.0.0.1:2", "--link", "udpin:0.0.0.0:3", "--set", "CTL_K1=30"),
    )
    assert result.speed == 20.0
    assert result.seconds == 305.0
    assert result.links == ("udpout:127.0.0.1:1", "tcpin:127.0.0.1:2", "udpin:0.0.0.0:3")
    assert result.settings == {"CTL_K1": 30.0}
    assert (result.vehicle.compass.driver, result.vehicle.rudder.driver) == ("pni_tcm", "volz")
    assert options("calm", "--speed", "max").speed == math.inf


def test_disturbances_are_merged():
    result = options("swell", "--with", "float=0.3:0.6,leeway=8", "--with", "sway").scenario
    assert text_of(result.disturbances) == "float=0.3:0.6,leeway=8:0:0,sway=1"
    assert options("swell").scenario.disturbances == NO_DISTURBANCES


def test_goals_after_the_end_are_ignored_with_a_warning(capsys):
    assert len(options("tank", "--seconds", "300").goals) == 2
    assert "later goals are ignored" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        "run lake", "run tank --speed fast", "run tank --speed 0", "run tank --speed nan", "run tank --seconds -1",
        "run tank --seconds nan", "run tank --seconds 1e300", "run tank --seed -1", "run tank --seed x",
        "run tank --goal noon:north", "run tank --goal 100:5 --seconds 50", "run tank --set UNKNOWN=1",
        "run tank --set CTL_K1=1e300", "run tank --vehicle /missing/boat.toml", "run tank --compass astrolabe",
        "run tank --with raft", "run tank --with ", "run tank --with float=nan", "run tank --with sway --with sway",
        "run calm --with orbital", "run tank+sway", "run tank --unknown", "run", "swim",
    ],
)  # fmt: skip
def test_invalid_usage_gives_an_error_of_one_line_and_code_2(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(words.split(" ")) == 2
    output = capsys.readouterr()
    assert output.out == ""
    errors = [line for line in output.err.splitlines() if "ignored" not in line]
    assert len(errors) == 1
    assert errors[0].startswith("rambler-hil: ")
    options = [word.strip("-") for word in words.split(" ") if word.startswith("--")]
    assert not options or options[-1] in errors[0]


def test_default_directory_is_hidden_from_git_and_other_state_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    result = command.read_options(parser.parse_args(["calm", "--seed", "4"]))
    assert str(result.out) == "runs/calm-4"
    assert (tmp_path / "runs" / ".gitignore").read_text() == "*\n"
    state_file = tmp_path / "mine" / "state" / "file"
    state_file.parent.mkdir(parents=True)
    state_file.write_text("x")
    with pytest.raises(UsageError, match="not of an earlier run"):
        prepare_directory(tmp_path / "mine")
    assert state_file.exists()
    (tmp_path / "mine" / "vehicle.toml").write_text("")  # as of a board
    with pytest.raises(UsageError, match="not of an earlier run"):
        prepare_directory(tmp_path / "mine")
    (tmp_path / "mine" / "firmware.log").write_text("")
    prepare_directory(tmp_path / "mine")
    remove_earlier(tmp_path / "mine")
    assert list((tmp_path / "mine").iterdir()) == []


def test_run_does_not_overwrite_a_campaign(tmp_path):
    for name in ("campaign.json", "summary.json", "report.html"):
        (tmp_path / name).write_text("kept")
    with pytest.raises(UsageError, match="holds a campaign, which would be overwritten; give another --out"):
        prepare_directory(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["campaign.json", "report.html", "summary.json"]


def test_run_can_start_with_the_state_of_the_earlier_run(tmp_path):
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


def test_unusable_output_directory_raises_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="give another --out"):
        prepare_directory(tmp_path / "file" / "out")


def test_copied_state_keeps_its_permissions(tmp_path):
    state = tmp_path / "state"
    state.mkdir()
    for name, mode in (("signing.key.0", 0o600), ("parameters.param.0", 0o640)):
        (state / name).write_bytes(b"x")
        (state / name).chmod(mode)
    run_directory.copy_state(state, tmp_path / "copy")
    assert (tmp_path / "copy/signing.key.0").stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "copy/parameters.param.0").read_bytes() == b"x"


def test_replaced_run_is_reported(tmp_path, monkeypatch, capsys):
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
def test_rejected_run_keeps_the_earlier_run(tmp_path, capsys, words, reason):
    earlier = earlier_run(tmp_path)
    assert main(["run", "calm", "--speed", "max", "--out", str(tmp_path), *words]) == 2
    output = capsys.readouterr()
    assert reason in output.err
    assert (output.err + output.out).count("\n") == 1
    assert content(tmp_path) == earlier


def test_run_replaces_the_earlier_run_after_it_has_begun(tmp_path, capsys):
    earlier_run(tmp_path)
    run_options = replace(options("calm", "--speed", "max"), out=tmp_path)
    with contextlib.suppress(ZeroDivisionError), recorded_run(run_options, 0.0) as book:
        assert capsys.readouterr().err == ""
        book.begin()
        assert "an earlier run is replaced" in capsys.readouterr().err
        _ = 1 / 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.json", "truth.csv"]
    assert "ZeroDivisionError" in (tmp_path / "run.json").read_text()


@pytest.mark.parametrize("renamed", [1, 9])
def test_run_killed_before_it_has_begun_keeps_the_earlier_run(tmp_path, monkeypatch, renamed):
    earlier = earlier_run(tmp_path)
    rename, count = Path.rename, itertools.count()

    def rename_until_killed(path, target):
        if next(count) == renamed:
            raise KeyboardInterrupt
        rename(path, target)

    monkeypatch.setattr(Path, "rename", rename_until_killed)
    with contextlib.suppress(KeyboardInterrupt):
        prepare_directory(tmp_path)
    monkeypatch.undo()
    (tmp_path / "run.json").touch()
    run_directory.restore_earlier(tmp_path)
    assert content(tmp_path) == earlier


@pytest.mark.parametrize("reason", ["missing state", "campaign"])
def test_rejected_run_reports_no_replacement(tmp_path, capsys, reason):
    (tmp_path / "vehicle.toml").touch()
    if reason == "campaign":
        (tmp_path / "campaign.json").touch()
    with pytest.raises(UsageError):
        prepare_directory(tmp_path, None if reason == "campaign" else tmp_path / "mistyped")
    assert capsys.readouterr().err == ""
    assert (tmp_path / "vehicle.toml").exists()
