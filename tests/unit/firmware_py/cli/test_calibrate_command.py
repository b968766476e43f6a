"""`rambler calibrate compass`: the proposal and its accuracy, or the reason for none."""

import json

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import logged_ticks
from firmware_py.common.intents import SetParameter
from firmware_py.common.parameters import parse_file
from firmware_py.estimate.deviation import NAMES
from support.paths import REPLAY
from support.swing import voyage


@pytest.fixture
def calibrate(monkeypatch, capsys):
    """Calibrate the compass from the log of a voyage; return the exit code and the output."""

    def run(*words, **options):
        monkeypatch.setattr(logged_ticks, "read_log", lambda _path: voyage(**options))
        code = main(["calibrate", "compass", "any.BIN", *words])
        return code, capsys.readouterr().out

    return run


@pytest.mark.parametrize("restart", [False, True])
def test_compass_report_compares_proposal_and_values_in_force(calibrate, restart):
    code, text = calibrate("--json", restart=restart)
    values = json.loads(text)
    assert (code, values["ready"]) == (0, True)
    assert values["in_force_deg"]["CMP_DEV_B"] == 2.0
    assert values["proposed_deg"]["CMP_DEV_A"] == pytest.approx(5.0, abs=0.3)
    assert values["proposed_deg"]["CMP_DEV_B"] == pytest.approx(0.0, abs=0.5)
    assert values["off_deg"] == pytest.approx(7.0, abs=0.7)
    assert values["mounting_deg"] == pytest.approx(values["proposed_deg"]["CMP_DEV_A"], abs=0.01)
    numbers = [value for value in values.values() if isinstance(value, float)]
    numbers += [*values["proposed_deg"].values(), *values["sd_deg"].values()]
    assert numbers == [round(number, 3) for number in numbers]
    assert values["residual_after_deg"] < 0.2 * values["residual_before_deg"]


def test_proposal_is_printed_and_saved_as_parameter_file(calibrate, tmp_path):
    path = tmp_path / "deviation.parm"
    code, text = calibrate("--save", str(path))
    assert code == 0
    lines = text.splitlines()
    assert [line[:13] for line in lines[1:8]] == [" " * 11 + "in", *(f"{name}    " for name in NAMES), "compass    in"]
    assert [line.split()[0] for line in lines[8:16]] == [str(heading_deg) for heading_deg in range(0, 360, 45)]
    # In force: B = 2 deg at 90 deg; proposed: A = 5 deg.
    for line, present_deg in zip(lines[8:16], (0.0, 1.41, 2.0, 1.41, 0.0, -1.41, -2.0, -1.41), strict=True):
        assert list(map(float, line.split()[1:])) == pytest.approx([present_deg, 5.0], abs=0.5)
    starts = ["error in force", "rms residual ", "alignment: CMP_OFFSET_DEG ", "CMP_DEV_A includes", "A speed that"]
    assert [line.startswith(start) for line, start in zip(lines[16:], starts, strict=True)] == [True] * 5
    saved = parse_file(path.read_text(), "-")
    assert list(saved) == list(NAMES)
    assert list(saved.values()) == pytest.approx([round(value, 2) for value in saved.values()], abs=1e-5)


def test_insufficient_data_gives_no_proposal_and_no_file(calibrate, tmp_path):
    path = tmp_path / "deviation.parm"
    code, text = calibrate("--save", str(path), legs=3)
    assert (code, "not enough data" in text, path.exists()) == (1, True, False)
    assert "minutes of steady motion in 3 of 12 sectors" in text


def test_parameters_set_during_the_log_are_in_force(calibrate):
    intents = (SetParameter("CMP_DEV_C", -3.0), SetParameter("NO_SUCH", 1.0))
    _, text = calibrate("--json", legs=3, requests=intents)
    assert json.loads(text)["in_force_deg"]["CMP_DEV_C"] == -3.0


def test_log_without_motion_gives_no_proposal_and_a_missing_log_is_an_error(capsys, tmp_path):
    assert main(["calibrate", "compass", str(REPLAY / "tank_pni_volz.BIN")]) == 1
    assert "sectors" in capsys.readouterr().out
    assert main(["calibrate", "compass", str(tmp_path / "none.BIN")]) == 2
    assert "none.BIN" in capsys.readouterr().err
