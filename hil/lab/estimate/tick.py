"""The autopilot's tick for the laboratory: the only module of `hil` that imports it (import contract `seam`).

The tick is the one that the boat runs, and the controller is called once more beside it, for the command that it would
give: in the tick the recorded rudder stands for the command, so that the monitors judge what was done.
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

from firmware_py.common.angles import wrap_two_pi
from firmware_py.common.intents import Arm, Request, SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, Inputs, PositionSample, RudderFeedback, Tick
from firmware_py.common.reports import Output, Snapshot
from firmware_py.control.law import IDLE, LawState
from firmware_py.control.rudder_limit import limited_command
from firmware_py.core.rudder_demand import rudder_demand
from firmware_py.core.state import Settings, State, settings_of
from firmware_py.core.step import step
from firmware_py.estimate import observer, prediction_check, water
from firmware_py.estimate.heading_model import Motion
from firmware_py.faults.fault import Fault
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.modes import HeadingGoal
from hil.lab.estimate.goals import goals_at
from hil.lab.estimate.recording import Recording
from hil.lab.identify.recording import Floats

SLOWEST_TICK_S: Final = 1.0  # the loop turns so often at least
GAP_INTERVALS: Final = 1.5  # a heading that comes later than this is missing
TICKS_IN_GAP_S: Final = 120.0  # after which nothing more comes of a gap
LEVELS: Final = 6
TELL_EVERY: Final = 500  # ticks
RESTARTED: Final = "Heading estimate restarted"
# What a tick estimates at a heading, in the order of `_row`; then its rudder command, and the compass as corrected.
COLUMNS: Final = (
    *("heading_rad", "heading_sd_rad", "yaw_rate_rad_s", "yaw_rate_sd_rad_s", "rudder_bias_rad", "rudder_bias_sd_rad"),
    *("speed_m_s", "speed_sd_m_s", "current_north_m_s", "current_east_m_s", "current_sd_m_s", "leeway_rad"),
    *("wave_period_s", "wave_yaw_rad", "compass_noise_rad", "innovation_rad", "innovation_sd_rad"),
    *("command_rad", "compass_rad"),
)

Sample = TypeVar("Sample", HeadingSample, PositionSample, RudderFeedback)
Tell = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class StandingFault:
    """A fault and when it stood, in seconds since the recording's begin."""

    name: str
    from_s: float
    to_s: float


@dataclass(frozen=True, slots=True)
class Watched:
    """What the autopilot made of a recording: columns by COLUMNS at its headings, NaN where not known, and the rest.

    Times are seconds since the recording's begin. goal_rad: what it was ordered to steer at the headings. travel_rad:
    of the rudder, as it would have commanded it. rudder_s, rudder_rad: the recorded rudder, in its own frame. motions,
    levels: state and noise levels of the heading filter at the headings, as heading_model.py has them; models: K, T and
    alpha at the speed there; inflation: by what the filter's standard deviations are enlarged.
    """

    time_s: Floats
    columns: Mapping[str, Floats]
    goal_rad: Floats
    faults: tuple[StandingFault, ...]
    restarts_s: tuple[float, ...]
    travel_rad: float
    ticks: int
    rudder_s: Floats
    rudder_rad: Floats
    motions: Floats
    levels: Floats
    models: Floats
    inflation: Floats


def watch(parameters: ParameterSet, recording: Recording, tell: Tell) -> Watched:
    """Run the ticks over a recording. tell: is given how many of how many ticks are done."""
    times_s, is_row, interval_s = _tick_times(recording)
    goals = goals_at(recording, times_s)
    headings, positions, rudder = _Queue(recording.headings), _Queue(recording.positions), _Queue(recording.rudder)
    state, log = State.at_start(parameters), _Log()
    settings = settings_of(parameters)
    to_rudder, angle_rad, helm = settings.rudder.linkage.to_rudder, 0.0, _Helm()
    for number, (now_s, goal) in enumerate(zip(times_s.tolist(), goals.tolist(), strict=True)):
        heard = headings.take(now_s)
        # The estimator takes the angle measured at a tick for that until the next.
        feedback = rudder.take(now_s) if recording.rudder else (_unknown_rudder(now_s),)
        for sample in feedback:
            angle_rad = angle_rad if sample.shaft_rad is None else to_rudder(sample.shaft_rad)
        inputs = Inputs(
            Tick(number, now_s, 0.0, 0, 1.0 / interval_s),
            headings=heard,
            positions=positions.take(now_s),
            rudder=feedback,
            requests=_orders(state, goal, now_s),
        )
        # The monitors judge what was done: the recorded angle stands for the command.
        before = replace(state, rudder=replace(state.rudder, command_rad=angle_rad))
        state, output = step(before, inputs)
        helm.steer(settings, state, output.snapshot, before.timing.step_s(now_s))
        log.take(output, now_s)
        if is_row[number]:
            compass = next(sample for sample in reversed(heard) if sample.source == recording.source)
            log.rows.append(_row(output.snapshot, helm.command_rad, _true_heading_rad(settings, state, compass)))
            log.filters.append(_filter_row(settings, state, now_s))
        if number % TELL_EVERY == 0 or number + 1 == times_s.size:
            tell(number + 1, times_s.size)
    columns = np.array(log.rows, dtype=np.float64).T
    filters = np.array(log.filters, dtype=np.float64)
    shafts = [(sample.t_s, sample.shaft_rad) for sample in recording.rudder if sample.shaft_rad is not None]
    return Watched(
        times_s[is_row],
        dict(zip(COLUMNS, columns, strict=True)),
        goals[is_row],
        log.standing_faults(float(times_s[-1])),
        tuple(log.restarts_s),
        helm.travel_rad,
        times_s.size,
        np.array([t_s for t_s, _ in shafts]),
        np.array([to_rudder(shaft_rad) for _, shaft_rad in shafts]),
        filters[:, : -LEVELS - 4],
        filters[:, -LEVELS - 4 : -4],
        filters[:, -4:-1],
        filters[:, -1],
    )


def _unknown_rudder(now_s: float) -> RudderFeedback:
    """Return the feedback of a servo without torque that measures no angle."""
    return RudderFeedback(now_s, shaft_rad=None, torque_on=False)


def _filter_row(settings: Settings, state: State, now_s: float) -> tuple[float, ...]:
    """Return state and covariance of the heading filter, its levels, K, T and alpha, and the inflation.

    NaN where the filter has no state of this time: before it has started, and while the compass is not used.
    """
    estimator = state.heading_estimator
    tick = estimator.tick
    if tick.filter.t_s != now_s:
        return (math.nan,) * (len(Motion._fields) + LEVELS + 4)
    model = water.model_at_speed(settings.heading_estimator.tick.model, estimator.water)
    inflation = prediction_check.sd_inflation(tick.check)
    return (*tick.filter.motion, *tick.filter.levels, *model[:3], inflation)


def _true_heading_rad(settings: Settings, state: State, sample: HeadingSample) -> float:
    """Return the true heading of a compass sample, with the corrections of the estimator."""
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


def _orders(state: State, goal_rad: float, now_s: float) -> tuple[Request, ...]:
    """Return the requests of a tick: arm and steer the goal as soon as there is a heading."""
    modes = state.modes
    if state.heading_estimator.heading.sample_t_s is None:
        return ()
    if modes.armed and modes.mode is Mode.GUIDED and isinstance(modes.goal, HeadingGoal):
        if modes.goal.heading_rad == wrap_two_pi(goal_rad):
            return ()
        return (Request(now_s, SteerHeading(goal_rad)),)
    return (Request(now_s, Arm(armed=True, force=True)), Request(now_s, SteerHeading(goal_rad, change_mode=True)))


def _tick_times(recording: Recording) -> tuple[Floats, NDArray[np.bool_], float]:
    """Return when to tick, which of these ticks have a heading, and the usual interval.

    In a gap the ticks go on, for the monitors, at the interval of the headings.
    """
    at_s = np.unique([sample.t_s for sample in recording.headings if sample.source == recording.source])
    interval_s = min(float(np.median(np.diff(at_s))), SLOWEST_TICK_S)
    more = [
        begin_s + interval_s * np.arange(1, math.ceil(min(end_s - begin_s, TICKS_IN_GAP_S) / interval_s - 0.5))
        for begin_s, end_s in pairwise(at_s.tolist())
        if end_s - begin_s > GAP_INTERVALS * interval_s
    ]
    between_s = np.concatenate(more) if more else np.zeros(0)
    times_s = np.concatenate((at_s, between_s))
    order = np.argsort(times_s, kind="stable")
    return times_s[order], (np.arange(times_s.size) < at_s.size)[order], interval_s


class _Queue(Generic[Sample]):
    """Samples of one kind, taken in order of time."""

    def __init__(self, samples: Sequence[Sample]) -> None:
        self._samples: Sequence[Sample] = samples
        self._next = 0

    def take(self, now_s: float) -> tuple[Sample, ...]:
        """Return the samples since the last call, up to a time."""
        begin = self._next
        while self._next < len(self._samples) and self._samples[self._next].t_s <= now_s:
            self._next += 1
        return tuple(self._samples[begin : self._next])


@dataclass(slots=True)
class _Helm:
    """What the heading controller would command if its own command before had been carried out."""

    controller: LawState = IDLE
    command_rad: float = 0.0
    travel_rad: float = 0.0

    def steer(self, settings: Settings, state: State, snapshot: Snapshot, step_s: float) -> None:
        """Take a tick."""
        target = SteeringTarget(snapshot.goal_heading_rad, snapshot.heading_error_rad)
        own = replace(state, rudder=replace(state.rudder, command_rad=self.command_rad), controller=self.controller)
        demand_rad, self.controller = rudder_demand(
            settings, own, target, snapshot.gain_reduction, snapshot.t_s, step_s
        )
        before_rad = self.command_rad
        self.command_rad = limited_command(settings.rudder.limits, before_rad, demand_rad, step_s)
        self.travel_rad += abs(self.command_rad - before_rad)


@dataclass(slots=True)
class _Log:
    """What the ticks have reported so far."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    filters: list[tuple[float, ...]] = field(default_factory=list)
    restarts_s: list[float] = field(default_factory=list)
    faults: list[StandingFault] = field(default_factory=list)
    since_s: dict[Fault, float] = field(default_factory=dict)

    def take(self, output: Output, now_s: float) -> None:
        """Take a tick."""
        snapshot = output.snapshot
        if any(event.text == RESTARTED for event in output.events):
            self.restarts_s.append(now_s)
        standing = {fault for fault in Fault if snapshot.faults >> fault & 1} if snapshot.faults else set()
        if standing == self.since_s.keys():
            return
        for fault in standing - self.since_s.keys():
            self.since_s[fault] = now_s
        for fault in self.since_s.keys() - standing:
            self.faults.append(StandingFault(fault.name, self.since_s.pop(fault), now_s))

    def standing_faults(self, end_s: float) -> tuple[StandingFault, ...]:
        """Return all faults in order of time; those that still stand end with the recording."""
        faults = [*self.faults, *(StandingFault(fault.name, since_s, end_s) for fault, since_s in self.since_s.items())]
        return tuple(sorted(faults, key=lambda fault: (fault.from_s, fault.name)))
