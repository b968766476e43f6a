"""Heading estimate of the compiled loop in a grid of seas and receivers: consistent, and near an informed filter.

The receiver affects the heading only through the speed at which K and T are evaluated.
"""

import math

import numpy as np
import pytest

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from hil.lab.twin import loop
from hil.lab.twin.sea import sea_of
from hil.ship.scenarios import parse_scenario
from hil.sim.goals import Goal
from support import informed_voyage
from support.heading_recording import filter_first_order
from support.informed_voyage import RECORDED_LIKE

pytestmark = [pytest.mark.proof, pytest.mark.timeout(7200)]

SECONDS, SETTLED_S = 3600.0, 900.0
GOALS = [Goal(900.0 * i, radians(angle)) for i, angle in enumerate((0.0, 90.0, 180.0, -90.0))]
SEEDS = range(1, 21)
DIFFUSIONS = (0.0, 0.3, 1.0, 2.0, 4.0, 6.0)
BIASES = ((2.0, 900.0), (5.0, 900.0), (12.0, 3000.0))
RECEIVERS = {
    "no lag": "0.2:0:10:0:0.005",
    "lag 5 s": "0.2:0:10:5:0.005",
    "lag 15 s": "0.2:0:10:15:0.005",
    "no receiver": "0.2:1",
}
LOW_PASSES_S = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0)


def mean_squares(record):
    """Return mean square heading error [rad^2], NEES, and mean square errors of the low-passed compass [rad^2]."""
    t = record.ticks
    is_settled = t[:, loop.TICK_S] > SETTLED_S
    true_rad = np.interp(t[:, loop.TICK_S], np.arange(record.heading_rad.size) / 10.0, record.heading_rad)
    error = np.array([math.remainder(x, 2.0 * math.pi) for x in true_rad - t[:, loop.HEADING_RAD]])[is_settled]
    first = np.flatnonzero(np.isfinite(t[:, loop.COMPASS_RAD]))[0]
    compass_rad = np.unwrap(t[first:, loop.COMPASS_RAD])
    low_pass_squares = []
    for lag_s in LOW_PASSES_S:
        keep = math.exp(-0.1 / lag_s) if lag_s else 0.0
        low = filter_first_order((1.0 - keep) * compass_rad, keep, compass_rad[0])
        error_rad = np.array([math.remainder(x, 2.0 * math.pi) for x in true_rad[first:] - low])[is_settled[first:]]
        low_pass_squares.append(float(np.mean(error_rad**2)))
    return float(np.mean(error**2)), float(np.mean((error / t[is_settled, loop.HEADING_SD_RAD]) ** 2)), low_pass_squares


@pytest.mark.parametrize("receiver", RECEIVERS)
@pytest.mark.parametrize("bias", BIASES)
@pytest.mark.parametrize("diffusion", DIFFUSIONS)
def test_uncertainty_is_consistent_and_near_the_informed_filter(diffusion, bias, receiver):
    levels = RECORDED_LIKE["coast"]._replace(diffusion=diffusion, bias_deg=bias[0], bias_memory_s=bias[1])
    name = f"coast+yaw={diffusion},bias={bias[0]:g}:{bias[1]:g},receiver={RECEIVERS[receiver]}"
    figures = []
    for seed in SEEDS:
        sea = sea_of(parse_scenario(name), seed, SECONDS)
        records = (
            informed_voyage.sail(sea, GOALS, SECONDS, ParameterSet(), levels, informed=informed, ticks=True)
            for informed in (False, True)
        )
        figures.append([mean_squares(record) for record in records])
    estimate_figures, informed_figures = zip(*figures, strict=True)
    error_deg, best_deg = (
        math.degrees(math.sqrt(np.mean([run[0] for run in runs]))) for runs in (estimate_figures, informed_figures)
    )
    nees, low_pass_squares = (
        np.mean([run[1] for run in estimate_figures]),
        np.mean([run[2] for run in estimate_figures], axis=0),
    )
    low_pass_deg = math.degrees(math.sqrt(low_pass_squares.min()))
    print(f"{name}: error {error_deg:.2f}, informed {best_deg:.2f}, low-pass {low_pass_deg:.2f} deg, NEES {nees:.2f}")
    assert 0.6 <= nees <= 1.4
    assert error_deg <= 1.1 * best_deg + 0.1
    assert error_deg <= low_pass_deg
