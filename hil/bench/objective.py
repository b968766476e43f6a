"""What the search's objective costs, beside the same arithmetic in C."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.bench.figure import Figure, Finding
from hil.bench.setting import Setting
from hil.bench.turns import in_turns
from hil.errors import HilError
from hil.lab.identify import synthetic
from hil.lab.identify.digest import digests
from hil.lab.identify.objective import output_error
from hil.lab.identify.recording import Floats, Recording
from hil.lab.identify.search import scan
from hil.lab.identify.stretch import prepare

SOURCE = Path(__file__).with_name("output_error.c")
COMPILERS = ("gcc", "clang", "cc")
OPTIONS = ("-O3", "-march=native", "-std=c99", "-shared", "-fPIC")
COMPILE_S = 60.0
CACHE_LINE = 8  # of doubles
CARRIED = 19  # rows of numbers that the C function carries along
SHOALS = (64, 30)
MOST_RATIO = 1.3
SAME = 1e-6  # relative; C multiplies and adds in one, and the sums have thousands of terms
HOUR_S, STEP_S = 3600.0, 0.1
TURNS_PER_PAIR = 8

Call = Callable[[], None]


def hour(seed: int = 1) -> Recording:
    """Return an hour of zigzag at 10 Hz with the tank's noise."""
    time_s = np.asarray(np.arange(round(HOUR_S / STEP_S)) * STEP_S, np.float64)
    rudder_rad = synthetic.zigzag(time_s, radians(20.0), 20.0)
    return synthetic.record(OCEAN_RAMBLER, time_s, rudder_rad, synthetic.TANK, seed)


def compiler() -> str | None:
    """Return the path of a C compiler, None where there is none."""
    return next((path for path in map(shutil.which, COMPILERS) if path is not None), None)


def library(compiler_path: str, directory: Path) -> ctypes.CDLL:
    """Compile the C function and load it, or raise HilError."""
    target = directory / "output_error.so"
    command = [compiler_path, *OPTIONS, "-o", str(target), str(SOURCE), "-lm"]
    done = subprocess.run(command, capture_output=True, check=False, timeout=COMPILE_S)
    if done.returncode != 0:
        lines = done.stderr.decode(errors="replace").splitlines() or ["it says nothing"]
        raise HilError(f"{compiler_path} does not compile {SOURCE.name}: {lines[0]}")
    return ctypes.CDLL(str(target))


def calls(loaded: ctypes.CDLL | None, fish: int) -> tuple[Call, Call, int]:
    """Return ours and C's, each of which evaluates so many fish once, and the samples; without C ours twice.

    Raises HilError when the two do not agree.
    """
    record = digests(prepare([hour()]))[-1]
    box = scan(record)
    low, high = box.bounds(cubic=True)
    points = box.points(low + (high - low) * np.random.default_rng(0).random((fish, low.size)))
    arguments = record.arguments(box.sign)
    values, others = np.empty(fish), np.empty(fish)

    def ours() -> None:
        output_error(points, values, *arguments)

    ours()
    samples = int(record.flags.size)
    if loaded is None:
        return ours, ours, samples
    arrays = [np.ascontiguousarray(points.T), others, *map(np.ascontiguousarray, arguments), workspace(fish)]
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]

    def in_c() -> None:
        loaded.output_error(ctypes.c_ssize_t(fish), ctypes.c_ssize_t(samples), *pointers)

    in_c()
    check_agreement(values, others)
    return ours, in_c, samples


def workspace(fish: int) -> Floats:
    """Return the rows that C carries along, on cache lines and one further apart than they are long."""
    size = CARRIED * (fish + CACHE_LINE)
    raw = np.empty(size + CACHE_LINE)
    skipped = -(raw.ctypes.data // raw.itemsize) % CACHE_LINE
    return np.asarray(raw[skipped : skipped + size])


def check_agreement(ours: Floats, theirs: Floats) -> None:
    """Raise HilError unless both computed the same."""
    if not np.allclose(ours, theirs, rtol=SAME, atol=0.0):
        raise HilError(f"{SOURCE.name} no longer computes what hil/lab/identify/objective.py does; bring it up to date")


def taken_s(call: Call) -> float:
    """Return the processor's seconds for one call: what other programs take meanwhile does not count."""
    start_s = time.thread_time()
    call()
    return time.thread_time() - start_s


def measure(setting: Setting) -> Finding:
    """Let both evaluate the same fish by turns."""
    path = compiler()
    loaded = None if path is None else library(path, setting.directory)
    figures, spreads = [], []
    for fish in SHOALS:
        ours, in_c, samples = calls(loaded, fish)
        turns = in_turns(
            lambda _, call=ours: taken_s(call),  # type: ignore[misc]
            lambda _, call=in_c: taken_s(call),  # type: ignore[misc]
            setting.pairs * TURNS_PER_PAIR,
        )
        name, scale = f"per sample and fish, {fish} fish", 1e9 / (samples * fish)
        if path is None:
            figures.append(Figure(name, "ns", turns.figure(name, "ns", scale).value))
        else:
            figures.append(turns.figure(name, "ns", scale, MOST_RATIO))
            low, high = turns.quartiles
            spreads.append(f"{fish} fish: half of {len(turns.ours)} ratios from {low:.2f} to {high:.2f}")
    notes: tuple[str, ...]
    if path is None:
        notes = ("no C compiler here (gcc, clang, cc), so nothing to compare with",)
    else:
        notes = (
            f"bare: the same arithmetic in C, {Path(path).name} {' '.join(OPTIONS[:2])}; processor time, by turns",
            *spreads,
        )
    return Finding("Objective of the identification", tuple(figures), notes)
