"""Run the autopilot's tick over a recording.

No other module of `hil` imports the tick of the firmware (import contract `seam`).

The tick is that of the firmware. The recorded rudder angle replaces the rudder command, so that the monitors check the
recorded steering. The controller is called a second time to compute the command that it would give.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Generic, TypeVar

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from firmware_py.common.angles import TWO_PI, radians, wrap_pi, wrap_two_pi
from firmware_py.common.intents import Arm, Request, SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, Inputs, PositionSample, RudderFeedback, Tick
from firmware_py.common.reports import Output, Snapshot
from firmware_py.control.law import IDLE, LawState
from firmware_py.control.rudder_limit import limit_command
from firmware_py.core.rudder_demand import compute_rudder_demand
from firmware_py.core.state import Settings, State, settings_of
from firmware_py.core.step import step
from firmware_py.estimate import observer, prediction_check, water
from firmware_py.estimate.heading_model import Motion
from firmware_py.faults.fault import Fault
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.modes import HeadingGoal
from hil.lab.estimate.recording import Recording
from hil.lab.identify.recording import Floats

MEAN_S: Final = 60.0  # averages many wave periods, and is shorter than most legs
MIN_GOAL_CHANGE_RAD: Final = radians(10.0)  # waves and gusts change the mean by less


def goals_at(recording: Recording, times_s: Floats) -> Floats:
    """Return the heading goals at times since the start of the recording.

    Without a recorded goal it is the mean heading of a minute, constant until that mean differs by MIN_GOAL_CHANGE_RAD.
    With a goal that follows the heading continuously, the monitors would see no heading error.
    """
    goals = _mean_headings(recording, times_s)
    if recording.goal_s.size:
        index = np.searchsorted(recording.goal_s, times_s, side="right") - 1
        recorded = np.where(index >= 0, recording.goal_rad[np.maximum(index, 0)], np.nan)
        goals = np.where(np.isfinite(recorded), recorded, goals)
    return np.asarray(goals % TWO_PI)


def _mean_headings(recording: Recording, times_s: Floats) -> Floats:
    samples = [sample for sample in recording.headings if sample.source == recording.source]
    time_s = np.array([sample.t_s for sample in samples])
    heading = np.unwrap([sample.heading_rad for sample in samples])
    area = np.concatenate(([0.0], np.cumsum(0.5 * (heading[1:] + heading[:-1]) * np.diff(time_s))))
    low, high = (np.clip(times_s + side * MEAN_S / 2, time_s[0], time_s[-1]) for side in (-1.0, 1.0))
    spans = np.maximum(high - low, 1e-9)
    means = (np.interp(high, time_s, area) - np.interp(low, time_s, area)) / spans
    goal, goals = float(means[0]), []
    for mean in means.tolist():
        if abs(wrap_pi(mean - goal)) > MIN_GOAL_CHANGE_RAD:
            goal = mean
        goals.append(goal)
    return np.array(goals)


MAX_TICK_S: Final = 1.0  # largest tick interval
GAP_INTERVALS: Final = 1.5  # a heading is missing after this number of intervals
MAX_GAP_TICKS_S: Final = 120.0  # later ticks in a gap have no effect
LEVEL_COUNT: Final = 6  # noise levels of the heading filter
TICKS_PER_REPORT: Final = 500
RESTART_TEXT: Final = "Heading estimate restarted"
# Estimates of a tick with a heading, in the order of `_row`; then rudder command and corrected compass heading.
COLUMNS: Final = (
    *("heading_rad", "heading_sd_rad", "yaw_rate_rad_s", "yaw_rate_sd_rad_s", "rudder_bias_rad", "rudder_bias_sd_rad"),
    *("speed_m_s", "speed_sd_m_s", "current_north_m_s", "current_east_m_s", "current_sd_m_s", "leeway_rad"),
    *("wave_period_s", "wave_yaw_rad", "compass_noise_rad", "innovation_rad", "innovation_sd_rad"),
    *("command_rad", "compass_rad"),
)

Sample = TypeVar("Sample", HeadingSample, PositionSample, RudderFeedback)
Report = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class FaultSpan:
    """A fault and its times, in seconds since the start of the recording."""

    name: str
    from_s: float
    to_s: float


@dataclass(frozen=True, slots=True)
class Estimates:
    """Results of the autopilot over a recording; `columns` are those of COLUMNS at the headings, NaN if unknown.

    Times are seconds since the start of the recording. goal_rad: commanded goal at the headings. travel_rad: travel of
    the computed rudder command. rudder_s, rudder_rad: recorded rudder angle. motions, levels: state and noise levels of
    the heading filter at the headings (heading_model.py). models: K, T and alpha at the speed of each row. inflation:
    factor on the filter's standard deviations.
    """

    time_s: Floats
    columns: Mapping[str, Floats]
    goal_rad: Floats
    faults: tuple[FaultSpan, ...]
    restarts_s: tuple[float, ...]
    travel_rad: float
    ticks: int
    rudder_s: Floats
    rudder_rad: Floats
    motions: Floats
    levels: Floats
    models: Floats
    inflation: Floats


def run_ticks(parameters: ParameterSet, recording: Recording, report: Report) -> Estimates:
    """Run the ticks over a recording; `report` is called with the finished and the total number of ticks."""
    times_s, is_row, interval_s = _tick_times(recording)
    goals = goals_at(recording, times_s)
    headings, positions, rudder = _Queue(recording.headings), _Queue(recording.positions), _Queue(recording.rudder)
    state, results = State.at_start(parameters), _Results()
    settings = settings_of(parameters)
    to_rudder, angle_rad, controller = settings.rudder.linkage.to_rudder, 0.0, _Controller()
    for number, (now_s, goal) in enumerate(zip(times_s.tolist(), goals.tolist(), strict=True)):
        samples = headings.take(now_s)
        # The estimator uses the angle measured at a tick until the next tick.
        feedback = rudder.take(now_s) if recording.rudder else (_unknown_rudder(now_s),)
        for sample in feedback:
            angle_rad = angle_rad if sample.shaft_rad is None else to_rudder(sample.shaft_rad)
        inputs = Inputs(
            Tick(number, now_s, 0.0, 0, 1.0 / interval_s),
            headings=samples,
            positions=positions.take(now_s),
            rudder=feedback,
            requests=_requests(state, goal, now_s),
        )
        # The recorded angle replaces the command, so that the monitors check the recorded steering.
        before = replace(state, rudder=replace(state.rudder, command_rad=angle_rad))
        state, output = step(before, inputs)
        controller.steer(settings, state, output.snapshot, before.timing.step_s(now_s))
        results.take(output, now_s)
        if is_row[number]:
            compass = next(sample for sample in reversed(samples) if sample.source == recording.source)
            results.rows.append(
                _row(output.snapshot, controller.command_rad, _true_heading_rad(settings, state, compass))
            )
            results.filters.append(_filter_row(settings, state, now_s))
        if number % TICKS_PER_REPORT == 0 or number + 1 == times_s.size:
            report(number + 1, times_s.size)
    columns = np.array(results.rows, dtype=np.float64).T
    filters = np.array(results.filters, dtype=np.float64)
    shafts = [(sample.t_s, sample.shaft_rad) for sample in recording.rudder if sample.shaft_rad is not None]
    return Estimates(
        times_s[is_row],
        dict(zip(COLUMNS, columns, strict=True)),
        goals[is_row],
        results.fault_spans(float(times_s[-1])),
        tuple(results.restarts_s),
        controller.travel_rad,
        times_s.size,
        np.array([t_s for t_s, _ in shafts]),
        np.array([to_rudder(shaft_rad) for _, shaft_rad in shafts]),
        filters[:, : -LEVEL_COUNT - 4],
        filters[:, -LEVEL_COUNT - 4 : -4],
        filters[:, -4:-1],
        filters[:, -1],
    )


def _unknown_rudder(now_s: float) -> RudderFeedback:
    """Return the feedback of a servo without torque and without a measured angle."""
    return RudderFeedback(now_s, shaft_rad=None, torque_on=False)


def _filter_row(settings: Settings, state: State, now_s: float) -> tuple[float, ...]:
    """Return state and covariance of the heading filter, its levels, K, T and alpha, and the inflation.

    NaN if the filter has no state of this time: before it starts, and while the compass is not used.
    """
    estimator = state.heading_estimator
    tick = estimator.tick
    if tick.filter.t_s != now_s:
        return (math.nan,) * (len(Motion._fields) + LEVEL_COUNT + 4)
    model = water.model_at_speed(settings.heading_estimator.tick.model, estimator.water)
    inflation = prediction_check.sd_inflation(tick.check)
    return (*tick.filter.motion, *tick.filter.levels, *model[:3], inflation)


def _true_heading_rad(settings: Settings, state: State, sample: HeadingSample) -> float:
    """Return the true heading of a compass sample, corrected as in the estimator."""
    corrections = settings.heading_estimator.observer
    declination_rad = state.heading_estimator.declination.declination_rad
    if settings.heading_estimator.declination_by_model and declination_rad is not None:
        corrections = replace(corrections, declination_rad=declination_rad)
    return observer.true_heading_rad(corrections, sample)


def _row(snapshot: Snapshot, command_rad: float, compass_rad: float) -> tuple[float, ...]:
    """Return the estimates of a tick, in the order of COLUMNS."""
    estimate, water, nan = snapshot.estimate, snapshot.water, math.nan
    if estimate is None:
        return (*(nan for _ in COLUMNS[:-2]), command_rad, compass_rad)
    return (
        estimate.heading_rad,
        estimate.heading_sd_rad,
        estimate.yaw_rate_rad_s,
        estimate.yaw_rate_sd_rad_s,
        estimate.bias_rad,
        estimate.bias_sd_rad,
        estimate.speed_m_s,
        estimate.speed_sd_m_s,
        nan if water is None else water.current_north_m_s,
        nan if water is None else water.current_east_m_s,
        nan if water is None else water.current_sd_m_s,
        nan if water is None else water.leeway_rad,
        estimate.wave_period_s,
        estimate.wave_yaw_rad,
        estimate.compass_noise_rad,
        estimate.innovation_rad,
        estimate.innovation_sd_rad,
        command_rad,
        compass_rad,
    )


def _requests(state: State, goal_rad: float, now_s: float) -> tuple[Request, ...]:
    """Return the requests of a tick: as soon as there is a heading, arm, and steer to the goal."""
    modes = state.modes
    if state.heading_estimator.heading.sample_t_s is None:
        return ()
    if modes.armed and modes.mode is Mode.GUIDED and isinstance(modes.goal, HeadingGoal):
        if modes.goal.heading_rad == wrap_two_pi(goal_rad):
            return ()
        return (Request(now_s, SteerHeading(goal_rad)),)
    return (Request(now_s, Arm(armed=True, force=True)), Request(now_s, SteerHeading(goal_rad, change_mode=True)))


def _tick_times(recording: Recording) -> tuple[Floats, NDArray[np.bool_], float]:
    """Return the times of the ticks, which of them have a heading, and the median interval.

    In a gap, ticks continue at the interval of the headings, for the monitors.
    """
    at_s = np.unique([sample.t_s for sample in recording.headings if sample.source == recording.source])
    interval_s = min(float(np.median(np.diff(at_s))), MAX_TICK_S)
    gap_times_s = [
        begin_s + interval_s * np.arange(1, math.ceil(min(end_s - begin_s, MAX_GAP_TICKS_S) / interval_s - 0.5))
        for begin_s, end_s in pairwise(at_s.tolist())
        if end_s - begin_s > GAP_INTERVALS * interval_s
    ]
    extra_s = np.concatenate(gap_times_s) if gap_times_s else np.zeros(0)
    times_s = np.concatenate((at_s, extra_s))
    order = np.argsort(times_s, kind="stable")
    return times_s[order], (np.arange(times_s.size) < at_s.size)[order], interval_s


class _Queue(Generic[Sample]):
    """Samples of one type in order of time."""

    def __init__(self, samples: Sequence[Sample]) -> None:
        self._samples: Sequence[Sample] = samples
        self._next = 0

    def take(self, now_s: float) -> tuple[Sample, ...]:
        """Return the samples after those of the last call up to time `now_s`."""
        begin = self._next
        while self._next < len(self._samples) and self._samples[self._next].t_s <= now_s:
            self._next += 1
        return tuple(self._samples[begin : self._next])


@dataclass(slots=True)
class _Controller:
    """The command that the heading controller would give if its previous commands had been executed."""

    controller: LawState = IDLE
    command_rad: float = 0.0
    travel_rad: float = 0.0

    def steer(self, settings: Settings, state: State, snapshot: Snapshot, step_s: float) -> None:
        """Process a tick."""
        target = SteeringTarget(snapshot.goal_heading_rad, snapshot.heading_error_rad)
        own_state = replace(
            state, rudder=replace(state.rudder, command_rad=self.command_rad), controller=self.controller
        )
        demand_rad, self.controller = compute_rudder_demand(
            settings, own_state, target, snapshot.gain_reduction, snapshot.t_s, step_s
        )
        previous_rad = self.command_rad
        self.command_rad = limit_command(settings.rudder.limits, previous_rad, demand_rad, step_s)
        self.travel_rad += abs(self.command_rad - previous_rad)


@dataclass(slots=True)
class _Results:
    """Results of the ticks so far."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    filters: list[tuple[float, ...]] = field(default_factory=list)
    restarts_s: list[float] = field(default_factory=list)
    faults: list[FaultSpan] = field(default_factory=list)
    since_s: dict[Fault, float] = field(default_factory=dict)

    def take(self, output: Output, now_s: float) -> None:
        """Process a tick."""
        snapshot = output.snapshot
        if any(event.text == RESTART_TEXT for event in output.events):
            self.restarts_s.append(now_s)
        active = {fault for fault in Fault if snapshot.faults >> fault & 1} if snapshot.faults else set()
        if active == self.since_s.keys():
            return
        for fault in active - self.since_s.keys():
            self.since_s[fault] = now_s
        for fault in self.since_s.keys() - active:
            self.faults.append(FaultSpan(fault.name, self.since_s.pop(fault), now_s))

    def fault_spans(self, end_s: float) -> tuple[FaultSpan, ...]:
        """Return all faults in order of time; active faults end at the end of the recording."""
        faults = [*self.faults, *(FaultSpan(fault.name, since_s, end_s) for fault, since_s in self.since_s.items())]
        return tuple(sorted(faults, key=lambda fault: (fault.from_s, fault.name)))
