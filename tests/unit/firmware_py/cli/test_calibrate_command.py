"""`rambler calibrate compass`: a proposal and what it is worth, or why there is none; nothing is set."""

import json
import math
import random

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import calibrate
from firmware_py.common.angles import TWO_PI, radians
from firmware_py.common.intents import Request, SetParameter
from firmware_py.common.parameters import ParameterSet, parse_file
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderCommand,
    Tick,
)
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_to_text
from firmware_py.log.reader import LoggedTick
from support.paths import REPLAY
from support.plans import placed

LOG = REPLAY / "tank_pni_volz.BIN"


def voyage(legs=30, leg_s=900, restart=False, requests=()):
    """Yield the ticks, one each 2 s, of straight legs by a compass that shows 5 deg too little on all headings."""
    courses, north_m, east_m, late_s = random.Random(1), 0.0, 0.0, 0.0
    text = state_to_text(State.at_start(ParameterSet().replaced("CMP_DEV_B", 2.0)))
    for index in range(legs * leg_s // 2):
        if index % (leg_s // 2) == 0:
            compass_rad = courses.uniform(0.0, TWO_PI)
        if restart and index == legs * leg_s // 4:
            late_s = 2.0 * index
        t_s = 2.0 * index - late_s
        way_rad = compass_rad + radians(5.0)
        north, east = 0.1 + 0.6 * math.cos(way_rad), 0.6 * math.sin(way_rad)
        north_m, east_m = north_m + 2.0 * north, east_m + 2.0 * east
        course_rad = math.atan2(east, north) % TWO_PI
        fix = PositionSample(t_s, FixType.FIX_3D, *placed(north_m, east_m), 0.0, math.hypot(north, east), course_rad)
        asked = tuple(Request(t_s, intent) for intent in requests) if index == 5 else ()
        headings = (HeadingSample(t_s, compass_rad, NorthReference.TRUE),)
        inputs = Inputs(Tick(index, t_s, 0.0, 0, 0.5), headings, (fix,), requests=asked)
        yield LoggedTick(inputs, RudderCommand(0.0, torque_on=True), text if index == 0 else None, gap=False)


def told(monkeypatch, capsys, *words, **how):
    monkeypatch.setattr(calibrate, "read_log", lambda _path: voyage(**how))
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


def test_a_proposal_is_saved_as_a_parameter_file(monkeypatch, capsys, tmp_path):
    path = tmp_path / "deviation.parm"
    code, text = told(monkeypatch, capsys, "--save", str(path))
    assert code == 0
    assert "CMP_DEV_A      0.00" in text
    assert "leeway" in text
    assert list(parse_file(path.read_text(), "-")) == list(calibrate.NAMES)


def test_too_little_is_no_proposal_and_nothing_is_saved(monkeypatch, capsys, tmp_path):
    path = tmp_path / "deviation.parm"
    code, text = told(monkeypatch, capsys, "--save", str(path), legs=3)
    assert code == 1
    assert "not enough for a proposal" in text
    assert not path.exists()


def test_what_is_set_meanwhile_is_in_force(monkeypatch, capsys):
    asked = (SetParameter("CMP_DEV_C", -3.0), SetParameter("NO_SUCH", 1.0))
    _, text = told(monkeypatch, capsys, "--json", legs=3, requests=asked)
    assert json.loads(text)["in_force_deg"]["CMP_DEV_C"] == -3.0


def test_a_log_without_a_voyage_tells_nothing(capsys):
    assert main(["calibrate", "compass", str(LOG)]) == 1
    assert "parts of the circle" in capsys.readouterr().out


def test_a_log_that_cannot_be_read_is_one_line(capsys, tmp_path):
    assert main(["calibrate", "compass", str(tmp_path / "none.BIN")]) == 2
    assert "none.BIN" in capsys.readouterr().err
