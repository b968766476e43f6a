"""Drills sailed: a boat brought to a moment, something broken and mended, and all that she said and did judged."""

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
from hil.lab.drill.together import explained, is_blind, is_hidden, stops_her
from hil.ship.scenarios import named
from hil.sim.ground_station import GUIDED

SEVERE = 4  # MAV_SEVERITY_WARNING and graver: nothing of that may be told without a cause
SEA = "tank"
SETTLED_S = 40.0
APART_S = 2.0  # between the two of a pair
QUIET_S = 5.0  # after the last recovery, for what follows


def _straight(boat: DrillBoat) -> None:
    boat.run(max(0.0, SETTLED_S - boat.now_s))


def _turning(boat: DrillBoat) -> None:
    _straight(boat)
    boat.steer(40.0)
    boat.run(4.0)


def _saturated(boat: DrillBoat) -> None:
    _straight(boat)
    boat.steer(120.0)
    boat.run(3.0)


# What she is doing when it breaks.
MOMENTS: Mapping[str, Callable[[DrillBoat], None]] = {
    "straight": _straight,
    "turning": _turning,
    "saturated": _saturated,
}


@dataclass(frozen=True, slots=True)
class Case:
    """One or two drills, sailed at a moment."""

    drills: tuple[Drill, ...]
    moment: str
    seed: int = 1

    @property
    def name(self) -> str:
        """What breaks."""
        return " + ".join(drill.name for drill in self.drills)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a case; times in seconds from the break and from the mending, None where none is asked for.

    `misses` say what was not as the book has it: none of them, and the drill is passed.
    """

    name: str
    moment: str
    told_s: tuple[float | None, ...]
    over_s: tuple[float | None, ...]
    worst_error_deg: float
    misses: tuple[str, ...]
    sailed_s: float
    wall_s: float


def cases(book: Sequence[Drill], seed: int, *, pairs: bool) -> list[Case]:
    """Return each drill at each moment, and each pair of those that go together, in the order of the book."""
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
    """One drill of a case while it is sailed."""

    drill: Drill
    broken_s: float = 0.0
    told_s: float | None = None
    mended_s: float = 0.0
    over_s: float | None = None
    misses: list[str] = field(default_factory=list)


def sail(case: Case) -> Outcome:
    """Sail a case on a boat of its own."""
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
        tuple(watch.told_s for watch in watches),
        tuple(watch.over_s for watch in watches),
        worst_deg,
        tuple(miss for watch in watches for miss in watch.misses) + tuple(misses),
        sailed_s,
        time.monotonic() - begun_s,
    )


def _boat(case: Case, directory: Path) -> DrillBoat:
    sea = named(SEA)
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
    if not boat.under_way():
        return ["she did not get under way"], 0.0
    MOMENTS[case.moment](boat)
    begun_s = boat.now_s
    boat.note_mode()
    for watch in watches:
        watch.broken_s = boat.now_s
        watch.drill.broken(boat)
        if len(watches) > 1:
            boat.run(APART_S)
    for watch in watches:
        _await_telling(boat, watch, asked=not is_hidden(watch.drill, case.drills))
    boat.run(max(0.0, max(watch.broken_s + watch.drill.stands_s for watch in watches) - boat.now_s))
    for watch in watches:
        if stops_her(watch.drill, case.drills):
            _mend(boat, watch)
            boat.goal_s = boat.now_s  # from now on she can turn
    for watch in watches:
        if not is_blind(case.drills) and (complaint := watch.drill.holds(boat, watch.broken_s)):
            watch.misses.append(f"{watch.drill.name}: {complaint}")
    worst_deg = max((abs(error) for t_s, error in boat.errors_deg if t_s >= begun_s), default=0.0)
    for watch in watches:
        if not stops_her(watch.drill, case.drills):
            _mend(boat, watch)
    for watch in watches:
        _await_end(boat, watch)
    boat.run(QUIET_S)
    misses = _unexplained(boat, case, begun_s)
    if not is_blind(case.drills):
        misses += [f"{watch.drill.name}: {wrong}" for watch in watches if (wrong := _afterwards(boat, watch))]
    return misses + [wrong for wrong in (within_limit(boat),) if wrong], worst_deg


def _afterwards(boat: DrillBoat, watch: _Watch) -> str:
    return watch.drill.after(boat, watch.broken_s) if watch.over_s is not None else ""


def _mend(boat: DrillBoat, watch: _Watch) -> None:
    watch.mended_s = boat.now_s
    watch.drill.mended(boat)


def _await_telling(boat: DrillBoat, watch: _Watch, *, asked: bool) -> None:
    drill = watch.drill
    if not drill.text:
        return
    at_s = boat.until(drill.text, drill.told_s, watch.broken_s)
    if at_s is None and asked:
        watch.misses.append(f"{drill.name}: {drill.text!r} not told within {drill.told_s:g} s")
    elif at_s is not None:
        watch.told_s = at_s - watch.broken_s


def _await_end(boat: DrillBoat, watch: _Watch) -> None:
    """What ends by itself may have ended while it was looked at."""
    drill = watch.drill
    if not drill.over_s or watch.told_s is None:
        return
    since_s = watch.broken_s + watch.told_s
    at_s = boat.until(drill.recovery, watch.mended_s + drill.over_s - since_s, since_s)
    if at_s is None:
        watch.misses.append(f"{drill.name}: {drill.recovery!r} not told within {drill.over_s:g} s of its mending")
    else:
        watch.over_s = max(0.0, at_s - watch.mended_s)


def _unexplained(boat: DrillBoat, case: Case, since_s: float) -> list[str]:
    """Return what was told gravely though nothing that was broken explains it."""
    known = tuple(text for drill in case.drills for text in (drill.text, drill.recovery, *drill.also) if text)
    known += explained(case.drills)
    everything = any("" in drill.also for drill in case.drills)
    grave = (text for t_s, severity, text in boat.station.texts if t_s >= since_s and severity <= SEVERE)
    return [] if everything else [f"unexplained: {text!r}" for text in grave if not text.startswith(known)]
