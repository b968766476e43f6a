"""Limits in the seas in which the autopilot misses a target: the error of an oracle at the target's rudder travel.

`pytest -m proof tests/voyages/test_limit.py -s` prints the lowest rms that it reaches on the seeds of the aims and on
more. It knows the processes of the sea, with all their numbers, and the ship: once with the water and the
mean of the rudder bias; once with the bias besides, from tick to tick; once without either, so
that it has to learn these constants from what the boat knows of them beforehand; and once without knowing that they
are constants, so that it has to expect them to change as the boat does.
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

MISSED = {"swell": 1067.0, "weak": 1200.0, "weak+float=0.3:0.6": 1300.0}  # and the rudder travel of the aim
GOALS, SECONDS = parse_goals("0:0,120:60,720:-30"), 1320.0
SEEDS, MORE = range(1, 6), range(1, 11)
REPORT = {
    "learns": {"learns": frozenset(oracle.UNKNOWN), "knows_drift": False},
    "wanders": {"learns": frozenset(oracle.UNKNOWN), "knows_drift": False, "wanders": True},
    "known": {"learns": frozenset(), "knows_drift": False},
    "known bias": {"learns": frozenset(), "knows_drift": True},
}
GAINS, BANDS_DEG = (1.5, 2.5, 4.0, 6.0, 9.0), (0.3, 0.45, 0.7, 1.0)
SAME = 0.03  # of two figures that chance sets apart


def tried(known, drawn, seeds):
    """Return rms and travel of laws: by gain, deadband and seed."""
    scores = [
        [
            [score_of(oracle.sail(known, drawn[seed], (k, k * radians(b)), GOALS, SECONDS)) for seed in seeds]
            for b in BANDS_DEG
        ]
        for k in GAINS
    ]
    return np.array([[[(one.rms_deg, one.travel_deg_per_h) for one in some] for some in row] for row in scores])


def lowest(laws, travel_deg_per_h):
    """Return the lowest rms of laws, by gain and deadband, at a travel, or below it where less is enough."""
    found = []
    for row in laws:
        rms, travel = np.sqrt(np.mean(row[..., 0] ** 2, axis=1)), np.mean(row[..., 1], axis=1)
        order = np.argsort(travel)
        if travel[order[0]] <= travel_deg_per_h:
            # For one gain, from deadband to deadband; beyond the narrowest nothing improves.
            found.append(float(np.interp(travel_deg_per_h, travel[order], np.minimum.accumulate(rms[order]))))
    return min(found, default=math.inf)


def test_lowest_error_at_a_travel():
    laws = np.array([[[(1.0, 900.0)], [(2.0, 500.0)]], [[(1.2, 600.0)], [(3.0, 400.0)]], [[(0.1, 2000.0)]] * 2])
    assert lowest(laws, 700.0) == pytest.approx(1.2)
    assert lowest(laws, 500.0) == pytest.approx(2.0)
    assert lowest(laws, 300.0) == math.inf


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("sea", MISSED)
def test_limits_of_an_oracle(sea, figures):
    scenario, found = parse_scenario(sea), {}
    drawn = {seed: oracle.drawn_of(scenario, seed, SECONDS) for seed in MORE}
    for name, knowledge in REPORT.items():
        laws = tried(oracle.knowledge_of(scenario, **knowledge), drawn, MORE)
        found[name] = lowest(laws[:, :, : len(SEEDS)], MISSED[sea]), lowest(laws, MISSED[sea])
        figures.keep(key_of("limit", sea, name, "five"), found[name][0], "deg")
    print(f"\n{sea} at {MISSED[sea]:.0f} deg/h, seeds 1 to 5 and 1 to 10: ", end="")
    print("; ".join(f"{name} {five:.2f}, {ten:.2f}" for name, (five, ten) in found.items()))
    # More knowledge does not increase the error.
    for column in range(2):
        assert found["known bias"][column] <= found["known"][column] + SAME <= found["learns"][column] + 2.0 * SAME
