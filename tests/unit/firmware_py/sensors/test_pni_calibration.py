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
# Frame ids.
SET_CONFIG, SAVE, START_CAL, STOP, POWER_UP = 6, 9, 10, 22, 23
COUNT, SCORE, SAVED = 17, 18, 16

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


def test_reopened_port_ends_the_calibration(turntable):
    turntable.run(10.0)
    turntable.line.unplug()
    turntable.run(0.1)
    turntable.line.plug()
    turntable.run(0.1)
    turntable.assert_ended(NONE, "")


def test_report_of_a_power_up_ends_the_calibration(turntable, pni):
    turntable.line.inbox += pni(POWER_UP)
    turntable.run(0.1)
    assert turntable.compass.calibration().percent == 0
    turntable.assert_ended(FAILED, "the compass lost power")


def test_power_cut_without_a_report_ends_the_calibration(turntable):
    turntable.run(5.0)
    turntable.module.power_cycle(turntable.now_s, 0.5)
    turntable.line.inbox += bytes.fromhex("000517") + b"\x9b\x23"  # a damaged power-up frame
    turntable.run(610.0)
    turntable.assert_ended(FAILED, "")


def counted(points):
    return COUNT, points.to_bytes(4, "big")


def scored(score):
    return SCORE, struct.pack(">6f", score, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_commands_are_sent_every_200_ms(pni):
    calibration, sent = PniCalibration(1.0), {}
    for now_s in (0.99, 1.0, 1.19, 1.21, 1.40, 1.42, 1.61, 1.63, 9.0):
        if (frame := calibration.next_frame(now_s)) is not None:
            sent[now_s] = frame
            calibration.note_sent(now_s)
    stop = pni(STOP)
    points, automatic = pni(SET_CONFIG, bytes([12, 0, 0, 0, 12])), pni(SET_CONFIG, bytes([13, 1]))
    assert sent == {1.0: stop, 1.21: points, 1.42: automatic, 1.63: pni(START_CAL, bytes([0, 0, 0, 20]))}


@pytest.mark.parametrize(
    ("frames", "end_s", "percent", "points"),
    [
        ([], 600.0, 0, 0),
        ([(100.0, COUNT, b"\0\0\6")], 600.0, 0, 0),
        ([(100.0, *counted(6))], 600.0, 47, 6),
        ([(100.0, *counted(12))], 250.0, 95, 12),
        ([(100.0, *counted(13)), (200.0, SCORE, bytes(23))], 250.0, 95, 12),
        ([(200.0, *scored(0.0))], 205.0, 99, 0),
        ([(100.0, *counted(12)), (200.0, *scored(2.0))], 205.0, 99, 12),
    ],
)
def test_each_stage_has_a_time_limit(pni, frames, end_s, percent, points):
    """There are 600 s for the samples, 150 s for the score and 5 s for saving."""
    calibration = PniCalibration(0.0)
    for now_s, *frame in frames:
        calibration.handle_frame(*frame, now_s)
    is_scored = percent == 99
    assert calibration.next_frame(end_s) == (pni(SAVE) if is_scored else pni(STOP))
    assert (calibration.report.state, calibration.report.percent) == (RUNNING, percent)
    calibration.next_frame(end_s + 0.1)
    assert (calibration.report.state, calibration.report.percent) == (FAILED, 100)
    assert calibration.report.text.endswith(f"timeout after {points} points")
    calibration.handle_frame(SAVED, b"\0\0", end_s + 0.2)
    assert calibration.report.state is FAILED


@pytest.mark.parametrize(
    ("frames", "state", "text"),
    [
        ([(SAVED, b"\0\0")], RUNNING, ""),
        ([scored(2.1)], FAILED, "score 2.1, at most 2;"),
        ([scored(-0.1)], FAILED, "score -0.1, at most 2;"),
        ([scored(math.nan)], FAILED, "score none, at most 2;"),
        ([scored(0.5), (SAVED, b"\0\0")], DONE, "Compass calibrated and saved: score 0.5"),
        ([scored(0.5), (SAVED, b"\0\1")], FAILED, "the compass could not save it"),
    ],
)
def test_result_is_that_of_the_score_and_of_saving(frames, state, text):
    calibration = PniCalibration(0.0)
    for frame in frames:
        calibration.handle_frame(*frame, 100.0)
    if state is not RUNNING:
        calibration.next_frame(999.0)  # the time limit does not change a result
    assert (calibration.report.state, text in calibration.report.text) == (state, True)


FRAMES = st.tuples(
    st.sampled_from([SAVED, COUNT, SCORE]),
    st.binary(max_size=30) | st.floats(width=32).map(lambda score: struct.pack(">6f", score, 0, 0, 0, 0, 0)),
)


@given(st.lists(FRAMES, max_size=20))
def test_only_a_good_score_is_saved_after_any_frames(frames):
    calibration = PniCalibration(0.0)
    has_good_score = False
    for step, (frame_id, payload) in enumerate(frames):
        is_running = calibration.report.state is RUNNING
        calibration.handle_frame(frame_id, payload, 1.0 + step)
        if is_running and frame_id == SCORE and len(payload) == 24:
            has_good_score = has_good_score or 0.0 <= struct.unpack_from(">f", payload)[0] <= 2.0
        assert 0 <= calibration.report.percent <= 100
        assert has_good_score or calibration.report.state is not DONE
