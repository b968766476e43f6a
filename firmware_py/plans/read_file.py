"""A plan file of any known format."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable

from msgspec.structs import replace

from firmware_py.common.plan import Plan, PlanKind
from firmware_py.plans.items import CAMERA, Command
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.qgc_file import read_plan
from firmware_py.plans.text_files import read_text
from firmware_py.plans.validation import problem_of

MAX_BYTES = 8 << 20


def read_plan_file(
    content: bytes, source: str, *, home: bool = True, note: Callable[[str], None] = lambda _text: None
) -> tuple[Plan, ...]:
    """Read the content of a plan file and judge its plans; PlanFileError names source, line or item, and the remedy.

    Camera items of a mission are passed over; `note` takes the line that says so.
    """
    if len(content) > MAX_BYTES:
        raise PlanFileError(f"{source}: larger than {MAX_BYTES >> 20} MiB; this is no plan file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise PlanFileError(f"{source}: this is no text; name a plan file") from None
    is_json = text.lstrip()[:1] == "{"
    plans = read_plan(text, source) if is_json else (read_text(text, source, home=home),)
    judged = []
    for each in plans:
        plan, kept = _without_camera(each)
        if problem := problem_of(plan):
            kind = plan.kind.name.lower()
            first = int(home and plan.kind is PlanKind.MISSION)
            counted = "home is item 0" if first else "items are counted from 0"
            if problem.index is not None:
                problem = replace(problem, index=kept[problem.index])
            raise PlanFileError(f"{source}: {kind}: {problem.message(first)}; mend it ({counted})")
        if passed_over := sorted({item.command for item in each.items} & CAMERA if plan is not each else ()):
            if not plan.items:
                raise PlanFileError(f"{source}: mission: it has nothing but commands for a camera; add waypoints")
            count, commands = len(each.items) - len(plan.items), ", ".join(map(str, passed_over))
            note(f"{source}: mission: camera items passed over: {count} (MAV_CMD {commands}); the boat has no camera")
        judged.append(plan)
    return tuple(judged)


def _without_camera(plan: Plan) -> tuple[Plan, list[int]]:
    """Return a mission without its camera items, its jumps renumbered, and the old places of the other items."""
    kept = [number for number, item in enumerate(plan.items) if item.command not in CAMERA]
    if plan.kind is not PlanKind.MISSION or len(kept) == len(plan.items):
        return plan, list(range(len(plan.items)))
    items = [plan.items[number] for number in kept]
    for number, item in enumerate(items):
        target = item.params[0]
        if item.command == Command.JUMP and 0.0 <= target < len(plan.items) and target.is_integer():
            items[number] = replace(item, params=(float(bisect_left(kept, target)), *item.params[1:]))
    return Plan.of(plan.kind, items), kept
