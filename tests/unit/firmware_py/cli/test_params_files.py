"""`rambler params`: files written and read back, the metadata."""

import json

import pytest

from firmware_py.__main__ import main
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import MAX_PROBLEMS, parse_file

SETTINGS = [row for row in TABLE if not row.read_only]


@pytest.mark.parametrize("form", ["plain", "qgc"])
def test_a_file_is_written_and_read_back(capsys, tmp_path, form):
    given, out = tmp_path / "boat.param", tmp_path / "out.param"
    given.write_text("CTL_K1 41\nEST_TAU_S,1.7\nSTAT_BOOTCNT 9\n")
    assert main(["params", str(given), "--save", str(out), "--format", form]) == 0
    assert f"{len(SETTINGS)} parameters written" in capsys.readouterr().out
    values = parse_file(out.read_text(), "out")
    assert list(values) == [row.name for row in SETTINGS]
    assert (values["CTL_K1"], values["EST_TAU_S"]) == (41.0, pytest.approx(1.7))
    assert all(values[row.name] == row.default for row in SETTINGS if row.name not in ("CTL_K1", "EST_TAU_S"))
    assert main(["params", str(out)]) == 0
    assert "2 differ from their defaults" in capsys.readouterr().out


def test_the_defaults_are_written_without_a_file(capsys, tmp_path):
    assert main(["params", "--save", str(tmp_path / "out")]) == 0
    assert parse_file((tmp_path / "out").read_text(), "out") == {row.name: row.default for row in SETTINGS}


def test_what_cannot_be_written_is_one_line(capsys, tmp_path):
    assert main(["params", "--save", str(tmp_path / "none" / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_wrong_file_is_not_saved_on(capsys, tmp_path):
    given, out = tmp_path / "boat.param", tmp_path / "out.param"
    given.write_text("CTL_K1 4100\n")
    assert main(["params", str(given), "--save", str(out)]) == 1
    assert not out.exists()


def test_the_metadata_is_printed(capsys):
    assert main(["params", "--metadata"]) == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)["parameters"]] == [row.name for row in TABLE]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--markdown", "CTL_K1"], "--markdown prints the whole page; remove CTL_K1"),
        (["--texts", "--save", "out"], "--texts prints the whole page; remove --save"),
        (["--markdown", "--faults"], "not allowed with argument --markdown"),
    ],
)
def test_what_a_page_would_not_heed_is_refused(capsys, words, told):
    assert main(["params", *words]) == 2
    said = capsys.readouterr()
    assert (said.out, told in said.err) == ("", True), said.err


@pytest.mark.parametrize("name", ["RUD_LIMIT_DEG", "rud_limit_deg"])
def test_a_name_is_explained(capsys, name):
    assert main(["params", name]) == 0
    assert capsys.readouterr().out == (
        "RUD_LIMIT_DEG: Maximum rudder angle to either side.\ndefault   30 deg\nallowed   1 to 60 deg\n"
    )


def test_every_parameter_is_explained_with_all_its_choices_and_conditions(capsys):
    for row in TABLE:
        assert main(["params", row.name]) == 0
        said = capsys.readouterr().out
        assert row.text in said
        assert ("next start" in said, "read-only" in said) == (row.reboot or "next start" in row.text, row.read_only)
        assert all(text in said for text in (row.choices or {}).values())


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("CTL_LIMIT_DEG", "RUD_LIMIT_DEG"),
        ("LOOP_HZ", "LOOP_RATE_HZ"),
        ("bat_volt_low", "BAT_LOW_VOLT"),
        ("STEER", "FS_STEER_ACT"),
        ("WPRADIUS", "WP_RADIUS"),
        ("POS_TIMOUT_S", "POS_TIMEOUT_S"),
    ],
)
def test_a_name_that_was_mistyped_brings_the_one_that_was_meant(capsys, name, meant):
    assert main(["params", name]) == 2
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert meant in line
    assert said.out == ""


def test_a_file_of_the_name_of_a_parameter_is_a_file(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "CTL_K1").write_text("CTL_K1 41\n")
    assert main(["params", "CTL_K1"]) == 0
    assert "40 -> 41" in capsys.readouterr().out


def test_all_that_is_wrong_with_a_file_is_told_at_once(capsys, tmp_path):
    given = tmp_path / "boat.param"
    given.write_text("CTL_K1 1e9\nCTL_K2 0.5\nNONE 1\nCTL_K2\nCTL_K2 two\n")
    assert main(["params", str(given)]) == 1
    said = capsys.readouterr()
    lines = said.err.splitlines()
    assert [line.split(":")[2] for line in lines] == ["1", "3", "4", "5"]
    assert all(line.startswith(f"rambler params: {given}:") for line in lines)
    assert said.out == ""


def test_of_a_file_that_is_none_not_more_is_told_than_anybody_reads(capsys, tmp_path):
    given = tmp_path / "boat.param"
    given.write_text("nothing of the kind\n" * 10_000)
    assert main(["params", str(given)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == MAX_PROBLEMS + 1
    assert "not checked after line 20" in lines[-1]
