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
def test_a_package_that_is_missing_is_told_before_anything_is_sailed(missing, words, tmp_path, monkeypatch, capsys):
    (tmp_path / "spec.toml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, missing, None)
    assert main(["campaign", *words, "--out", "out"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == f"rambler-hil: {missing} is not installed; pip install 'rambler-autopilot[campaign]'\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("spec.toml", "more"), "give SPEC or replay DIR ROW or compare DIR DIR"),
        (("compare", "."), "give SPEC or replay DIR ROW or compare DIR DIR"),
        (("replay", ".", "first"), "'first' is not the number of a run"),
        (("replay", ".", "0", "--resume"), "replay takes neither --resume nor --scheduler; leave them out"),
        (
            ("compare", ".", ".", "--scheduler", "fish"),
            "compare takes neither --resume nor --scheduler; leave them out",
        ),
        (("spec.toml", "--workers", "0"), "--workers 0: give a whole number from 1 to 1024"),
        (("spec.toml", "--scheduler", "fish"), "--scheduler fish: write tcp://HOST:PORT"),
    ],
)
def test_wrong_words_are_told_before_a_package_is_asked_for(words, told, tmp_path, monkeypatch, capsys):
    (tmp_path / "spec.toml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    for package in ("pyarrow", "distributed"):
        monkeypatch.setitem(sys.modules, package, None)
    assert main(["campaign", *words, "--out", "out"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("rambler-hil: ")
    assert said.err.endswith(f"{told}\n")
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_does_not_answer_leaves_no_directory(tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed")
    (tmp_path / "spec.toml").write_text(SPEC)
    monkeypatch.setattr("hil.lab.campaign.crew.PATIENCE_S", 0.2)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # and does not listen
        address = f"tcp://127.0.0.1:{nobody.getsockname()[1]}"
        words = [str(tmp_path / "spec.toml"), "--out", str(tmp_path / "out"), "--scheduler", address]
        assert main(["campaign", *words]) == 2
    assert capsys.readouterr().err.startswith(f"rambler-hil: --scheduler {address}: no dask scheduler answers: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["campaign.json", "run.json"])
def test_a_comparison_replaces_the_page_of_no_campaign_and_of_no_run(name, tmp_path, capsys):
    pytest.importorskip("pyarrow")
    (tmp_path / name).write_text("{}")
    (tmp_path / "report.html").write_text("kept")
    assert main(["campaign", "compare", str(tmp_path), str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "whose results would be lost; give another" in capsys.readouterr().err
    assert (tmp_path / "report.html").read_text() == "kept"
