"""Error of an oracle in the seas in which the autopilot misses a target, at the rudder travel of the target.

`pytest -m proof tests/voyages/test_limit.py -s` prints the lowest rms of the oracle with the seeds of the targets and
with more. It knows the ship and the processes of the sea with their parameters. There are four oracles: one knows water
and mean rudder bias; one knows also the bias at each tick; one knows neither and has to learn these constants; one has
to learn them and assumes, as the autopilot does, that they change.
"""

import math

import numpy as np
import pytest

from firmware_py.common.angles import radians
from hil.lab.compare.score import score_of
from hil.report.figure_file import key_of
from hil.ship.scenarios import parse_scenario
from hil.sim.goals import parse_goals
from support import oracle

# sea -> rudder travel of its target [deg/h]
MISSED_TARGETS = {"swell": 1067.0, "weak": 1200.0, "weak+float=0.3:0.6": 1300.0}
GOALS, SECONDS = parse_goals("0:0,120:60,720:-30"), 1320.0
SEEDS, MORE_SEEDS = range(1, 6), range(1, 11)
ORACLES = {
    "learns": {"learns": frozenset(oracle.UNKNOWN), "knows_drift": False},
    "wanders": {"learns": frozenset(oracle.UNKNOWN), "knows_drift": False, "is_walking": True},
    "known": {"learns": frozenset(), "knows_drift": False},
    "known bias": {"learns": frozenset(), "knows_drift": True},
}
GAINS, BANDS_DEG = (1.5, 2.5, 4.0, 6.0, 9.0), (0.3, 0.45, 0.7, 1.0)
TOLERANCE_DEG = 0.03  # statistical difference of two figures


def score_laws(knowledge, seas, seeds):
    """Return rms and travel, (gains, deadbands, seeds, 2)."""
    scores = [
        [
            [score_of(oracle.sail(knowledge, seas[seed], (k, k * radians(b)), GOALS, SECONDS)) for seed in seeds]
            for b in BANDS_DEG
        ]
        for k in GAINS
    ]
    return np.array(
        [
            [[(score.rms_deg, score.travel_deg_per_h) for score in scores_of_law] for scores_of_law in row]
            for row in scores
        ]
    )


def lowest_rms(figures_by_law, travel_deg_per_h):
    """Return the lowest rms of all gains and deadbands with at most the given travel."""
    result = []
    for row in figures_by_law:
        rms, travel = np.sqrt(np.mean(row[..., 0] ** 2, axis=1)), np.mean(row[..., 1], axis=1)
        order = np.argsort(travel)
        if travel[order[0]] <= travel_deg_per_h:
            # Interpolated between the deadbands of one gain; constant below the smallest one.
            result.append(float(np.interp(travel_deg_per_h, travel[order], np.minimum.accumulate(rms[order]))))
    return min(result, default=math.inf)


def test_lowest_error_at_a_travel():
    figures_by_law = np.array(
        [[[(1.0, 900.0)], [(2.0, 500.0)]], [[(1.2, 600.0)], [(3.0, 400.0)]], [[(0.1, 2000.0)]] * 2]
    )
    assert lowest_rms(figures_by_law, 700.0) == pytest.approx(1.2)
    assert lowest_rms(figures_by_law, 500.0) == pytest.approx(2.0)
    assert lowest_rms(figures_by_law, 300.0) == math.inf


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("sea", MISSED_TARGETS)
def test_oracle_with_more_knowledge_has_no_larger_error(sea, figures):
    scenario, result = parse_scenario(sea), {}
    seas = {seed: oracle.drawn_of(scenario, seed, SECONDS) for seed in MORE_SEEDS}
    for name, knowledge in ORACLES.items():
        figures_by_law = score_laws(oracle.knowledge_of(scenario, **knowledge), seas, MORE_SEEDS)
        result[name] = (
            lowest_rms(figures_by_law[:, :, : len(SEEDS)], MISSED_TARGETS[sea]),
            lowest_rms(figures_by_law, MISSED_TARGETS[sea]),
        )
        figures.keep(key_of("limit", sea, name, "five"), result[name][0], "deg")
    print(f"\n{sea} at {MISSED_TARGETS[sea]:.0f} deg/h, seeds 1 to 5 and 1 to 10: ", end="")
    print("; ".join(f"{name} {five:.2f}, {ten:.2f}" for name, (five, ten) in result.items()))
    # More knowledge does not increase the error.
    for column in range(2):
        assert (
            result["known bias"][column]
            <= result["known"][column] + TOLERANCE_DEG
            <= result["learns"][column] + 2.0 * TOLERANCE_DEG
        )
