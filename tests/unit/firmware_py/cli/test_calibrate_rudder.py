"""`rambler calibrate rudder`: limits on a simulated servo with stops, the centre from a log."""

import json
import math
import random
from itertools import pairwise

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import logged_ticks
from firmware_py.cli.calibrate_rudder import BenchError, Measured, examine
from firmware_py.common.angles import degrees, radians, wrap_two_pi
from firmware_py.common.intents import Arm, Request, SetParameter
from firmware_py.common.parameters import ParameterSet, parse_file
from firmware_py.common.records import HeadingSample, Inputs, NorthReference, RudderCommand, RudderFeedback, Tick
from firmware_py.log.reader import LoggedTick


class Shaft:
    """A servo with mechanical stops; it moves `scale` of the command."""

    def __init__(self, low_deg=-90.0, high_deg=90.0, scale=1.0, first_deg=1.5, heavy_deg=None, silent=False):
        self.low, self.high, self.scale, self.heavy = low_deg, high_deg, scale, heavy_deg
        self.angle = first_deg
        self.moves, self.silent = [], silent

    def release(self):
        return None if self.silent else self.move(None)

    def move(self, shaft_rad):
        self.moves.append(shaft_rad)
        if shaft_rad is not None:
            self.angle = min(max(self.scale * degrees(shaft_rad), self.low), self.high)
        current_a = 9.0 if self.heavy is not None and abs(self.angle) >= self.heavy else 0.3
        return Measured(radians(self.angle), current_a)


def found(shaft, *, amidships=False, asks=False, **values):
    parameters = ParameterSet()
    for name, value in values.items():
        parameters = parameters.replaced(name, value)
    return examine(shaft, parameters, amidships=amidships, asks=asks)


def test_free_rudder_keeps_its_limit():
    proposed, values, _ = found(Shaft())
    assert proposed == {"RUD_LIMIT_DEG": 30.0}
    assert values["stopped"] == [False, False]
    assert values["reached_deg"] == [36.0, 36.0]


@pytest.mark.parametrize(("low", "high", "limit"), [(-90, 21, 18.0), (-17, 90, 14.0), (-9, 25, 6.0)])
def test_limit_is_the_nearer_stop_less_a_margin(low, high, limit):
    shaft = Shaft(low, high)
    proposed, _, lines = found(shaft)
    assert proposed["RUD_LIMIT_DEG"] == pytest.approx(limit, abs=2.0)
    assert proposed["RUD_LIMIT_DEG"] < min(-low, high)
    assert any("mechanical stop" in line for line in lines)
    farthest = max(abs(degrees(one)) for one in shaft.moves if one is not None and one > 0.0)
    assert farthest <= high + 5.0  # it is not pressed against


def test_high_current_counts_as_a_stop():
    proposed, values, _ = found(Shaft(heavy_deg=20.0))
    assert values["stopped"] == [True, True]
    assert proposed["RUD_LIMIT_DEG"] == 16.0


def test_centre_is_proposed_only_with_amidships():
    assert found(Shaft(), amidships=True)[0]["RUD_CENTRE_DEG"] == 1.5
    assert "RUD_CENTRE_DEG" not in found(Shaft())[0]


def test_servo_without_angle_while_released_still_gets_limits():
    assert found(Shaft(silent=True))[0] == {"RUD_LIMIT_DEG": 30.0}
    with pytest.raises(BenchError, match="without --amidships"):
        found(Shaft(silent=True), amidships=True)


def test_steps_are_small_and_end_amidships():
    shaft = Shaft()
    found(shaft, RUD_CENTRE_DEG=5.0)
    ways = [degrees(one) for one in shaft.moves[1:]]
    out = [abs(second - first) for first, second in pairwise(ways) if second != ways[-1]]
    assert max(out) == pytest.approx(2.0)
    assert ways[-1] == pytest.approx(5.0)


@pytest.mark.parametrize(("answer", "reverse"), [("y", 0.0), ("n", 1.0), ("?", None)])
def test_direction_follows_the_answer_of_the_operator(monkeypatch, answer, reverse):
    monkeypatch.setattr("builtins.input", lambda _question: answer)
    assert found(Shaft(), asks=True)[0].get("RUD_REVERSE") == reverse


def test_demonstrated_deflection_keeps_the_margin_to_a_stop(monkeypatch):
    shaft = Shaft(high_deg=9.0)
    monkeypatch.setattr("builtins.input", lambda _question: str(demonstrated.append(shaft.moves[-1])))
    demonstrated = []
    proposed, _, _ = found(shaft, asks=True)
    assert [degrees(one) for one in demonstrated] == pytest.approx([proposed["RUD_LIMIT_DEG"]], abs=0.05)


@pytest.mark.parametrize(
    ("shaft", "text"),
    [
        (Shaft(scale=0.88), "0.88"),
        (Shaft(-0.5, 0.5, first_deg=0.0, heavy_deg=0.1), "does not follow"),
        (Shaft(-0.5), "stops at 0.5 deg on one side: it sticks"),
        (Shaft(high_deg=5.0), "stops at 5.0 deg on one side"),
    ],
)
def test_faulty_servo_gives_no_proposal(shaft, text):
    with pytest.raises(BenchError, match=text):
        found(shaft)


def test_missing_port_is_a_one_line_error(capsys, tmp_path):
    path = tmp_path / "boat.toml"
    path.write_text(
        '[compass]\ndriver = "nmea"\nport = "/dev/none"\nbaud = 4800\n'
        '[rudder]\ndriver = "volz"\nport = "/dev/none"\nbaud = 115200\n'
    )
    assert main(["calibrate", "rudder", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


# ------------------------------------------------------------------ from a voyage


def voyage(courses=24, off_deg=3.0, wave_deg=2.0, armed=True, reverse=False, spinning=False):
    """Yield straight courses of a little over ten minutes with different rudder angles."""
    chances, index = random.Random(1), 0
    questions = [SetParameter("RUD_CENTRE_DEG", 10.0), SetParameter("RUD_REVERSE", float(reverse)), Arm(armed)]
    for course in range(courses):
        goal_rad = 2.0 * math.pi * chances.random()
        for second in range(0, 620, 2):
            t_s = 2.0 * index
            heading_rad = wrap_two_pi(goal_rad + radians(chances.gauss(0.0, wave_deg)))
            rudder_deg = off_deg + 4.0 * math.sin(goal_rad) + chances.gauss(0.0, 3.0)
            shaft_rad = radians(10.0 + (-rudder_deg if reverse else rudder_deg))
            requests = tuple(Request(t_s, one) for one in questions) if course == second == 0 else ()
            other = HeadingSample(t_s, wrap_two_pi(0.1 * t_s), NorthReference.TRUE, source=1)
            inputs = Inputs(
                Tick(index, t_s, 0.0, 0, 0.5),
                (HeadingSample(t_s, heading_rad, NorthReference.TRUE), *([other] if spinning else [])),
                rudder=(RudderFeedback(t_s, shaft_rad),),
                requests=requests,
            )
            yield LoggedTick(inputs, RudderCommand(shaft_rad, torque_on=True), None, gap=False)
            index += 1


def output(monkeypatch, capsys, *words, **how):
    monkeypatch.setattr(logged_ticks, "read_log", lambda _path: voyage(**how))
    code = main(["calibrate", "rudder", "any.BIN", "--json", *words])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(("reverse", "centre"), [(False, 13.0), (True, 7.0)])
def test_centre_is_the_mean_over_all_courses(monkeypatch, capsys, tmp_path, reverse, centre):
    path = tmp_path / "rudder.parm"
    code, values = output(monkeypatch, capsys, "--save", str(path), courses=60, reverse=reverse, off_deg=3.0)
    assert code == (0 if values["ready"] else 1)
    assert values["mean_deg"] == pytest.approx(3.0, abs=0.7)
    assert values["proposed_deg"]["RUD_CENTRE_DEG"] == pytest.approx(centre, abs=0.7)
    assert path.exists() == values["ready"]
    if values["ready"]:
        assert parse_file(path.read_text(), "-") == values["proposed_deg"]


def test_second_compass_has_no_effect(monkeypatch, capsys):
    assert output(monkeypatch, capsys, spinning=True) == output(monkeypatch, capsys)


@pytest.mark.parametrize("how", [{"courses": 3}, {"wave_deg": 9.0}, {"armed": False}])
def test_waves_or_no_steering_give_no_proposal(monkeypatch, capsys, how):
    code, values = output(monkeypatch, capsys, **how)
    assert (code, values["ready"]) == (1, False)


def test_report_names_the_missing_data(monkeypatch, capsys):
    monkeypatch.setattr(logged_ticks, "read_log", lambda _path: voyage(courses=4))
    assert main(["calibrate", "rudder", "any.BIN"]) == 1
    assert "not enough data" in capsys.readouterr().out
