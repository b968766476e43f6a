"""Driver of a wind sensor with NMEA 0183.

Source: Airmar PB200 WeatherStation User Manual 1.000 (MWV, MWD, VWR, VWT; VWT is the wind over the water).
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceRole, WindReference, WindSample
from firmware_py.sensors.nmea_preference import MAX_WIND_M_S, WIND_RANKS, Preference
from firmware_py.sensors.nmea_reader import CAPTURE_FORMAT, NmeaReader
from firmware_py.sensors.nmea_sentences import DecodedSentence
from firmware_py.sensors.sensor_driver import SensorDriver

WIND_SENTENCES = ("MWV", "VWR", "MWD", "VWT")
SILENT_AFTER_S = 5.0  # a sensor may send once in two seconds


@dataclass(frozen=True, slots=True)
class NmeaWindOptions:
    """Options of the vehicle file for an NMEA wind sensor; raises ValueError."""

    sentences: tuple[str, ...] = option(
        "wind sentences to use; empty: all, apparent wind preferred", default=(), choices=WIND_SENTENCES
    )
    offset_deg: float = option(
        "mounting angle of the sensor, clockwise from the bow, added to wind angles from the bow",
        default=0.0,
        minimum=-180.0,
        maximum=180.0,
    )
    require_checksum: bool = option("whether to reject sentences without a checksum", default=True)

    def __post_init__(self) -> None:
        """Check the sentences and the range."""
        check(self)


class NmeaWind(SensorDriver[WindSample]):
    """Returns the wind of MWV, VWR, MWD and VWT.

    Sensors send one measurement in several sentences. Only the apparent wind (MWV R, VWR) is used while it is received,
    otherwise the wind from true north (MWD), from the bow (MWV T, VWT), or from magnetic north (MWD). Every valid wind
    sentence counts as accepted, also one without a wind.
    """

    def __init__(self, line: ByteLine, options: NmeaWindOptions) -> None:
        """Store line and options."""
        super().__init__(line, DeviceRole.WIND, SILENT_AFTER_S)
        self._offset_deg = options.offset_deg
        self._reader = NmeaReader(
            line,
            self._monitor,
            options.sentences or WIND_SENTENCES,
            require_checksum=options.require_checksum,
            by_option=bool(options.sentences),
        )
        self._preference = Preference(WIND_RANKS)

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._reader.restart()
            self._preference = Preference(WIND_RANKS)
        for sentence, decoded in self._reader.read(now_s):
            self._handle_sentence(sentence.address, sentence.kind, decoded, now_s)

    def _handle_sentence(self, address: str, kind: str, decoded: DecodedSentence, now_s: float) -> None:
        wind_m_s = decoded.numbers["wind_speed_m_s"]
        if wind_m_s is not None and wind_m_s > MAX_WIND_M_S:
            self._monitor.reject(now_s, f"{address}: wind_speed_m_s {wind_m_s:.10g} out of range")
            return
        self._monitor.accept(now_s)
        reference, angle_deg = _read_angle(kind, decoded)
        if reference is None or angle_deg is None or wind_m_s is None:
            self._monitor.note(f"{address}: no wind")
            return
        if not self._preference.accepts(reference, now_s):
            return
        self._monitor.note("")
        is_from_bow = reference not in (WindReference.NORTH, WindReference.MAGNETIC)
        angle_rad = wrap_two_pi(radians(angle_deg + (self._offset_deg if is_from_bow else 0.0)))
        self._samples.append(WindSample(now_s, wind_m_s, angle_rad, reference))


def _read_angle(kind: str, decoded: DecodedSentence) -> tuple[WindReference | None, float | None]:
    """Return the reference and the angle [deg] of a wind sentence; one of them is None if it is not valid."""
    numbers = decoded.numbers
    if kind == "MWD":
        north_deg = numbers["wind_from_true_deg"]
        if north_deg is None:
            return WindReference.MAGNETIC, numbers["wind_from_magnetic_deg"]
        return WindReference.NORTH, north_deg
    if kind != "MWV":
        return (WindReference.APPARENT if kind == "VWR" else WindReference.BOW_WATER), numbers["wind_angle_deg"]
    references = {"R": WindReference.APPARENT, "T": WindReference.BOW}
    is_valid = decoded.letters["status"] == "A"
    return references.get(decoded.letters["reference"]) if is_valid else None, numbers["wind_angle_deg"]


DRIVER = Driver(
    interface=INTERFACE,
    device="NMEA 0183 wind sensors (MWV, VWR, MWD, VWT)",
    options=NmeaWindOptions,
    make=NmeaWind,
    capture=CAPTURE_FORMAT,
)
