"""Fuzz one target in a process: atheris finds inputs that reach new code; inputs that cause an error are stored.

Without atheris, inputs are changed at random.
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
except ImportError:  # wheels exist for x86-64 only
    atheris = None

CORPUS = Path(__file__).parent / "corpus"
HANG_S = 4.0  # processor time of one input
SAMPLE_INTERVAL_S = 0.5
MAX_FINDINGS = 8
MINIMISE_S = 20.0
OUR_FOLDERS = ("firmware_py", "hil", "tests/fuzz")
# Packages that read no external bytes; counting their branches would double the time.
UNINSTRUMENTED = [f"firmware_py.{folder}" for folder in ("estimate", "control", "safety", "model", "faults")]


class HangError(BaseException):
    """An input takes too long. A BaseException, so that no `except Exception` catches it."""


def stop_hang(_number, _frame):
    raise HangError(f"more than {HANG_S:g} s of processor time")


def finding_key(error):
    """Return the key of a finding: type of the error and its location in our code."""
    locations = [
        f"{Path(frame.filename).name}:{frame.name}"
        for frame in traceback.extract_tb(error.__traceback__)
        if any(f"/{folder}/" in frame.filename for folder in OUR_FOLDERS)
    ]
    return f"{type(error).__name__} {' '.join(locations[-2:])}"


def error_of_input(target, data):
    """Return the error that an input causes, or None."""
    signal.setitimer(signal.ITIMER_VIRTUAL, HANG_S)
    try:
        target.play(data)
    except (Exception, HangError) as error:  # noqa: BLE001 - any error is a finding
        return error
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    return None


def minimise(target, data, key):
    """Shorten an input for at most MINIMISE_S while it causes the same finding."""
    end_s = time.monotonic() + MINIMISE_S
    size = len(data) // 2
    while size and time.monotonic() < end_s:
        start = 0
        while start < len(data) and time.monotonic() < end_s:
            shorter = data[:start] + data[start + size :]
            error = error_of_input(target, shorter)
            if error is not None and finding_key(error) == key:
                data = shorter
            else:
                start += size
        size //= 2
    return data


class Run:
    """Runs inputs, stores findings and samples the memory."""

    def __init__(self, target, seconds, directory):
        self.target, self.seconds, self.directory = target, seconds, directory
        self.start_s = self.sample_s = time.monotonic()
        self.inputs, self.refused = 0, 0
        self.memory = []  # (time, resident KiB)
        self.findings = {}

    def play(self, data):
        """Run one input; a finding does not end the run."""
        self.inputs += 1
        error = error_of_input(self.target, data)
        if error is not None and (key := finding_key(error)) not in self.findings and len(self.findings) < MAX_FINDINGS:
            self._store_finding(key, error, data)
        now_s = time.monotonic()
        if now_s - self.sample_s >= SAMPLE_INTERVAL_S:
            self.sample_s = now_s
            self.memory.append((now_s - self.start_s, resident_kib()))
            self.write()

    def _store_finding(self, key, error, data):
        text = "".join(traceback.format_exception(error, limit=-6))
        self.findings[key] = text
        shortest = minimise(self.target, data, key)
        (self.directory / "findings" / hashlib.sha256(shortest).hexdigest()[:16]).write_bytes(shortest)
        self.write()

    def write(self):
        """Write the results so far, since the process may be ended at any time."""
        result = {
            "inputs": self.inputs,
            "findings": self.findings,
            "growth_kib": growth_kib(self.memory, self.seconds),
            "peak_kib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        }
        (self.directory / "result.json").write_text(json.dumps(result))


def resident_kib():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() // 1024


def growth_kib(memory, seconds):
    """Return the growth of memory from the first to the last tenth of a run; None if the run is too short."""
    early_kib = [kib for t_s, kib in memory if t_s <= 0.1 * seconds]
    late_kib = [kib for t_s, kib in memory if t_s >= 0.9 * memory[-1][0]] if memory else []
    return max(late_kib) - max(early_kib) if early_kib and late_kib and len(memory) >= 4 else None


def mutate(data, rng, words):
    """Return an input with a few random changes."""
    data = bytearray(data)
    for _ in range(rng.randrange(1, 6)):
        start, size = rng.randrange(len(data) + 1), rng.randrange(1, 9)
        piece = rng.choice(words) if words and rng.random() < 0.3 else rng.randbytes(size)
        data[start : start + rng.choice((0, size))] = rng.choice((b"", piece))
        if data:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def fuzz_randomly(run, seeds, seed):
    """Run the seeds, then random changes of them until the time is over."""
    rng = random.Random(seed)
    for data in seeds:
        run.play(data)
    while time.monotonic() < run.start_s + run.seconds:
        run.play(mutate(rng.choice(seeds or [b""]), rng, run.target.words)[: run.target.max_bytes])


def escape(word):
    """Return a word as hexadecimal escapes for a dictionary of atheris."""
    return "".join(f"\\x{byte:02x}" for byte in word)


def fuzz_guided(run, corpus, new_inputs, seed):
    """Let atheris change inputs, guided by the code that they reach; does not return."""
    words = run.directory / "words"
    words.write_text("".join(f'"{escape(word)}"\n' for word in run.target.words or (b"\0",)))
    options = [
        f"-seed={seed}", f"-max_len={run.target.max_bytes}", f"-dict={words}",
        f"-artifact_prefix={run.directory}/findings/", "-timeout=100", "-rss_limit_mb=2048", "-detect_leaks=0",
    ]  # fmt: skip
    if run.seconds:
        options += [f"-max_total_time={run.seconds}", str(new_inputs), str(corpus)]
    else:
        options += ["-merge=1", str(corpus), str(new_inputs)]
    atheris.Setup(["fuzz", *options], run.play)
    atheris.Fuzz()


def import_targets():
    """Import the targets, instrumented by atheris for their branches."""
    if atheris is None:
        return import_module("fuzz.table").TARGETS
    with atheris.instrument_imports(include=["firmware_py", "hil", "tomllib"], exclude=UNINSTRUMENTED):
        return import_module("fuzz.table").TARGETS


def run_target(target, corpus, seconds, seed, directory, new_inputs):
    """Fuzz a target in a process that ends afterwards.

    `new_inputs` receives inputs that reach new code, `directory`/findings inputs with an error, `directory`/result.json
    the results. With 0 seconds, merge the inputs of `new_inputs` that reach new code into the corpus.
    """
    for subdirectory in (directory / "findings", directory / "tmp", new_inputs, corpus):
        subdirectory.mkdir(parents=True, exist_ok=True)
    tempfile.tempdir = str(directory / "tmp")
    signal.signal(signal.SIGVTALRM, stop_hang)
    run = Run(target, seconds, directory)
    if atheris is not None:
        fuzz_guided(run, corpus, new_inputs, seed)
    fuzz_randomly(run, [path.read_bytes() for path in sorted(corpus.glob("*"))], seed)
    run.write()
