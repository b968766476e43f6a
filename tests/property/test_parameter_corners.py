"""With any valid parameters and any compass, the loop continues and the rudder command is finite."""

import random

import pytest

from firmware_py.common.mode_table import Mode
from support.corners import COMPASSES, FREE, GUIDED, CheckedBoat, value_at_share

SECONDS = 15.0
GROUP_SIZE = 5
# With each of these the autopilot of commit e343f391 failed within seconds, in the cubic term.
FORMER_FAILURES = [
    ({"MDL_K": 20.0, "MDL_ALPHA_S2": 1e6}, "whole degrees"),
    ({"MDL_K": 20.0, "MDL_ALPHA_S2": 1e6}, "gaps"),
    ({"MDL_K": 5.0, "MDL_ALPHA_S2": 1e5}, "fine"),
    ({"MDL_K": 5.0, "MDL_ALPHA_S2": 1e5}, "coarse"),
    ({"MDL_K": 5.0, "MDL_ALPHA_S2": 1e5}, "frozen"),
    ({"MDL_K": 20.0}, "noisy"),
    ({"MDL_K": 20.0, "MDL_ALPHA_S2": 1e6, "MDL_T_S": 0.05}, "slow"),
]
STEERING_PARAMETERS = tuple(
    row for row in FREE if row.name.startswith(("MDL_", "CTL_", "EST_", "LOOP_", "RUD_", "CRUISE_"))
)


@pytest.mark.parametrize(("values", "compass"), FORMER_FAILURES)
def test_extreme_models_do_not_fail(values, compass):
    CheckedBoat(values, compass).run(SECONDS)
    CheckedBoat({}, compass, later=values).run(SECONDS)


def parameter_groups(seed):
    """Yield groups of parameters at the ends of their ranges, with compass, mode and whether they are set later."""
    rng = random.Random(seed)
    rows, compasses = rng.sample(FREE, len(FREE)), rng.sample(sorted(COMPASSES), len(COMPASSES))
    for number, start in enumerate(range(0, len(rows), GROUP_SIZE)):
        values = {row.name: value_at_share(row, rng.choice((0.0, 1.0))) for row in rows[start : start + GROUP_SIZE]}
        mode = GUIDED if number % 3 else rng.choice(list(Mode)).value
        yield values, compasses[number % len(compasses)], mode, number % 4 == 0


@pytest.mark.parametrize("seed", [*range(2), *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(2, 30))])
def test_parameters_at_the_ends_of_their_ranges_do_not_fail(seed):
    for values, compass, mode, is_set_later in parameter_groups(seed):
        CheckedBoat({} if is_set_later else values, compass, values if is_set_later else (), mode).run(SECONDS)


@pytest.mark.proof
@pytest.mark.parametrize("compass", COMPASSES)
def test_pairs_of_steering_parameters_do_not_fail(compass):
    rng = random.Random(compass)
    for _ in range(150):
        rows = rng.sample(STEERING_PARAMETERS, 2)
        CheckedBoat({row.name: value_at_share(row, rng.choice((0.0, 1.0, rng.random()))) for row in rows}, compass).run(
            SECONDS
        )
