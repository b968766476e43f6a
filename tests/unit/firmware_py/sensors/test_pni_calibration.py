"""Calibration of the PNI compass: start, results, and headings after every end."""

import math
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.records import CalibrationState
from firmware_py.sensors.pni_calibration import PniCalibration
from firmware_py.sensors.pni_tcm import PniCompass, PniOptions
from hil.devices.pni_tcm import PniTcmEmulator

POINT_COUNT = 12

NONE, RUNNING, DONE, FAILED = CalibrationState


class Turntable:
    """A compass on a turntable, simulated in steps of 20 ms."""

    def __init__(self, line):
        self.line, self.rate_deg_s, self.now_s = line, 10.0, 0.0
        self.compass = PniCompass(line, PniOptions())
        attitude = SimpleNamespace(
            heading_rad=lambda: math.radians(self.rate_deg_s * self.now_s % 360.0), yaw_rate_rad_s=lambda: 0.0
        )
        self.module = PniTcmEmulator(attitude, np.random.default_rng(1), noise_deg=0.0)
        self.reports = []

    def run(self, seconds):
        """Return the samples of this time."""
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

    def assert_ended(self, state, text):
        """Check the result, and that there are headings again."""
        report = self.compass.calibration()
        assert (report.state, text in report.text) == (state, True)
        assert len(self.run(3.0)) > 20


@pytest.fixture
def turntable(line):
    """A turntable whose compass has just started its calibration."""
    turntable = Turntable(line)
    assert len(turntable.run(3.0)) > 10
    assert turntable.compass.calibrate(turntable.now_s)
    return turntable


def test_full_circle_is_sampled_scored_and_saved(turntable):
    turntable.run(45.0)
    assert bytes.fromhex("00090A000000145CF9") in turntable.line.written  # the frame in the manual
    assert turntable.module.calibrated
    percents = [report.percent for report in turntable.reports if report.state is RUNNING]
    assert percents == sorted(percents)
    assert len(set(percents)) >= POINT_COUNT
    turntable.assert_ended(DONE, "Compass calibrated and saved: score 0.6")


def test_bad_score_is_not_saved(turntable):
    turntable.module.calibration_score = 5.25
    turntable.compass.cancel()
    assert turntable.compass.calibrate(turntable.now_s)
    turntable.run(45.0)
    assert not turntable.module.calibrated
    turntable.assert_ended(FAILED, "score 5.2")


def test_calibration_without_turning_ends_after_the_time_limit(turntable):
    turntable.rate_deg_s = 0.0
    turntable.run(602.0)
    turntable.assert_ended(FAILED, "timeout after")


def test_running_calibration_can_be_cancelled_and_not_started_again(turntable):
    turntable.run(10.0)
    assert not turntable.compass.calibrate(turntable.now_s)
    turntable.compass.cancel()
    turntable.run(1.0)
    turntable.assert_ended(NONE, "")
    assert turntable.compass.calibrate(turntable.now_s)


def test_power_cut_ends_the_calibration(turntable):
    turntable.run(5.0)
    turntable.module.power_cycle(turntable.now_s, 0.5)
    turntable.line.inbox += bytes.fromhex("000517") + b"\x9b\x23"  # a damaged power-up frame
    turntable.run(610.0)
    turntable.assert_ended(FAILED, "")


FRAMES = st.tuples(
    st.sampled_from([16, 17, 18]),
    st.binary(max_size=30) | st.floats(width=32).map(lambda score: struct.pack(">6f", score, 0, 0, 0, 0, 0)),
)


@given(st.lists(FRAMES, max_size=20))
def test_only_a_good_score_is_saved_after_any_frames(frames):
    calibration = PniCalibration(0.0)
    has_good_score = False
    for step, (frame_id, payload) in enumerate(frames):
        is_running = calibration.report.state is RUNNING
        calibration.handle_frame(frame_id, payload, 1.0 + step)
        if is_running and frame_id == 18 and len(payload) == 24:
            has_good_score = has_good_score or 0.0 <= struct.unpack_from(">f", payload)[0] <= 2.0
        assert 0 <= calibration.report.percent <= 100
        assert has_good_score or calibration.report.state is not DONE
