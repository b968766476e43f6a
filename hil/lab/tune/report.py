"""Report of a tuning of fixed gains: text, JSON and parameter file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN
from firmware_py.common.parameters import format_file
from hil.lab.tune import delivered
from hil.lab.tune.loop_kernel import ITAE, MEAN, OVERSHOOT, RMS, TRAVEL, Floats, closed_loop
from hil.lab.tune.paper import StepStudy
from hil.lab.tune.search import TuningResult
from hil.lab.tune.trials import DEG_PER_H, FIXED_GAINS, PAPER, Score, Setting, Trials

PLOTTED_SCENARIO = "sea"  # if it is among the cases; otherwise the first case is plotted
COLUMNS = ("case", "rms deg", "largest mean deg", "travel deg/h", "rms deg", "largest mean deg", "travel deg/h")


@dataclass(frozen=True, slots=True)
class Trace:
    """A run of one case for the plot; the rudder travel is that of the steady parts."""

    name: str
    time_s: Floats
    goal_rad: Floats
    heading_rad: Floats
    rudder_rad: Floats
    travel_deg_per_h: float


@dataclass(frozen=True, slots=True)
class Report:
    """Result of a tuning: the problem of the paper, the practical one, and the results of the choice in fresh seas.

    fresh_trials: the same cases with other waves and noise. delivered: the default controller in the same seas.
    """

    vehicle: str
    seed: int
    present: Setting
    studies: tuple[StepStudy, ...]
    trials: Trials
    fresh_trials: Trials
    tuned: TuningResult
    fresh_score: Score
    delivered: delivered.Trials
    seconds: float

    @property
    def traces(self) -> tuple[Trace, Trace]:
        """Return runs of the paper's gains and of the chosen setting in the plotted case."""
        return (
            _simulate("the paper's", self.fresh_trials, self._plotted_row(), PAPER),
            _simulate("chosen", self.fresh_trials, self._plotted_row(), self.tuned.chosen.setting),
        )

    @property
    def plotted_case(self) -> str:
        """Return the name of the plotted case."""
        return self.fresh_trials.cases[self._plotted_row()].scenario.name

    def _plotted_row(self) -> int:
        names = [case.scenario.name if case.is_nominal else "" for case in self.fresh_trials.cases]
        return names.index(PLOTTED_SCENARIO) if PLOTTED_SCENARIO in names else 0


def _simulate(name: str, trials: Trials, row: int, setting: Setting) -> Trace:
    task, seas = trials.task, trials.seas
    ticks = task.goals_rad.size * task.leg_ticks
    heading_rad, rudder_rad = np.zeros(ticks), np.zeros(ticks)
    closed_loop(
        trials.row_of(setting),
        trials.autopilot,
        task,
        seas.ships[row],
        seas.compass_rad[row],
        seas.offset_rad[row],
        heading_rad,
        rudder_rad,
    )
    travel = float(trials.results([setting])[0, row, TRAVEL]) * DEG_PER_H
    goal_rad = np.array(np.repeat(task.goals_rad, task.leg_ticks), np.float64)
    return Trace(name, np.arange(ticks, dtype=np.float64) * task.step_s, goal_rad, heading_rad, rudder_rad, travel)


def parameter_file(report: Report) -> str:
    """Return a parameter file with the chosen parameters that differ from the vehicle's."""
    chosen = report.tuned.chosen
    header = [
        f"# Tuned for {report.vehicle} by rambler-hil tune, seed {report.seed}: {report.tuned.reason}.",
        (
            f"# Error {chosen.error:.2f} and rudder travel {chosen.travel_deg_per_h / _paper_travel(report):.2f} of "
            "those of the paper's gains 40, 0.3 in the same trial runs."
        ),
    ]
    values = chosen.setting.parameters()
    header += [f"# {line}" for line in switched_off_lines(report)]
    return (
        "\n".join(header)
        + "\n"
        + format_file({**FIXED_GAINS, **{name: values[name] for name in report.tuned.changed_names}})
    )


def _paper_travel(report: Report) -> float:
    return max(report.trials.paper.travel_deg_per_h, 1e-9)


def as_json(report: Report) -> dict[str, Any]:
    """Return the results for JSON."""
    chosen = report.tuned.chosen
    return {
        "vehicle": report.vehicle,
        "seed": report.seed,
        "paper": [_study_json(study) for study in report.studies],
        "reference": _score_json(report.trials.paper),
        "chosen": {
            **_score_json(chosen),
            "why": report.tuned.reason,
            "parameters": {name: chosen.setting.parameters()[name] for name in report.tuned.changed_names},
        },
        "fresh_seas": _score_json(report.fresh_score),
        "front": [_score_json(score) for score in report.tuned.front],
        "cases": _cases_json(report),
        "switched_off": [
            {
                "scenario": name,
                "delivered": {"rms_error_deg": round(rms, 4), "rudder_travel_deg_per_h": round(travel, 1)},
                "chosen": {"rms_error_deg": round(own_rms, 4), "rudder_travel_deg_per_h": round(own_travel, 1)},
            }
            for name, (rms, travel), (own_rms, own_travel) in _switched_off(report)
        ],
        "evaluations": report.tuned.evaluations,
        "trial_runs": report.tuned.evaluations * len(report.trials.cases),
        "seconds": round(report.seconds, 3),
    }


def _study_json(study: StepStudy) -> dict[str, Any]:
    return {
        "step_deg": study.step_deg,
        "k1": round(float(study.swarm.best[0]), 4),
        "k2": round(float(study.swarm.best[1]), 4),
        "itae_deg_s2": round(study.best_itae, 3),
        "paper_itae_deg_s2": round(study.paper_itae, 3),
        "paper_excess": round(study.excess, 5),
        "paper_overshoot": round(study.paper_overshoot, 5),
        "overshoot": round(study.best_overshoot, 5),
        "evaluations": study.swarm.evaluations,
    }


def _score_json(score: Score) -> dict[str, Any]:
    return {
        "k1": round(score.setting.k1, 4),
        "k2": round(score.setting.k2, 4),
        "tau_s": round(score.setting.tau_s, 4),
        "deadband_deg": round(score.setting.deadband_deg, 4),
        "error": round(score.error, 5),
        "worst_error": round(score.worst_error, 5),
        "travel_deg_per_h": round(score.travel_deg_per_h, 1),
    }


def _cases_json(report: Report) -> list[dict[str, Any]]:
    results = report.fresh_trials.results([PAPER, report.tuned.chosen.setting])
    rows = []
    for number, case in enumerate(report.fresh_trials.cases):
        row: dict[str, Any] = {
            "scenario": case.scenario.name,
            "speed_m_s": case.scenario.speed_m_s,
            "K_factor": case.ability_factor,
            "T_factor": case.lag_factor,
        }
        for name, result in zip(("paper", "chosen"), results[:, number], strict=True):
            row[name] = {
                "itae_mean_error_deg": round(float(result[ITAE]) * DEGREES_PER_RADIAN, 4),
                "rms_error_deg": round(float(result[RMS]) * DEGREES_PER_RADIAN, 4),
                "mean_error_deg": round(float(result[MEAN]) * DEGREES_PER_RADIAN, 4),
                "overshoot": round(float(result[OVERSHOOT]), 4),
                "rudder_travel_deg_per_h": round(float(result[TRAVEL]) * DEG_PER_H, 1),
            }
        rows.append(row)
    return rows


def case_rows(report: Report) -> list[Sequence[str]]:
    """Return the table of results of the paper's gains and of the chosen setting, for the nominal ships."""
    results = report.fresh_trials.results([PAPER, report.tuned.chosen.setting])
    rows: list[Sequence[str]] = [COLUMNS]
    for number, case in enumerate(report.fresh_trials.cases):
        if case.is_nominal:
            cells = [case.scenario.name]
            for result in results[:, number]:
                cells += [
                    f"{result[RMS] * DEGREES_PER_RADIAN:.2f}",
                    f"{result[MEAN] * DEGREES_PER_RADIAN:+.2f}",
                    f"{result[TRAVEL] * DEG_PER_H:.0f}",
                ]
            rows.append(cells)
    return rows


def study_line(study: StepStudy) -> str:
    """Return a line with the results of one step of the paper's problem."""
    best = study.swarm.best
    return (
        f"ITAE of a {study.step_deg:g} deg step: optimum at k1 {best[0]:.1f}, k2 {best[1]:.2f}; the paper's 40, 0.3 is "
        f"{100.0 * study.excess:.1f} % above it and overshoots {100.0 * study.paper_overshoot:.1f} %"
    )


def choice_lines(report: Report) -> list[str]:
    """Return lines with the choice, its reason and its scores."""
    chosen, fresh = report.tuned.chosen, report.fresh_score
    values = chosen.setting.parameters()
    changed_text = ", ".join(f"{name} {values[name]:g}" for name in report.tuned.changed_names)
    lines = [
        f"chosen: {changed_text} ({report.tuned.reason})",
        (
            f"error {chosen.error:.2f} x the paper's (largest {chosen.worst_error:.2f} x), rudder travel "
            f"{chosen.travel_deg_per_h:.0f} deg/h against {report.trials.paper.travel_deg_per_h:.0f}"
        ),
        (
            f"in fresh seas: error {fresh.error:.2f} x, rudder travel "
            f"{fresh.travel_deg_per_h:.0f} deg/h against {report.fresh_trials.paper.travel_deg_per_h:.0f}"
        ),
    ]
    edges = report.tuned.limit_texts
    if edges:
        lines.append(f"at a limit of the search: {', '.join(edges)}")
    return lines


def _switched_off(report: Report) -> list[tuple[str, tuple[float, float], tuple[float, float]]]:
    """Return, for each sea with the nominal ship, rms [deg] and travel [deg/h] of default controller and choice."""
    results_of_choice = report.fresh_trials.results([report.tuned.chosen.setting])[0]
    choice_by_sea = {
        case.scenario.name: results_of_choice[number]
        for number, case in enumerate(report.fresh_trials.cases)
        if case.is_nominal
    }
    rows = []
    for case, result in zip(report.delivered.cases, report.delivered.reference, strict=True):
        if case.ship == delivered.SHIP_FACTORS[0]:
            default_figures, choice_figures = (
                (row[RMS], row[TRAVEL]) for row in (result, choice_by_sea[case.scenario.name])
            )
            rows.append((case.text, _in_degrees(*default_figures), _in_degrees(*choice_figures)))
    return rows


def _in_degrees(rms_rad: float, travel_rad_s: float) -> tuple[float, float]:
    return float(rms_rad) * DEGREES_PER_RADIAN, float(travel_rad_s) * DEG_PER_H


def switched_off_lines(report: Report) -> list[str]:
    """Return lines that warn that the parameters switch the default controller off, and show the consequences."""
    lines = ["the file switches the default controller off (CTL_MODE 0, EST_MODE 0); consequences in the same seas:"]
    for name, (rms, travel), (own_rms, own_travel) in _switched_off(report):
        lines.append(
            f"  {name}: rms {rms:.2f} deg becomes {own_rms:.2f}, rudder travel {travel:.0f} deg/h becomes "
            f"{own_travel:.0f} ({own_travel / max(travel, 1e-9):.1f} x)"
        )
    return lines


def text(report: Report) -> str:
    """Return the text for the terminal."""
    rows = case_rows(report)
    widths = [max(len(row[column]) for row in rows) for column in range(len(COLUMNS))]
    margin = " " * (widths[0] + 2)
    split = sum(widths[1:4]) + 4
    table = [margin + "the paper's gains".ljust(split + 2) + "chosen"]
    table += ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows]
    lines = [*map(study_line, report.studies), "", *choice_lines(report), "", *switched_off_lines(report), "", *table]
    return "\n".join(lines)
