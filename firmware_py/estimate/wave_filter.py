"""Heading, yaw rate, rudder bias, speed, current and leeway, with float and waves told apart.

A Kalman filter (kalman.py) that tunes itself to the sea and to the float (learning.py). It is driven by the measured
rudder, scaled to the estimated speed by similarity, and takes each sample at its own time. A compass shows the float:
its heading and the yaw of the waves. Velocity over the ground shows the way of the glider through the water, the
current and the waves' motion of the receiver. The sea it allows for is that of docs/explanation/physics.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians, wrap_pi, wrap_two_pi
from firmware_py.estimate import kalman, learning, over_ground
from firmware_py.estimate.wave_filter_state import (
    FLOAT_WANDERS,
    WHITE,
    Heading,
    Velocity,
    WaveFilterSettings,
    WaveFilterState,
    bound,
    start,
)

LONGEST_STEP_S: Final = 1.0  # one step of the covariance; a longer one takes several
LONGEST_SILENCE_S: Final = 600.0  # after this the filter starts anew
LATEST_S: Final = 1.0  # a sample older than the filter by more than this is not taken
FASTEST_M_S: Final = 10.0  # a velocity over the ground beyond it is a receiver's error
GATE_SIGMAS, GATE_RAD = 6.0, radians(20.0)
HEADING_LIMIT: Final = 5.0  # a normalised innovation beyond it counts as this many
FIX_LIMIT: Final = 9.0
SWING_PERIODS: Final = 4.0  # over so many the waves' own yaw has a mean of less than half its spread
LEAST_TURN_RAD, TURN_SPREADS = radians(15.0), 0.6
TURN_RATE_RAD_S, TURN_BIAS_RAD = radians(2.0), radians(20.0)  # uncertain beside a turn that was not expected
_NOTHING: Final = np.zeros(kalman.COLUMNS)
# Where the numbers of covariance and slopes, one behind the other, stand beside each other, and back.
_BEHIND: Final = np.arange(kalman.STATES * kalman.COLUMNS)
_BESIDE: Final = np.hstack([part.reshape(kalman.STATES, -1) for part in np.split(_BEHIND, [kalman.STATES**2])])
_APART: Final = _BESIDE.argsort(None)
_BIASES: Final = np.ix_((kalman.BIAS, kalman.BIAS_MEAN), (kalman.BIAS, kalman.BIAS_MEAN))


class _Workspace:
    """The numbers of a filter while a measurement is taken in; `columns`: the covariance with the slopes beside it."""

    __slots__ = ("columns", "noise_model", "rudder_rad", "settings", "t_s", "x")

    def __init__(self, settings: WaveFilterSettings, state: WaveFilterState) -> None:
        self.settings = settings
        self.t_s = state.t_s
        self.x = state.x
        self.columns = np.frombuffer(state.p + state.slopes).reshape(_BEHIND.size).take(_BESIDE)
        self.noise_model = state.noise_model
        self.rudder_rad = state.rudder_rad

    def predict_to(self, t_s: float) -> None:
        """Carry everything to t_s; an earlier time changes nothing."""
        while (way_s := t_s - self.t_s) > 0.0:
            step_s = min(way_s, LONGEST_STEP_S)
            self._predict(step_s)
            self.t_s = t_s if step_s == way_s else self.t_s + step_s

    def _predict(self, step_s: float) -> None:
        model, x = self.noise_model, self.x
        omega_rad_s, follow_rad_s = model.omega_rad_s, model.follow_rad_s
        wave = kalman.response(omega_rad_s, kalman.DAMPING, step_s)
        bias_variance = self.columns.item(kalman.BIAS, kalman.BIAS)
        turn = kalman.turn(x, self.rudder_rad, step_s, self.settings.model, bias_variance)
        follow = kalman.response(follow_rad_s, kalman.FLOAT_DAMPING, step_s)
        transition = kalman.Transition(turn, follow, wave, math.exp(-step_s / kalman.BIAS_MEMORY_S))
        noise = [each * step_s for each in WHITE]
        noise[kalman.BIAS] = math.exp(model.log_bias_noise) * step_s
        noise[kalman.FLOAT_RATE] *= min(follow_rad_s * follow_rad_s, FLOAT_WANDERS)
        yaw = kalman.wave_noise(wave, omega_rad_s, math.exp(model.log_power))
        orbit = kalman.wave_noise(wave, omega_rad_s, model.orbit_power)
        self.columns = kalman.predict(self.columns, transition, noise, (yaw, orbit, orbit))
        self.x = bound(kalman.advance(x, transition))
        behind = x[kalman.FLOAT] - 0.5 * (x[kalman.HEADING] + turn.heading_rad)
        motions = range(kalman.WAVE, kalman.STATES, 2)
        swung = [(omega_rad_s, kalman.DAMPING, x[place], x[place + 1]) for place in motions]
        followed = (follow_rad_s, kalman.FLOAT_DAMPING, behind, x[kalman.FLOAT_RATE])
        kalman.pull(self.columns, (*swung, followed), step_s)

    def correct(self, measured: kalman.Measured, innovation: float, variance: float) -> None:
        """Take a measurement in, that of `measure` and with its variance or a larger one."""
        x, self.columns = kalman.correct(self.x, self.columns, measured, innovation, variance)
        self.x = bound(x)

    def measure(self, parts: Sequence[tuple[int, float]], noise: float) -> kalman.Measured:
        """Return how a measurement shows the states; `parts` are the places of H that are not 0, and what is there.

        Of a model far too lively, rounding can make a square negative: no variance is NaN, and starts the filter anew.
        """
        columns, shown, variance = self.columns, _NOTHING, 0.0
        for place, part in parts:
            shown = shown + (columns[place] if part == 1.0 else part * columns[place])
        for place, part in parts:
            variance += part * shown.item(place)
        variance += noise
        return kalman.Measured(shown, variance if variance > 0.0 else math.nan)

    def open_shares(self, leg_rad: float, leg_s: float, step_s: float) -> None:
        """Leave open how a change of the water is shared out, of a step of the leg."""
        gains = over_ground.open_shares(self.x, leg_rad, leg_s, step_s)
        self.columns.put(over_ground.OPEN, self.columns.take(over_ground.OPEN) + gains)

    def learn_frequencies(self, measured: kalman.Measured, innovation: float, step_s: float) -> None:
        """Learn the frequencies of waves and float from an innovation."""
        by_omega, by_follow = measured.shown[kalman.STATES :].tolist()
        self.noise_model = learning.learn_frequencies(
            self.noise_model, innovation, measured.variance, by_omega, by_follow, step_s
        )

    def learn_from_heading(self, innovation_rad: float, variance: float, step_s: float) -> None:
        """Learn strengths from the innovation of a heading that has been taken in."""
        angle, rate, p = self.x[kalman.WAVE], self.x[kalman.WAVE_RATE], self.columns
        omega_rad_s = self.noise_model.omega_rad_s
        rate_square = (rate * rate + p.item(kalman.WAVE_RATE, kalman.WAVE_RATE)) / (omega_rad_s * omega_rad_s)
        swing_square = 0.5 * (angle * angle + p.item(kalman.WAVE, kalman.WAVE) + rate_square)
        self.noise_model = learning.learn_from_heading(self.noise_model, innovation_rad, variance, step_s, swing_square)

    def give_turn_back(self, slow_wave_rad: float, step_s: float) -> float:
        """Follow the mean of the waves' yaw, and take from them what is a turn; return the mean.

        Waves swing about nothing. Where the boat circles against all that its model expects, as with a servo the wrong
        way round, their yaw would make up for whole turns.
        """
        model, x = self.noise_model, self.x
        part = min(model.omega_rad_s * step_s / (2.0 * math.pi * SWING_PERIODS), 0.5)
        turned_rad = slow_wave_rad + part * (x[kalman.WAVE] - slow_wave_rad)
        if abs(turned_rad) <= LEAST_TURN_RAD or abs(turned_rad) <= TURN_SPREADS * model.wave_spread_rad:
            return turned_rad
        moved = list(x)
        for place, by_rad in ((kalman.HEADING, turned_rad), (kalman.FLOAT, turned_rad), (kalman.WAVE, -turned_rad)):
            moved[place] += by_rad
        self.x = tuple(moved)
        self.columns[kalman.RATE, kalman.RATE] += TURN_RATE_RAD_S * TURN_RATE_RAD_S
        self.columns[_BIASES] += TURN_BIAS_RAD * TURN_BIAS_RAD
        return 0.0


def correct_heading(
    settings: WaveFilterSettings, state: WaveFilterState, t_s: float, heading_rad: float
) -> WaveFilterState:
    """Take one true heading in; one beyond the gate is refused and counted, one after a long silence starts anew."""
    if not (math.isfinite(t_s) and math.isfinite(heading_rad)):
        return state
    if not state.x or t_s - state.t_s > LONGEST_SILENCE_S:
        return start(state, t_s, heading_rad, settings.model.turning_ability_1_s)
    late_s = state.t_s - t_s
    if late_s > LATEST_S:
        return state
    work = _Workspace(settings, state)
    work.predict_to(t_s)
    x = work.x
    expected_rad = x[kalman.FLOAT] + x[kalman.WAVE]
    if late_s > 0.0:
        expected_rad -= late_s * (x[kalman.FLOAT_RATE] + x[kalman.WAVE_RATE])
    innovation_rad = wrap_pi(heading_rad - expected_rad)
    measured = work.measure(((kalman.FLOAT, 1.0), (kalman.WAVE, 1.0)), math.exp(work.noise_model.log_noise))
    variance = measured.variance
    deviation_rad = math.sqrt(variance)
    if abs(innovation_rad) > max(GATE_SIGMAS * deviation_rad, GATE_RAD):
        return _finish(work, state, refusals=state.refusals + 1, innovation_rad=innovation_rad)
    step_s, slow_wave_rad = 0.0 if state.sample_t_s is None else t_s - state.sample_t_s, state.slow_wave_rad
    limited_rad = innovation_rad / HEADING_LIMIT
    work.correct(measured, innovation_rad, max(variance, limited_rad * limited_rad))
    if step_s > 0.0:
        work.learn_frequencies(measured, innovation_rad, step_s)
        work.learn_from_heading(innovation_rad, variance, step_s)
        slow_wave_rad = work.give_turn_back(slow_wave_rad, step_s)
    return _finish(
        work,
        state,
        sample_t_s=max(t_s, state.sample_t_s or t_s),
        refusals=0,
        innovation_rad=innovation_rad,
        innovation_sd_rad=deviation_rad,
        slow_wave_rad=slow_wave_rad,
    )


def correct_velocity(
    settings: WaveFilterSettings,
    state: WaveFilterState,
    t_s: float,
    speed_m_s: float,
    course_rad: float,
    mean: tuple[float, float] | None = None,
) -> WaveFilterState:
    """Take one velocity over the ground in; before the first heading, or out of range, it changes nothing.

    `mean`, for a velocity that is the mean over a while: cosine and sine of the heading, their means over that while.
    """
    if not state.x or not (math.isfinite(t_s) and math.isfinite(course_rad) and 0.0 <= speed_m_s <= FASTEST_M_S):
        return state
    if not -LATEST_S <= t_s - state.t_s <= LONGEST_SILENCE_S:
        return state
    work = _Workspace(settings, state)
    work.predict_to(t_s)
    leg_rad = over_ground.leg_rad(state.leg_rad, work.x)
    leg_t_s = state.leg_t_s if leg_rad == state.leg_rad else t_s
    if state.fix_t_s is not None:
        work.open_shares(leg_rad, t_s - leg_t_s, t_s - state.fix_t_s)
    normalised, moved_m_s = [], []
    swing_rad = (work.x[kalman.WAVE], work.x[kalman.WAVE_RATE] / work.noise_model.omega_rad_s)
    velocity_m_s = (speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad))
    for axis, shown_m_s in enumerate(velocity_m_s):
        expected = over_ground.expect(work.x, axis, leg_rad, work.noise_model, mean)
        innovation_m_s = shown_m_s - expected.velocity_m_s
        measured = work.measure(expected.parts, expected.noise)
        square = innovation_m_s * innovation_m_s / measured.variance
        work.learn_frequencies(measured, innovation_m_s, 0.0)
        work.correct(measured, innovation_m_s, measured.variance * max(1.0, square / FIX_LIMIT))
        normalised.append(innovation_m_s / math.sqrt(measured.variance))
        moved_m_s.append(shown_m_s - expected.way_m_s)
    step_s = t_s - state.fix_t_s if state.fix_t_s is not None else LONGEST_SILENCE_S
    if step_s > 0.0:  # of two that have waited in the same buffer, the second tells nothing about noise
        model = learning.learn_from_velocity(
            work.noise_model, (normalised[0], normalised[1]), step_s, in_waves=mean is None
        )
        if mean is None:
            model = replace(model, coupling=learning.learn_coupling(model.coupling, swing_rad, moved_m_s, step_s))
        work.noise_model = model
    return _finish(work, state, fix_t_s=t_s, leg_rad=leg_rad, leg_t_s=leg_t_s)


def _finish(work: _Workspace, state: WaveFilterState, **taken: Any) -> WaveFilterState:
    """Return the state that the work has come to, with what it has taken; numbers that are none start the filter anew.

    `taken` are fields that a measurement changes besides.
    """
    x, numbers = work.x, work.columns.take(_APART)
    p = numbers[: kalman.STATES**2]
    sound = math.isfinite(sum(x)) and math.isfinite(kalman.sum_of(p))
    if not sound or min(p[:: kalman.STATES + 1].tolist()) <= 0.0:
        return WaveFilterState(rudder_rad=state.rudder_rad, expected_water=state.expected_water, **taken)
    heading_rad = wrap_two_pi(x[kalman.HEADING])
    turns_rad = heading_rad - x[kalman.HEADING]
    return replace(
        state,
        t_s=work.t_s,
        x=(heading_rad, *x[1 : kalman.FLOAT], x[kalman.FLOAT] + turns_rad, *x[kalman.FLOAT + 1 :]),
        p=p.tobytes(),
        slopes=numbers[kalman.STATES**2 :].tobytes(),
        noise_model=work.noise_model,
        **taken,
    )


def predict_heading(settings: WaveFilterSettings, state: WaveFilterState, t_s: float) -> tuple[float, float]:
    """Return heading and yaw rate carried to t_s by the K-T equation alone, for a filter that has started."""
    step_s = clamp(t_s - state.t_s, 0.0, LONGEST_SILENCE_S)
    turn = kalman.turn(state.x, state.rudder_rad, step_s, settings.model)
    return wrap_two_pi(turn.heading_rad), turn.yaw_rate_rad_s


def carry_on(settings: WaveFilterSettings, state: WaveFilterState, t_s: float) -> WaveFilterState:
    """Carry a filter that has started to t_s, with nothing measured."""
    work = _Workspace(settings, state)
    with np.errstate(all="ignore"):
        work.predict_to(t_s)
        return _finish(work, state)


def update(
    settings: WaveFilterSettings,
    state: WaveFilterState,
    headings: Sequence[Heading],
    velocities: Sequence[Velocity],
    rudder_rad: float,
) -> WaveFilterState:
    """Take a tick's samples in, in order of their times; the rudder stood at rudder_rad at its beginning."""
    samples: list[Heading | Velocity] = sorted([*headings, *velocities], key=lambda sample: sample.t_s)
    with np.errstate(all="ignore"):  # numbers beyond all bounds start the filter anew, and need no warning
        for one in samples:
            if isinstance(one, Heading):
                state = correct_heading(settings, state, one.t_s, one.heading_rad)
            else:
                state = correct_velocity(settings, state, one.t_s, one.speed_m_s, one.course_rad, one.mean)
    return state if state.rudder_rad == rudder_rad else replace(state, rudder_rad=rudder_rad)
