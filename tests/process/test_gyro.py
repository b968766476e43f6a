"""A gyroscope without north beside the compass: faults of its line and its power, wrong direction, and the tools."""

import json
import math
import subprocess
import sys

import pytest

from firmware_py.__main__ import main
from firmware_py.common.records import DeviceRole, NorthReference
from firmware_py.log.reader import read_log
from support.paths import ROOT

AGREES, DIFFERS = "Gyro agrees with compass: yaw rate used", "Gyro differs from compass: yaw rate not used"
SETTINGS = {"BOOT_ARM": 1, "BOOT_MODE": 15}


@pytest.fixture
def bench(make_boat):
    """A moored boat in real time, without a ground station."""
    boat = make_boat(
        scenario="calm", second_compass="bno08x_rvc", speed=None, settings=SETTINGS, without=("position", "link")
    )
    boat.start().run_until_written("Mode GUIDED")
    boat.run(1.5)
    return boat


def gyro_samples(boat):
    return [
        sample
        for path in boat.logs()
        for tick in read_log(path)
        for sample in tick.inputs.headings
        if sample.reference is NorthReference.RELATIVE
    ]


def gyro_texts(boat):
    devices = (device for path in boat.logs() for tick in read_log(path) for device in tick.inputs.devices)
    return [device.text for device in devices if device.role is DeviceRole.COMPASS_B]


def test_cable_power_and_foreign_bytes_make_no_spike_and_cost_no_heading(bench):
    bench.lines["compass_b"].unplug()
    bench.run_until_written("Compass: no data")
    bench.attitude.error_rad = bench.other_attitude.error_rad = 1.0  # the boat has turned meanwhile
    bench.lines["compass_b"].plug()
    bench.run_until_written("Compass: data recovered")
    bench.other_attitude.error_rad = 2.0
    bench.run(0.3)
    bench.other_compass.power_cycle(bench.world.now_s, off_s=0.1)  # yaw begins at 0
    bench.run(1.5)
    bench.other_line.garbage, bench.other_line.flip = 0.3, 0.002
    bench.run(3.0)
    bench.other_line.garbage = bench.other_line.flip = 0.0
    bench.lines["compass_b"].write(bytes([0x7F, 0x00, 0xE6, 0xAA]) * 500)  # as at a wrong baud rate
    bench.run(1.5)
    assert "No valid heading" not in bench.output_text()
    bench.finish()
    assert all(main(["replay", str(log)]) == 0 for log in bench.logs())
    samples = gyro_samples(bench)
    assert len(samples) > 40
    assert max(abs(math.degrees(sample.yaw_rate_rad_s)) for sample in samples) < 3.0
    assert {sample.source for sample in samples} == {1}
    texts = gyro_texts(bench)
    assert "gyro only, no north: used as yaw rate" in texts
    assert any(text.startswith("no port") for text in texts)


@pytest.mark.parametrize("clockwise", [True, False])
def test_yaw_rate_of_a_gyroscope_is_used_only_with_the_right_direction(fault_bench, clockwise):
    boat = fault_bench(scenario="sea", second_compass="bno08x_rvc", goals="0:0,100:60")
    boat.other_compass._direction = 1.0 if clockwise else -1.0
    boat.run(400.0)
    texts = boat.texts_since(0.0)
    if clockwise:
        assert texts.count(AGREES) == 1
    assert (DIFFERS in texts or AGREES not in texts) is not clockwise
    assert abs(math.degrees(math.remainder(boat.world.heading_low_rad() - math.radians(60.0), math.tau))) < 12.0
    boat.finish()
    assert all(main(["replay", str(log)]) == 0 for log in boat.logs())


def test_tools_state_that_there_is_no_north(make_boat):
    boat = make_boat(second_compass="bno08x_rvc", speed=None)
    boat.time.begin(boat.board, None)
    command = [sys.executable, "-m", "firmware_py", "check", str(boat._vehicle), "--state", str(boat.state), "--json"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as program:
        while program.poll() is None:
            boat.run(0.2)
        findings = {row["subject"]: row for row in json.loads(program.stdout.read())["findings"]}
    finding = findings["compass_b"]
    assert finding["level"] == "pass", finding
    assert finding["north"] == "none, gyro only"
    assert finding["rate_hz"] == pytest.approx(10.0, abs=1.0)
    assert abs(finding["yaw_rate_deg_s"]) < 20.0  # in waves, at any moment
