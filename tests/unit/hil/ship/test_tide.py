import math

import pytest

from hil.ship.planar import M2_S, Tide


def test_current_without_period_is_constant():
    tide = Tide(0.3, math.pi / 2)
    assert tide.velocity_m_s(0.0) == tide.velocity_m_s(1e6) == pytest.approx((0.0, 0.3))


def test_current_with_a_period_reverses():
    tide = Tide(0.3, 0.0, M2_S)
    assert tide.velocity_m_s(M2_S / 2) == pytest.approx((-0.3, 0.0), abs=1e-9)
    assert tide.velocity_m_s(M2_S / 4) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert tide.velocity_m_s(5 * M2_S) == pytest.approx((0.3, 0.0), abs=1e-9)


@pytest.mark.parametrize(("rotary", "east"), [(1.0, 0.3), (-0.5, -0.15)])
def test_rotary_current_turns_by_its_sign(rotary, east):
    assert Tide(0.3, 0.0, 3600.0, rotary).velocity_m_s(900.0) == pytest.approx((0.0, east), abs=1e-9)
