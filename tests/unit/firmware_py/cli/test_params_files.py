"""`rambler params`: files written and read back, the metadata."""

import json

import pytest

from firmware_py.__main__ import main
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import parse_file

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
