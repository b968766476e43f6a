"""Rows of the comparison with the paper: value of the paper, our value, and verdict."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import DEGREES_PER_RADIAN, KNOTS_PER_METRE_PER_SECOND, radians
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel, steady_yaw_rate
from hil.lab.identify.identify import Identification
from hil.lab.identify.verdict import IDENTIFIABLE
from hil.lab.reproduce.chain import Chain, Voyage
from hil.lab.reproduce.heading_test import GOAL_S, GOALS_DEG
from hil.ship import scenarios

# step [deg] -> largest excess of the ITAE of the paper's gains, k1 = 40 and k2 = 0.3, over the minimum, as a fraction.
MAX_EXCESS = {30.0: 0.085, 90.0: 0.025}
MAX_ERROR_DEG = {"tank": 3.0, "sea": 8.0}
MAX_PREDICTION_MEAN_DEG, MAX_PREDICTION_ERROR_DEG = 0.6, 10.0
MIN_VISIBLE_OVERSHOOT = 0.03  # relative to the step
RADIUS_M = (20.0, 30.0)  # turning radius in the paper
SEA_SPEEDS_KN = (1.5, 2.1)
NOT_PRINTED = "not given"
MAX_STANDARD_ERRORS = 3.0
# name, unit, and half of the last printed digit
PRINTED = (("K", "1/s", 0.0005), ("T", "s", 0.5), ("alpha", "s^2", 0.5))


class Verdict(Enum):
    """The verdict of a row."""

    MATCHES = "matches"
    MISSES = "MISSES"
    DIFFERS = "differs"  # not a failure; the note contains the reason
    SILENT = "silent"  # the available text of the paper does not contain the value
    OURS = "ours"  # the paper has no such quantity


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the table."""

    quantity: str
    paper: str
    ours: str
    verdict: Verdict
    note: str = ""


def rows(chain: Chain) -> tuple[Row, ...]:
    """Return all rows of the table."""
    return (
        *_model_rows(chain),
        *_prediction_rows(chain),
        *_figure_rows(chain),
        *_gain_rows(chain),
        *(_voyage_row(voyage) for voyage in chain.voyages),
        _sea_speed_row(),
        *_silent_rows(chain.model),
    )


def all_match(table: tuple[Row, ...]) -> bool:
    """Return whether no row has the verdict MISSES."""
    return all(row.verdict is not Verdict.MISSES for row in table)


def _match_verdict(*, is_match: bool) -> Verdict:
    return Verdict.MATCHES if is_match else Verdict.MISSES


def _model_rows(chain: Chain) -> list[Row]:
    return [
        *_estimate_rows("heading control test", chain.test.identification),
        *_estimate_rows("zigzag and circles", chain.open_loop),
    ]


def _estimate_rows(source: str, identification: Identification) -> list[Row]:
    """Compare an identified model with the paper's, at the speed of the paper."""
    rows = []
    scaled = identification.model().at_speed(OCEAN_RAMBLER.speed_m_s)
    for index, (name, unit, rounding) in enumerate(PRINTED):
        estimate, true = identification.judgement.estimates[name], OCEAN_RAMBLER[index]
        # The standard error is scaled by the same ratio; an alpha of zero has no ratio.
        ratio = scaled[index] / estimate.value if estimate.value else 1.0
        value, se = estimate.value * ratio, estimate.se * ratio
        is_match = abs(value - true) <= max(MAX_STANDARD_ERRORS * se, rounding)
        is_identifiable = estimate.verdict == IDENTIFIABLE
        verdict = _match_verdict(is_match=is_match) if is_identifiable or not is_match else Verdict.DIFFERS
        note = "" if is_identifiable else f"{estimate.verdict} from this: {estimate.reason}"
        rows.append(Row(f"{name}, {source}", f"{true:g} {unit}", f"{value:.4g} +-{se:.2g} {unit}", verdict, note))
    return rows


def _prediction_rows(chain: Chain) -> list[Row]:
    error = chain.test.heading_error_deg
    mean, fraction_within = float(np.mean(error)), float(np.mean(np.abs(error) <= MAX_PREDICTION_ERROR_DEG))
    return [
        Row(
            "mean heading prediction error",
            "-0.6 deg",
            f"{mean:+.2f} deg",
            _match_verdict(is_match=abs(mean) <= MAX_PREDICTION_MEAN_DEG),
            f"{chain.effort.validation_s:g} s of the heading control test that were not used for the model, predicted "
            "from the rudder alone",
        ),
        Row(
            "heading prediction error",
            "almost all within +-10 deg",
            f"{100.0 * fraction_within:.1f} % within, largest {float(np.max(np.abs(error))):.1f} deg",
            _match_verdict(is_match=fraction_within >= 0.95),
        ),
    ]


def _figure_rows(chain: Chain) -> list[Row]:
    """Return the rows for figures 6 and 7, for which the text of the paper contains no numbers."""
    test = chain.test
    rate = test.predicted_rate_deg_s - test.measured_rate_deg_s
    rudder = (test.validation_truth.rudder_rad - test.validation_truth.rudder_command_rad) * DEGREES_PER_RADIAN
    return [
        Row(
            "yaw rate, predicted minus measured (figure 6)",
            NOT_PRINTED,
            f"rms {_rms(rate):.3f} deg/s of {_rms(test.measured_rate_deg_s):.2f}",
            Verdict.SILENT,
            f"both are means over {test.rate_span_s:.3g} s, two periods of the tank's waves, measured by the compass; "
            f"against the hull's own yaw rate rms {_rms(test.predicted_rate_deg_s - test.hull_rate_deg_s):.3f} deg/s",
        ),
        Row(
            "rudder, actual minus commanded (figure 7)",
            NOT_PRINTED,
            f"rms {_rms(rudder):.2f} deg",
            Verdict.SILENT,
            "the servo moves at up to 30 deg/s",
        ),
    ]


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _gain_rows(chain: Chain) -> list[Row]:
    table = []
    for study in chain.studies:
        best = study.swarm.best
        table.append(
            Row(
                f"k1, k2 by ITAE, {study.step_deg:g} deg step",
                "40, 0.3",
                f"40, 0.3 is within {100.0 * study.excess:.1f} % of the optimum",
                _match_verdict(is_match=study.excess <= MAX_EXCESS[study.step_deg]),
                f"the optimum at {best[0]:.0f}, {best[1]:.2f} is at the limit of 1 <= k1 <= 60: ITAE alone has no "
                "limit of the gain",
            )
        )
        table.append(
            Row(
                f"overshoot, {study.step_deg:g} deg step",
                "not visible",
                f"{100.0 * study.paper_overshoot:.1f} %",
                _match_verdict(is_match=study.paper_overshoot <= MIN_VISIBLE_OVERSHOOT),
                "with 40, 0.3, in the model without noise",
            )
        )
    chosen, reference = chain.tuned.chosen, chain.trials.paper
    values = chosen.setting.parameters()
    changed_text = ", ".join(f"{name} {values[name]:g}" for name in chain.tuned.changed_names)
    table.append(
        Row(
            "gains with a weight of rudder travel",
            "-",
            changed_text,
            Verdict.OURS,
            f"error {chosen.error:.2f}, rudder travel {chosen.travel_deg_per_h / reference.travel_deg_per_h:.2f} of "
            "those of 40, 0.3",
        )
    )
    return table


def _voyage_row(voyage: Voyage) -> Row:
    limit_deg = MAX_ERROR_DEG[voyage.scenario]
    largest_deg = voyage.max_error_deg
    travel = np.mean([goal.rudder_travel_deg_per_h for goal in voyage.figures])
    return Row(
        f"steady error, {voyage.scenario}, {voyage.gains} gains",
        f"within +-{limit_deg:g} deg",
        f"largest {largest_deg:.1f}, 95 % within {voyage.p95_error_deg:.1f} deg",
        _match_verdict(is_match=largest_deg <= limit_deg),
        f"the real autopilot on ptys; rudder travel {travel:.0f} deg/h",
    )


def _sea_speed_row() -> Row:
    knots = scenarios.find_scenario("sea").speed_m_s * KNOTS_PER_METRE_PER_SECOND
    low, high = SEA_SPEEDS_KN
    return Row(
        "speed at sea",
        f"{low:g} to {high:g} kn",
        f"{knots:.2f} kn",
        _match_verdict(is_match=low <= knots <= high),
        "scenario sea",
    )


def _silent_rows(model: KtModel) -> list[Row]:
    rate = steady_yaw_rate(radians(30.0), model.turning_ability_1_s, model.norrbin_s2)
    radius_m = model.speed_m_s / rate
    return [
        Row(
            "turning radius, rudder 30 deg, 0.4 m/s",
            f"{RADIUS_M[0]:g} to {RADIUS_M[1]:g} m",
            f"{radius_m:.1f} m",
            Verdict.DIFFERS,
            "the paper's value is from a satellite track in waves, which it calls imprecise; its own K, T, alpha give "
            f"{0.4 / steady_yaw_rate(radians(30.0), 0.049, 17.0):.1f} m",
        ),
        Row(
            "normalisation of the S-surface",
            NOT_PRINTED,
            "e / pi and r / r_max",
            Verdict.SILENT,
            f"r_max {rate * DEGREES_PER_RADIAN:.3f} deg/s, of full rudder; 40, 0.3 then behaves as the paper reports",
        ),
        Row(
            "main particulars of the float",
            "incomplete",
            "3.05 x 0.81 x 0.23 m, 200 kg",
            Verdict.SILENT,
            "a published float of the same class, 50 kg, and its glider, 150 kg; heading does not depend on it",
        ),
        Row(
            "manoeuvres, noise, step, bounds of k1 and k2",
            NOT_PRINTED,
            "see below",
            Verdict.SILENT,
            "heading control test: the autopilot with 40, 0.3 steers "
            f"{' '.join(f'{goal:g}' for goal in GOALS_DEG)} deg in turn, {GOAL_S:g} s each; zigzag 20/20 deg, circles "
            "of 10 to 30 deg of rudder; compass noise 0.3 deg, resolution 0.1 deg; steps of 30 and 90 deg; "
            "1 <= k1 <= 60, 0 <= k2 <= 10",
        ),
    ]
