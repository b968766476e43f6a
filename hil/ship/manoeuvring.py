"""Planar motion with sway and current (Wang et al. 2018, eq. 1-2), as plain functions that numba can also compile.

    dx/dt = U cos(psi) - v sin(psi) + current north      dpsi/dt = r
    dy/dt = U sin(psi) + v cos(psi) + current east
    m22 dv/dt = -m11 U r + Yv v                          T dr/dt + r + alpha r^3 = K (delta - delta0)

Sway does not act on the turn, so heading and yaw rate are those of the K-T equation alone. The simulated ship behind
the autopilot sways only with the disturbance `sway` (hil.ship.sideways); this module is for turning circles and tracks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_py.model.kt import KtModel, rk4_step, steady_yaw_rate, yaw_acceleration
from hil.ship.kt_plant import inner_steps
from hil.ship.regressions import SwayModel

State = tuple[float, float, float, float, float]

MAX_STEP_PER_SWAY_TIME = 0.2


@dataclass(frozen=True, slots=True)
class Motion:
    """North and east [m], heading [rad, not wrapped], yaw rate [rad/s], sway velocity to starboard [m/s]."""

    north_m: float = 0.0
    east_m: float = 0.0
    heading_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0
    sway_m_s: float = 0.0


class Manoeuvre:
    """A hull with yaw, sway and current, in steps of fixed length.

    Without a sway model v is 0. Raises ValueError for a model that is not physical.
    """

    def __init__(
        self,
        model: KtModel,
        sway: SwayModel | None,
        step_s: float,
        current_m_s: tuple[float, float] = (0.0, 0.0),
        start: Motion | None = None,
    ) -> None:
        """Start at the origin or at `start`; `model` is that at the boat's speed, the current is north and east."""
        self.motion = Motion() if start is None else start
        self._model = model
        speed_m_s = model.speed_m_s
        self._ratios = (0.0, 0.0)
        count = inner_steps(model, step_s, self.motion.yaw_rate_rad_s)
        if sway is not None:
            self._ratios = sway_ratios(sway, speed_m_s)
            count = max(count, math.ceil(step_s * abs(self._ratios[1]) / MAX_STEP_PER_SWAY_TIME))
        self._current_m_s = current_m_s
        self._inner_steps, self._inner_s = count, step_s / count

    def step(self, rudder_rad: float) -> Motion:
        """Advance one step at a constant rudder."""
        model, motion = self._model, self.motion
        state = (motion.north_m, motion.east_m, motion.heading_rad, motion.yaw_rate_rad_s, motion.sway_m_s)
        for _ in range(self._inner_steps):
            state = planar_step(
                state,
                rudder_rad,
                self._inner_s,
                model.speed_m_s,
                self._current_m_s[0],
                self._current_m_s[1],
                model.turning_ability_1_s,
                model.turning_lag_s,
                model.norrbin_s2,
                model.rudder_offset_rad,
                self._ratios[0],
                self._ratios[1],
            )
        self.motion = Motion(*state)
        return self.motion


def sway_ratios(sway: SwayModel, speed_m_s: float) -> tuple[float, float]:
    """Return drive [m/s] and damping [1/s] of dv/dt = drive r + damping v; both are proportional to the speed."""
    return (-sway.surge_mass_kg * speed_m_s / sway.sway_mass_kg, sway.sway_damping_kg_s(speed_m_s) / sway.sway_mass_kg)


def planar_step(
    state: State,
    rudder_rad: float,
    step_s: float,
    speed_m_s: float,
    current_north_m_s: float,
    current_east_m_s: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
    norrbin_s2: float,
    rudder_offset_rad: float,
    sway_drive_m_s: float,
    sway_damping_1_s: float,
) -> State:
    """Advance (north, east, heading, yaw rate, sway) by one fourth-order Runge-Kutta step.

    Heading and yaw rate do not depend on the other states: they follow the K-T equation of the simulated ship.
    """
    constants = (
        rudder_rad,
        speed_m_s,
        current_north_m_s,
        current_east_m_s,
        turning_ability_1_s,
        turning_lag_s,
        norrbin_s2,
        rudder_offset_rad,
        sway_drive_m_s,
        sway_damping_1_s,
    )
    heading_rad, yaw_rate_rad_s = rk4_step(
        state[2], state[3], rudder_rad, step_s, turning_ability_1_s, turning_lag_s, norrbin_s2, rudder_offset_rad
    )
    half_s = 0.5 * step_s
    d1 = planar_rates(state, constants)
    d2 = planar_rates(_extrapolate(state, d1, half_s), constants)
    d3 = planar_rates(_extrapolate(state, d2, half_s), constants)
    d4 = planar_rates(_extrapolate(state, d3, step_s), constants)
    return (
        state[0] + step_s * (d1[0] + 2.0 * d2[0] + 2.0 * d3[0] + d4[0]) / 6.0,
        state[1] + step_s * (d1[1] + 2.0 * d2[1] + 2.0 * d3[1] + d4[1]) / 6.0,
        heading_rad,
        yaw_rate_rad_s,
        state[4] + step_s * (d1[4] + 2.0 * d2[4] + 2.0 * d3[4] + d4[4]) / 6.0,
    )


def planar_rates(
    state: State, constants: tuple[float, float, float, float, float, float, float, float, float, float]
) -> State:
    """Return the rates of change of the state."""
    _, _, heading_rad, yaw_rate_rad_s, sway_m_s = state
    rudder_rad, speed_m_s, north_m_s, east_m_s, ability_1_s, lag_s, norrbin_s2, offset_rad, drive_m_s, damping_1_s = (
        constants
    )
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    return (
        speed_m_s * cosine - sway_m_s * sine + north_m_s,
        speed_m_s * sine + sway_m_s * cosine + east_m_s,
        yaw_rate_rad_s,
        yaw_acceleration(yaw_rate_rad_s, rudder_rad, ability_1_s, lag_s, norrbin_s2, offset_rad),
        drive_m_s * yaw_rate_rad_s + damping_1_s * sway_m_s,
    )


def _extrapolate(state: State, rates: State, step_s: float) -> State:
    return (
        state[0] + step_s * rates[0],
        state[1] + step_s * rates[1],
        state[2] + step_s * rates[2],
        state[3] + step_s * rates[3],
        state[4] + step_s * rates[4],
    )


@dataclass(frozen=True, slots=True)
class SteadyTurn:
    """A steady turn: yaw rate [rad/s], sway [m/s], radius [m] (inf straight ahead).

    drift_rad is course minus heading: negative in a turn to starboard, where the bow points into the circle.
    """

    yaw_rate_rad_s: float
    sway_m_s: float
    radius_m: float
    drift_rad: float


def steady_turn(model: KtModel, rudder_rad: float, sway: SwayModel | None = None) -> SteadyTurn:
    """Return the steady turn at a constant rudder.

    Raises ValueError if the sway model has no damping at this speed.
    """
    rate_rad_s = steady_yaw_rate(rudder_rad - model.rudder_offset_rad, model.turning_ability_1_s, model.norrbin_s2)
    sway_m_s = 0.0
    if sway is not None:
        damping_kg_s = sway.sway_damping_kg_s(model.speed_m_s)
        if not damping_kg_s < 0.0:
            raise ValueError("the sway model has no damping, so there is no steady turn")
        sway_m_s = sway.surge_mass_kg * model.speed_m_s * rate_rad_s / damping_kg_s
    speed_m_s = math.hypot(model.speed_m_s, sway_m_s)
    radius_m = speed_m_s / abs(rate_rad_s) if rate_rad_s else math.inf
    return SteadyTurn(rate_rad_s, sway_m_s, radius_m, math.atan2(sway_m_s, model.speed_m_s))
