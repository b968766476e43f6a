"""Report of a tuning of the default controller: text, JSON and parameter file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from firmware_py.common.angles import DEGREES_PER_RADIAN
from firmware_py.common.parameters import format_file
from hil.lab.tune.delivered import (
    DEG_PER_H,
    SEARCHED_NAMES,
    SHIP_FACTORS,
    Score,
    Trials,
    default_setting,
    parameters_of,
)
from hil.lab.tune.delivered_search import TuningResult
from hil.lab.tune.loop_kernel import ITAE, MEAN, OVERSHOOT, RMS, TRAVEL, Floats

RESULT_COLUMNS = ("rms deg", "largest mean deg", "travel deg/h")
# The parameters below belong to this controller.
CONTROLLER_PARAMETERS = {"CTL_MODE": 1.0, "EST_MODE": 1.0}
RATIO_DIGITS = 3
TUNING_NOTE = (
    "note: on two other ships the tuner found nothing better than the defaults; the whole improvement came from the "
    "identified model. To trade error for rudder travel, see rambler-hil compare --prices 0.5 1 2 4"
)


@dataclass(frozen=True, slots=True)
class Report:
    """Result of a tuning; `fresh_trials` has the same seas and ships with other waves and noise."""

    vehicle: str
    seed: int
    scenarios: tuple[str, ...]
    trials: Trials
    fresh_trials: Trials
    tuned: TuningResult
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Return the chosen values by parameter name."""
        return parameters_of(self.tuned.chosen.setting)


def parameter_file(report: Report) -> str:
    """Return the chosen parameters as `NAME VALUE` lines, with the seas and seeds of the search."""
    fresh, default_score = report.tuned.fresh_score, report.fresh_trials.default_score
    header = [
        f"# Tuned for {report.vehicle} by rambler-hil tune, seed {report.seed}: {report.tuned.reason}.",
        f"# Seas: {' '.join(report.scenarios)}; {_ships_text()}; seeds {_seeds_text(report.trials)}.",
        (
            f"# In fresh seas, seeds {_seeds_text(report.fresh_trials)}: error {fresh.error:.{RATIO_DIGITS}f} and "
            f"rudder travel {report.fresh_trials.travel(fresh):.{RATIO_DIGITS}f} of the defaults "
            f"({default_score.travel_deg_per_h:.0f})."
        ),
    ]
    return "\n".join(header) + "\n" + format_file({**CONTROLLER_PARAMETERS, **report.values})


def as_json(report: Report) -> dict[str, Any]:
    """Return the results for JSON."""
    tuned = report.tuned
    return {
        "vehicle": report.vehicle,
        "controller": "delivered",
        "seed": report.seed,
        "scenarios": list(report.scenarios),
        "ships": [dict(zip(("K_factor", "T_factor", "alpha_factor"), ship, strict=True)) for ship in SHIP_FACTORS],
        "seeds": list(report.trials.seeds),
        "fresh_seeds": list(report.fresh_trials.seeds),
        "delivered": _score_json(report.trials, report.trials.default_score),
        "chosen": {
            **_score_json(report.trials, tuned.chosen),
            "why": tuned.reason,
            "kept_as_delivered": tuned.keeps_defaults,
            "parameters": report.values,
        },
        "fresh_seas": {
            "delivered": _score_json(report.fresh_trials, report.fresh_trials.default_score),
            "chosen": _score_json(report.fresh_trials, tuned.fresh_score),
        },
        "tried": [_score_json(report.trials, score) for score in report.trials.archive],
        "cases": _cases_json(report),
        "evaluations": tuned.evaluations,
        "trial_runs": tuned.evaluations * len(report.trials.cases),
        "seconds": round(report.seconds, 3),
    }


def _score_json(trials: Trials, score: Score) -> dict[str, Any]:
    return {
        **{name: round(value, 4) for name, value in zip(SEARCHED_NAMES, score.setting, strict=True)},
        "error": round(score.error, 5),
        "worst_error": round(score.worst_error, 5),
        "travel_deg_per_h": round(score.travel_deg_per_h, 1),
        "travel": round(trials.travel(score), 5),
    }


def _cases_json(report: Report) -> list[dict[str, Any]]:
    results_of_both = _results_of_both(report)
    rows = []
    for number, case in enumerate(report.fresh_trials.cases):
        ability, lag, norrbin = case.ship
        row: dict[str, Any] = {
            "scenario": case.text,
            "speed_m_s": case.scenario.speed_m_s,
            "K_factor": ability,
            "T_factor": lag,
            "alpha_factor": norrbin,
            "seed": case.seed,
        }
        for name, results in zip(("delivered", "chosen"), results_of_both, strict=True):
            result = results[number]
            row[name] = {
                "itae_mean_error_deg": round(float(result[ITAE]) * DEGREES_PER_RADIAN, 4),
                "rms_error_deg": round(float(result[RMS]) * DEGREES_PER_RADIAN, 4),
                "mean_error_deg": round(float(result[MEAN]) * DEGREES_PER_RADIAN, 4),
                "overshoot": round(float(result[OVERSHOOT]), 4),
                "rudder_travel_deg_per_h": round(float(result[TRAVEL]) * DEG_PER_H, 1),
            }
        rows.append(row)
    return rows


def _results_of_both(report: Report) -> tuple[Floats, Floats]:
    """Return the results of the defaults and of the choice in the fresh seas."""
    reference = report.fresh_trials.reference
    return reference, reference if report.tuned.keeps_defaults else report.fresh_trials.results(
        report.tuned.chosen.setting
    )


def case_rows(report: Report) -> list[Sequence[str]]:
    """Return the table of defaults and choice in the fresh seas with the first seed."""
    results_of_both = _results_of_both(report)
    rows: list[Sequence[str]] = [(f"case, seed {report.fresh_trials.seeds[0]}", *RESULT_COLUMNS, *RESULT_COLUMNS)]
    for number, case in enumerate(report.fresh_trials.cases):
        if case.seed != report.fresh_trials.seeds[0]:
            continue
        cells = [f"{case.text}, K T alpha x {' '.join(f'{factor:g}' for factor in case.ship)}"]
        for results in results_of_both:
            result = results[number]
            cells += [
                f"{result[RMS] * DEGREES_PER_RADIAN:.2f}",
                f"{result[MEAN] * DEGREES_PER_RADIAN:+.2f}",
                f"{result[TRAVEL] * DEG_PER_H:.0f}",
            ]
        rows.append(cells)
    return rows


def choice_lines(report: Report) -> list[str]:
    """Return lines with the choice, its reason, and its scores relative to the defaults."""
    tuned, default = report.tuned, parameters_of(default_setting())
    chosen = ", ".join(f"{name} {value:g}" for name, value in report.values.items())
    default_text = ", ".join(f"{name} {value:g}" for name, value in default.items())
    lines = [
        f"seas: {' '.join(report.scenarios)}; {_ships_text()}; seeds {_seeds_text(report.trials)}",
        f"defaults: {default_text}",
    ]
    if tuned.keeps_defaults:
        lines.append(f"chosen: the defaults; {tuned.reason}")
    else:
        lines.append(f"chosen: {chosen} ({tuned.reason})")
        lines.append(_score_line("in these seas", report.trials, tuned.chosen))
        lines.append(
            _score_line(
                f"in fresh seas, seeds {_seeds_text(report.fresh_trials)}", report.fresh_trials, tuned.fresh_score
            )
        )
    return [*lines, TUNING_NOTE, *report.notes]


def _score_line(where: str, trials: Trials, score: Score) -> str:
    return (
        f"{where}: error {score.error:.{RATIO_DIGITS}f} x that of the defaults (largest {score.worst_error:.2f} x), "
        f"rudder travel {score.travel_deg_per_h:.0f} deg/h against {trials.default_score.travel_deg_per_h:.0f} "
        f"({trials.travel(score):.{RATIO_DIGITS}f} x)"
    )


def text(report: Report) -> str:
    """Return the text for the terminal."""
    rows = case_rows(report)
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    margin, split = " " * (widths[0] + 2), sum(widths[1:4]) + 4
    table = [margin + "defaults".ljust(split + 2) + "chosen"]
    table += ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows]
    return "\n".join([*choice_lines(report), "", *table])


def _ships_text() -> str:
    return "ships K T alpha x " + ", ".join(" ".join(f"{factor:g}" for factor in ship) for ship in SHIP_FACTORS)


def _seeds_text(trials: Trials) -> str:
    return " ".join(map(str, trials.seeds))
