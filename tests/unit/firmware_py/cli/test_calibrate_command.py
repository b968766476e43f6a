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

LOG = REPLAY / "tank_pni_volz.BIN"


def output(monkeypatch, capsys, *words, **how):
    monkeypatch.setattr(logged_ticks, "read_log", lambda _path: voyage(**how))
    code = main(["calibrate", "compass", "any.BIN", *words])
    return code, capsys.readouterr().out


@pytest.mark.parametrize("restart", [False, True])
def test_compass_report_compares_proposal_and_values_in_force(monkeypatch, capsys, restart):
    code, text = output(monkeypatch, capsys, "--json", restart=restart)
    found = json.loads(text)
    assert (code, found["ready"]) == (0, True)
    assert found["in_force_deg"]["CMP_DEV_B"] == 2.0
    assert found["proposed_deg"]["CMP_DEV_A"] == pytest.approx(5.0, abs=0.3)
    assert found["proposed_deg"]["CMP_DEV_B"] == pytest.approx(0.0, abs=0.5)
    assert found["off_deg"] == pytest.approx(7.0, abs=0.7)
    assert found["mounting_deg"] == pytest.approx(found["proposed_deg"]["CMP_DEV_A"], abs=0.01)
    assert found["residual_after_deg"] < 0.2 * found["residual_before_deg"]


def test_proposal_is_saved_as_parameter_file(monkeypatch, capsys, tmp_path):
    path = tmp_path / "deviation.parm"
    code, text = output(monkeypatch, capsys, "--save", str(path))
    assert code == 0
    assert "CMP_DEV_A      0.00" in text
    assert "leeway" in text
    assert "alignment: CMP_OFFSET_DEG " in text
    assert list(parse_file(path.read_text(), "-")) == list(NAMES)


def test_insufficient_data_gives_no_proposal_and_no_file(monkeypatch, capsys, tmp_path):
    path = tmp_path / "deviation.parm"
    code, text = output(monkeypatch, capsys, "--save", str(path), legs=3)
    assert code == 1
    assert "not enough data" in text
    assert not path.exists()


def test_parameters_set_during_the_log_are_in_force(monkeypatch, capsys):
    run = (SetParameter("CMP_DEV_C", -3.0), SetParameter("NO_SUCH", 1.0))
    _, text = output(monkeypatch, capsys, "--json", legs=3, requests=run)
    assert json.loads(text)["in_force_deg"]["CMP_DEV_C"] == -3.0


def test_log_without_motion_gives_no_estimate(capsys):
    assert main(["calibrate", "compass", str(LOG)]) == 1
    assert "sectors" in capsys.readouterr().out


def test_unreadable_log_is_a_one_line_error(capsys, tmp_path):
    assert main(["calibrate", "compass", str(tmp_path / "none.BIN")]) == 2
    assert "none.BIN" in capsys.readouterr().err
