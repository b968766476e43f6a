"""How long the identification of an hour's log takes, once everything is compiled."""

from __future__ import annotations

import statistics
import time

from hil.bench.figure import Figure, Finding
from hil.bench.objective import HOUR_S, STEP_S, hour
from hil.bench.setting import Setting
from hil.lab.identify.identify import identify

MOST_S = 2.0


def measure(setting: Setting) -> Finding:
    """Identify logs of different noise, the first one unwatched."""
    identify([hour(0)])
    passed_s, used_s = [], []
    evaluations = []
    for seed in range(1, setting.pairs + 1):
        log = hour(seed)
        start_s, cpu_s = time.perf_counter(), time.process_time()
        evaluations.append(identify([log]).evaluations)
        used_s.append(time.process_time() - cpu_s)
        passed_s.append(time.perf_counter() - start_s)
    return Finding("Identification of an hour", figures_of(passed_s, used_s), notes_of(passed_s, evaluations))


def figures_of(passed_s: list[float], used_s: list[float]) -> tuple[Figure, ...]:
    """Return the figures; the processor's time is what it would take on an idle machine."""
    return (
        Figure("from the log to the judged model", "s", statistics.median(passed_s), most=MOST_S),
        Figure("processor time of that", "s", statistics.median(used_s)),
    )


def notes_of(passed_s: list[float], evaluations: list[int]) -> tuple[str, ...]:
    """Say how it was measured."""
    spread = f"{min(passed_s):.2f} to {max(passed_s):.2f} s in {len(passed_s)} runs"
    rows = round(HOUR_S / STEP_S)
    return (
        f"{rows} rows at {1.0 / STEP_S:g} Hz, tank noise, zigzag; linear or cubic by evidence, errors and verdicts",
        f"{spread}, another seed of the noise each; some {statistics.median(evaluations):.0f} simulations",
    )
