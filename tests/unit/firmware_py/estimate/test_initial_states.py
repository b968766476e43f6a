"""Initial states of the estimates. Stored records of earlier versions also take these values for missing fields."""

import math

import msgspec
import numpy as np
import pytest

from firmware_py.control import law
from firmware_py.estimate import deviation_filter, gyro, heading_tick, water, water_results, wind
from firmware_py.estimate.declination import Declination
from firmware_py.estimate.heading_model import Motion, NoiseLevels
from firmware_py.estimate.observer import HeadingState
from firmware_py.estimate.position import PositionState
from firmware_py.estimate.position_consistency import PositionConsistency
from firmware_py.estimate.water_filter import WaterFilter

DEGREE = math.radians(1.0)
PRIOR = [2.0 * math.log(DEGREE), *map(math.log, (DEGREE, 2.8, 0.2, 0.1 * DEGREE, 0.3 * DEGREE))]
COMPASS = [1.0, 5.0 * DEGREE]  # longest time with a constant reading, resolution
SQUARES = [1.0, 1.0]  # of innovations and predictions
WATER = np.log([0.1, 0.0004, 0.15, 0.3])


def numbers(value):
    """Return the numbers of a record other than 0 and NaN, in order."""
    if isinstance(value, msgspec.Struct):
        value = msgspec.structs.astuple(value)
    if isinstance(value, (tuple, np.ndarray)):
        return [number for item in value for number in numbers(item)]
    return [] if value is None or isinstance(value, bytes) or value == 0.0 or math.isnan(value) else [float(value)]


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        (heading_tick.START, [*COMPASS, *COMPASS, 3.0, *PRIOR, *SQUARES]),
        (NoiseLevels(), []),
        (Motion(), []),
        (HeadingState(), []),
        (Declination(), []),
        (gyro.START, []),
        (PositionState(), []),
        (PositionConsistency(), []),
        (deviation_filter.DeviationState(), [2.0 * math.log(0.05)] * 2),
        (deviation_filter.Minute(0.0, 0.0, 0.0, 0.0), []),
        (water.WaterState(), [*WATER, 0.5, 0.5]),
        (WaterFilter(), [*WATER]),
        (water_results.CurrentVerdict(), []),
        (water_results.DeadReckoning(), [0.09, 0.09, 0.09, 0.01]),
        (water_results.DeadReckoning()[5:], []),
        (wind.Motion(None, 0.0, 0.0), []),
        (law.IDLE, []),
    ],
)
def test_initial_state_is_zero_apart_from_prior_values(record, expected):
    assert numbers(record) == pytest.approx(expected)
