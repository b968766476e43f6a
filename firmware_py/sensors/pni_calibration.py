"""The user calibration of a PNI compass: turned slowly through a full circle, it learns the iron around it.

Source: TCM user manual, DOC#1014688 r06, sections 7.3.10 to 7.3.18. The 2D calibration, for what
cannot be tilted at will. The module samples by itself as its heading changes and sends a
score; only a good one is saved. It gives no headings meanwhile.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping

from firmware_py.common.records import Calibration, CalibrationState
from firmware_py.sensors import pni_protocol as pni
from firmware_py.sensors.pni_protocol import Frame

POINTS = 12
WORST_SCORE = 2.0  # acceptable for all calibrations but the full range one
STEP_S = 0.2  # between two commands
SAMPLING_S = 600.0  # for the whole circle
SCORING_S = 150.0  # the manual: it may take more than a minute
SAVING_S = 5.0
_TWO_DIMENSIONS = 20
_POINTS_ID, _AUTOMATIC_ID = 12, 13

_BEGIN = (
    pni.encode(Frame.STOP_CONTINUOUS),
    pni.encode(Frame.SET_CONFIG, struct.pack(">BI", _POINTS_ID, POINTS)),
    pni.encode(Frame.SET_CONFIG, bytes((_AUTOMATIC_ID, 1))),
    pni.encode(Frame.START_CAL, struct.pack(">I", _TWO_DIMENSIONS)),
)


class PniCalibration:
    """Runs one calibration: hands out the frames to send and takes what the module answers."""

    def __init__(self, now_s: float) -> None:
        """Begin now."""
        self._frames = list(_BEGIN)
        self._due_s = now_s
        self._give_up_s = now_s + SAMPLING_S
        self._points = 0
        self._report = Calibration(CalibrationState.RUNNING)
        self._takers: Mapping[int, Callable[[bytes, float], None]] = {
            Frame.CAL_SAMPLE_COUNT: self._take_count,
            Frame.CAL_SCORE: self._take_score,
            Frame.SAVE_DONE: self._take_saving,
        }

    @property
    def report(self) -> Calibration:
        """How far it is."""
        return self._report

    def next_frame(self, now_s: float) -> bytes | None:
        """Return the command that is due, None when none is; end it when the module has been silent for too long."""
        if now_s > self._give_up_s:
            self._end(CalibrationState.FAILED, f"Compass calibration: no end after {self._points} points")
        if not self._frames or now_s < self._due_s:
            return None
        return self._frames[0]

    def note_sent(self, now_s: float) -> None:
        """Note that the command has left."""
        self._frames.pop(0)
        self._due_s = now_s + STEP_S

    def take(self, frame_id: int, payload: bytes, now_s: float) -> None:
        """Take a frame of the module; those of other matters, and malformed ones, say nothing here."""
        taker = self._takers.get(frame_id)
        if taker is not None and self._report.state is CalibrationState.RUNNING:
            taker(payload, now_s)

    def _take_count(self, payload: bytes, now_s: float) -> None:
        if len(payload) != 4:
            return
        self._points = min(POINTS, int.from_bytes(payload, "big"))
        self._report = Calibration(CalibrationState.RUNNING, 95 * self._points // POINTS)
        if self._points == POINTS:
            self._give_up_s = now_s + SCORING_S

    def _take_score(self, payload: bytes, now_s: float) -> None:
        if len(payload) != 24:
            return
        (score,) = struct.unpack_from(">f", payload)
        # Written so that NaN fails the comparison.
        if not 0.0 <= score <= WORST_SCORE:
            shown = f"{score:.1f}" if math.isfinite(score) else "none"
            text = (
                f"Compass calibration not saved: score {shown}, at most {WORST_SCORE:g}; switch the compass off and on"
            )
            self._end(CalibrationState.FAILED, text)
            return
        self._report = Calibration(CalibrationState.RUNNING, 99, f"Compass calibrated and saved: score {score:.1f}")
        self._frames = [pni.encode(Frame.SAVE)]
        self._due_s, self._give_up_s = now_s, now_s + SAVING_S

    def _take_saving(self, payload: bytes, _now_s: float) -> None:
        if self._report.percent < 99:
            return
        if payload == b"\x00\x00":
            self._end(CalibrationState.DONE, self._report.text)
        else:
            self._end(CalibrationState.FAILED, "Compass calibration: the compass could not save it")

    def _end(self, state: CalibrationState, text: str) -> None:
        if self._report.state is CalibrationState.RUNNING:
            self._report = Calibration(state, 100, text)
