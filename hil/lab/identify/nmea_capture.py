"""Read a capture of NMEA 0183: heading of HDG, HDT, HDM or THS, rudder of RSA or XDR, speed of VHW or RMC.

A capture does not contain arrival times. Sentences without a time are spread evenly between those with one (RMC, GGA,
GLL, ZDA).
"""

from __future__ import annotations

import os
from collections import defaultdict
from pathlib import Path

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.files.reading import open_regular
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.nmea_framing import NmeaFramer
from firmware_py.sensors.nmea_sentences import DecodedSentence, decode_sentence
from hil.errors import UsageError
from hil.lab.identify.onboard_log import Pair, smooth_speed
from hil.lab.identify.recording import MIN_ROWS, Recording
from hil.lab.identify.table_text import MAX_BYTES

HEAD_BYTES = 4096  # is_capture reads only this start of the file
MIN_SENTENCES = 3  # number of valid sentences in the start of a capture
DAY_S = 86400.0
HEADING_FIELDS = ("heading_true_deg", "heading_magnetic_deg", "sensor_deg")
HEADING_SENTENCES = ("HDG", "HDT", "HDM", "THS")
USED_SENTENCES = frozenset((*HEADING_SENTENCES, "RSA", "XDR", "VHW", "RMC", "GGA", "GLL", "GNS", "ZDA"))


def is_capture(path: Path) -> bool:
    """Return whether a file starts with NMEA sentences with valid checksums."""
    try:
        with os.fdopen(open_regular(path, max_bytes=MAX_BYTES), "rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return False
    valid = [sentence for sentence in NmeaFramer().feed(head) if not sentence.fault]
    lines = [line for line in head.splitlines() if line.strip() and not line.startswith(b"#")]
    return len(valid) >= MIN_SENTENCES and lines[0].lstrip().startswith((b"$", b"!"))


def read(path: Path) -> Recording:
    """Read a capture, or raise UsageError."""
    clock_readings, series, damaged_count = _read_sentences(path.read_bytes())
    if len(clock_readings) < 2:
        raise UsageError(
            f"{path}: NMEA 0183 with too few different times ({len(clock_readings)} of at least 2); "
            "also record RMC, GGA, GLL or ZDA"
        )
    sentence_numbers, time_of_day_s = np.array(clock_readings).T
    day_count = np.cumsum(np.diff(time_of_day_s, prepend=time_of_day_s[0]) < -0.5 * DAY_S)
    clock_s = time_of_day_s + DAY_S * day_count
    # Interpolation needs increasing times: omit each time that is not later than all previous ones.
    is_later = np.concatenate(([True], np.diff(np.maximum.accumulate(clock_s)) > 0.0))
    sentence_numbers, clock_s = sentence_numbers[is_later], clock_s[is_later]

    def interpolate_times(name: str) -> list[Pair]:
        """Return (time, value) of a series between the first and the last sentence with a time."""
        pairs = np.array(series[name]).reshape(-1, 2)
        pairs = pairs[(pairs[:, 0] >= sentence_numbers[0]) & (pairs[:, 0] <= sentence_numbers[-1])]
        times_s = np.interp(pairs[:, 0], sentence_numbers, clock_s)
        return list(zip(times_s.tolist(), pairs[:, 1].tolist(), strict=True))

    sentence_type = max(HEADING_SENTENCES, key=lambda sentence_name: len(series[sentence_name]))
    heading = np.array(interpolate_times(sentence_type)).reshape(-1, 2)
    rudder = np.array(interpolate_times("rudder")).reshape(-1, 2)
    if heading.shape[0] < MIN_ROWS or rudder.shape[0] < MIN_ROWS:
        raise UsageError(
            f"{path}: NMEA 0183 with {heading.shape[0]} headings and {rudder.shape[0]} rudder angles (RSA, XDR) "
            f"between the first and the last time; at least {MIN_ROWS} of each are needed"
        )
    # One row per sample of the slower sensor: interpolation of the rudder between its samples would make T too short.
    slower_series = min(heading, rudder, key=len)
    time_s = np.unique(slower_series[:, 0])
    time_s = time_s[(time_s >= max(heading[0, 0], rudder[0, 0])) & (time_s <= min(heading[-1, 0], rudder[-1, 0]))]
    notes = [f"NMEA 0183: headings of {sentence_type}; sentences without a time are spread between those with one"]
    if damaged_count:
        notes.append(f"{damaged_count} damaged sentences ignored")
    speed_name = "water speed" if len(series["water speed"]) >= MIN_ROWS else "ground speed"
    speed = smooth_speed(interpolate_times(speed_name), time_s, notes)
    return Recording(
        str(path),
        time_s - time_s[0],
        np.interp(time_s, rudder[:, 0], rudder[:, 1]) * radians(1.0),
        np.interp(time_s, heading[:, 0], np.unwrap(heading[:, 1] * radians(1.0))),
        None,
        speed,
        tuple(notes),
    )


def _read_sentences(data: bytes) -> tuple[list[Pair], dict[str, list[Pair]], int]:
    """Return clock readings, series and the number of damaged sentences; pairs begin with the sentence number."""
    clock_readings: list[Pair] = []
    series: dict[str, list[Pair]] = defaultdict(list)
    framer, damaged_count = NmeaFramer(), 0
    for number, sentence in enumerate([*framer.feed(data), *framer.finish()]):
        if sentence.kind not in USED_SENTENCES:
            continue
        decoded = None
        if not sentence.fault:
            try:
                decoded = decode_sentence(sentence)
            except MessageError:
                decoded = None
        if decoded is None:
            damaged_count += 1
            continue
        _store_values(decoded, sentence.kind, float(number), clock_readings, series)
    return clock_readings, series, damaged_count


def _store_values(
    decoded: DecodedSentence,
    sentence_type: str,
    number: float,
    clock_readings: list[Pair],
    series: dict[str, list[Pair]],
) -> None:
    numbers = decoded.numbers
    time_of_day_s = numbers.get("time_of_day_s")
    if time_of_day_s is not None and (not clock_readings or time_of_day_s != clock_readings[-1][1]):
        clock_readings.append((number, time_of_day_s))
    for name, key in (("rudder", "rudder_deg"), ("water speed", "water_speed_m_s"), ("ground speed", "sog_m_s")):
        value = numbers.get(key)
        if value is not None:
            series[name].append((number, value))
    if sentence_type in HEADING_SENTENCES:
        heading_deg = next((numbers[name] for name in HEADING_FIELDS if numbers.get(name) is not None), None)
        if heading_deg is not None:
            series[sentence_type].append((number, heading_deg))
