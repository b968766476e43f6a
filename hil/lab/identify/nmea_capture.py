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

HEAD_BYTES, MIN_SENTENCES = 4096, 3  # start of the file that is_capture reads, and its valid sentences
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
    times, series, faults = _read_sentences(path.read_bytes())
    if len(times) < 2:
        raise UsageError(f"{path}: NMEA 0183 with {len(times)} times; the capture needs RMC, GGA, GLL or ZDA")
    clock_marks = np.array(times)
    midnights = np.cumsum(np.diff(clock_marks[:, 1], prepend=clock_marks[0, 1]) < -0.5 * DAY_S)
    clock = clock_marks[:, 1] + DAY_S * midnights
    is_later = np.concatenate(([True], np.diff(np.maximum.accumulate(clock)) > 0.0))
    clock_marks, clock = clock_marks[is_later, 0], clock[is_later]

    def with_times(name: str) -> list[Pair]:
        pairs = np.array(series[name]).reshape(-1, 2)
        timed_pairs = pairs[(pairs[:, 0] >= clock_marks[0]) & (pairs[:, 0] <= clock_marks[-1])]
        return list(
            zip(np.interp(timed_pairs[:, 0], clock_marks, clock).tolist(), timed_pairs[:, 1].tolist(), strict=True)
        )

    sentence_type = max(HEADING_SENTENCES, key=lambda sentence_name: len(series[sentence_name]))
    heading, rudder = np.array(with_times(sentence_type)).reshape(-1, 2), np.array(with_times("rudder")).reshape(-1, 2)
    if heading.shape[0] < MIN_ROWS or rudder.shape[0] < MIN_ROWS:
        raise UsageError(
            f"{path}: NMEA 0183 with {heading.shape[0]} headings and {rudder.shape[0]} rudder angles (RSA, XDR) "
            f"between its times; at least {MIN_ROWS} of each are needed"
        )
    # One row per sample of the slower sensor: interpolation of the rudder between its samples would make T too short.
    slower_series = min(heading, rudder, key=len)
    time_s = np.unique(slower_series[:, 0])
    time_s = time_s[(time_s >= max(heading[0, 0], rudder[0, 0])) & (time_s <= min(heading[-1, 0], rudder[-1, 0]))]
    notes = [f"NMEA 0183: headings of {sentence_type}; sentences without a time are spread between those with one"]
    if faults:
        notes.append(f"{faults} damaged sentences ignored")
    speed = smooth_speed(with_times("water" if len(series["water"]) >= MIN_ROWS else "ground"), time_s, notes)
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
    times: list[Pair] = []
    series: dict[str, list[Pair]] = defaultdict(list)
    framer, faults = NmeaFramer(), 0
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
            faults += 1
            continue
        _store(decoded, sentence.kind, float(number), times, series)
    return times, series, faults


def _store(
    decoded: DecodedSentence, sentence_type: str, number: float, times: list[Pair], series: dict[str, list[Pair]]
) -> None:
    numbers = decoded.numbers
    now_s = numbers.get("time_of_day_s")
    if now_s is not None and (not times or now_s != times[-1][1]):
        times.append((number, now_s))
    for name, key in (("rudder", "rudder_deg"), ("water", "water_speed_m_s"), ("ground", "sog_m_s")):
        value = numbers.get(key)
        if value is not None:
            series[name].append((number, value))
    if sentence_type in HEADING_SENTENCES:
        angle = next((numbers[name] for name in HEADING_FIELDS if numbers.get(name) is not None), None)
        if angle is not None:
            series[sentence_type].append((number, angle))
