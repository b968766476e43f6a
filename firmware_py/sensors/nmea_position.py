"""Driver of a GNSS receiver with NMEA 0183."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.geodesy import is_possible_position
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import option
from firmware_py.common.records import DeviceRole, FixType, PositionSample
from firmware_py.sensors.nmea_fields import SECONDS_PER_DAY
from firmware_py.sensors.nmea_reader import CAPTURE_FORMAT, NmeaReader
from firmware_py.sensors.nmea_sentences import DecodedSentence
from firmware_py.sensors.sensor_driver import SensorDriver

FIX_SENTENCES = frozenset({"RMC", "GGA", "GNS", "GLL"})
OTHER_SENTENCES = frozenset({"VTG", "ZDA"})
EPOCH_TIMEOUT_S = 0.5  # an epoch is one burst; a lost sentence must not delay it for long
MAX_REPEATED_TIME_S = 3.0  # some receivers repeat whole seconds at rates above 1 Hz; a hanging one does so for longer
MAX_HDOP = 1e3  # larger values mean unknown; some receivers send 9999

# GGA field 6; dead reckoning (6), manual input (7) and simulation (8) are not used.
_QUALITIES: Mapping[float, FixType] = {
    1: FixType.FIX_3D,
    2: FixType.DGPS,
    3: FixType.FIX_3D,
    4: FixType.RTK_FIXED,
    5: FixType.RTK_FLOAT,
}
# The mode letter of RMC, GLL, GNS; estimated, manual, simulated and invalid are not used.
_MODES: Mapping[str, FixType] = {
    "A": FixType.FIX_3D,
    "P": FixType.FIX_3D,
    "D": FixType.DGPS,
    "F": FixType.RTK_FLOAT,
    "R": FixType.RTK_FIXED,
}


@dataclass(slots=True)
class _Epoch:
    """The merged sentences of one instant; `t_s` is the arrival of the last one."""

    t_s: float
    has_time: bool = False  # whether a sentence with a time has arrived; VTG has none
    time_of_day_s: float | None = None
    kinds: set[str] = field(default_factory=set)
    fixes: list[FixType] = field(default_factory=list)
    values: dict[str, float] = field(default_factory=dict)
    is_emitted: bool = False

    def is_ended_by(self, kind: str, decoded: DecodedSentence, now_s: float) -> bool:
        """Return whether a sentence belongs to the next epoch, not to this one."""
        if kind in self.kinds:
            return True
        if kind == "VTG":
            return now_s - self.t_s > EPOCH_TIMEOUT_S
        return self.has_time and decoded.numbers["time_of_day_s"] != self.time_of_day_s

    def add(self, kind: str, decoded: DecodedSentence, now_s: float) -> None:
        """Merge a sentence into the epoch."""
        self.t_s = now_s
        self.kinds.add(kind)
        self.values.update({name: value for name, value in decoded.numbers.items() if value is not None})
        if kind in FIX_SENTENCES:
            self.has_time = True
            self.time_of_day_s = decoded.numbers["time_of_day_s"]
            self.fixes.append(_decode_fix(decoded))


@dataclass(frozen=True, slots=True)
class NmeaPositionOptions:
    """Options of the vehicle file for an NMEA receiver."""

    require_checksum: bool = option("whether to reject sentences without a checksum", default=True)


class NmeaPosition(SensorDriver[PositionSample]):
    """Returns one sample per epoch, merged from RMC, GGA, GNS, GLL and VTG.

    Sentences with the same time of day form an epoch. VTG has no time and belongs to the burst in which it arrives. A
    repeated kind starts the next epoch. An epoch is complete when all kinds of the previous epoch have arrived, when
    the next one starts, or EPOCH_TIMEOUT_S after its last sentence; its time stamp is the arrival of that sentence.
    The fix is NONE if any sentence reports no valid fix (status V, quality 0, a mode without a measured position), or
    if the time of day does not advance, because a hanging receiver repeats an old position. The date is that of RMC,
    otherwise of ZDA; without a date the UTC is extrapolated from the last one. Every valid sentence counts as accepted,
    also one without a fix.
    """

    def __init__(self, line: ByteLine, options: NmeaPositionOptions) -> None:
        """Store line and options."""
        super().__init__(line, DeviceRole.POSITION)
        self._reader = NmeaReader(
            line,
            self._monitor,
            FIX_SENTENCES | OTHER_SENTENCES,
            require_checksum=options.require_checksum,
        )
        self._epoch: _Epoch | None = None
        self._expected_kinds: frozenset[str] = frozenset()
        self._last_utc: tuple[float, float] | None = None  # time of arrival, UTC
        self._last_time_of_day: tuple[float, float] | None = None  # the last time of day, and when it first arrived

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._reader.restart()
            self._epoch = self._last_utc = self._last_time_of_day = None
            self._expected_kinds = frozenset()
        for sentence, decoded in self._reader.read(now_s):
            self._monitor.accept(now_s)
            if sentence.kind == "ZDA":
                self._note_utc(decoded.numbers["utc_s"], now_s)
            else:
                self._add_to_epoch(sentence.kind, decoded, now_s)
        if self._epoch is not None and now_s - self._epoch.t_s > EPOCH_TIMEOUT_S:
            self._emit(self._epoch)

    def _add_to_epoch(self, kind: str, decoded: DecodedSentence, now_s: float) -> None:
        """Add a sentence to its epoch; complete the previous one if necessary."""
        epoch = self._epoch
        if epoch is None or epoch.is_ended_by(kind, decoded, now_s):
            if epoch is not None and epoch.fixes:
                self._emit(epoch)
                self._expected_kinds = frozenset(epoch.kinds)
            epoch = self._epoch = _Epoch(now_s)
        epoch.add(kind, decoded, now_s)
        if self._expected_kinds and epoch.kinds >= self._expected_kinds:
            self._emit(epoch)

    def _emit(self, epoch: _Epoch) -> None:
        """Append the sample of an epoch, once."""
        if epoch.is_emitted or not epoch.fixes:
            return
        epoch.is_emitted = True
        values = epoch.values
        fix = FixType.NONE if FixType.NONE in epoch.fixes else max(epoch.fixes)
        reason = "time not advancing: no fix" if self._is_time_frozen(epoch) else ""
        if fix is FixType.NONE or "lat_deg" not in values or "lon_deg" not in values:
            reason = reason or "no fix"
        elif not is_possible_position(radians(values["lat_deg"]), radians(values["lon_deg"])):
            reason = reason or "position invalid: no fix"
        if reason:
            self._monitor.note(reason)
            self._samples.append(PositionSample(epoch.t_s, FixType.NONE, satellites=_to_int(values.get("satellites"))))
            return
        self._monitor.note("")
        course_deg, hdop = values.get("cog_deg"), values.get("hdop")
        self._samples.append(
            PositionSample(
                t_s=epoch.t_s,
                fix=FixType.FIX_2D if fix is FixType.FIX_3D and "altitude_m" not in values else fix,
                latitude_rad=radians(values["lat_deg"]),
                longitude_rad=radians(values["lon_deg"]),
                altitude_m=values.get("altitude_m"),
                speed_over_ground_m_s=values.get("sog_m_s"),
                course_over_ground_rad=None if course_deg is None else wrap_two_pi(radians(course_deg)),
                satellites=_to_int(values.get("satellites")),
                hdop=None if hdop is None or hdop > MAX_HDOP else hdop,
                utc_s=self._compute_utc_s(epoch),
            )
        )

    def _is_time_frozen(self, epoch: _Epoch) -> bool:
        """Return whether the time of day has not advanced for MAX_REPEATED_TIME_S."""
        if epoch.time_of_day_s is None:
            return False
        if self._last_time_of_day is None or self._last_time_of_day[0] != epoch.time_of_day_s:
            self._last_time_of_day = (epoch.time_of_day_s, epoch.t_s)
        return epoch.t_s - self._last_time_of_day[1] > MAX_REPEATED_TIME_S

    def _note_utc(self, utc_s: float | None, now_s: float) -> None:
        if utc_s is not None:
            self._last_utc = (now_s, utc_s)

    def _compute_utc_s(self, epoch: _Epoch) -> float | None:
        """Return the UTC of an epoch: as received, or its time of day on the day nearest to the expected UTC."""
        stated_s = epoch.values.get("utc_s")
        if stated_s is not None or self._last_utc is None or epoch.time_of_day_s is None:
            self._note_utc(stated_s, epoch.t_s)
            return stated_s
        expected_s = self._last_utc[1] + epoch.t_s - self._last_utc[0]
        days = round((expected_s - epoch.time_of_day_s) / SECONDS_PER_DAY)
        return days * SECONDS_PER_DAY + epoch.time_of_day_s


def _decode_fix(decoded: DecodedSentence) -> FixType:
    """Return the fix type of one sentence."""
    if "quality" in decoded.numbers:
        return _QUALITIES.get(decoded.numbers["quality"] or 0.0, FixType.NONE)
    if decoded.letters.get("status", "A") != "A":
        return FixType.NONE
    mode = decoded.letters["mode"]  # GNS has one letter per constellation; none before NMEA 2.3
    if not mode:
        return FixType.FIX_3D
    return max(_MODES.get(letter, FixType.NONE) for letter in mode)


def _to_int(value: float | None) -> int | None:
    return None if value is None else int(value)


DRIVER = Driver(
    interface=INTERFACE,
    device="NMEA 0183 receivers (RMC, GGA, GNS, GLL, VTG, ZDA)",
    options=NmeaPositionOptions,
    make=NmeaPosition,
    capture=CAPTURE_FORMAT,
)
