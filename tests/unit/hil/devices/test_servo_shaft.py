import math

import pytest

from hil.ship.servo import ServoShaft

DEG = math.pi / 180.0


def engaged(**options):
    shaft = ServoShaft(**options)
    shaft.set_torque(on=True)
    return shaft


def test_shaft_moves_at_the_slew_and_stops():
    shaft = engaged()
    shaft.set_target(20 * DEG)
    shaft.advance(0.5)
    assert shaft.angle_rad() == pytest.approx(15 * DEG)
    assert shaft.rate_rad_s() == pytest.approx(30 * DEG)
    shaft.advance(5.0)
    assert shaft.angle_rad() == 20 * DEG
    assert shaft.rate_rad_s() == 0.0


def test_angle_does_not_depend_on_the_steps():
    angles = []
    for steps in (1, 1000):
        shaft = engaged()
        shaft.set_target(-0.5)
        for step in range(1, steps + 1):
            shaft.advance(0.7 * step / steps)
        angles.append(shaft.angle_rad())
    assert angles[0] == angles[1]


def test_repeated_target_does_not_change_the_motion():
    shaft, repeated = engaged(), engaged()
    shaft.set_target(0.5)
    for step in range(1, 101):
        repeated.set_target(0.5)
        repeated.advance(step * 0.009)
    shaft.advance(100 * 0.009)
    assert repeated.angle_rad() == shaft.angle_rad()


def test_new_target_reverses_the_motion():
    shaft = engaged()
    shaft.set_target(30 * DEG)
    shaft.advance(0.5)
    shaft.set_target(-30 * DEG)
    shaft.advance(1.0)
    assert shaft.angle_rad() == pytest.approx(0.0, abs=1e-12)


def test_shaft_ends_at_its_stop():
    shaft = engaged(low_stop_rad=-0.2, high_stop_rad=0.1)
    shaft.set_target(9.0)
    shaft.advance(10.0)
    assert shaft.angle_rad() == 0.1


def test_released_shaft_keeps_angle_and_target():
    shaft = engaged()
    shaft.set_target(30 * DEG)
    shaft.advance(0.5)
    shaft.set_torque(on=False)
    shaft.advance(3.0)
    assert shaft.angle_rad() == pytest.approx(15 * DEG)
    shaft.set_torque(on=True)
    shaft.advance(3.25)
    assert shaft.angle_rad() == pytest.approx(22.5 * DEG)


def test_jammed_shaft_stays_until_freed():
    shaft = engaged()
    shaft.set_target(30 * DEG)
    shaft.jam(5 * DEG)
    shaft.advance(10.0)
    assert shaft.angle_rad() == pytest.approx(5 * DEG)
    assert shaft.rate_rad_s() == 0.0
    shaft.free()
    shaft.advance(10.5)
    assert shaft.angle_rad() == pytest.approx(20 * DEG)


def test_invalid_times_and_targets_are_ignored():
    shaft = engaged()
    shaft.set_target(0.3)
    shaft.advance(5.0)
    for target_rad in (math.nan, math.inf):
        shaft.set_target(target_rad)
    shaft.advance(1.0)
    shaft.advance(math.nan)
    shaft.advance(6.0)
    assert shaft.angle_rad() == 0.3


@pytest.mark.parametrize(
    ("options", "error"), [({"low_stop_rad": 1.0, "high_stop_rad": 0.0}, "stops"), ({"slew_rad_s": -1.0}, "slew")]
)
def test_invalid_options_are_rejected(options, error):
    with pytest.raises(ValueError, match=error):
        ServoShaft(**options)
