"""From a compass sentence to the servo frame that it decides, beside a process that only carries bytes."""

from __future__ import annotations

import select
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hil.bench.figure import Figure, Finding
from hil.bench.helper import answer_of, background
from hil.bench.onboard import logged
from hil.bench.path import passages
from hil.bench.rig import COMPASS_HZ, Rig
from hil.bench.setting import Setting
from hil.bench.spread import Spread, spread
from hil.bench.steady import steady
from hil.devices.nmea_text import whole_sentence
from hil.devices.pty_line import PtyLine
from hil.errors import HilError

MILLISECONDS = 1e3
MICROSECONDS = 1e6
MOST_WHOLE_MS = 5.0
MOST_RATIO = 5.0
SENTENCE = whole_sentence("HEHDT,0.123,T")
BACK_TO_BACK_S = 0.0005
BACK_TO_BACK_ECHOES = 300
PATIENCE_S = 1.0
ALIVE_S = 60.0
DECODINGS = 100
DECODING_GAP_S = 0.02

# The HIL may not import the drivers, so a process of its own times them: the autopilot's own
# compass on its own serial line, after pauses as between real sentences.
DECODE = """
import json, os, select, sys, time, tty
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.system import realtime
from firmware_py.system.serial_port import SerialPort
sentence, count, gap_s = sys.argv[1].encode(), int(sys.argv[2]), float(sys.argv[3])
master, slave = os.openpty()
tty.setraw(slave)
line = SerialPort(os.ttyname(slave), 38400)
line.open()
compass = NmeaCompass(line, NmeaCompassOptions())
realtime.prepare()
taken_s = []
for _ in range(count):
    time.sleep(gap_s)
    os.write(master, sentence)
    select.select([line.fileno()], [], [])
    start_s = time.monotonic()
    compass.receive(start_s)
    taken_s.append(time.monotonic() - start_s)
    assert len(compass.poll()) == 1
print(json.dumps(taken_s))
"""


def measure(setting: Setting) -> Finding:
    """Play compass and servo, follow each heading through, and echo the same bytes before and after."""
    directory = setting.directory / "sense"
    directory.mkdir(parents=True)
    with _echo(directory) as echo:
        bare_s = echo.times(setting.echoes // 2, 1.0 / COMPASS_HZ)
        busy = spread(echo.times(BACK_TO_BACK_ECHOES, BACK_TO_BACK_S))
    decoding = spread(_decodings())
    with Rig(directory / "rig") as rig, steady():
        rig.serve_until_alive(ALIVE_S)
        counted_from_s = rig.now_s() + setting.lock_s
        rig.serve(counted_from_s + setting.sense_s)
    with _echo(directory) as echo:
        bare_s += echo.times(setting.echoes - len(bare_s), 1.0 / COMPASS_HZ)
    found = passages(logged(rig.out), rig.sentences_s, rig.goals_s)
    counted = [passage for passage in found if passage.sentence_s >= counted_from_s]
    if not counted:
        raise HilError("no heading was followed to the servo; see what the onboard log says")
    whole = spread([passage.whole_s for passage in counted])
    computing = spread([passage.computing_s(decoding.p50) for passage in counted])
    wait = spread([passage.wait_s for passage in counted])
    wait_us, decoding_us, busy_us = (one.p50 * MICROSECONDS for one in (wait, decoding, busy))
    notes = (
        f"{whole.count} headings of a free-running {COMPASS_HZ:g} Hz NMEA compass, told apart in the onboard log",
        f"counted from {setting.lock_s:g} s after the first goal, when the ticks have locked to the compass",
        f"computing: whole less the wait for the tick (p50 {wait_us:.0f} us), its decoding ({decoding_us:.0f} us) kept",
        "bare: a Python process that carries the same bytes from pty to pty, at the compass's pace",
        f"the same back to back, with warm caches: p50 {busy_us:.0f} us",
    )
    return Finding("Sense to actuate", figures_of(whole, computing, spread(bare_s)), notes)


def figures_of(whole: Spread, computing: Spread, bare: Spread) -> tuple[Figure, ...]:
    """Return the figures; the spreads are in seconds."""
    return (
        Figure("computing path, p50", "us", computing.p50 * MICROSECONDS, bare.p50 * MICROSECONDS,
               most_ratio=MOST_RATIO),
        Figure("computing path, p95", "us", computing.p95 * MICROSECONDS, bare.p95 * MICROSECONDS),
        Figure("whole path, p50", "ms", whole.p50 * MILLISECONDS, bare.p50 * MILLISECONDS,
               most=MOST_WHOLE_MS, peer="pypilot 26"),
        Figure("whole path, p95", "ms", whole.p95 * MILLISECONDS, bare.p95 * MILLISECONDS),
    )  # fmt: skip


class _Echo:
    """Asks the echo process and takes the time."""

    def __init__(self, inward: PtyLine, outward: PtyLine) -> None:
        self._inward = inward
        self._outward = outward

    def times(self, count: int, gap_s: float) -> list[float]:
        """Return the seconds from writing to the last byte readable, count times."""
        taken_s = []
        with steady():
            for _ in range(count):
                time.sleep(gap_s)
                sent_s, heard = time.monotonic(), 0
                self._inward.write(SENTENCE)
                while heard < len(SENTENCE):
                    if not select.select([self._outward], [], [], PATIENCE_S)[0]:
                        raise HilError("the echo process of the bench does not answer")
                    heard_s = time.monotonic()
                    heard += len(self._outward.read())
                taken_s.append(heard_s - sent_s)
        return taken_s


@contextmanager
def _echo(directory: Path) -> Iterator[_Echo]:
    inward, outward = PtyLine(directory / "echo-in"), PtyLine(directory / "echo-out")
    try:
        with background("-m", "hil.bench.bare_echo", "pty", str(directory / "echo-in"), str(directory / "echo-out")):
            yield _Echo(inward, outward)
    finally:
        inward.close()
        outward.close()


def _decodings() -> list[float]:
    arguments = ["-c", DECODE, SENTENCE.decode(), str(DECODINGS), str(DECODING_GAP_S)]
    found: list[float] = answer_of(arguments, DECODINGS * DECODING_GAP_S)
    return found
