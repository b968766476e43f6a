"""`rambler params`: files written and read back, explanations of parameters, errors."""

import pytest

from firmware_py.__main__ import main
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import parse_file

MAX_PROBLEMS = 20

SETTINGS = [row for row in TABLE if not row.read_only]


@pytest.fixture
def file(tmp_path):
    return tmp_path / "boat.param"


@pytest.mark.parametrize("file_format", ["plain", "qgc"])
def test_parameter_file_round_trip(capsys, file, tmp_path, file_format):
    out = tmp_path / "out.param"
    file.write_text("CTL_K1 41\nEST_TAU_S,1.7\nSTAT_BOOTCNT 9\n")
    assert main(["params", str(file), "--save", str(out), "--format", file_format]) == 0
    assert f"{len(SETTINGS)} parameters written" in capsys.readouterr().out
    values = parse_file(out.read_text(), "out")
    assert list(values) == [row.name for row in SETTINGS]
    assert (values["CTL_K1"], values["EST_TAU_S"]) == (41.0, pytest.approx(1.7))
    assert all(values[row.name] == row.default for row in SETTINGS if row.name not in ("CTL_K1", "EST_TAU_S"))
    assert main(["params", str(out)]) == 0
    assert "2 differ from their defaults" in capsys.readouterr().out


def test_save_without_file_writes_defaults_or_a_one_line_error(capsys, tmp_path):
    assert main(["params", "--save", str(tmp_path / "out")]) == 0
    assert parse_file((tmp_path / "out").read_text(), "out") == {row.name: row.default for row in SETTINGS}
    assert main(["params", "--save", str(tmp_path / "none" / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_invalid_file_is_not_saved(file, tmp_path):
    file.write_text("CTL_K1 4100\n")
    assert main(["params", str(file), "--save", str(tmp_path / "out.param")]) == 1
    assert not (tmp_path / "out.param").exists()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--markdown", "CTL_K1"], "--markdown prints the whole page; remove CTL_K1"),
        (["--texts", "--save", "out"], "--texts prints the whole page; remove --save"),
        (["--markdown", "--faults"], "not allowed with argument --markdown"),
        (["CTL_LIMIT_DEG"], "RUD_LIMIT_DEG"),
        (["CTL_K1", "--save", "out"], "CTL_K1: cannot be read: No such file"),
        (["ctl.k1"], "ctl.k1: cannot be read: No such file"),
        (["K" * 33], "no parameter or file"),
        (["K" * 34], "cannot be read: No such file"),
        (["LOOP_HZ"], "LOOP_RATE_HZ"),
        (["bat_volt_low"], "BAT_LOW_VOLT"),
        (["STEER"], "FS_STEER_ACT"),
        (["WPRADIUS"], "WP_RADIUS"),
        (["POS_TIMOUT_S"], "POS_TIMEOUT_S"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, list) else "",
)
def test_wrong_option_or_mistyped_name_is_a_one_line_error_with_remedy(capsys, words, text):
    assert main(["params", *words]) == 2
    output = capsys.readouterr()
    (line,) = output.err.splitlines()
    assert (output.out, text in line) == ("", True), line


@pytest.mark.parametrize("name", ["RUD_LIMIT_DEG", "rud_limit_deg"])
def test_parameter_is_explained(capsys, name):
    assert main(["params", name]) == 0
    lines = ["RUD_LIMIT_DEG: Maximum rudder angle to either side.", "default   30 deg", "allowed   1 to 60 deg"]
    assert capsys.readouterr().out.splitlines() == lines


def test_every_parameter_is_explained_with_choices_and_conditions(capsys):
    for row in TABLE:
        assert main(["params", row.name]) == 0
        output = capsys.readouterr().out
        assert all(text in output for text in (row.text, *(row.choices or {}).values()))
        assert ("next start" in output) == (row.reboot or "next start" in row.text)
        assert ("read-only" in output) == row.read_only


def test_file_takes_precedence_over_parameter_name(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "CTL_K1").write_text("CTL_K1 41\n")
    assert main(["params", "CTL_K1"]) == 0
    assert "40 -> 41" in capsys.readouterr().out


def test_all_errors_of_a_file_are_reported_up_to_a_limit(capsys, file):
    file.write_text("CTL_K1 1e9\nCTL_K2 0.5\nNONE 1\nCTL_K2\nCTL_K2 two\n")
    assert main(["params", str(file)]) == 1
    output = capsys.readouterr()
    lines = output.err.splitlines()
    assert output.out == ""
    assert [line.split(":")[2] for line in lines] == ["1", "3", "4", "5"]
    assert all(line.startswith(f"rambler params: {file}:") for line in lines)
    file.write_text("nothing of the kind\n" * 10_000)
    assert main(["params", str(file)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == MAX_PROBLEMS + 1
    assert "not checked after line 20" in lines[-1]
