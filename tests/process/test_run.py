"""`rambler-hil run` end to end, with the real autopilot as a process on ptys."""

import json
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from firmware_py.log.disk import log_files
from firmware_py.log.reader import read_log
from hil.sim.truth import COLUMNS, FLOAT_COLUMN, read
from support.harness import is_replay_identical, rambler_hil, read_events, start_rambler_hil
from support.processes import autopilots, wait_until

# test_tank_proof.py has more seeds and combinations of the other devices.
TANK_RUNS = [(1, "nmea", "dynamixel"), pytest.param(6, "mti", "volz", marks=pytest.mark.proof)]


@pytest.mark.parametrize(("seed", "compass", "servo"), TANK_RUNS)
def test_heading_keeping_in_the_tank_meets_the_limits(tmp_path, seed, compass, servo):
    words = [
        "run",
        "tank",
        "--speed",
        "max",
        "--goal",
        "0:0,10:60",
        "--seconds",
        "140",
        "--seed",
        seed,
        "--out",
        tmp_path,
    ]
    has_picture = seed == 1  # the others run without matplotlib
    code, output, errors = rambler_hil(*words, "--compass", compass, "--servo", servo, picture=has_picture)
    assert (code, errors) == (0, "")
    assert (tmp_path / "run.png").exists() == has_picture
    summary = json.loads((tmp_path / "summary.json").read_text())
    first_goal, second_goal = summary["goals"]
    assert second_goal["overshoot_deg"] <= 3.0
    assert second_goal["p95_error_deg"] <= 3.0
    assert second_goal["settling_s"] <= 100.0
    assert first_goal["p95_error_deg"] <= 3.0
    assert second_goal["accepted_s"] - 10.0 < 0.5
    assert summary["loop"]["ticks"] >= 1390
    assert summary["loop"]["skipped"] == 0
    assert (tmp_path / "truth.csv").read_text().splitlines()[0] == ",".join(COLUMNS)
    truth = read(tmp_path / "truth.csv")
    assert truth.time_s[-1] == 140.0
    assert abs(truth.rudder_rad).max() < 0.53
    assert is_replay_identical(tmp_path)
    assert "overshoot" in output
    assert str(tmp_path / "report.html") in output
    assert (tmp_path / "report.html").stat().st_size > 50_000


@pytest.mark.parametrize(
    ("compass", "servo"), [("pni", "volz"), pytest.param("nmea", "dynamixel", marks=pytest.mark.proof)]
)
def test_two_runs_with_a_seed_are_identical_at_any_speed_and_another_seed_differs(tmp_path, compass, servo):
    """In the sea with the most disturbances. Ten readers of the page have no effect, and the log replays."""
    truths = []
    for name, seed, speed in (("a", "1", "max"), ("b", "1", "4"), ("c", "2", "max")):
        words = ["run", "ocean-4", "--with", "float=0.4", "--speed", speed, "--seconds", "12", "--goal", "0:30"]
        words += ["--set", "BOOT_RESUME=2"]  # acknowledgements wait for the disk
        words += ["--compass", compass, "--servo", servo, "--seed", seed]
        process = start_rambler_hil(
            *words, *(("--view", "127.0.0.1:0") if name == "b" else ()), "--out", tmp_path / name
        )
        if name == "b":
            assert_ten_readers_get_the_whole_stream(int(process.stdout.readline().rstrip("/\n").rpartition(":")[2]))
        _, errors = process.communicate()
        assert (process.returncode, errors) == (0, "")
        truths.append((tmp_path / name / "truth.csv").read_bytes())
    assert truths[0] == truths[1]
    assert truths[0] != truths[2]
    assert truths[0].splitlines()[0].decode() == ",".join([*COLUMNS, FLOAT_COLUMN])
    summaries = [json.loads((tmp_path / name / "summary.json").read_text()) for name in "ab"]
    assert summaries[1]["speed_ratio"] <= 4.01
    assert [summary["loop"]["skipped"] for summary in summaries] == [0, 0]
    assert summaries[0]["with"].startswith("float=0.4:0.6,leeway=5:4:300,")
    logs = [(tmp_path / name / "state/logs/00000001.BIN").read_bytes() for name in "ab"]
    assert logs[0] == logs[1]
    assert is_replay_identical(tmp_path / "a")


def assert_ten_readers_get_the_whole_stream(port):
    with ThreadPoolExecutor(10) as readers:
        streams = list(readers.map(read_events, [port] * 10))
    assert all(events.count(b"event: new") > 5 and events.rstrip().endswith(b"{}") for events in streams)


@pytest.mark.parametrize(
    ("compass", "servo"), [("pni", "dynamixel"), pytest.param("nmea", "volz", marks=pytest.mark.proof)]
)
def test_run_in_real_time_turns_and_measures_lateness(tmp_path, compass, servo):
    words = ["run", "tank", "--speed", "real", "--seconds", "12", "--goal", "0:60"]
    start_s = time.time()
    code, output, errors = rambler_hil(*words, "--compass", compass, "--servo", servo, "--out", str(tmp_path))
    assert (code, errors) == (0, "")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert set(summary["loop"]["lateness_us"]) == {"p50", "p99", "p99.9", "max"}
    assert summary["speed_ratio"] == pytest.approx(1.0, abs=0.05)
    # On a busy computer the autopilot starts late, and the boat has turned less: it turns as commanded.
    truth = read(tmp_path / "truth.csv")
    assert truth.heading_low_rad[-1] > truth.heading_low_rad[0]
    assert truth.yaw_rate_rad_s[-1] > 0.0
    assert truth.rudder_rad[-1] > 0.05
    assert "lateness of ticks" in output
    assert is_replay_identical(tmp_path)
    (log,) = log_files(tmp_path / "state" / "logs").values()
    ticks = list(read_log(log))
    periods = round(10.0 * (ticks[-1].inputs.tick.t_s - ticks[0].inputs.tick.t_s))
    assert summary["loop"]["ticks"] + summary["loop"]["skipped"] == pytest.approx(periods + 1, abs=1)
    fixes = [fix for tick in ticks for fix in tick.inputs.positions if fix.utc_s is not None]
    assert all(start_s - 1.0 < fix.utc_s < time.time() for fix in fixes)  # the receiver has the time of the computer
    assert len(fixes) > 5


def test_failed_start_prints_the_error_of_the_autopilot_and_replaces_no_run(tmp_path):
    names = ("run.json", "vehicle.toml", "firmware.log")
    for name in names:
        (tmp_path / name).write_text("earlier")
    code, output, errors = rambler_hil("run", "calm", "--speed", "max", "--link", "udp:nowhere", "--out", str(tmp_path))
    assert code == 1
    assert output == ""
    assert len(errors.splitlines()) == 1
    assert "the autopilot ended" in errors
    assert "udp:nowhere" in errors
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(names, "earlier")


def test_goal_that_cannot_be_accepted_fails_the_run(tmp_path):
    # The compass never sends the configured sentence, so the autopilot cannot be armed.
    vehicle = tmp_path / "boat.toml"
    vehicle.write_text(
        '[compass]\ndriver = "nmea"\nport = "x"\nbaud = 4800\nsentences = ["PASHR"]\n'
        '[rudder]\ndriver = "volz"\nport = "x"\nbaud = 115200\n'
    )
    words = ["run", "calm", "--speed", "max", "--goal", "0:10", "--seconds", "4", "--vehicle", str(vehicle)]
    code, output, errors = rambler_hil(*words, "--out", str(tmp_path / "out"))
    assert (code, output) == (1, "")
    assert len(errors.splitlines()) == 1
    assert "arming was never" in errors
    assert (tmp_path / "out" / "truth.csv").exists()
    assert "arming was never" in read_early_summary(tmp_path / "out")["ending"]


def read_early_summary(out):
    """Check the report of a run that ended early; return its summary."""
    assert "Ended early" in (out / "report.html").read_text(encoding="utf-8")
    return json.loads((out / "summary.json").read_text())


def test_run_with_a_killed_autopilot_writes_its_report(tmp_path):
    process = start_rambler_hil("run", "tank", "--seconds", "100000", "--speed", "15", "--out", str(tmp_path / "out"))
    (pid,) = wait_until(lambda: autopilots(str(tmp_path / "out" / "vehicle.toml")))
    wait_until(lambda: (tmp_path / "out" / "truth.csv").stat().st_size > 1 << 12)
    # The log is written to disk once per second of real time at any speed.
    logs = tmp_path / "out" / "state" / "logs"
    wait_until(lambda: any(b"Armed\0" in path.read_bytes() for path in logs.glob("*.BIN")))
    os.kill(pid, signal.SIGKILL)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 1
    assert len(errors.splitlines()) == 1
    figures = read_early_summary(tmp_path / "out")
    assert "the autopilot ended" in figures["ending"]
    assert any(event["text"] == "Armed" for event in figures["events"])
    assert len(figures["goals"]) > 0
    (tmp_path / "out" / "report.html").unlink()
    assert rambler_hil("report", tmp_path / "out")[0] == 0
    assert read_early_summary(tmp_path / "out") == figures


@pytest.mark.parametrize(
    ("speed", "number"), [pytest.param("max", signal.SIGINT, marks=pytest.mark.proof), ("real", signal.SIGTERM)]
)
def test_interrupted_run_leaves_only_truth_and_report(tmp_path, number, speed):
    temporary = tmp_path / "scratch"
    temporary.mkdir()
    process = start_rambler_hil(
        *("run", "tank", "--speed", speed, "--seconds", "100000", "--out", str(tmp_path / "out")),
        env={**os.environ, "TMPDIR": str(temporary)},
    )
    wait_until((tmp_path / "out" / "state" / "logs").exists)
    time.sleep(0.5)
    process.send_signal(number)
    output, _ = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert f"report: {tmp_path / 'out' / 'report.html'}" in output
    assert read_early_summary(tmp_path / "out")["ending"].startswith("interrupted after")
    assert list(temporary.iterdir()) == []
    assert read(tmp_path / "out" / "truth.csv").time_s.size > 1
    assert autopilots(str(tmp_path)) == []


def test_autopilot_in_lockstep_has_no_real_time_priority(make_boat):
    boat = make_boat().start()
    boat.run(2.0)
    tasks = Path(f"/proc/{boat.process._process.pid}/task").iterdir()
    assert {os.sched_getscheduler(int(task.name)) for task in tasks} == {os.sched_getscheduler(0)}
