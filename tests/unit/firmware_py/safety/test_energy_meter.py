import math

import pytest

from firmware_py.common.records import RudderStatus
from firmware_py.safety.energy_meter import EnergyMeterState, report, update


def run(state, angles_rad, power_w=None, step_s=0.1, start_s=0.0):
    for index, angle_rad in enumerate(angles_rad):
        t_s = start_s + index * step_s
        rudder = RudderStatus(t_s, 0.0, angle_rad, is_new=True, feedback_s=t_s, power_w=power_w)
        state = update(state, rudder, step_s)
    return state


def test_travel_reversals_and_energy_of_an_oscillating_rudder():
    # 0.2 rad to both sides with a period of 10 s for an hour: 0.8 rad of travel and two reversals in each period.
    angles = [0.2 * math.sin(math.tau * index / 100) for index in range(36000)]
    energy = report(run(EnergyMeterState(), angles, 3.0), is_torque_released=False)
    assert energy.travel_rad == pytest.approx(288.0, rel=1e-3)
    assert energy.reversals == pytest.approx(720, abs=2)
    assert energy.travel_rad_per_h == pytest.approx(288.0, rel=1e-2)
    assert energy.reversals_per_h == pytest.approx(720.0, rel=1e-2)
    assert energy.energy_j == pytest.approx(3.0 * 3600.0, rel=1e-3)
    assert energy.power_w == 3.0


def test_encoder_noise_is_travel_but_no_reversal():
    state = run(EnergyMeterState(), [0.001 * (index % 2) for index in range(1000)])
    assert state.reversals == 0
    assert state.travel_rad == pytest.approx(0.999)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("back_deg", "reversals"), [(0.49, 0), (0.51, 1)])
def test_movement_of_half_a_degree_in_the_opposite_direction_is_a_reversal(side, back_deg, reversals):
    angles_deg = (0.0, 5.0, 10.0, 10.0 - back_deg, 10.0 - back_deg)
    state = run(EnergyMeterState(), [side * math.radians(angle) for angle in angles_deg])
    assert (state.reversals, state.direction) == (reversals, -side if reversals else side)


@pytest.mark.parametrize(("gap_s", "energy_j"), [(-0.1, 10.0), (0.0, 10.0), (1.9, 29.0), (2.1, 10.0), (100.0, 10.0)])
def test_gap_of_more_than_2_s_in_the_servo_feedback_adds_no_energy(gap_s, energy_j):
    state = run(EnergyMeterState(), [0.0] * 11, 10.0)
    assert state.energy_j == pytest.approx(10.0)
    assert run(state, [0.0], 10.0, start_s=1.0 + gap_s).energy_j == pytest.approx(energy_j)


def test_sums_of_the_values_per_hour_decrease_to_1_over_e_in_an_hour():
    state = EnergyMeterState(recent_s=3600.0, recent_rad=1.0, recent_reversals=2.0, angle_rad=0.0)
    energy = report(run(state, [0.0], step_s=3600.0), is_torque_released=False)
    share = math.exp(-1.0) / (1.0 + math.exp(-1.0))
    assert (energy.travel_rad_per_h, energy.reversals_per_h) == pytest.approx((share, 2.0 * share))
    assert report(EnergyMeterState(recent_rad=1.0), is_torque_released=False).travel_rad_per_h == 0.0


def test_values_per_hour_have_a_memory_of_an_hour():
    state = run(EnergyMeterState(), [0.3 * (index % 2) for index in range(100)], step_s=1.0)
    reversals_per_h = report(state, is_torque_released=False).reversals_per_h
    later = report(run(state, [0.0] * 20000, step_s=1.0), is_torque_released=True)
    assert reversals_per_h > 3000.0
    assert later.reversals_per_h < 1.0
    assert later.resting
    assert later.power_w is None


def test_noise_of_a_rudder_angle_sensor_is_no_travel():
    state = EnergyMeterState()
    for tick in range(100):
        noise_rad = 0.01 * (-1) ** tick
        state = update(state, RudderStatus(0.1 * tick, 0.001 * tick, noise_rad, measured=True, from_sensor=True), 0.1)
    assert state.travel_rad == pytest.approx(0.099)
