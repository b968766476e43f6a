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
from hil.lab.drill.checks import within_limit
from hil.ship.scenarios import find_scenario
from hil.sim.ground_station import GUIDED

# Inputs that a fault removes.
REMOVED_INPUTS = {
    "compass silent": {"compass", "its number"},
    "compass frozen": {"its number"},
    "compass loses and flips bytes": {"its number"},
    "compasses disagree": {"other compass"},
    "position lost": {"receiver"},
    "position jumps": {"receiver"},
    "servo's cable out": {"servo", "torque"},
    "servo's hardware error": {"torque"},
    "servo's power cut": {"torque"},
    "power monitor silent": {"monitor"},
}
# Inputs that the detection of a fault needs, besides its own.
NEEDED_INPUTS = {
    "compass frozen": {"compass"},
    "compasses disagree": {"compass", "its number"},
    "position jumps": {"receiver"},
    "servo's hardware error": {"servo"},
    "servo overloaded": {"torque"},
    "servo's power cut": {"torque"},
    "battery low": {"monitor"},
}
NO_HEADING = ("Heading lost", "No valid heading", "Compass heading jumped")


def removed_inputs(drills: Sequence[Drill]) -> set[str]:
    """Return the inputs that these faults remove together."""
    return {one for drill in drills for one in REMOVED_INPUTS.get(drill.name, ())}


def is_undetectable(drill: Drill, drills: Sequence[Drill]) -> bool:
    """Return whether the other faults prevent the detection of this one."""
    others = [other for other in drills if other is not drill]
    return bool(NEEDED_INPUTS.get(drill.name, set()) & removed_inputs(others))


def has_no_heading(drills: Sequence[Drill]) -> bool:
    """Return whether two faults together leave no heading, or one with an undetectable error."""
    return bool(explained_texts(drills))


def explained_texts(drills: Sequence[Drill]) -> tuple[str, ...]:
    """Return the additional messages of two faults that leave no reliable heading."""
    lost = "its number" in removed_inputs(drills) and bool({"receiver", "other compass"} & removed_inputs(drills))
    return NO_HEADING if len(drills) > 1 and lost else ()


def prevents_steering(drill: Drill, drills: Sequence[Drill]) -> bool:
    """Return whether this fault of a pair prevents steering, so that the check of the other one must wait."""
    return len(drills) > 1 and "servo" in removed_inputs([drill])


WARNING = 4  # MAV_SEVERITY_WARNING; messages of this severity and above need a cause
SEA = "tank"
SITUATION_S = 40.0
PAIR_INTERVAL_S = 2.0  # between the injections of a pair
FINAL_S = 5.0  # after the last recovery, for late messages


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


# Situations at the injection.
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

    `misses` are the deviations; a drill without any is passed.
    """

    name: str
    moment: str
    report_s: tuple[float | None, ...]
    clear_s: tuple[float | None, ...]
    worst_error_deg: float
    misses: tuple[str, ...]
    sailed_s: float
    wall_s: float


def cases(book: Sequence[Drill], seed: int, *, pairs: bool) -> list[Case]:
    """Return each drill in each situation, and all pairs that can be combined, in the order of the book."""
    found = [
        Case((drill,), moment, seed) for drill in book for moment in ((drill.moment,) if drill.moment else MOMENTS)
    ]
    if pairs:
        able = [drill for drill in book if drill.pair]
        found += [
            Case((first, second), "turning", seed) for number, first in enumerate(able) for second in able[number + 1 :]
        ]
    return found


@dataclass(slots=True)
class _Watch:
    """State of a drill during a case."""

    drill: Drill
    injected_s: float = 0.0
    report_s: float | None = None
    removed_s: float = 0.0
    clear_s: float | None = None
    misses: list[str] = field(default_factory=list)


def sail(case: Case) -> Outcome:
    """Run a case on a new boat."""
    begun_s = time.monotonic()
    watches = [_Watch(drill) for drill in case.drills]
    with tempfile.TemporaryDirectory(prefix="rambler-drill-") as directory:
        try:
            with _boat(case, Path(directory)) as boat:
                misses, worst_deg = _sailed(boat, case, watches)
                sailed_s = boat.now_s
        except HilError as error:
            misses, worst_deg, sailed_s = [str(error)], 0.0, 0.0
    return Outcome(
        case.name,
        case.moment,
        tuple(watch.report_s for watch in watches),
        tuple(watch.clear_s for watch in watches),
        worst_deg,
        tuple(miss for watch in watches for miss in watch.misses) + tuple(misses),
        sailed_s,
        time.monotonic() - begun_s,
    )


def _boat(case: Case, directory: Path) -> DrillBoat:
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


def _sailed(boat: DrillBoat, case: Case, watches: list[_Watch]) -> tuple[list[str], float]:
    if not boat.start_commands():
        return ["first commands of the operator not accepted"], 0.0
    MOMENTS[case.moment](boat)
    begun_s = boat.now_s
    boat.store_mode()
    for watch in watches:
        watch.injected_s = boat.now_s
        watch.drill.inject(boat)
        if len(watches) > 1:
            boat.run(PAIR_INTERVAL_S)
    for watch in watches:
        _await_report(boat, watch, required=not is_undetectable(watch.drill, case.drills))
    boat.run(max(0.0, max(watch.injected_s + watch.drill.active_s for watch in watches) - boat.now_s))
    for watch in watches:
        if prevents_steering(watch.drill, case.drills):
            _remove(boat, watch)
            boat.goal_s = boat.now_s  # only now can the boat turn
    for watch in watches:
        if not has_no_heading(case.drills) and (deviation := watch.drill.check(boat, watch.injected_s)):
            watch.misses.append(f"{watch.drill.name}: {deviation}")
    worst_deg = max((abs(error) for t_s, error in boat.errors_deg if t_s >= begun_s), default=0.0)
    for watch in watches:
        if not prevents_steering(watch.drill, case.drills):
            _remove(boat, watch)
    for watch in watches:
        _await_end(boat, watch)
    boat.run(FINAL_S)
    misses = _unexplained(boat, case, begun_s)
    if not has_no_heading(case.drills):
        misses += [f"{watch.drill.name}: {deviation}" for watch in watches if (deviation := _check_after(boat, watch))]
    return misses + [deviation for deviation in (within_limit(boat),) if deviation], worst_deg


def _check_after(boat: DrillBoat, watch: _Watch) -> str:
    return watch.drill.check_after(boat, watch.injected_s) if watch.clear_s is not None else ""


def _remove(boat: DrillBoat, watch: _Watch) -> None:
    watch.removed_s = boat.now_s
    watch.drill.remove(boat)


def _await_report(boat: DrillBoat, watch: _Watch, *, required: bool) -> None:
    drill = watch.drill
    if not drill.text:
        return
    at_s = boat.until(drill.text, drill.report_s, watch.injected_s)
    if at_s is None and required:
        watch.misses.append(f"{drill.name}: {drill.text!r} not reported within {drill.report_s:g} s")
    elif at_s is not None:
        watch.report_s = at_s - watch.injected_s


def _await_end(boat: DrillBoat, watch: _Watch) -> None:
    """Wait for the recovery, which may already have been reported during the checks."""
    drill = watch.drill
    if not drill.clear_s or watch.report_s is None:
        return
    since_s = watch.injected_s + watch.report_s
    at_s = boat.until(drill.recovery, watch.removed_s + drill.clear_s - since_s, since_s)
    if at_s is None:
        watch.misses.append(f"{drill.name}: {drill.recovery!r} not reported within {drill.clear_s:g} s of the removal")
    else:
        watch.clear_s = max(0.0, at_s - watch.removed_s)


def _unexplained(boat: DrillBoat, case: Case, since_s: float) -> list[str]:
    """Return warnings that no injected fault explains."""
    known = tuple(text for drill in case.drills for text in (drill.text, drill.recovery, *drill.also) if text)
    known += explained_texts(case.drills)
    any_text = any("" in drill.also for drill in case.drills)
    warnings = (text for t_s, severity, text in boat.station.texts if t_s >= since_s and severity <= WARNING)
    return [] if any_text else [f"unexplained: {text!r}" for text in warnings if not text.startswith(known)]
