import socket
import sys

import pytest

from hil.__main__ import main

SPEC = 'engine = "compiled"\nruns = 1\nseed = 1\nseconds = 60\nscenarios = ["tank"]\n'


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        ("pyarrow", ("spec.toml",)),
        ("pyarrow", ("replay", ".", "0")),
        ("pyarrow", ("compare", ".", ".")),
        ("distributed", ("spec.toml", "--scheduler", "tcp://127.0.0.1:1")),
    ],
)
def test_missing_package_is_reported_before_the_first_run(missing, words, tmp_path, monkeypatch, capsys):
    (tmp_path / "spec.toml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, missing, None)
    assert main(["campaign", *words, "--out", "out"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err == f"rambler-hil: {missing} is not installed; pip install 'rambler-autopilot[campaign]'\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("spec.toml", "more"), "give SPEC or replay DIR ROW or compare DIR DIR"),
        (("compare", "."), "give SPEC or replay DIR ROW or compare DIR DIR"),
        (("replay", ".", "first"), "'first' is not the number of a run"),
        (("replay", ".", "0", "--resume"), "replay does not take --resume or --scheduler; remove them"),
        (("compare", ".", ".", "--scheduler", "fish"), "compare does not take --resume or --scheduler; remove them"),
        (("spec.toml", "--workers", "0"), "--workers 0: give a whole number from 1 to 1024"),
        (("spec.toml", "--scheduler", "fish"), "--scheduler fish: write tcp://HOST:PORT"),
    ],
)
def test_invalid_arguments_are_reported_before_a_package_is_imported(words, error, tmp_path, monkeypatch, capsys):
    (tmp_path / "spec.toml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    for package in ("pyarrow", "distributed"):
        monkeypatch.setitem(sys.modules, package, None)
    assert main(["campaign", *words, "--out", "out"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("rambler-hil: ")
    assert output.err.endswith(f"{error}\n")
    assert not (tmp_path / "out").exists()


def test_missing_scheduler_leaves_no_directory(tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed")
    (tmp_path / "spec.toml").write_text(SPEC)
    monkeypatch.setattr("hil.lab.campaign.workers.TIMEOUT_S", 0.2)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))  # without listening
        address = f"tcp://127.0.0.1:{unused.getsockname()[1]}"
        words = [str(tmp_path / "spec.toml"), "--out", str(tmp_path / "out"), "--scheduler", address]
        assert main(["campaign", *words]) == 2
    assert capsys.readouterr().err.startswith(f"rambler-hil: --scheduler {address}: no dask scheduler answers: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["campaign.json", "run.json"])
def test_comparison_does_not_overwrite_a_campaign_or_a_run(name, tmp_path, capsys):
    pytest.importorskip("pyarrow")
    (tmp_path / name).write_text("{}")
    (tmp_path / "report.html").write_text("kept")
    assert main(["campaign", "compare", str(tmp_path), str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "which would be overwritten; give another" in capsys.readouterr().err
    assert (tmp_path / "report.html").read_text() == "kept"
