import math

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.estimate.deviation import deviation_of, deviation_rad
from firmware_py.estimate.observer import ObserverSettings, true_heading_rad


def parameters(**values):
    chosen = ParameterSet()
    for name, value in values.items():
        chosen = chosen.replaced(name, value)
    return chosen


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.0, 4.5])
def test_the_classical_coefficients(heading):
    deviation = deviation_of(parameters(CMP_DEV_A=1, CMP_DEV_B=-2, CMP_DEV_C=3, CMP_DEV_D=0.5, CMP_DEV_E=-1), "CMP")
    expected = (
        1.0
        - 2.0 * math.sin(heading)
        + 3.0 * math.cos(heading)
        + 0.5 * math.sin(2.0 * heading)
        - math.cos(2.0 * heading)
    )
    assert math.degrees(deviation_rad(deviation, heading)) == pytest.approx(expected, abs=1e-6)


def test_each_compass_has_its_own_corrections():
    settings = ObserverSettings.of(
        parameters(CMP_OFFSET_DEG=10, CMPB_OFFSET_DEG=-20, CMPB_DEV_A=5, CMP_DECL_DEG=7, CMP_DEV_C=0)
    )

    def compass_heading(source, reference):
        return math.degrees(true_heading_rad(settings, HeadingSample(0.0, 1.0, reference, source=source)))

    bare = math.degrees(1.0)
    assert compass_heading(0, NorthReference.TRUE) == pytest.approx(bare + 10.0, abs=1e-4)
    assert compass_heading(0, NorthReference.MAGNETIC) == pytest.approx(bare + 17.0, abs=1e-4)
    assert compass_heading(1, NorthReference.TRUE) == pytest.approx(bare - 15.0, abs=1e-4)
    assert compass_heading(1, NorthReference.MAGNETIC) == pytest.approx(bare - 8.0, abs=1e-4)
