"""Run drills: bring a boat into a situation, inject and remove a fault, and check messages and behaviour."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hil.errors import HilError
from hil.lab.drill.boat import DrillBoat
from hil.lab.drill.book import Drill
from hil.lab.drill.checks import was_within_limit
from hil.ship.scenarios import find_scenario
from hil.sim.ground_station import GUIDED

# fault -> inputs that it removes
REMOVED_INPUTS = {
    "compass silent": {"compass", "compass value"},
    "compass frozen": {"compass value"},
    "compass loses and flips bytes": {"compass value"},
    "compasses disagree": {"other compass"},
    "position lost": {"receiver"},
    "position jumps": {"receiver"},
    "servo's cable out": {"servo", "torque"},
    "servo's hardware error": {"torque"},
    "servo's power cut": {"torque"},
    "power monitor silent": {"monitor"},
}
# fault -> inputs that its detection needs
NEEDED_INPUTS = {
    "compass frozen": {"compass"},
    "compasses disagree": {"compass", "compass value"},
    "position jumps": {"receiver"},
    "servo's hardware error": {"servo"},
    "servo overloaded": {"torque"},
    "servo's power cut": {"torque"},
    "battery low": {"monitor"},
}
NO_HEADING = ("Heading lost", "No valid heading", "Compass heading jumped")


def removed_inputs(drills: Sequence[Drill]) -> set[str]:
    """Return the inputs that the faults remove together."""
    return {input_name for drill in drills for input_name in REMOVED_INPUTS.get(drill.name, ())}


def is_undetectable(drill: Drill, drills: Sequence[Drill]) -> bool:
    """Return whether the other faults prevent the detection of this one."""
    others = [other for other in drills if other is not drill]
    return bool(NEEDED_INPUTS.get(drill.name, set()) & removed_inputs(others))


def has_no_heading(drills: Sequence[Drill]) -> bool:
    """Return whether two faults together remove the heading or make its error undetectable."""
    return bool(explained_texts(drills))


def explained_texts(drills: Sequence[Drill]) -> tuple[str, ...]:
    """Return the additional messages that two faults without a reliable heading cause."""
    loses_compass = "compass value" in removed_inputs(drills) and bool(
        {"receiver", "other compass"} & removed_inputs(drills)
    )
    return NO_HEADING if len(drills) > 1 and loses_compass else ()


def prevents_steering(drill: Drill, drills: Sequence[Drill]) -> bool:
    """Return whether this fault of a pair prevents steering; then it is removed before the check of the other one."""
    return len(drills) > 1 and "servo" in removed_inputs([drill])


WARNING = 4  # MAV_SEVERITY_WARNING; messages of this or a higher severity need a cause
SEA = "tank"
SITUATION_S = 40.0  # from the start of the run to the situation, with a steady course
PAIR_INTERVAL_S = 2.0  # between the injections of a pair
FINAL_S = 5.0  # after the last recovery, for delayed messages


def _straight(boat: DrillBoat) -> None:
    boat.run(max(0.0, SITUATION_S - boat.now_s))


def _turning(boat: DrillBoat) -> None:
    _straight(boat)
    boat.steer(40.0)
    boat.run(4.0)


def _saturated(boat: DrillBoat) -> None:
    _straight(boat)
    boat.steer(120.0)
    boat.run(3.0)


# name of the situation -> function that brings the boat into it
MOMENTS: Mapping[str, Callable[[DrillBoat], None]] = {
    "straight": _straight,
    "turning": _turning,
    "saturated": _saturated,
}


@dataclass(frozen=True, slots=True)
class Case:
    """One or two drills in a situation."""

    drills: tuple[Drill, ...]
    moment: str
    seed: int = 1

    @property
    def name(self) -> str:
        """Return the names of the drills."""
        return " + ".join(drill.name for drill in self.drills)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a case: times from the injection to the report and from the removal to the recovery, or None.

    `misses`: the deviations; a case without deviations is passed.
    """

    name: str
    moment: str
    report_s: tuple[float | None, ...]
    clear_s: tuple[float | None, ...]
    worst_error_deg: float
    misses: tuple[str, ...]
    simulated_s: float
    wall_s: float


def cases(book: Sequence[Drill], seed: int, *, pairs: bool) -> list[Case]:
    """Return each drill in each situation, and all pairs that can be combined, in the order of the book."""
    all_cases = [
        Case((drill,), moment, seed) for drill in book for moment in ((drill.moment,) if drill.moment else MOMENTS)
    ]
    if pairs:
        combinable = [drill for drill in book if drill.can_pair]
        all_cases += [
            Case((first, second), "turning", seed)
            for number, first in enumerate(combinable)
            for second in combinable[number + 1 :]
        ]
    return all_cases


@dataclass(slots=True)
class _DrillState:
    """A drill and its results during a case."""

    drill: Drill
    injected_s: float = 0.0
    report_s: float | None = None
    removed_s: float = 0.0
    clear_s: float | None = None
    misses: list[str] = field(default_factory=list)


def sail(case: Case) -> Outcome:
    """Run a case on a new boat."""
    start_s = time.monotonic()
    states = [_DrillState(drill) for drill in case.drills]
    with tempfile.TemporaryDirectory(prefix="rambler-drill-") as directory:
        try:
            with _build_boat(case, Path(directory)) as boat:
                misses, worst_deg = _run_case(boat, case, states)
                simulated_s = boat.now_s
        except HilError as error:
            misses, worst_deg, simulated_s = [str(error)], 0.0, 0.0
    return Outcome(
        case.name,
        case.moment,
        tuple(state.report_s for state in states),
        tuple(state.clear_s for state in states),
        worst_deg,
        tuple(miss for state in states for miss in state.misses) + tuple(misses),
        simulated_s,
        time.monotonic() - start_s,
    )


def _build_boat(case: Case, directory: Path) -> DrillBoat:
    sea = find_scenario(SEA)
    settings: dict[str, float] = {}
    for drill in case.drills:
        sea = drill.sea(sea)
        settings |= drill.settings or {}
    return DrillBoat(
        directory,
        sea,
        seed=case.seed,
        mode=next((drill.mode for drill in case.drills if drill.mode != GUIDED), GUIDED),
        settings=settings,
        fitted=tuple({name: None for drill in case.drills for name in drill.fitted}),
        plans=tuple(drill.plan(directory) for drill in case.drills if drill.plan is not None),
    )


def _run_case(boat: DrillBoat, case: Case, states: list[_DrillState]) -> tuple[list[str], float]:
    if not boat.start_commands():
        return ["first commands of the operator not accepted"], 0.0
    MOMENTS[case.moment](boat)
    start_s = boat.now_s
    boat.store_mode()
    for state in states:
        state.injected_s = boat.now_s
        state.drill.inject(boat)
        if len(states) > 1:
            boat.run(PAIR_INTERVAL_S)
    for state in states:
        _await_report(boat, state, required=not is_undetectable(state.drill, case.drills))
    boat.run(max(0.0, max(state.injected_s + state.drill.active_s for state in states) - boat.now_s))
    for state in states:
        if prevents_steering(state.drill, case.drills):
            _remove(boat, state)
            boat.goal_s = boat.now_s  # because the boat can turn only from now on
    for state in states:
        if not has_no_heading(case.drills) and (deviation := state.drill.check(boat, state.injected_s)):
            state.misses.append(f"{state.drill.name}: {deviation}")
    worst_deg = max((abs(error) for t_s, error in boat.errors_deg if t_s >= start_s), default=0.0)
    for state in states:
        if not prevents_steering(state.drill, case.drills):
            _remove(boat, state)
    for state in states:
        _await_end(boat, state)
    boat.run(FINAL_S)
    misses = _unexplained_warnings(boat, case, start_s)
    if not has_no_heading(case.drills):
        misses += [f"{state.drill.name}: {deviation}" for state in states if (deviation := _check_after(boat, state))]
    if text := was_within_limit(boat):
        misses.append(text)
    return misses, worst_deg


def _check_after(boat: DrillBoat, state: _DrillState) -> str:
    return state.drill.check_after(boat, state.injected_s) if state.clear_s is not None else ""


def _remove(boat: DrillBoat, state: _DrillState) -> None:
    state.removed_s = boat.now_s
    state.drill.remove(boat)


def _await_report(boat: DrillBoat, state: _DrillState, *, required: bool) -> None:
    drill = state.drill
    if not drill.text:
        return
    at_s = boat.await_report(drill.text, drill.report_s, state.injected_s)
    if at_s is None and required:
        state.misses.append(f"{drill.name}: {drill.text!r} not reported within {drill.report_s:g} s")
    elif at_s is not None:
        state.report_s = at_s - state.injected_s


def _await_end(boat: DrillBoat, state: _DrillState) -> None:
    """Wait for the recovery, which may have been reported during the checks."""
    drill = state.drill
    if not drill.clear_s or state.report_s is None:
        return
    since_s = state.injected_s + state.report_s
    at_s = boat.await_report(drill.recovery, state.removed_s + drill.clear_s - since_s, since_s)
    if at_s is None:
        state.misses.append(f"{drill.name}: {drill.recovery!r} not reported within {drill.clear_s:g} s of the removal")
    else:
        state.clear_s = max(0.0, at_s - state.removed_s)


def _unexplained_warnings(boat: DrillBoat, case: Case, since_s: float) -> list[str]:
    """Return texts on the warnings that no injected fault explains."""
    explained = tuple(text for drill in case.drills for text in (drill.text, drill.recovery, *drill.also) if text)
    explained += explained_texts(case.drills)
    any_text = any("" in drill.also for drill in case.drills)
    warnings = (text for t_s, severity, text in boat.station.texts if t_s >= since_s and severity <= WARNING)
    return [] if any_text else [f"unexplained: {text!r}" for text in warnings if not text.startswith(explained)]
