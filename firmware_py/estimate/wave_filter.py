"""Heading, yaw rate, rudder bias, speed and current, seen through the waves.

A Kalman filter on the K-T equation and a wave-frequency state (kalman.py) that tunes itself to
the sea (learning.py). It is driven by the measured rudder, scaled to the estimated speed by
similarity, and takes every sample at its own time. Velocity over the ground tells of the
low-frequency heading too, with the noise that it is found to have.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.angles import clamp, radians, wrap_pi, wrap_two_pi
from firmware_py.estimate import kalman, learning
from firmware_py.estimate.learning import Learned
from firmware_py.params import ParameterSet

LONGEST_STEP_S: Final = 1.0  # one carry of the covariance; a longer way takes several
LONGEST_SILENCE_S: Final = 600.0  # after this the filter starts anew
LATEST_S: Final = 1.0  # a sample older than the filter by more than this is not taken
SPEEDS_M_S: Final = (0.08, 2.5)
FACTORS: Final = (0.4, 2.5)
FASTEST_M_S: Final = 10.0  # a velocity over the ground beyond it is a receiver's error
GATE_SIGMAS: Final = 6.0
GATE_RAD: Final = radians(20.0)
HEADING_LIMIT: Final = 5.0  # a normalised innovation beyond it counts as this many
FIX_LIMIT: Final = 9.0

RATE_NOISE: Final = 1e-6 * radians(1.0) ** 2
CURRENT_NOISE: Final = 2e-6
SPEED_NOISE: Final = 1e-5
FACTOR_NOISE: Final = 1e-6
# Standard deviations at the start, in the order of the states.
FIRST: Final = (
    radians(10.0),
    radians(1.0),
    radians(5.0),
    radians(5.0),
    radians(6.0),
    0.2,
    0.2,
    0.4,
    0.2,
)


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """The model of the vehicle file."""

    turning_ability_1_s: float
    turning_lag_s: float
    norrbin_s2: float
    speed_m_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> FilterSettings:
        """Read the settings from the parameters."""
        return cls(
            parameters["MDL_K"], parameters["MDL_T_S"], parameters["MDL_ALPHA_S2"], parameters["MDL_SPEED"]
        )


@dataclass(frozen=True, slots=True)
class FilterState:
    """State and covariance (row by row) at t_s; empty before the first heading.

    `sensitivity` is by how much heading, rate, bias, wave and wave rate would differ for another
    ln omega. `sample_t_s` and `fix_t_s` are the times of the last heading and velocity taken,
    `refused` how many headings in a row the gate has refused.
    """

    t_s: float = 0.0
    x: tuple[float, ...] = ()
    p: tuple[float, ...] = ()
    sensitivity: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    learned: Learned = Learned()  # noqa: RUF009 - frozen
    rudder_rad: float = 0.0
    sample_t_s: float | None = None
    fix_t_s: float | None = None
    refused: int = 0
    innovation_rad: float = 0.0
    innovation_sd_rad: float = 0.0

    def spread(self, index: int) -> float:
        """Return the standard deviation of a state."""
        return math.sqrt(max(self.p[10 * index], 0.0)) if self.p else 0.0


def started(settings: FilterSettings, t_s: float, heading_rad: float, learned: Learned | None = None) -> FilterState:
    """Return the filter at its first heading."""
    x = (heading_rad, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, settings.speed_m_s, 1.0)
    p = tuple(FIRST[i] ** 2 if i == j else 0.0 for i in range(kalman.STATES) for j in range(kalman.STATES))
    return FilterState(t_s, x, p, learned=learned or Learned(), sample_t_s=t_s)


class _Work:
    """The numbers of a filter while a tick works on them."""

    def __init__(self, settings: FilterSettings, state: FilterState) -> None:
        self.settings = settings
        self.t_s = state.t_s
        self.x = list(state.x)
        self.p = list(state.p)
        self.s = list(state.sensitivity)
        self.learned = state.learned
        self.rudder_rad = state.rudder_rad
        self.scratch = [0.0] * (kalman.STATES * kalman.STATES)

    def carry_to(self, t_s: float) -> None:
        """Carry everything to t_s; an earlier time changes nothing."""
        while (way_s := t_s - self.t_s) > 0.0:
            step_s = min(way_s, LONGEST_STEP_S)
            self._carry(step_s)
            self.t_s = t_s if step_s == way_s else self.t_s + step_s

    def _carry(self, step_s: float) -> None:
        known, x, s = self.settings, self.x, self.s
        omega_rad_s = self.learned.omega_rad_s
        transition = kalman.wave_transition(omega_rad_s, step_s)
        # What another ln omega would change: the force that brings the wave back, and its damping.
        force = -2.0 * omega_rad_s * (omega_rad_s * x[kalman.WAVE] + kalman.DAMPING * x[kalman.WAVE_RATE])
        ratio = x[kalman.SPEED] / known.speed_m_s
        decay = math.exp(-step_s * ratio / known.turning_lag_s)
        ability_1_s = known.turning_ability_1_s * ratio * x[kalman.FACTOR]
        kalman.carry(
            x,
            self.p,
            self.scratch,
            step_s,
            self.rudder_rad,
            known.turning_ability_1_s,
            known.turning_lag_s,
            known.norrbin_s2,
            known.speed_m_s,
            transition,
            omega_rad_s,
            math.exp(self.learned.log_power),
            (
                RATE_NOISE * step_s,
                math.exp(self.learned.log_bias_noise) * step_s,
                CURRENT_NOISE * step_s,
                SPEED_NOISE * step_s,
                FACTOR_NOISE * step_s,
            ),
        )
        x[kalman.SPEED] = clamp(x[kalman.SPEED], *SPEEDS_M_S)
        x[kalman.FACTOR] = clamp(x[kalman.FACTOR], *FACTORS)
        wave, wave_rate = s[3], s[4]
        s[0] += s[1] * step_s
        s[1] = decay * s[1] - ability_1_s * (1.0 - decay) * s[2]
        s[3] = transition[0] * wave + transition[1] * wave_rate + 0.5 * step_s * step_s * force
        s[4] = transition[2] * wave + transition[3] * wave_rate + step_s * force

    def absorb(self, gain: list[float], innovation: float, variance: float, shown: float) -> None:
        """Take a measurement in; `shown` is how the sensitivity shows in it."""
        kalman.absorb(self.x, self.p, gain, innovation, variance)
        for i in range(5):
            self.s[i] -= gain[i] * shown


def take_heading(settings: FilterSettings, state: FilterState, t_s: float, heading_rad: float) -> FilterState:
    """Take one true heading in; one beyond the gate is refused and counted, one after a long silence starts anew."""
    if not (math.isfinite(t_s) and math.isfinite(heading_rad)):
        return state
    if not state.x or t_s - state.t_s > LONGEST_SILENCE_S:
        return started(settings, t_s, heading_rad, state.learned if state.x else None)
    late_s = state.t_s - t_s
    if late_s > LATEST_S:
        return state
    work = _Work(settings, state)
    work.carry_to(t_s)
    x, p = work.x, work.p
    expected_rad = x[kalman.HEADING] + x[kalman.WAVE]
    if late_s > 0.0:
        expected_rad -= late_s * (x[kalman.RATE] + x[kalman.WAVE_RATE])
    innovation_rad = wrap_pi(heading_rad - expected_rad)
    gain = [p[row] + p[row + 3] for row in range(0, 81, 9)]
    variance = gain[0] + gain[3] + math.exp(work.learned.log_noise)
    deviation_rad = math.sqrt(variance)
    if abs(innovation_rad) > max(GATE_SIGMAS * deviation_rad, GATE_RAD):
        return replace(_ended(work, state), refused=state.refused + 1, innovation_rad=innovation_rad)
    shown = work.s[0] + work.s[3]
    step_s = t_s - state.sample_t_s if state.sample_t_s is not None else 0.0
    work.absorb(gain, innovation_rad, max(variance, (innovation_rad / HEADING_LIMIT) ** 2), shown)
    if step_s > 0.0:
        work.learned = learning.from_heading(work.learned, innovation_rad, variance, shown, step_s)
    return replace(
        _ended(work, state),
        sample_t_s=max(t_s, state.sample_t_s or t_s),
        refused=0,
        innovation_rad=innovation_rad,
        innovation_sd_rad=deviation_rad,
    )


def take_velocity(settings: FilterSettings, state: FilterState, t_s: float, speed_m_s: float, course_rad: float) -> FilterState:
    """Take one velocity over the ground in; before the first heading, or out of range, it changes nothing."""
    if not state.x or not (math.isfinite(t_s) and math.isfinite(course_rad) and 0.0 <= speed_m_s <= FASTEST_M_S):
        return state
    if not -LATEST_S <= t_s - state.t_s <= LONGEST_SILENCE_S:
        return state
    work = _Work(settings, state)
    work.carry_to(t_s)
    x, p, squares = work.x, work.p, 0.0
    noise = math.exp(work.learned.log_velocity_noise)
    for current, seen_m_s in ((45, speed_m_s * math.cos(course_rad)), (54, speed_m_s * math.sin(course_rad))):
        cosine, sine = math.cos(x[kalman.HEADING]), math.sin(x[kalman.HEADING])
        # North is U cos psi + c_north, east U sin psi + c_east.
        by_speed, by_heading = (cosine, -x[kalman.SPEED] * sine) if current == 45 else (sine, x[kalman.SPEED] * cosine)
        innovation = seen_m_s - (x[kalman.SPEED] * by_speed + x[current // 9])
        gain = [by_heading * p[j] + p[current + j] + by_speed * p[63 + j] for j in range(9)]
        variance = by_heading * gain[kalman.HEADING] + gain[current // 9] + by_speed * gain[kalman.SPEED] + noise
        square = innovation * innovation / variance
        squares += min(square, FIX_LIMIT)
        work.absorb(gain, innovation, variance * max(1.0, square / FIX_LIMIT), by_heading * work.s[0])
    x[kalman.SPEED] = clamp(x[kalman.SPEED], *SPEEDS_M_S)
    x[kalman.FACTOR] = clamp(x[kalman.FACTOR], *FACTORS)
    work.learned = learning.from_velocity(work.learned, squares)
    return replace(_ended(work, state), fix_t_s=t_s)


def _ended(work: _Work, state: FilterState) -> FilterState:
    """Return the state that the work has come to; numbers that are none start the filter anew."""
    x, p = work.x, work.p
    sound = math.isfinite(sum(x)) and math.isfinite(sum(p)) and all(p[10 * i] > 0.0 for i in range(9))
    if not sound:
        return FilterState(rudder_rad=state.rudder_rad)
    x[kalman.HEADING] = wrap_two_pi(x[kalman.HEADING])
    return replace(
        state, t_s=work.t_s, x=tuple(x), p=tuple(p), sensitivity=tuple(work.s), learned=work.learned
    )


def ahead(settings: FilterSettings, state: FilterState, t_s: float) -> tuple[float, float]:
    """Return heading and yaw rate carried to t_s by the K-T equation alone, for a started filter."""
    x = state.x
    step_s = clamp(t_s - state.t_s, 0.0, LONGEST_SILENCE_S)
    ratio = x[kalman.SPEED] / settings.speed_m_s
    lag_s, r = settings.turning_lag_s / ratio, x[kalman.RATE]
    steady = x[kalman.FACTOR] * settings.turning_ability_1_s * ratio * (state.rudder_rad - x[kalman.BIAS])
    steady -= settings.norrbin_s2 / (ratio * ratio) * r * r * r
    decay = math.exp(-step_s / lag_s)
    turned_rad = steady * step_s + (r - steady) * lag_s * (1.0 - decay)
    return wrap_two_pi(x[kalman.HEADING] + turned_rad), steady + (r - steady) * decay


Heading = tuple[float, float]  # time [s], true heading [rad]
Velocity = tuple[float, float, float]  # time [s], speed [m/s] and course [rad] over the ground


def update(
    settings: FilterSettings,
    state: FilterState,
    headings: Sequence[Heading],
    velocities: Sequence[Velocity],
    rudder_rad: float,
) -> FilterState:
    """Take a tick's samples in, in order of their times; the rudder stood at rudder_rad at its beginning."""
    events = sorted([*headings, *velocities], key=lambda event: event[0])
    for event in events:
        if len(event) == 2:
            state = take_heading(settings, state, *event)
        else:
            state = take_velocity(settings, state, *event)
    return state if state.rudder_rad == rudder_rad else replace(state, rudder_rad=rudder_rad)
