"""Driver of an echo sounder with NMEA 0183.

Sources: Airmar DST800 and DT800 manuals (DPT, DBT), NMEA Revealed (gpsd; DBS, DBK and the sign of the offset of DPT).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DepthSample, DeviceRole
from firmware_py.sensors.nmea_preference import Preference
from firmware_py.sensors.nmea_reader import CAPTURE_FORMAT, NmeaReader
from firmware_py.sensors.nmea_sentences import Numbers
from firmware_py.sensors.sensor_driver import SensorDriver

# DBS and DPT contain or may contain the depth of the transducer, DBT and DBK do not.
_RANKS: Mapping[str, int] = {"DBS": 0, "DPT": 1, "DBT": 2, "DBK": 3}
DEPTH_SENTENCES = tuple(_RANKS)
SILENT_AFTER_S = 5.0  # a sounder may send once in two seconds


@dataclass(frozen=True, slots=True)
class NmeaDepthOptions:
    """Options of the vehicle file for an NMEA echo sounder; raises ValueError."""

    sentences: tuple[str, ...] = option(
        "depth sentences to use; empty: all, DBS and DPT preferred", default=(), choices=DEPTH_SENTENCES
    )
    transducer_depth_m: float = option(
        "depth of the transducer below the surface, added to DBT and to DPT without an offset to the surface",
        default=0.0,
        minimum=0.0,
        maximum=100.0,
    )
    keel_depth_m: float = option(
        "depth of the keel below the surface, added to DBK", default=0.0, minimum=0.0, maximum=100.0
    )
    require_checksum: bool = option("whether to reject sentences without a checksum", default=True)

    def __post_init__(self) -> None:
        """Check the sentences and the ranges."""
        check(self)


class NmeaDepth(SensorDriver[DepthSample]):
    """Returns the water depth below the surface of DBS, DPT, DBT and DBK.

    Sounders send one measurement in several sentences; only the best one in that order is used while it is received. A
    depth of 0 below the transducer means that the sounder has lost the bottom, and gives no sample. Every valid depth
    sentence counts as accepted.
    """

    def __init__(self, line: ByteLine, options: NmeaDepthOptions) -> None:
        """Store line and options."""
        super().__init__(line, DeviceRole.DEPTH, SILENT_AFTER_S)
        self._options = options
        self._reader = NmeaReader(
            line,
            self._monitor,
            options.sentences or DEPTH_SENTENCES,
            require_checksum=options.require_checksum,
            by_option=bool(options.sentences),
        )
        self._preference = Preference(_RANKS)

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._reader.restart()
            self._preference = Preference(_RANKS)
        for sentence, decoded in self._reader.read(now_s):
            self._monitor.accept(now_s)
            sample = self._make_sample(sentence.kind, decoded.numbers, now_s)
            if sample is None:
                self._monitor.note(f"{sentence.address}: no bottom")
            elif self._preference.accepts(sentence.kind, now_s):
                self._monitor.note("")
                self._samples.append(sample)

    def _make_sample(self, kind: str, numbers: Numbers, now_s: float) -> DepthSample | None:
        """Return the sample of a sentence; None without a depth."""
        transducer_m = self._options.transducer_depth_m
        if kind == "DBS":
            depth_m = numbers["depth_below_surface_m"]
        elif kind == "DBK":
            below_keel_m = numbers["depth_below_keel_m"]
            depth_m = None if not below_keel_m else below_keel_m + self._options.keel_depth_m
        else:
            offset_m = numbers.get("offset_m")
            transducer_m = offset_m if offset_m is not None and offset_m > 0.0 else transducer_m
            below_transducer_m = numbers["depth_below_transducer_m"]
            depth_m = None if not below_transducer_m else below_transducer_m + transducer_m
        return DepthSample(now_s, depth_m, transducer_m) if depth_m else None


DRIVER = Driver(
    interface=INTERFACE,
    device="NMEA 0183 echo sounders (DBS, DPT, DBT, DBK)",
    options=NmeaDepthOptions,
    make=NmeaDepth,
    capture=CAPTURE_FORMAT,
)
