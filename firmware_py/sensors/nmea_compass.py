"""Driver of a compass with NMEA 0183."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceRole, HeadingSample, NorthReference
from firmware_py.sensors.nmea_reader import CAPTURE_FORMAT, NmeaReader
from firmware_py.sensors.nmea_sentences import DecodedSentence, Numbers
from firmware_py.sensors.sensor_driver import SensorDriver

HEADING_SENTENCES = ("HDG", "HDT", "HDM", "THS", "PASHR")
ADDITIONAL_SENTENCES = ("ROT", "XDR")
TURN_RATE_HOLD_S = 1.0
ATTITUDE_HOLD_S = 2.5  # XDR has a period of 1 s
MIN_TRUE_HEADINGS = 3
TRUE_HOLD_S = 2.0
MAX_DEVIATION_DEG = 3.0  # a larger deviation may be the variation
SAME_HEADING_S, SAME_HEADING_DEG = 0.3, 1.5  # maximum differences between two sentences of one heading

# THS: autonomous (A) and estimated (E: a satellite compass that uses its gyro); not manual, simulated or invalid.
_THS_MODES = frozenset("AE")


@dataclass(frozen=True, slots=True)
class NmeaCompassOptions:
    """Options of the vehicle file for an NMEA compass; raises ValueError."""

    sentences: tuple[str, ...] = option(
        "heading sentences to use; empty: all, true headings preferred",
        default=(),
        choices=HEADING_SENTENCES,
    )
    require_checksum: bool = option("whether to reject sentences without a checksum", default=True)

    def __post_init__(self) -> None:
        """Check the sentences."""
        check(self)


class NmeaCompass(SensorDriver[HeadingSample]):
    """Returns every heading of HDG, HDT, HDM, THS and PASHR, with the yaw rate of ROT and roll and pitch of XDR.

    HDG is true if it states its variation, otherwise magnetic; the estimator checks the variation. VHW repeats the
    heading later and at a lower rate and is ignored. All true sentences are returned. Magnetic ones are ignored after
    MIN_TRUE_HEADINGS true ones at intervals of at most TRUE_HOLD_S, until the last one is older than that: the two
    would differ by the error of the variation. Only headings count as accepted.
    """

    def __init__(self, line: ByteLine, options: NmeaCompassOptions) -> None:
        """Store line and options."""
        super().__init__(line, DeviceRole.COMPASS)
        self._reader = NmeaReader(
            line,
            self._monitor,
            {*(options.sentences or HEADING_SENTENCES), *ADDITIONAL_SENTENCES},
            require_checksum=options.require_checksum,
            by_option=bool(options.sentences),
        )
        self._turn_rate: tuple[float, float] | None = None  # time, rate [rad/s]
        self._attitude: dict[str, tuple[float, float]] = {}  # time and angle [rad] by name
        self._true_count = 0
        self._true_s = 0.0
        self._stated_variation: tuple[float, float, float] | None = None  # time, true heading, variation [deg] of HDG
        self._uses_stated_variation = False  # whether other true headings contain the variation of HDG

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._reader.restart()
            self._turn_rate = None
            self._attitude.clear()
            self._true_count = 0
        for sentence, decoded in self._reader.read(now_s):
            if sentence.kind == "ROT":
                self._handle_turn(decoded, now_s)
            elif sentence.kind == "XDR":
                for name in ("roll_deg", "pitch_deg"):
                    if (angle_deg := decoded.numbers.get(name)) is not None:
                        self._attitude[name] = (now_s, radians(angle_deg))
            elif sentence.kind == "THS" and decoded.letters["mode"] not in _THS_MODES:
                self._monitor.note(f"{sentence.address}: heading not valid")
            else:
                self._handle_heading(sentence.address, decoded.numbers, now_s)

    def _handle_turn(self, decoded: DecodedSentence, now_s: float) -> None:
        turn_rate_deg_min = decoded.numbers["turn_rate_deg_min"]
        if turn_rate_deg_min is None or decoded.letters["status"] != "A":
            self._turn_rate = None
        else:
            self._turn_rate = (now_s, radians(turn_rate_deg_min / 60.0))

    def _recent_yaw_rate_rad_s(self, now_s: float) -> float | None:
        if self._turn_rate is None or now_s - self._turn_rate[0] > TURN_RATE_HOLD_S:
            return None
        return self._turn_rate[1]

    def _recent_attitude_rad(self, name: str, numbers: Numbers, now_s: float) -> float | None:
        """Return an angle of the sentence, else that of the last XDR; None if that is too old."""
        if name in numbers:
            return _radians_or_none(numbers[name])
        t_s, angle_rad = self._attitude.get(name, (-math.inf, 0.0))
        return angle_rad if now_s - t_s <= ATTITUDE_HOLD_S else None

    def _find_variation(self, true_deg: float, now_s: float) -> float | None:
        """Return the variation contained in a true heading: that of HDG if both headings agree, else None."""
        if self._stated_variation is None or now_s - self._stated_variation[0] > TRUE_HOLD_S:
            return None
        stated_s, stated_deg, variation_deg = self._stated_variation
        if now_s - stated_s <= SAME_HEADING_S:
            self._uses_stated_variation = abs((true_deg - stated_deg + 180.0) % 360.0 - 180.0) <= SAME_HEADING_DEG
        return variation_deg if self._uses_stated_variation else None

    def _handle_heading(self, address: str, numbers: Numbers, now_s: float) -> None:
        true_deg, magnetic_deg = numbers.get("heading_true_deg"), numbers.get("heading_magnetic_deg")
        variation_deg, deviation_deg = numbers.get("variation_deg"), numbers.get("deviation_deg")
        if deviation_deg is not None and abs(deviation_deg) > MAX_DEVIATION_DEG and not variation_deg:
            # Some compasses state the variation as deviation: the heading counts as magnetic.
            true_deg, variation_deg = None, deviation_deg
        if true_deg is not None:
            if variation_deg is None:
                variation_deg = self._find_variation(true_deg, now_s)
            else:
                self._stated_variation = (now_s, true_deg, variation_deg)
        heading_deg = magnetic_deg if true_deg is None else true_deg
        if heading_deg is None:
            self._monitor.note(f"{address}: no heading")
            return
        if true_deg is not None:
            # True headings at long intervals do not suppress magnetic ones.
            self._true_count = self._true_count + 1 if now_s - self._true_s <= TRUE_HOLD_S else 1
            self._true_s = now_s
        elif self._true_count >= MIN_TRUE_HEADINGS and now_s - self._true_s <= TRUE_HOLD_S:
            return
        self._monitor.accept(now_s)
        self._monitor.note("")
        self._samples.append(
            HeadingSample(
                t_s=now_s,
                heading_rad=wrap_two_pi(radians(heading_deg)),
                reference=NorthReference.MAGNETIC if true_deg is None else NorthReference.TRUE,
                variation_rad=_radians_or_none(variation_deg),
                yaw_rate_rad_s=self._recent_yaw_rate_rad_s(now_s),
                roll_rad=self._recent_attitude_rad("roll_deg", numbers, now_s),
                pitch_rad=self._recent_attitude_rad("pitch_deg", numbers, now_s),
            )
        )


def _radians_or_none(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else radians(angle_deg)


DRIVER = Driver(
    interface=INTERFACE,
    device="NMEA 0183 compasses (HDT, HDG, HDM, THS, PASHR, ROT, XDR)",
    options=NmeaCompassOptions,
    make=NmeaCompass,
    capture=CAPTURE_FORMAT,
)
