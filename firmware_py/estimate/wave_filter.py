"""Heading, yaw rate, rudder bias, speed and current, with the waves told apart.

A Kalman filter on the K-T equation and a wave-frequency state (kalman.py) that tunes itself to the sea (learning.py).
It is driven by the measured rudder, scaled to the estimated speed by similarity, and takes each sample at its own time.
Velocity over the ground tells of the low-frequency heading too, with the noise that it is found to have. The sea it
allows for is that of docs/explanation/physics.md, "The sea that acts on the boat".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import clamp, radians, wrap_pi, wrap_two_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.estimate import kalman, learning
from firmware_py.estimate.kalman import Numbers
from firmware_py.estimate.learning import NoiseModel
from firmware_py.model.kt import KtModel

LONGEST_STEP_S: Final = 1.0  # one step of the covariance; a longer one takes several
LONGEST_SILENCE_S: Final = 600.0  # after this the filter starts anew
LATEST_S: Final = 1.0  # a sample older than the filter by more than this is not taken
SPEEDS_M_S: Final = (0.08, 2.5)
FACTORS: Final = (0.4, 2.5)
FASTEST_M_S: Final = 10.0  # a velocity over the ground beyond it is a receiver's error
GATE_SIGMAS: Final = 6.0
GATE_RAD: Final = radians(20.0)
HEADING_LIMIT: Final = 5.0  # a normalised innovation beyond it counts as this many
FIX_LIMIT: Final = 9.0

_HEADING_AND_WAVE: Final = tuple((kalman.covariance_index(0, j), kalman.covariance_index(3, j)) for j in range(9))
_VELOCITY: Final = {
    current: tuple(
        (kalman.covariance_index(0, j), kalman.covariance_index(current, j), kalman.covariance_index(7, j))
        for j in range(9)
    )
    for current in (kalman.NORTH, kalman.EAST)
}

RATE_NOISE: Final = 1e-6 * radians(1.0) ** 2
CURRENT_NOISE: Final = 5e-7  # [m^2/s^3]: 2 cm/s in a quarter of an hour
SPEED_NOISE: Final = 2e-6
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
class WaveFilterSettings:
    """The K-T model of the vehicle file."""

    model: KtModel

    @classmethod
    def of(cls, parameters: ParameterSet) -> WaveFilterSettings:
        """Read the settings from the parameters."""
        return cls(model=KtModel.of(parameters))


@dataclass(frozen=True, slots=True)
class WaveFilterState:
    """State and covariance (upper triangle, row by row) at t_s; empty before the first heading.

    `sensitivity` is by how much heading, rate, bias, wave and wave rate would differ for another
    ln omega. `sample_t_s` and `fix_t_s` are the times of the last heading and velocity taken,
    `refusals` how many headings in a row the gate has refused.
    """

    t_s: float = 0.0
    x: tuple[float, ...] = ()
    p: tuple[float, ...] = ()
    sensitivity: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    noise_model: NoiseModel = NoiseModel()  # noqa: RUF009 - frozen
    rudder_rad: float = 0.0
    sample_t_s: float | None = None
    fix_t_s: float | None = None
    refusals: int = 0
    innovation_rad: float = 0.0
    innovation_sd_rad: float = 0.0

    def spread(self, index: int) -> float:
        """Return the standard deviation of a state."""
        return math.sqrt(self.p[kalman.DIAGONAL[index]]) if self.p else 0.0


def start(
    settings: WaveFilterSettings, t_s: float, heading_rad: float, noise_model: NoiseModel | None = None
) -> WaveFilterState:
    """Return the filter at its first heading."""
    x = (heading_rad, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, clamp(settings.model.speed_m_s, *SPEEDS_M_S), 1.0)
    p = tuple(FIRST[i] ** 2 if i == j else 0.0 for i in range(kalman.STATES) for j in range(i, kalman.STATES))
    return WaveFilterState(t_s, x, p, noise_model=noise_model or NoiseModel(), sample_t_s=t_s)


class _Workspace:
    """The numbers of a filter while a tick works on them."""

    __slots__ = ("noise_model", "p", "rudder_rad", "s", "settings", "t_s", "x")

    def __init__(self, settings: WaveFilterSettings, state: WaveFilterState) -> None:
        self.settings = settings
        self.t_s = state.t_s
        self.x = state.x
        self.p = state.p
        self.s = state.sensitivity
        self.noise_model = state.noise_model
        self.rudder_rad = state.rudder_rad

    def predict_to(self, t_s: float) -> None:
        """Carry everything to t_s; an earlier time changes nothing."""
        while (way_s := t_s - self.t_s) > 0.0:
            step_s = min(way_s, LONGEST_STEP_S)
            self._predict(step_s)
            self.t_s = t_s if step_s == way_s else self.t_s + step_s

    def _predict(self, step_s: float) -> None:
        noise_model, x, s = self.noise_model, self.x, self.s
        omega_rad_s = noise_model.omega_rad_s
        w00, w01, w10, w11 = transition = kalman.wave_transition(omega_rad_s, step_s)
        turn = kalman.turn(x, self.rudder_rad, step_s, self.settings.model)
        angle, both, rate = kalman.wave_noise(transition, omega_rad_s, math.exp(noise_model.log_power))
        noise = (
            RATE_NOISE * step_s,
            math.exp(noise_model.log_bias_noise) * step_s,
            angle,
            both,
            rate,
            CURRENT_NOISE * step_s,
            SPEED_NOISE * step_s,
            FACTOR_NOISE * step_s,
        )
        self.p = kalman.predict(self.p, turn, transition, noise)
        _, _, bias, wave, wave_rate, north, east, speed, factor = x
        self.x = _bound(
            (
                turn.heading_rad,
                turn.yaw_rate_rad_s,
                bias,
                w00 * wave + w01 * wave_rate,
                w10 * wave + w11 * wave_rate,
                north,
                east,
                speed,
                factor,
            )
        )
        # What another ln omega would change: the force that brings the wave back, and its damping.
        force = -2.0 * omega_rad_s * (omega_rad_s * wave + kalman.DAMPING * wave_rate)
        s0, s1, s2, s3, s4 = s
        self.s = (
            s0 + turn.reach_s * s1 + turn.share_s * turn.by_bias * s2,
            turn.by_rate * s1 + turn.by_bias * s2,
            s2,
            w00 * s3 + w01 * s4 + 0.5 * step_s * step_s * force,
            w10 * s3 + w11 * s4 + step_s * force,
        )

    def correct(self, shown: Numbers, innovation: float, variance: float, sensitivity: float) -> None:
        """Take a measurement in; shown is P H', sensitivity how that of the state shows in it."""
        x, self.p = kalman.correct(self.x, self.p, shown, innovation, variance)
        self.x = _bound(x)
        part = sensitivity / variance
        s0, s1, s2, s3, s4 = self.s
        self.s = (
            s0 - shown[0] * part,
            s1 - shown[1] * part,
            s2 - shown[2] * part,
            s3 - shown[3] * part,
            s4 - shown[4] * part,
        )


def _bound(x: Numbers) -> Numbers:
    """Keep speed and turning factor within what a boat can have."""
    if SPEEDS_M_S[0] <= x[7] <= SPEEDS_M_S[1] and FACTORS[0] <= x[8] <= FACTORS[1]:
        return x
    return (*x[:7], clamp(x[7], *SPEEDS_M_S), clamp(x[8], *FACTORS))


def correct_heading(
    settings: WaveFilterSettings, state: WaveFilterState, t_s: float, heading_rad: float
) -> WaveFilterState:
    """Take one true heading in; one beyond the gate is refused and counted, one after a long silence starts anew."""
    if not (math.isfinite(t_s) and math.isfinite(heading_rad)):
        return state
    if not state.x or t_s - state.t_s > LONGEST_SILENCE_S:
        return start(settings, t_s, heading_rad, state.noise_model if state.x else None)
    late_s = state.t_s - t_s
    if late_s > LATEST_S:
        return state
    work = _Workspace(settings, state)
    work.predict_to(t_s)
    x, p = work.x, work.p
    expected_rad = x[kalman.HEADING] + x[kalman.WAVE]
    if late_s > 0.0:
        expected_rad -= late_s * (x[kalman.RATE] + x[kalman.WAVE_RATE])
    innovation_rad = wrap_pi(heading_rad - expected_rad)
    # Heading and wave yaw show together: H has a one for each.
    shown = tuple([p[heading] + p[wave] for heading, wave in _HEADING_AND_WAVE])
    variance = shown[0] + shown[3] + math.exp(work.noise_model.log_noise)
    deviation_rad = math.sqrt(variance)
    if abs(innovation_rad) > max(GATE_SIGMAS * deviation_rad, GATE_RAD):
        return replace(_finish(work, state), refusals=state.refusals + 1, innovation_rad=innovation_rad)
    sensitivity = work.s[0] + work.s[3]
    step_s = t_s - state.sample_t_s if state.sample_t_s is not None else 0.0
    work.correct(shown, innovation_rad, max(variance, (innovation_rad / HEADING_LIMIT) ** 2), sensitivity)
    if step_s > 0.0:
        work.noise_model = learning.learn_from_heading(work.noise_model, innovation_rad, variance, sensitivity, step_s)
    return replace(
        _finish(work, state),
        sample_t_s=max(t_s, state.sample_t_s or t_s),
        refusals=0,
        innovation_rad=innovation_rad,
        innovation_sd_rad=deviation_rad,
    )


def correct_velocity(
    settings: WaveFilterSettings, state: WaveFilterState, t_s: float, speed_m_s: float, course_rad: float
) -> WaveFilterState:
    """Take one velocity over the ground in; before the first heading, or out of range, it changes nothing."""
    if not state.x or not (math.isfinite(t_s) and math.isfinite(course_rad) and 0.0 <= speed_m_s <= FASTEST_M_S):
        return state
    if not -LATEST_S <= t_s - state.t_s <= LONGEST_SILENCE_S:
        return state
    work = _Workspace(settings, state)
    work.predict_to(t_s)
    squares, noise = 0.0, math.exp(work.noise_model.log_velocity_noise)
    measured = ((kalman.NORTH, speed_m_s * math.cos(course_rad)), (kalman.EAST, speed_m_s * math.sin(course_rad)))
    for current, measured_m_s in measured:
        x, p = work.x, work.p
        cosine, sine = math.cos(x[kalman.HEADING]), math.sin(x[kalman.HEADING])
        # North is U cos psi + c_north, east U sin psi + c_east.
        north = current == kalman.NORTH
        by_speed, by_heading = (cosine, -x[kalman.SPEED] * sine) if north else (sine, x[kalman.SPEED] * cosine)
        innovation = measured_m_s - (x[kalman.SPEED] * by_speed + x[current])
        shown = tuple(
            [by_heading * p[heading] + p[drift] + by_speed * p[speed] for heading, drift, speed in _VELOCITY[current]]
        )
        variance = by_heading * shown[kalman.HEADING] + shown[current] + by_speed * shown[kalman.SPEED] + noise
        square = innovation * innovation / variance
        squares += min(square, FIX_LIMIT)
        work.correct(shown, innovation, variance * max(1.0, square / FIX_LIMIT), by_heading * work.s[0])
    work.noise_model = learning.learn_from_velocity(work.noise_model, squares)
    return replace(_finish(work, state), fix_t_s=t_s)


def _finish(work: _Workspace, state: WaveFilterState) -> WaveFilterState:
    """Return the state that the work has come to; numbers that are none start the filter anew."""
    x, p = work.x, work.p
    sound = math.isfinite(sum(x)) and math.isfinite(sum(p)) and min([p[i] for i in kalman.DIAGONAL]) > 0.0
    if not sound:
        return WaveFilterState(rudder_rad=state.rudder_rad)
    x = (wrap_two_pi(x[kalman.HEADING]), *x[1:])
    return replace(state, t_s=work.t_s, x=x, p=p, sensitivity=work.s, noise_model=work.noise_model)


def predict_heading(settings: WaveFilterSettings, state: WaveFilterState, t_s: float) -> tuple[float, float]:
    """Return heading and yaw rate carried to t_s by the K-T equation alone, for a filter that has started."""
    step_s = clamp(t_s - state.t_s, 0.0, LONGEST_SILENCE_S)
    turn = kalman.turn(state.x, state.rudder_rad, step_s, settings.model)
    return wrap_two_pi(turn.heading_rad), turn.yaw_rate_rad_s


Heading = tuple[float, float]  # time [s], true heading [rad]
Velocity = tuple[float, float, float]  # time [s], speed [m/s] and course [rad] over the ground


def update(
    settings: WaveFilterSettings,
    state: WaveFilterState,
    headings: Sequence[Heading],
    velocities: Sequence[Velocity],
    rudder_rad: float,
) -> WaveFilterState:
    """Take a tick's samples in, in order of their times; the rudder stood at rudder_rad at its beginning."""
    samples = sorted([*headings, *velocities], key=lambda sample: sample[0])
    for sample in samples:
        if len(sample) == 2:
            state = correct_heading(settings, state, *sample)
        else:
            state = correct_velocity(settings, state, *sample)
    return state if state.rudder_rad == rudder_rad else replace(state, rudder_rad=rudder_rad)
