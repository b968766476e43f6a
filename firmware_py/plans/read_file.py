"""Reading of plan files in all supported formats."""

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
    """Read and validate the plans of a file; raise PlanFileError with source, line or item, and remedy.

    `home`: item 0 of a mission in a text file is home. Camera items of a mission are skipped and reported by `note`.
    """
    if len(content) > MAX_BYTES:
        raise PlanFileError(f"{source}: larger than {MAX_BYTES >> 20} MiB: not a plan file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise PlanFileError(f"{source}: not a text file; name a plan file") from None
    is_json = text.lstrip()[:1] == "{"
    plans = read_plan(text, source) if is_json else (read_text(text, source, home=home),)
    valid_plans = []
    for file_plan in plans:
        plan, indices = _remove_camera_items(file_plan)
        if problem := problem_of(plan):
            kind = plan.kind.name.lower()
            first_number = int(home and plan.kind is PlanKind.MISSION)
            numbering = "home is item 0" if first_number else "items are counted from 0"
            if problem.index is not None:
                problem = replace(problem, index=indices[problem.index])
            raise PlanFileError(f"{source}: {kind}: {problem.message(first_number)}; correct it ({numbering})")
        if skipped := sorted({item.command for item in file_plan.items} & CAMERA if plan is not file_plan else ()):
            if not plan.items:
                raise PlanFileError(f"{source}: mission: it has only camera commands; add waypoints")
            count, commands = len(file_plan.items) - len(plan.items), ", ".join(map(str, skipped))
            note(f"{source}: mission: camera items skipped: {count} (MAV_CMD {commands}); the boat has no camera")
        valid_plans.append(plan)
    return tuple(valid_plans)


def _remove_camera_items(plan: Plan) -> tuple[Plan, list[int]]:
    """Return a mission without camera items and with renumbered jumps, and the former indices of its items."""
    indices = [number for number, item in enumerate(plan.items) if item.command not in CAMERA]
    if plan.kind is not PlanKind.MISSION or len(indices) == len(plan.items):
        return plan, list(range(len(plan.items)))
    items = [plan.items[number] for number in indices]
    for number, item in enumerate(items):
        target = item.params[0]
        if item.command == Command.JUMP and 0.0 <= target < len(plan.items) and target.is_integer():
            items[number] = replace(item, params=(float(bisect_left(indices, target)), *item.params[1:]))
    return Plan.of(plan.kind, items), indices
