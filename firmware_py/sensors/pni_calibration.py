"""User calibration of a PNI compass for hard and soft iron, while the boat turns slowly through a full circle.

Source: TCM user manual, DOC#1014688 r06, sections 7.3.10 to 7.3.18. This is the 2D calibration, for a boat that cannot
be tilted. The module takes samples while its heading changes and then sends a score; only a good result is saved.
During the calibration there are no headings.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping

from firmware_py.common.records import Calibration, CalibrationState
from firmware_py.sensors import pni_protocol as pni
from firmware_py.sensors.pni_protocol import Frame

POINT_COUNT = 12
MAX_SCORE = 2.0  # acceptable for all calibrations but the full-range one
COMMAND_INTERVAL_S = 0.2  # between two commands
MAX_SAMPLING_S = 600.0  # for the full circle
MAX_SCORING_S = 150.0  # the manual states more than a minute
MAX_SAVING_S = 5.0
SAMPLED_PERCENT, SAVING_PERCENT = 95, 99  # progress with all samples, and with a good score
_CALIBRATION_2D = 20
_POINT_COUNT_ID, _AUTOMATIC_SAMPLING_ID = 12, 13

_START_FRAMES = (
    pni.encode(Frame.STOP_CONTINUOUS),
    pni.encode(Frame.SET_CONFIG, struct.pack(">BI", _POINT_COUNT_ID, POINT_COUNT)),
    pni.encode(Frame.SET_CONFIG, bytes((_AUTOMATIC_SAMPLING_ID, 1))),
    pni.encode(Frame.START_CAL, struct.pack(">I", _CALIBRATION_2D)),
)


class PniCalibration:
    """One calibration: returns the frames to send and processes the replies of the module."""

    def __init__(self, now_s: float) -> None:
        """Start the calibration at now_s."""
        self._frames = list(_START_FRAMES)
        self._due_s = now_s
        self._deadline_s = now_s + MAX_SAMPLING_S
        self._sampled_points = 0
        self._report = Calibration(CalibrationState.RUNNING)
        self._handlers: Mapping[int, Callable[[bytes, float], None]] = {
            Frame.CAL_SAMPLE_COUNT: self._handle_count,
            Frame.CAL_SCORE: self._handle_score,
            Frame.SAVE_DONE: self._handle_save_done,
        }

    @property
    def report(self) -> Calibration:
        """The progress, or the result."""
        return self._report

    def next_frame(self, now_s: float) -> bytes | None:
        """Return the command that is due, None without one; after a timeout the calibration fails."""
        if now_s > self._deadline_s:
            self._end(
                CalibrationState.FAILED, f"Compass calibration failed: timeout after {self._sampled_points} points"
            )
        if not self._frames or now_s < self._due_s:
            return None
        return self._frames[0]

    def note_sent(self, now_s: float) -> None:
        """Note that the command was sent."""
        self._frames.pop(0)
        self._due_s = now_s + COMMAND_INTERVAL_S

    def handle_frame(self, frame_id: int, payload: bytes, now_s: float) -> None:
        """Process a frame of the module; unrelated and malformed frames are ignored."""
        handler = self._handlers.get(frame_id)
        if handler is not None and self._report.state is CalibrationState.RUNNING:
            handler(payload, now_s)

    def _handle_count(self, payload: bytes, now_s: float) -> None:
        if len(payload) != 4:
            return
        self._sampled_points = min(POINT_COUNT, int.from_bytes(payload, "big"))
        self._report = Calibration(CalibrationState.RUNNING, SAMPLED_PERCENT * self._sampled_points // POINT_COUNT)
        if self._sampled_points == POINT_COUNT:
            self._deadline_s = now_s + MAX_SCORING_S

    def _handle_score(self, payload: bytes, now_s: float) -> None:
        if len(payload) != 24:
            return
        (score,) = struct.unpack_from(">f", payload)
        # In this form, NaN is rejected.
        if not 0.0 <= score <= MAX_SCORE:
            value = f"{score:.1f}" if math.isfinite(score) else "none"
            text = f"Compass calibration not saved: score {value}, at most {MAX_SCORE:g}; switch the compass off and on"
            self._end(CalibrationState.FAILED, text)
            return
        text = f"Compass calibrated and saved: score {score:.1f}"
        self._report = Calibration(CalibrationState.RUNNING, SAVING_PERCENT, text)
        self._frames = [pni.encode(Frame.SAVE)]
        self._due_s, self._deadline_s = now_s, now_s + MAX_SAVING_S

    def _handle_save_done(self, payload: bytes, _now_s: float) -> None:
        if self._report.percent < SAVING_PERCENT:
            return  # no save was requested
        if payload == b"\x00\x00":  # error code 0: saved
            self._end(CalibrationState.DONE, self._report.text)
        else:
            self._end(CalibrationState.FAILED, "Compass calibration failed: the compass could not save it")

    def _end(self, state: CalibrationState, text: str) -> None:
        if self._report.state is CalibrationState.RUNNING:
            self._report = Calibration(state, 100, text)
