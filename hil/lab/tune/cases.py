"""Trial runs of the fixed-gain controller: seas, speeds, and ships that differ from the model.

In each sea the ship equals the model, or its K and T differ by 30 % (four ships). Two more runs are in flat water at
the lowest and the highest speed. The autopilot uses the model of the vehicle file; all settings have the same waves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from firmware_py.common.angles import clamp, degrees, radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel, steady_yaw_rate
from hil.lab.tune.loop_kernel import Autopilot, Seas, Task
from hil.ship import scenarios
from hil.ship.disturbances import NO_DISTURBANCES
from hil.ship.drift import RudderDrift
from hil.ship.kt_plant import MAX_STEP_S, inner_steps
from hil.ship.noise import NormalNumbers
from hil.ship.scenarios import Scenario
from hil.ship.servo import DEFAULT_SLEW_RAD_S
from hil.ship.waves import WaveYaw

STEP_S = 0.1
MIN_LEG_S, MAX_LEG_S = 300.0, 3000.0
STEADY_FRACTION = 1.0 / 3.0  # last part of a leg
GOALS_DEG = (60.0, -30.0)  # turns of 60 deg to starboard and 90 deg to port
COMPASS_NOISE_DEG = 0.3
DEFAULT_SCENARIOS = ("tank", "sea", "swell", "weak")
SHIP_FACTORS = ((0.7, 0.7), (0.7, 1.3), (1.3, 0.7), (1.3, 1.3))  # of K and T
SPEEDS_M_S = (0.2, 1.2)
NOMINAL = (1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Case:
    """A trial run: a sea, and the ship's K and T relative to those of the model."""

    scenario: Scenario
    ability_factor: float
    lag_factor: float

    @property
    def is_nominal(self) -> bool:
        """Return whether the ship equals the model."""
        return (self.ability_factor, self.lag_factor) == NOMINAL

    def ship(self, model: KtModel) -> KtModel:
        """Return the ship of this case, at the speed of the sea."""
        scaled = model.at_speed(self.scenario.speed_m_s)
        return scaled._replace(
            turning_ability_1_s=scaled.turning_ability_1_s * self.ability_factor,
            turning_lag_s=scaled.turning_lag_s * self.lag_factor,
        )


def cases_of(names: Sequence[str]) -> tuple[Case, ...]:
    """Return the cases of scenarios; raise UnknownScenarioError for an unknown or unsupported one."""
    seas = [scenarios.find_scenario(name) for name in names]
    for sea in seas:
        if sea.disturbances != NO_DISTURBANCES:
            raise scenarios.UnknownScenarioError(
                f"scenario {sea.name!r} has disturbances that the trial runs do not have"
            )
    calm = scenarios.find_scenario("calm")
    calm_seas = [replace(calm, name=f"calm at {speed:g} m/s", speed_m_s=speed) for speed in SPEEDS_M_S]
    cases = [Case(sea, *factors) for sea in seas for factors in (NOMINAL, *SHIP_FACTORS)]
    return (*cases, *(Case(sea, *NOMINAL) for sea in calm_seas))


def task_of(model: KtModel, autopilot: Autopilot) -> Task:
    """Return the task of all cases; a leg lasts three times as long as the larger turn, and MIN_LEG_S to MAX_LEG_S."""
    turn_s = max(abs(GOALS_DEG[0]), abs(GOALS_DEG[1] - GOALS_DEG[0])) / degrees(autopilot.rate_max_rad_s)
    leg_s = clamp(3.0 * (turn_s + 5.0 * model.turning_lag_s), MIN_LEG_S, MAX_LEG_S)
    ticks = round(leg_s / STEP_S)
    return Task(np.array([radians(goal) for goal in GOALS_DEG]), ticks, round((1.0 - STEADY_FRACTION) * ticks), STEP_S)


def autopilot_of(parameters: ParameterSet) -> Autopilot:
    """Return the settings of the autopilot, computed as in the firmware."""
    limit_rad = radians(parameters["RUD_LIMIT_DEG"])
    ability_1_s = parameters["MDL_K"]
    return Autopilot(
        turning_ability_1_s=ability_1_s,
        turning_lag_s=parameters["MDL_T_S"],
        rate_limit_rad_s=10.0 * ability_1_s * limit_rad + radians(5.0),
        rate_max_rad_s=steady_yaw_rate(limit_rad, ability_1_s, parameters["MDL_ALPHA_S2"]),
        rudder_limit_rad=limit_rad,
        rudder_slew_rad_s=radians(parameters["RUD_SLEW_DEG_S"]),
        trim_rad=radians(parameters["CTL_TRIM_DEG"]),
        servo_slew_rad_s=DEFAULT_SLEW_RAD_S,
    )


def steps_in(ship: KtModel, step_s: float) -> int:
    """Return the number of Runge-Kutta steps in a time step `step_s`; raise ValueError for an invalid ship.

    The ship is scaled by similarity so that the time step becomes MAX_STEP_S; then the plant's own step limit has no
    effect.
    """
    return inner_steps(ship.at_speed(ship.speed_m_s * step_s / MAX_STEP_S), MAX_STEP_S)


def seas_of(cases: Sequence[Case], model: KtModel, task: Task, seed: int) -> Seas:
    """Draw waves, noise and rudder drift of all cases; raise ValueError for an invalid model."""
    ticks = task.goals_rad.size * task.leg_ticks
    ships = np.zeros((len(cases), 4))
    compass_rad = np.zeros((len(cases), ticks))
    offset_rad = np.zeros((len(cases), ticks))
    for row, case in enumerate(cases):
        ship = case.ship(model)
        ships[row] = (ship.turning_ability_1_s, ship.turning_lag_s, ship.norrbin_s2, steps_in(ship, task.step_s))
        generators = [np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, row, k]))) for k in range(3)]
        compass_rad[row] = radians(COMPASS_NOISE_DEG) * generators[0].standard_normal(ticks)
        compass_rad[row] += _wave_yaw(case.scenario, task, ticks, generators[1])
        offset_rad[row] = _offset(case.scenario, task, ticks, generators[2])
        offset_rad[row] += ship.rudder_offset_rad
    return Seas(ships, compass_rad, offset_rad)


def _wave_yaw(sea: Scenario, task: Task, ticks: int, rng: np.random.Generator) -> list[float]:
    waves = WaveYaw(radians(sea.wave_yaw_deg), sea.wave_period_s, task.step_s, NormalNumbers(rng))
    yaw_rad = []
    for _ in range(ticks):
        yaw_rad.append(waves.angle_rad(0.0))
        waves.step()
    return yaw_rad


def _offset(sea: Scenario, task: Task, ticks: int, rng: np.random.Generator) -> list[float]:
    drift = RudderDrift(radians(sea.drift_deg), task.step_s, NormalNumbers(rng))
    bias_rad = radians(sea.bias_deg)
    angle_rad = []
    for _ in range(ticks):
        angle_rad.append(bias_rad + drift.angle_rad)
        drift.step()
    return angle_rad
