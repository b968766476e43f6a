"""The PNI compass calibrates itself while it is turned, and gives headings again afterwards, however it ends."""

import math
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.records import CalibrationState
from firmware_py.sensors.pni_calibration import POINTS, PniCalibration
from firmware_py.sensors.pni_tcm import PniCompass, PniOptions
from hil.devices.pni_tcm import PniTcmEmulator

RUNNING, DONE, FAILED = CalibrationState.RUNNING, CalibrationState.DONE, CalibrationState.FAILED


class Bench:
    """A compass on a turntable, stepped in 20 ms."""

    def __init__(self, line, deg_s=10.0):
        self.line, self.deg_s = line, deg_s
        self.now_s = 0.0
        self.compass = PniCompass(line, PniOptions())
        attitude = SimpleNamespace(
            heading_rad=lambda: math.radians(self.deg_s * self.now_s % 360.0), yaw_rate_rad_s=lambda: 0.0
        )
        self.module = PniTcmEmulator(attitude, np.random.default_rng(1), noise_deg=0.0)
        self.reports = []

    def run(self, seconds):
        """Return the headings that came."""
        samples = []
        for _ in range(round(seconds * 50)):
            self.now_s += 0.02
            sent = len(self.line.written)
            self.compass.receive(self.now_s)
            self.module.receive(self.now_s, b"".join(self.line.written[sent:]))
            if self.module.next_output_s() <= self.now_s:
                self.line.inbox += self.module.take_output(self.now_s)
            samples += self.compass.poll()
            self.reports.append(self.compass.calibration())
        return samples


@pytest.fixture
def bench(line):
    made = Bench(line)
    assert len(made.run(3.0)) > 10
    assert made.compass.calibrate(made.now_s)
    return made


def test_a_full_circle_is_sampled_scored_saved_and_headings_come_again(bench):
    bench.run(45.0)
    assert bench.compass.calibration().state is DONE
    assert bench.compass.calibration().text == "Compass calibrated and saved: score 0.6"
    assert bench.module.calibrated
    percents = [report.percent for report in bench.reports if report.state is RUNNING]
    assert percents == sorted(percents)
    assert len(set(percents)) >= POINTS
    assert len(bench.run(3.0)) > 20


def test_the_manuals_own_frame_starts_it(bench):
    bench.run(2.0)
    assert bytes.fromhex("00090A000000145CF9") in bench.line.written


def test_a_bad_score_is_not_saved(bench):
    bench.module.calibration_score = 5.25
    bench.compass.cancel()
    assert bench.compass.calibrate(bench.now_s)
    bench.run(45.0)
    assert bench.compass.calibration().state is FAILED
    assert "score 5.2" in bench.compass.calibration().text
    assert not bench.module.calibrated
    assert len(bench.run(3.0)) > 20


def test_one_that_is_not_turned_ends_in_time(bench):
    bench.deg_s = 0.0
    bench.run(602.0)
    assert bench.compass.calibration().state is FAILED
    assert "timeout after" in bench.compass.calibration().text
    assert len(bench.run(3.0)) > 20


def test_it_can_be_called_off_and_begun_once_at_a_time(bench):
    bench.run(10.0)
    assert not bench.compass.calibrate(bench.now_s)
    bench.compass.cancel()
    assert len(bench.run(4.0)) > 20
    assert bench.compass.calibration().state is CalibrationState.NONE
    assert bench.compass.calibrate(bench.now_s)


def test_a_power_cut_ends_it(bench):
    bench.run(5.0)
    bench.module.power_cycle(bench.now_s, 0.5)
    bench.line.inbox += bytes.fromhex("000517") + b"\x9b\x23"  # noise where the power came back
    bench.run(610.0)
    assert bench.compass.calibration().state is FAILED
    assert len(bench.run(3.0)) > 20


FRAMES = st.tuples(
    st.sampled_from([16, 17, 18]),
    st.binary(max_size=30) | st.floats(width=32).map(lambda score: struct.pack(">6f", score, 0, 0, 0, 0, 0)),
)


@given(st.lists(FRAMES, max_size=20))
def test_whatever_the_module_says_only_a_good_score_is_saved(frames):
    calibration = PniCalibration(0.0)
    good = False
    for step, (number, payload) in enumerate(frames):
        running = calibration.report.state is RUNNING
        calibration.take(number, payload, 1.0 + step)
        if running and number == 18 and len(payload) == 24:
            good = good or 0.0 <= struct.unpack_from(">f", payload)[0] <= 2.0
        assert 0 <= calibration.report.percent <= 100
        assert good or calibration.report.state is not DONE
