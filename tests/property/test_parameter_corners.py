"""No lawful parameter ends the loop or makes a command that is no number, with any kind of compass."""

import random

import pytest

from firmware_py.common.mode_table import Mode
from support.corners import COMPASSES, FREE, GUIDED, Sail, lawful

SECONDS = 15.0
GROUP = 5
# Of commit e343f391: each ended the autopilot within seconds, in the step of the cubic term.
KNOWN = [
    ({"MDL_K": 20.0, "MDL_ALPHA_S2": 1e6}, "whole degrees"),
    ({"MDL_K": 20.0, "MDL_ALPHA_S2": 1e6}, "gaps"),
    ({"MDL_K": 5.0, "MDL_ALPHA_S2": 1e5}, "fine"),
    ({"MDL_K": 5.0, "MDL_ALPHA_S2": 1e5}, "coarse"),
    ({"MDL_K": 5.0, "MDL_ALPHA_S2": 1e5}, "frozen"),
    ({"MDL_K": 20.0}, "noisy"),
    ({"MDL_K": 20.0, "MDL_ALPHA_S2": 1e6, "MDL_T_S": 0.05}, "slow"),
]
SHIP = tuple(row for row in FREE if row.name.startswith(("MDL_", "CTL_", "EST_", "LOOP_", "RUD_", "CRUISE_")))


@pytest.mark.parametrize(("values", "compass"), KNOWN)
def test_extreme_models_are_steered(values, compass):
    Sail(values, compass).run(SECONDS)
    Sail({}, compass, later=values).run(SECONDS)


def groups(seed):
    """Yield all parameters in groups, each at one end of its range, with compass, mode and when they are set."""
    draw = random.Random(seed)
    rows, compasses = draw.sample(FREE, len(FREE)), draw.sample(sorted(COMPASSES), len(COMPASSES))
    for number, at in enumerate(range(0, len(rows), GROUP)):
        values = {row.name: lawful(row, draw.choice((0.0, 1.0))) for row in rows[at : at + GROUP]}
        mode = GUIDED if number % 3 else draw.choice(list(Mode)).value
        yield values, compasses[number % len(compasses)], mode, number % 4 == 0


@pytest.mark.parametrize("seed", [*range(2), *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(2, 30))])
def test_every_parameter_at_the_ends_of_its_range(seed):
    for values, compass, mode, late in groups(seed):
        Sail({} if late else values, compass, values if late else (), mode).run(SECONDS)


@pytest.mark.proof
@pytest.mark.parametrize("compass", COMPASSES)
def test_pairs_of_what_steers_at_their_corners(compass):
    draw = random.Random(compass)
    for _ in range(150):
        rows = draw.sample(SHIP, 2)
        Sail({row.name: lawful(row, draw.choice((0.0, 1.0, draw.random()))) for row in rows}, compass).run(SECONDS)
