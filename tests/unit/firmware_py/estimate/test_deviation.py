import math
from functools import reduce

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.estimate.deviation import deviation_rad, read_deviation
from firmware_py.estimate.observer import ObserverSettings, true_heading_rad


def parameters(**values):
    return reduce(lambda result, item: result.replaced(*item), values.items(), ParameterSet())


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.0, 4.5])
def test_deviation_equals_the_classical_formula(heading):
    deviation = read_deviation(parameters(CMP_DEV_A=1, CMP_DEV_B=-2, CMP_DEV_C=3, CMP_DEV_D=0.5, CMP_DEV_E=-1), "CMP")
    single = 1.0 - 2.0 * math.sin(heading) + 3.0 * math.cos(heading)
    double = 0.5 * math.sin(2.0 * heading) - math.cos(2.0 * heading)
    assert math.degrees(deviation_rad(deviation, heading)) == pytest.approx(single + double, abs=1e-6)


@pytest.mark.parametrize(
    ("source", "reference", "correction_deg"),
    [
        (0, NorthReference.TRUE, 10.0),
        (0, NorthReference.MAGNETIC, 17.0),
        (1, NorthReference.TRUE, -15.0),
        (1, NorthReference.MAGNETIC, -8.0),
    ],
)
def test_each_compass_has_its_own_corrections(source, reference, correction_deg):
    settings = ObserverSettings.of(parameters(CMP_OFFSET_DEG=10, CMPB_OFFSET_DEG=-20, CMPB_DEV_A=5, CMP_DECL_DEG=7))
    heading_rad = true_heading_rad(settings, HeadingSample(0.0, 1.0, reference, source=source))
    assert math.degrees(heading_rad - 1.0) == pytest.approx(correction_deg, abs=1e-4)
