"""A plan file of any known format."""

from __future__ import annotations

from pathlib import Path

from firmware_py.common.plan import Plan
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.qgc_file import read_plan
from firmware_py.plans.text_files import read_text
from firmware_py.plans.validation import problem_of

_MOST_BYTES = 8 << 20


def read_file(path: Path, *, home: bool = True) -> tuple[Plan, ...]:
    """Read a plan file and judge its plans; PlanFileError names file, line or item, and the remedy."""
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise PlanFileError(f"{path}: {error.strerror}; name a file that can be read") from None
    if len(content) > _MOST_BYTES:
        raise PlanFileError(f"{path}: larger than {_MOST_BYTES >> 20} MiB; this is no plan file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise PlanFileError(f"{path}: this is no text; name a plan file") from None
    found = text.lstrip()[:1]
    plans = read_plan(text, str(path)) if found == "{" else (read_text(text, str(path), home=home),)
    for plan in plans:
        if fault := problem_of(plan):
            raise PlanFileError(f"{path}: {plan.kind.name.lower()}: {fault}; mend it (items are counted from 0 here)")
    return plans
