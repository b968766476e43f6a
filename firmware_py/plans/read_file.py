"""A plan file of any known format."""

from __future__ import annotations

from firmware_py.common.plan import Plan, PlanKind
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.qgc_file import read_plan
from firmware_py.plans.text_files import read_text
from firmware_py.plans.validation import problem_of

MOST_BYTES = 8 << 20


def read_plan_file(content: bytes, source: str, *, home: bool = True) -> tuple[Plan, ...]:
    """Read the content of a plan file and judge its plans; PlanFileError names source, line or item, and the remedy."""
    if len(content) > MOST_BYTES:
        raise PlanFileError(f"{source}: larger than {MOST_BYTES >> 20} MiB; this is no plan file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise PlanFileError(f"{source}: this is no text; name a plan file") from None
    is_json = text.lstrip()[:1] == "{"
    plans = read_plan(text, source) if is_json else (read_text(text, source, home=home),)
    for plan in plans:
        if problem := problem_of(plan):
            kind = plan.kind.name.lower()
            first = int(home and plan.kind is PlanKind.MISSION)
            counted = "home is item 0" if first else "items are counted from 0"
            raise PlanFileError(f"{source}: {kind}: {problem.shown(first)}; mend it ({counted})")
    return plans
