"""Comparison of the constants of the heading filter with others; table in docs/decisions/0012-heading-filter.md."""

import inspect
from functools import cache
from types import FunctionType, ModuleType

import numpy as np
import pytest

from firmware_py.estimate import heading_filter
from hil.lab.compiled import compiled_here
from hil.lab.numeric_core import functions_of, inner
from support.heading_recording import (
    UNDISTURBED_SEAS,
    Sea,
    best_low_pass_deg,
    draw_recording,
    filter_rows,
    mean_scores,
    score,
    to_estimates,
    with_turn,
    wrap,
)

SEEDS = range(1, 4)
SEAS = {
    "D 0": (Sea(0.0), True),
    "D 2": (Sea(), True),
    "D 6": (Sea(6.0, bias_sd_deg=12.0, bias_memory_s=3000.0), True),
    "D 0, no rudder": (Sea(0.0), False),
    "offshore": (Sea(6.0, 2.4, 3.2, compass_noise_deg=0.3, compass_hz=10.0), True),
    "tank": (UNDISTURBED_SEAS["tank"], True),
    "sea": (UNDISTURBED_SEAS["sea"], True),
    "weak": (UNDISTURBED_SEAS["weak"], True),
    "swell": (UNDISTURBED_SEAS["swell"], True),
    "storm": (UNDISTURBED_SEAS["storm"], True),
}
LEVEL_OFFSETS = "LEVEL_OFFSETS = NoiseLevels(0.3, 0.2, 0.05, 0.3, 0.4, 0.4)"
PRIOR_SDS = "PRIOR_SDS = NoiseLevels(2.5, 1.0, 0.6, 0.5, 0.7, 1.0)"
MEMORY = "MIN_MEMORY_S, MAX_MEMORY_S, MEMORY_SHARE = 100.0, 1800.0, 0.5"
CANDIDATES = "CANDIDATE_PHASE_S, CHOICE_INTERVAL_S = 60.0"
VARIANTS = {
    "offsets all 0.1": (LEVEL_OFFSETS, "LEVEL_OFFSETS = NoiseLevels(0.1, 0.1, 0.1, 0.1, 0.1, 0.1)"),
    "offsets all 0.2": (LEVEL_OFFSETS, "LEVEL_OFFSETS = NoiseLevels(0.2, 0.2, 0.2, 0.2, 0.2, 0.2)"),
    "offsets all 0.4": (LEVEL_OFFSETS, "LEVEL_OFFSETS = NoiseLevels(0.4, 0.4, 0.4, 0.4, 0.4, 0.4)"),
    "window 5 s": ("WINDOW_S = 15.0", "WINDOW_S = 5.0"),
    "window 30 s": ("WINDOW_S = 15.0", "WINDOW_S = 30.0"),
    "largest step 0.25": ("MAX_LEVEL_STEP = 0.5", "MAX_LEVEL_STEP = 0.25"),
    "largest step 1": ("MAX_LEVEL_STEP = 0.5", "MAX_LEVEL_STEP = 1.0"),
    "memory 900 s": (MEMORY, MEMORY.replace("100.0, 1800.0", "900.0, 900.0")),
    "memory 1800 s": (MEMORY, MEMORY.replace("100.0", "1800.0")),
    "memory grows to 900 s": (MEMORY, MEMORY.replace("1800.0", "900.0")),
    "memory grows to 3600 s": (MEMORY, MEMORY.replace("1800.0", "3600.0")),
    "prior sd of D 1.5": (PRIOR_SDS, PRIOR_SDS.replace("2.5", "1.5")),
    "prior sds halved": (PRIOR_SDS, "PRIOR_SDS = NoiseLevels(1.25, 0.5, 0.3, 0.25, 0.35, 0.5)"),
    "prior sds doubled": (PRIOR_SDS, "PRIOR_SDS = NoiseLevels(5.0, 2.0, 1.2, 1.0, 1.4, 2.0)"),
    "learning at 1 Hz": ("LEARNING_STEP_S = 0.4", "LEARNING_STEP_S = 1.0"),
    "learning at 10 Hz": ("LEARNING_STEP_S = 0.4", "LEARNING_STEP_S = 0.099"),
    "no candidates": (CANDIDATES, CANDIDATES.replace("60.0", "0.0")),
    "candidates for 180 s": (CANDIDATES, CANDIDATES.replace("60.0", "180.0")),
    "no unexplained turns": ("UNEXPLAINED_SQUARE, UNEXPLAINED_S = 9.0", "UNEXPLAINED_SQUARE, UNEXPLAINED_S = 1e9"),
    "unknown rudder: 1 deg/sqrt(s)": ("math.log(radians(2.0))", "math.log(radians(1.0))"),
    "unknown rudder: 4 deg/sqrt(s)": ("math.log(radians(2.0))", "math.log(radians(4.0))"),
}


@cache
def compile_variant(old: str, new: str):
    """Compile a copy of the heading filter with one text replaced."""
    text, module = inspect.getsource(heading_filter), ModuleType("heading_filter_variant")
    assert text.count(old) == 1
    exec(text.replace(old, new), vars(module))
    for function in functions_of(module):
        inner(function)
    names = {**filter_rows.py_func.__globals__, "begin": module.begin, "update": module.update}
    return compiled_here(FunctionType(filter_rows.py_func.__code__, names))


@cache
def recordings(name: str):
    return [draw_recording(SEAS[name][0], seed) for seed in SEEDS]


def mean_scores_of(kernel, name: str):
    """Return the mean scores of a filter over the recordings of a sea."""
    sea, is_rudder_known = SEAS[name]
    scores = []
    for recording in recordings(name):
        rudder_rad = recording.rudder_rad if is_rudder_known else np.full(recording.t_s.size, np.nan)
        _, rows = kernel(recording.t_s, recording.compass_rad, rudder_rad, sea.model)
        scores.append(score(sea, recording, to_estimates(rows), None, None))
    return mean_scores(scores)


def print_row(kernel, name: str):
    """Return the scores of a filter in all seas, and print its row of the table: error [deg] (NEES)."""
    scores = [mean_scores_of(kernel, sea) for sea in SEAS]
    print(
        "| " + " | ".join([name, *(f"{score.error_deg:.2f} ({score.nees:.2f})" for score in scores)]) + " |", flush=True
    )
    return scores


@cache
def reference_scores():
    print("| " + " | ".join(["", *SEAS]) + " |")
    low_pass = (np.mean([best_low_pass_deg(recording) for recording in recordings(name)]) for name in SEAS)
    print("| " + " | ".join(["best low-pass", *(f"{error_deg:.2f}" for error_deg in low_pass)]) + " |")
    return print_row(filter_rows, "as it is")


@pytest.mark.proof
@pytest.mark.parametrize("name", VARIANTS)
def test_other_constants_are_not_clearly_better(name):
    reference = reference_scores()
    variant = print_row(compile_variant(*VARIANTS[name]), name)
    ratios = [other.error_deg / own.error_deg for other, own in zip(variant, reference, strict=True)]
    assert np.exp(np.mean(np.log(ratios))) > 0.97


def errors_deg(kernel, sea: Sea, recording):
    """Return the absolute heading errors of a filter over a recording [deg]."""
    _, rows = kernel(recording.t_s, recording.compass_rad, recording.rudder_rad, sea.model)
    return np.degrees(np.abs(wrap(rows[:, 0] - recording.true_rad)))


@pytest.mark.proof
@pytest.mark.parametrize("name", ["weak", "swell", "storm"])
def test_without_candidates_large_waves_are_not_learned(name):
    sea, rms_deg = UNDISTURBED_SEAS[name], []
    for kernel in (filter_rows, compile_variant(*VARIANTS["no candidates"])):
        errors = [errors_deg(kernel, sea, draw_recording(sea, seed, 300.0))[1200:] for seed in SEEDS]
        rms_deg.append(float(np.sqrt(np.mean(np.square(errors)))))
    print(f"{name}, 2 to 5 min: {rms_deg[0]:.1f} deg, without candidates {rms_deg[1]:.1f} deg")
    assert rms_deg[1] > 2.0 * rms_deg[0]


@pytest.mark.proof
def test_without_unexplained_turn_rule_the_error_remains():
    sea = Sea(0.0)
    recording = with_turn(draw_recording(sea, 1, 1500.0), 10.0)
    with_rule_deg, without_rule_deg = (
        errors_deg(kernel, sea, recording)[recording.t_s > 1229.0].max()
        for kernel in (filter_rows, compile_variant(*VARIANTS["no unexplained turns"]))
    )
    print(f"20 s after an unexplained turn: {with_rule_deg:.1f} deg, without the rule {without_rule_deg:.1f} deg")
    assert without_rule_deg > 10.0 * with_rule_deg
