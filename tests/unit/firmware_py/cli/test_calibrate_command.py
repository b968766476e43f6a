"""`rambler calibrate compass`: a proposal and what it is worth, or why there is none; nothing is set."""

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


def told(monkeypatch, capsys, *words, **how):
    monkeypatch.setattr(logged_ticks, "read_log", lambda _path: voyage(**how))
    code = main(["calibrate", "compass", "any.BIN", *words])
    return code, capsys.readouterr().out


@pytest.mark.parametrize("restart", [False, True])
def test_a_proposal_is_shown_beside_what_is_in_force(monkeypatch, capsys, restart):
    code, text = told(monkeypatch, capsys, "--json", restart=restart)
    found = json.loads(text)
    assert (code, found["ready"]) == (0, True)
    assert found["in_force_deg"]["CMP_DEV_B"] == 2.0
    assert found["proposed_deg"]["CMP_DEV_A"] == pytest.approx(5.0, abs=0.3)
    assert found["proposed_deg"]["CMP_DEV_B"] == pytest.approx(0.0, abs=0.5)
    assert found["off_deg"] == pytest.approx(7.0, abs=0.7)
    assert found["mounting_deg"] == pytest.approx(found["proposed_deg"]["CMP_DEV_A"], abs=0.01)
    assert found["residual_after_deg"] < 0.2 * found["residual_before_deg"]


def test_a_proposal_is_saved_as_a_parameter_file(monkeypatch, capsys, tmp_path):
    path = tmp_path / "deviation.parm"
    code, text = told(monkeypatch, capsys, "--save", str(path))
    assert code == 0
    assert "CMP_DEV_A      0.00" in text
    assert "leeway" in text
    assert "alignment: CMP_OFFSET_DEG " in text
    assert list(parse_file(path.read_text(), "-")) == list(NAMES)


def test_too_little_is_no_proposal_and_nothing_is_saved(monkeypatch, capsys, tmp_path):
    path = tmp_path / "deviation.parm"
    code, text = told(monkeypatch, capsys, "--save", str(path), legs=3)
    assert code == 1
    assert "not enough data" in text
    assert not path.exists()


def test_what_is_set_meanwhile_is_in_force(monkeypatch, capsys):
    asked = (SetParameter("CMP_DEV_C", -3.0), SetParameter("NO_SUCH", 1.0))
    _, text = told(monkeypatch, capsys, "--json", legs=3, requests=asked)
    assert json.loads(text)["in_force_deg"]["CMP_DEV_C"] == -3.0


def test_a_log_without_a_voyage_tells_nothing(capsys):
    assert main(["calibrate", "compass", str(LOG)]) == 1
    assert "sectors" in capsys.readouterr().out


def test_a_log_that_cannot_be_read_is_one_line(capsys, tmp_path):
    assert main(["calibrate", "compass", str(tmp_path / "none.BIN")]) == 2
    assert "none.BIN" in capsys.readouterr().err
