"""Quaternion, local position, position target, and the status of the estimator."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import FixType, PositionSample
from firmware_py.common.reports import Activity, DeadReckoningPosition, Estimate, Home, Navigation
from firmware_py.link.telemetry.motion import quaternion

FIX = PositionSample(0.0, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, math.pi / 2, 8, 1.25)
ESTIMATE = Estimate(
    source=0, heading_rad=1.0, heading_sd_rad=0.01, yaw_rate_rad_s=0.0, yaw_rate_sd_rad_s=0.001, bias_rad=0.1,
    bias_sd_rad=0.01, wave_period_s=6.0, wave_sd_rad=0.2, compass_noise_rad=0.01, speed_m_s=0.5, speed_sd_m_s=0.05,
    current_north_m_s=0.1, current_east_m_s=-0.1, innovation_rad=0.0, innovation_sd_rad=0.01,
    innovation_square=1.0,
)  # fmt: skip
DEAD_RECKONING = {
    "position": FIX,
    "position_ok": False,
    "dead_reckoning": DeadReckoningPosition(0.7, -0.2, 0.3, 0.0, 250.0, 3600.0),
}
# Flags of ESTIMATOR_STATUS
ATTITUDE, VELOCITY = mavlink.ESTIMATOR_ATTITUDE, mavlink.ESTIMATOR_VELOCITY_HORIZ
RELATIVE_POSITION = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
ABSOLUTE_POSITION = mavlink.ESTIMATOR_POS_HORIZ_ABS | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
VERTICAL = mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS
HOME = Home(0.7 - 100.0 / EARTH_RADIUS_M, -0.2, 1.0)


@pytest.fixture
def request_message(rig, of):
    def call(number, name, **changes):
        rig.tick(**changes)
        replies = of(rig.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number), name)
        return replies[0] if replies else None

    return call


def test_quaternion_equals_the_attitude(request_message):
    attitude = request_message(31, "ATTITUDE_QUATERNION", heading_rad=5.0, roll_rad=None, pitch_rad=None)
    assert (attitude.q1, attitude.q4) == pytest.approx((math.cos(2.5 - math.pi), math.sin(2.5 - math.pi)), abs=1e-6)
    assert (attitude.q2, attitude.q3, attitude.repr_offset_q) == (0, 0, [0, 0, 0, 0])
    assert request_message(31, "ATTITUDE_QUATERNION", heading_ok=False) is None


@given(*(st.floats(-1.5, 1.5),) * 2, st.floats(-3.0, 3.0))
def test_angles_are_recovered_from_the_quaternion(roll_rad, pitch_rad, yaw_rad):
    w, x, y, z = quaternion(roll_rad, pitch_rad, yaw_rad)
    assert math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(roll_rad, abs=1e-6)
    assert math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))) == pytest.approx(pitch_rad, abs=1e-6)
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(yaw_rad, abs=1e-6)


def test_local_position_is_relative_to_home(request_message):
    position = request_message(32, "LOCAL_POSITION_NED", position=FIX, position_ok=True, home=HOME)
    assert (position.x, position.y, position.z) == pytest.approx((100.0, 0.0, -2.0), abs=1e-3)
    assert (position.vx, position.vy, position.vz) == pytest.approx((0.0, 0.5, 0.0), abs=1e-6)
    for velocity in (
        {"speed_over_ground_m_s": None},
        {"course_over_ground_rad": None},
        {"course_over_ground_rad": math.inf},
    ):
        fix = msgspec.structs.replace(FIX, **velocity)
        position = request_message(32, "LOCAL_POSITION_NED", position=fix, position_ok=True, home=HOME)
        assert (position.vx, position.vy) == (0.0, 0.0)
    fix = msgspec.structs.replace(FIX, altitude_m=None)
    assert request_message(32, "LOCAL_POSITION_NED", position=fix, position_ok=True, home=HOME).z == 0.0
    assert request_message(32, "LOCAL_POSITION_NED", position=FIX, position_ok=False, home=HOME) is None
    assert request_message(32, "LOCAL_POSITION_NED", position=FIX, position_ok=True) is None


def test_position_target_is_the_navigation_target(request_message):
    target = request_message(87, "POSITION_TARGET_GLOBAL_INT", navigation=Navigation(Activity.LINE, 0.7, -0.2))
    assert (target.lat_int, target.lon_int) == (round(math.degrees(0.7) * 1e7), round(math.degrees(-0.2) * 1e7))
    assert target.type_mask & 0b11 == 0
    assert target.type_mask & 0b1101_1111_1100 == 0b1101_1111_1100
    assert request_message(87, "POSITION_TARGET_GLOBAL_INT", navigation=Navigation(Activity.HEADING)) is None


def test_estimator_flags_are_valid_quantities(request_message):
    good = request_message(230, "ESTIMATOR_STATUS", position=FIX, position_ok=True)
    assert good.flags == ATTITUDE | VELOCITY | RELATIVE_POSITION | ABSOLUTE_POSITION
    assert all(math.isnan(value) for value in (good.vel_ratio, good.mag_ratio, good.pos_horiz_accuracy))
    assert request_message(230, "ESTIMATOR_STATUS", heading_ok=False).flags == 0


def test_dead_reckoning_is_relative_with_its_accuracy(request_message):
    status = request_message(230, "ESTIMATOR_STATUS", **DEAD_RECKONING)
    assert (status.flags, status.pos_horiz_accuracy) == (ATTITUDE | RELATIVE_POSITION, 250.0)
    assert request_message(32, "LOCAL_POSITION_NED", home=HOME, **DEAD_RECKONING).vx == pytest.approx(0.3)


def test_mag_ratio_is_the_innovation_in_five_standard_deviations(request_message):
    def ratio(innovation_rad, innovation_sd_rad):
        estimate = msgspec.structs.replace(ESTIMATE, innovation_rad=innovation_rad, innovation_sd_rad=innovation_sd_rad)
        return request_message(230, "ESTIMATOR_STATUS", estimate=estimate).mag_ratio

    assert ratio(-math.radians(5.0), math.radians(2.0)) == pytest.approx(0.5)
    assert math.isnan(ratio(1.0, 0.0))


def test_ekf_status_report_has_the_flags_and_ratio_of_the_estimator(request_message):
    assert request_message(193, "EKF_STATUS_REPORT", heading_ok=False).flags == 0
    good = request_message(193, "EKF_STATUS_REPORT", position=FIX, position_ok=True)
    assert good.flags == ATTITUDE | VELOCITY | RELATIVE_POSITION | ABSOLUTE_POSITION | VERTICAL
    ratios = {name: getattr(good, name) for name in good.fieldnames if name.endswith("_variance")}
    assert (len(ratios), set(ratios.values())) == (6, {0.0})
    assert request_message(193, "EKF_STATUS_REPORT", **DEAD_RECKONING).flags == ATTITUDE | RELATIVE_POSITION
    outlier = msgspec.structs.replace(ESTIMATE, innovation_rad=0.1, innovation_sd_rad=0.02)
    assert request_message(193, "EKF_STATUS_REPORT", estimate=outlier).compass_variance == pytest.approx(1.0)
