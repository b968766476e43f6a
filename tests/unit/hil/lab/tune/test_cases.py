"""Trial runs of the fixed-gain controller: cases, tasks and seas."""

import math

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.control.law import Gains
from firmware_py.estimate.observer import ObserverSettings
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab.tune.cases import autopilot_of, cases_of, seas_of, steps_in, task_of
from hil.ship.scenarios import UnknownScenarioError

PARAMETERS = ParameterSet()
AUTOPILOT = autopilot_of(PARAMETERS)
TASK = task_of(OCEAN_RAMBLER, AUTOPILOT)


def test_cases_are_five_ships_in_each_sea_and_calm_water_at_two_speeds():
    cases = cases_of(["tank", "swell"])
    assert [case.scenario.name for case in cases[:10]] == ["tank"] * 5 + ["swell"] * 5
    assert {(case.ability_factor, case.lag_factor) for case in cases[:5]} == {
        (1.0, 1.0), (0.7, 0.7), (0.7, 1.3), (1.3, 0.7), (1.3, 1.3),
    }  # fmt: skip
    assert [case.scenario.speed_m_s for case in cases[10:]] == [0.2, 1.2]
    assert sum(case.is_nominal for case in cases) == 4


def test_ships_are_scaled_by_similarity_and_by_their_factors():
    case = cases_of(["sea"])[2]
    ship = case.ship(OCEAN_RAMBLER)
    ratio = 0.9 / 0.4
    assert ship.turning_ability_1_s == pytest.approx(0.049 * ratio * 0.7)
    assert ship.turning_lag_s == pytest.approx(4.0 / ratio * 1.3)
    assert ship.norrbin_s2 == pytest.approx(17.0 / ratio**2)


def test_unknown_sea_is_refused():
    with pytest.raises(UnknownScenarioError, match="unknown scenario 'pond'"):
        cases_of(["pond"])


def test_sea_with_unsupported_disturbances_is_refused():
    with pytest.raises(UnknownScenarioError, match="'ocean-1' has disturbances that the trial runs do not have"):
        cases_of(["sea", "ocean-1"])


def test_autopilot_settings_equal_those_of_the_firmware():
    gains, observer = Gains.of(PARAMETERS), ObserverSettings.of(PARAMETERS)
    assert AUTOPILOT.rate_max_rad_s == gains.yaw_rate_max_rad_s
    assert AUTOPILOT.rudder_limit_rad == gains.rudder_limit_rad
    assert AUTOPILOT.rate_limit_rad_s == observer.yaw_rate_limit_rad_s
    assert (AUTOPILOT.turning_ability_1_s, AUTOPILOT.turning_lag_s) == (
        observer.model.turning_ability_1_s,
        observer.model.turning_lag_s,
    )


def test_seas_have_the_wave_yaw_noise_and_offset_of_their_scenarios():
    cases = cases_of(["swell", "weak"])
    seas = seas_of(cases, OCEAN_RAMBLER, TASK, 4)
    sd_deg = np.degrees(np.std(seas.compass_rad, axis=1))
    assert np.mean(sd_deg[:5]) == pytest.approx(20.0, rel=0.2)
    assert np.mean(sd_deg[5:10]) == pytest.approx(10.0, rel=0.2)
    assert sd_deg[10:] == pytest.approx(0.3, rel=0.1)
    assert math.degrees(np.mean(seas.offset_rad[:5])) == pytest.approx(5.0, abs=1.5)
    assert np.all(seas.offset_rad[10:] == 0.0)


def test_seas_depend_on_the_seed_only():
    cases = cases_of(["tank"])
    first_seas, same_seas, other_seas = (seas_of(cases, OCEAN_RAMBLER, TASK, seed) for seed in (1, 1, 2))
    assert np.array_equal(first_seas.compass_rad, same_seas.compass_rad)
    assert not np.array_equal(first_seas.compass_rad, other_seas.compass_rad)


def test_leg_is_longer_for_slow_ships_up_to_a_limit():
    slow = KtModel(0.005, 30.0, 0.0, 0.0, 1.0)
    autopilot = autopilot_of(PARAMETERS.replaced("MDL_K", 0.005))
    assert TASK.leg_ticks == 3000
    assert 3000 < task_of(slow, autopilot).leg_ticks <= 30000
    assert task_of(KtModel(0.01, 4000.0, 0.0, 0.0, 1.0), autopilot).leg_ticks == 30000


def test_short_lag_needs_more_steps_and_invalid_ship_is_refused():
    fast = KtModel(6.0, 0.2, 1e4, 0.0, 0.4)
    assert seas_of(cases_of(["calm"]), fast, TASK, 1).ships[0, 3] > 2
    with pytest.raises(ValueError, match="invalid ship model"):
        seas_of(cases_of(["calm"]), KtModel(1.0, -1.0, 0.0, 0.0, 0.4), TASK, 1)


def test_number_of_steps_depends_on_the_lag():
    assert steps_in(OCEAN_RAMBLER, 0.1) == 1
    assert steps_in(KtModel(0.049, 400.0, 0.0, 0.0, 0.4), 10.0) == 1
    # A step is a fifth of the lag if there is no cubic term.
    assert steps_in(KtModel(0.049, 1.0, 0.0, 0.0, 0.4), 1.0) == 5
