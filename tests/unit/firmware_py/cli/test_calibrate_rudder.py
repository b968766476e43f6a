"""`rambler calibrate rudder`: limits on a simulated servo with stops, the centre from a log."""

import io
import json
import math
import random
from itertools import pairwise
from types import SimpleNamespace

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import calibrate_rudder, logged_ticks
from firmware_py.cli.bench_session import BenchDevice
from firmware_py.cli.calibrate_rudder import Bench, BenchError, ServoFeedback, measure_rudder
from firmware_py.common.angles import degrees, radians, wrap_two_pi
from firmware_py.common.intents import Arm, Request, SetParameter
from firmware_py.common.parameters import ParameterSet, parse_file
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    HeadingSample,
    Inputs,
    NorthReference,
    RudderCommand,
    RudderFeedback,
    Tick,
)
from firmware_py.log.reader import LoggedTick
from firmware_py.system.store import Store


class SimulatedBench:
    """A servo with mechanical stops. It moves `scale` of the command; from `heavy_deg` on its current is high."""

    def __init__(self, low_deg=-90.0, high_deg=90.0, scale=1.0, initial_deg=1.5, heavy_deg=math.inf, silent=False):
        self.low_deg, self.high_deg, self.scale, self.heavy_deg = low_deg, high_deg, scale, heavy_deg
        self.angle_deg, self.is_silent, self.commands_rad = initial_deg, silent, []

    def release(self):
        return None if self.is_silent else self.move(None)

    def move(self, shaft_rad):
        self.commands_rad.append(shaft_rad)
        if shaft_rad is not None:
            self.angle_deg = min(max(self.scale * degrees(shaft_rad), self.low_deg), self.high_deg)
        return ServoFeedback(radians(self.angle_deg), 9.0 if abs(self.angle_deg) >= self.heavy_deg else 0.3)


def measure(bench, *, amidships=False, can_ask=False, **parameters):
    values = ParameterSet()
    for name, value in parameters.items():
        values = values.replaced(name, value)
    return measure_rudder(bench, values, amidships=amidships, can_ask=can_ask)


def test_free_rudder_keeps_its_limit():
    proposed, values, _ = measure(SimulatedBench())
    assert proposed == {"RUD_LIMIT_DEG": 30.0}
    assert (values["ready"], values["stopped"], values["reached_deg"]) == (True, [False, False], [36.0, 36.0])


@pytest.mark.parametrize(
    ("low_deg", "high_deg", "limit_deg", "max_deg"),
    [
        (-90, 20.9, 18.9, 24.0),
        (-90, 21.1, 19.1, 26.0),
        (-17, 90, 15.0, 36.0),
        (-9, 25.1, 7.0, 30.0),
        (-90, 7.1, 5.1, 12.0),
    ],
)
def test_limit_is_the_nearer_stop_less_a_margin(low_deg, high_deg, limit_deg, max_deg):
    bench = SimulatedBench(low_deg, high_deg)
    proposed, values, lines = measure(bench)
    assert (proposed["RUD_LIMIT_DEG"], values["scale"]) == (limit_deg, pytest.approx(1.0, abs=0.1))
    assert any("mechanical stop" in line for line in lines)
    # A step of 2 deg that fails by more than 3 deg is the last one: the shaft is not pressed against the stop.
    assert degrees(max(filter(None, bench.commands_rad))) == pytest.approx(max_deg)


@pytest.mark.parametrize(("scale", "rounded", "reached_deg"), [(0.9104, 0.91, 29.1), (1.0896, 1.09, 34.9)])
def test_scale_of_the_encoder_may_be_wrong_by_a_tenth(scale, rounded, reached_deg):
    values = measure(SimulatedBench(scale=scale))[1]
    assert (values["scale"], values["reached_deg"]) == (rounded, [reached_deg] * 2)


@pytest.mark.parametrize(
    ("max_a", "has_stop", "limit_deg"), [(0.5, True, 16.0), (8.9, True, 16.0), (9.0, False, 30.0), (0.0, False, 30.0)]
)
def test_high_current_counts_as_a_stop(max_a, has_stop, limit_deg):
    proposed, values, _ = measure(SimulatedBench(heavy_deg=20.0), RUD_AMP_MAX=max_a)
    assert (values["stopped"], proposed["RUD_LIMIT_DEG"]) == ([has_stop] * 2, limit_deg)


@pytest.mark.parametrize(("limit_deg", "reached_deg"), [(29.5, 34.0), (30.0, 36.0), (56.0, 60.0)])
def test_rudder_is_moved_up_to_six_degrees_beyond_its_limit(limit_deg, reached_deg):
    assert measure(SimulatedBench(), RUD_LIMIT_DEG=limit_deg)[1]["reached_deg"] == [reached_deg] * 2


def test_centre_is_proposed_only_with_amidships():
    assert measure(SimulatedBench(initial_deg=1.507), amidships=True)[0]["RUD_CENTRE_DEG"] == 1.51
    assert "RUD_CENTRE_DEG" not in measure(SimulatedBench())[0]


def test_servo_without_angle_while_released_still_gets_limits():
    assert measure(SimulatedBench(silent=True))[0] == {"RUD_LIMIT_DEG": 30.0}
    with pytest.raises(BenchError, match="without --amidships"):
        measure(SimulatedBench(silent=True), amidships=True)


def test_steps_are_small_and_end_amidships():
    bench = SimulatedBench()
    measure(bench, RUD_CENTRE_DEG=5.0)
    angles_deg = [degrees(angle_rad) for angle_rad in bench.commands_rad[1:]]
    outward_steps = [abs(second - first) for first, second in pairwise(angles_deg) if second != angles_deg[-1]]
    assert max(outward_steps) == pytest.approx(2.0)
    assert angles_deg[-1] == pytest.approx(5.0)


@pytest.mark.parametrize(("answer", "reverse"), [("y", 0.0), ("n", 1.0), ("?", None)])
def test_direction_follows_the_answer_of_the_operator(monkeypatch, answer, reverse):
    monkeypatch.setattr("builtins.input", lambda _question: answer)
    assert measure(SimulatedBench(), can_ask=True)[0].get("RUD_REVERSE") == reverse


@pytest.mark.parametrize(("high_deg", "deflection_deg"), [(9.0, 7.0), (90.0, 10.0)])
def test_deflection_for_the_operator_keeps_the_margin_to_a_stop(monkeypatch, high_deg, deflection_deg):
    bench, deflections_rad = SimulatedBench(high_deg=high_deg), []
    monkeypatch.setattr("builtins.input", lambda _question: str(deflections_rad.append(bench.commands_rad[-1])))
    measure(bench, can_ask=True)
    assert list(map(degrees, deflections_rad)) == pytest.approx([deflection_deg], abs=0.05)
    assert bench.commands_rad[-1] == 0.0


@pytest.mark.parametrize(
    ("bench", "text"),
    [
        (SimulatedBench(scale=0.89), "0.89"),
        (SimulatedBench(scale=1.11), "1.11"),
        (SimulatedBench(high_deg=6.9), "stops at 6.9 deg on one side"),
        (SimulatedBench(-0.5, 0.5, initial_deg=0.0, heavy_deg=0.1), "does not follow"),
        (SimulatedBench(-0.5), "stops at 0.5 deg on one side: it sticks"),
        (SimulatedBench(high_deg=5.0), "stops at 5.0 deg on one side"),
    ],
)
def test_faulty_servo_gives_no_proposal(bench, text):
    with pytest.raises(BenchError, match=text):
        measure(bench)


class SimulatedServo:
    """A servo that moves by 20 deg/s and reports its angle every 50 ms, with the clock of the bench."""

    def __init__(self, *, sends=True, is_stuck=False, state=DeviceState.RUNNING):
        self.time_s = self.angle_rad = self.target_rad = 0.0
        self.sends, self.is_stuck, self.state = sends, is_stuck, state

    def now_s(self):
        return self.time_s

    def wait(self, until_s, _descriptors):
        step_rad = radians(20.0) * (until_s - self.time_s) * (not self.is_stuck)
        self.angle_rad += max(-step_rad, min(self.target_rad - self.angle_rad, step_rad))
        self.time_s = until_s

    def command(self, command, _now_s):
        self.target_rad = command.shaft_rad if command.torque_on else self.angle_rad

    def receive(self, _now_s):
        pass

    def poll(self):
        return (RudderFeedback(self.time_s, self.angle_rad),) if self.sends else ()

    def health(self, now_s):
        return DeviceHealth(now_s, DeviceRole.RUDDER, self.state, 0, 0, "")

    def fileno(self):
        return -1


def bench_of(servo):
    bench = Bench(BenchDevice("rudder", "volz", "/dev/x"), servo)
    bench._clock = servo
    return bench


def test_bench_waits_until_the_shaft_settles():
    servo = SimulatedServo()
    bench = bench_of(servo)
    assert bench.move(None).shaft_rad == 0.0
    start_s = servo.time_s
    assert degrees(bench.move(radians(10.0)).shaft_rad) == pytest.approx(10.0, abs=0.5)
    assert servo.time_s - start_s == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(("error_deg", "waited_s"), [(0.45, 0.15), (-0.45, 0.15), (0.52, 1.5), (-0.52, 1.5)])
def test_shaft_has_settled_within_half_a_degree(error_deg, waited_s):
    servo = SimulatedServo()
    servo.poll = lambda: (RudderFeedback(servo.time_s, servo.angle_rad + radians(error_deg)),)
    assert bench_of(servo).move(0.0).shaft_rad == pytest.approx(radians(error_deg))
    assert servo.time_s == pytest.approx(waited_s, abs=0.06)


def test_bench_waits_for_a_stuck_shaft_for_a_time_per_step():
    servo = SimulatedServo(is_stuck=True)
    bench = bench_of(servo)
    bench.move(None)
    start_s = servo.time_s
    assert bench.move(radians(4.0)).shaft_rad == 0.0
    assert servo.time_s - start_s == pytest.approx(3 * 1.5, abs=0.1)


def test_commands_are_repeated_every_tenth_of_a_second():
    servo, times_s = SimulatedServo(is_stuck=True), []
    servo.command = lambda _command, now_s: times_s.append(now_s)
    bench_of(servo).move(radians(4.0))
    gaps_s = [later - earlier for earlier, later in pairwise(times_s)]
    assert (min(gaps_s), max(gaps_s)) == pytest.approx((0.1, 0.15), abs=0.001)  # the servo is polled each 50 ms


def test_bench_waits_for_an_angle_after_the_command():
    servo = SimulatedServo()
    bench = bench_of(servo)
    bench.move(None)
    start_s, bench_poll = servo.time_s, servo.poll
    bench.move(0.0)
    assert servo.time_s - start_s == pytest.approx(0.15, abs=0.01)  # more than a command interval
    start_s = servo.time_s
    servo.poll = lambda: bench_poll() if servo.time_s > start_s + 0.48 else ()
    bench.move(0.0)
    assert servo.time_s - start_s == pytest.approx(0.5, abs=0.01)


def test_bench_refuses_a_silent_servo():
    servo = SimulatedServo(sends=False)
    with pytest.raises(BenchError, match="no angle from the servo; check power and wiring"):
        bench_of(servo).move(0.1)
    assert servo.time_s == pytest.approx(3.0, abs=0.1)
    assert bench_of(servo).release() is None  # it runs, but reports no angle while released
    with pytest.raises(BenchError):
        bench_of(SimulatedServo(sends=False, state=DeviceState.SILENT)).release()


def test_servo_that_measures_no_angle_is_refused_with_the_remedy():
    servo = SimulatedServo()
    servo.poll = lambda: (RudderFeedback(servo.time_s),)
    with pytest.raises(BenchError, match="this servo measures no angle; set its pulses"):
        bench_of(servo).move(0.1)
    assert bench_of(servo).release() is None


@pytest.fixture
def vehicle(tmp_path):
    path = tmp_path / "boat.toml"
    path.write_text(
        '[compass]\ndriver = "nmea"\nport = "/dev/none"\nbaud = 4800\n'
        '[rudder]\ndriver = "volz"\nport = "/dev/none-b"\nbaud = 115200\n'
    )
    return str(path)


def test_missing_port_is_a_one_line_error(capsys, vehicle):
    assert main(["calibrate", "rudder", vehicle]) == 2
    error = capsys.readouterr().err
    assert (error.count("\n"), "/dev/none-b: no such port" in error) == (1, True)


def test_rudder_is_measured_with_the_stored_parameters_and_released(monkeypatch, capsys, vehicle, tmp_path):
    store, calls, servo = Store(tmp_path / "state"), [], SimulatedServo()
    store.save("parameters.param", b"RUD_LIMIT_DEG 25\n")
    store.close()
    line = SimpleNamespace(close=lambda: calls.append("close"))
    device = BenchDevice("rudder", "volz", "/dev/x", servo, line=line)
    servo.command = lambda command, _now_s: calls.append(command)

    def measure(_bench, parameters, *, amidships, can_ask):
        calls.append((parameters["RUD_LIMIT_DEG"], amidships, can_ask))
        return {}, {"ready": True}, []

    monkeypatch.setattr(calibrate_rudder, "open_devices", lambda _group: [device])
    monkeypatch.setattr(calibrate_rudder, "RealClock", lambda: servo)
    monkeypatch.setattr(calibrate_rudder, "measure_rudder", measure)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["calibrate", "rudder", vehicle, "--state", str(tmp_path / "state"), "--json"]) == 1
    assert (calls[0], set(calls[1:-1]), calls[-1]) == (
        (25.0, False, False),
        {RudderCommand(0.0, torque_on=False)},
        "close",
    )
    assert json.loads(capsys.readouterr().out) == {"ready": True}


# ------------------------------------------------------------------ from logs


def voyage(courses=24, wind_deg=1.0, wave_deg=2.0, armed=True, torque_on=True, reverse=False, second_compass=False):
    """Yield straight courses of a little over ten minutes; the wind adds a rudder angle that depends on the course."""
    rng, index = random.Random(1), 0
    intents = [SetParameter("RUD_CENTRE_DEG", 10.0), SetParameter("RUD_REVERSE", float(reverse)), Arm(armed)]
    for course in range(courses):
        goal_rad = 2.0 * math.pi * rng.random()
        for second in range(0, 620, 2):
            t_s = 2.0 * index
            heading_rad = wrap_two_pi(goal_rad + radians(rng.gauss(0.0, wave_deg)))
            rudder_deg = 3.0 + wind_deg * math.sin(goal_rad) + rng.gauss(0.0, 3.0)
            shaft_rad = radians(10.0 + (-rudder_deg if reverse else rudder_deg))
            turning = HeadingSample(t_s, wrap_two_pi(0.1 * t_s), NorthReference.TRUE, source=1)
            inputs = Inputs(
                Tick(index, t_s, 0.0, 0, 0.5),
                (HeadingSample(t_s, heading_rad, NorthReference.TRUE), *([turning] if second_compass else [])),
                rudder=(RudderFeedback(t_s, shaft_rad),),
                requests=tuple(Request(t_s, intent) for intent in intents) if course == second == 0 else (),
            )
            yield LoggedTick(inputs, RudderCommand(shaft_rad, torque_on=torque_on), None, gap=False)
            index += 1


@pytest.fixture
def calibrate(monkeypatch, capsys):
    """Calibrate the rudder from the log of a voyage; return the exit code and the values."""

    def run(*words, **options):
        monkeypatch.setattr(logged_ticks, "read_log", lambda _path: voyage(**options))
        code = main(["calibrate", "rudder", "any.BIN", "--json", *words])
        return code, json.loads(capsys.readouterr().out)

    return run


@pytest.mark.parametrize(("reverse", "centre_deg"), [(False, 13.01), (True, 6.99)])
def test_centre_is_the_mean_over_all_courses(calibrate, tmp_path, reverse, centre_deg):
    path = tmp_path / "rudder.parm"
    code, values = calibrate("--save", str(path), reverse=reverse)
    assert (code, values["ready"]) == (0, True)
    assert values["mean_deg"] == pytest.approx(3.0, abs=0.1)
    assert 0.0 < values["sd_deg"] < 1.0
    assert [values[name] for name in ("mean_deg", "sd_deg")] == [
        round(values[name], 3) for name in ("mean_deg", "sd_deg")
    ]
    assert values["proposed_deg"] == {"RUD_CENTRE_DEG": centre_deg}
    assert parse_file(path.read_text(), "-") == pytest.approx(values["proposed_deg"])


def test_second_compass_has_no_effect(calibrate):
    assert calibrate(second_compass=True) == calibrate()


@pytest.mark.parametrize(
    "options",
    [{"courses": 3}, {"wind_deg": 4.0}, {"wave_deg": 9.0}, {"armed": False}, {"torque_on": False}],
    ids=lambda options: next(iter(options)),
)
def test_unsuitable_log_gives_no_proposal(calibrate, tmp_path, options):
    code, values = calibrate("--save", str(tmp_path / "rudder.parm"), **options)
    assert (code, values["ready"], list(tmp_path.iterdir())) == (1, False, [])


def test_report_without_json_names_the_missing_data(monkeypatch, capsys):
    monkeypatch.setattr(logged_ticks, "read_log", lambda _path: voyage(courses=4))
    assert main(["calibrate", "rudder", "any.BIN"]) == 1
    assert "not enough data" in capsys.readouterr().out
