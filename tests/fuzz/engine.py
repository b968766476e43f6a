"""Fuzzes one target in a process of its own: atheris finds inputs that reach new code, what they break is kept.

Where there is no atheris inputs are changed at random.
"""

import hashlib
import json
import random
import resource
import signal
import tempfile
import time
import traceback
from importlib import import_module
from pathlib import Path

try:
    import atheris
except ImportError:  # there are wheels for x86-64 alone
    atheris = None

CORPUS = Path(__file__).parent / "corpus"
HANG_S = 4.0  # of processor time, for one input
LOOK_EVERY_S = 0.5
MOST_FINDINGS = 8
MINIMISE_S = 20.0
OURS = ("firmware_py", "hil", "tests/fuzz")
# Rooms that compute and read no bytes: to count their branches costs half the time.
COMPUTING = [f"firmware_py.{room}" for room in ("estimate", "control", "safety", "model", "faults")]


class HangError(BaseException):
    """An input takes too long; no `except Exception` may swallow this."""


def stop_hang(_number, _frame):
    raise HangError(f"more than {HANG_S:g} s of processor time")


def culprit(error):
    """Return the key of a finding: the type of the error and its place in our code."""
    places = [
        f"{Path(frame.filename).name}:{frame.name}"
        for frame in traceback.extract_tb(error.__traceback__)
        if any(f"/{room}/" in frame.filename for room in OURS)
    ]
    return f"{type(error).__name__} {' '.join(places[-2:])}"


def complaint(target, data):
    """Return the error of a target for an input, or None."""
    signal.setitimer(signal.ITIMER_VIRTUAL, HANG_S)
    try:
        target.play(data)
    except (Exception, HangError) as error:  # noqa: BLE001 - that is what is looked for
        return error
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    return None


def minimised(target, data, wanted):
    """Return an input that is as short as can soon be found and breaks the same."""
    end_s = time.monotonic() + MINIMISE_S
    size = len(data) // 2
    while size and time.monotonic() < end_s:
        at = 0
        while at < len(data) and time.monotonic() < end_s:
            shorter = data[:at] + data[at + size :]
            error = complaint(target, shorter)
            if error is not None and culprit(error) == wanted:
                data = shorter
            else:
                at += size
        size //= 2
    return data


class Run:
    """Plays inputs, keeps the findings and watches the memory."""

    def __init__(self, target, seconds, room):
        self.target, self.seconds, self.room = target, seconds, room
        self.begun_s = self.looked_s = time.monotonic()
        self.inputs, self.refused = 0, 0
        self.memory = []  # (time, resident KiB)
        self.found = {}

    def take(self, data):
        """Play one input; a finding does not end the run."""
        self.inputs += 1
        error = complaint(self.target, data)
        if error is not None and (key := culprit(error)) not in self.found and len(self.found) < MOST_FINDINGS:
            self._keep(key, error, data)
        now_s = time.monotonic()
        if now_s - self.looked_s >= LOOK_EVERY_S:
            self.looked_s = now_s
            self.memory.append((now_s - self.begun_s, resident_kib()))
            self.write()

    def _keep(self, key, error, data):
        text = "".join(traceback.format_exception(error, limit=-6))
        self.found[key] = text
        short = minimised(self.target, data, key)
        (self.room / "found" / hashlib.sha256(short).hexdigest()[:16]).write_bytes(short)
        self.write()

    def write(self):
        """Write how it goes: the process may be ended from outside at any time."""
        result = {
            "inputs": self.inputs,
            "found": self.found,
            "growth_kib": growth_kib(self.memory, self.seconds),
            "peak_kib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        }
        (self.room / "result.json").write_text(json.dumps(result))


def resident_kib():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() // 1024


def growth_kib(memory, seconds):
    """Return by how much the last tenth of a run needs more memory than the first, None of too short a run."""
    first = [kib for t_s, kib in memory if t_s <= 0.1 * seconds]
    last = [kib for t_s, kib in memory if t_s >= 0.9 * memory[-1][0]] if memory else []
    return max(last) - max(first) if first and last and len(memory) >= 4 else None


def changed(data, chances, words):
    """Return an input with a few places changed."""
    data = bytearray(data)
    for _ in range(chances.randrange(1, 6)):
        at, size = chances.randrange(len(data) + 1), chances.randrange(1, 9)
        piece = chances.choice(words) if words and chances.random() < 0.3 else chances.randbytes(size)
        data[at : at + chances.choice((0, size))] = chances.choice((b"", piece))
        if data:
            data[chances.randrange(len(data))] ^= 1 << chances.randrange(8)
    return bytes(data)


def at_random(run, seeds, seed):
    """Change seeds at random, as long as there is time: what is done without atheris."""
    chances = random.Random(seed)
    for data in seeds:
        run.take(data)
    while time.monotonic() < run.begun_s + run.seconds:
        run.take(changed(chances.choice(seeds or [b""]), chances, run.target.words)[: run.target.largest])


def escaped(word):
    return "".join(f"\\x{byte:02x}" for byte in word)


def guided(run, corpus, kept, seed):
    """Let atheris change inputs, guided by the code that they reach; does not return."""
    words = run.room / "words"
    words.write_text("".join(f'"{escaped(word)}"\n' for word in run.target.words or (b"\0",)))
    options = [
        f"-seed={seed}", f"-max_len={run.target.largest}", f"-dict={words}", f"-artifact_prefix={run.room}/found/",
        "-timeout=100", "-rss_limit_mb=2048", "-detect_leaks=0",
    ]  # fmt: skip
    if run.seconds:
        options += [f"-max_total_time={run.seconds}", str(kept), str(corpus)]
    else:
        options += ["-merge=1", str(corpus), str(kept)]
    atheris.Setup(["fuzz", *options], run.take)
    atheris.Fuzz()


def instrumented_targets():
    """Import the targets so that atheris sees which branches they take."""
    if atheris is None:
        return import_module("fuzz.table").TARGETS
    with atheris.instrument_imports(include=["firmware_py", "hil", "tomllib"], exclude=COMPUTING):
        return import_module("fuzz.table").TARGETS


def run_target(target, corpus, seconds, seed, room, kept):
    """Fuzz a target, in a process that ends with this. `kept` takes what reaches new code.

    `room`/found takes what breaks something, `room`/result.json how it went. After 0 seconds what of `kept` adds
    code is taken into the corpus.
    """
    for directory in (room / "found", room / "tmp", kept, corpus):
        directory.mkdir(parents=True, exist_ok=True)
    tempfile.tempdir = str(room / "tmp")
    signal.signal(signal.SIGVTALRM, stop_hang)
    run = Run(target, seconds, room)
    if atheris is not None:
        guided(run, corpus, kept, seed)
    at_random(run, [path.read_bytes() for path in sorted(corpus.glob("*"))], seed)
    run.write()
