"""Plans in one file transfer: `@MISSION/mission.dat`, `fence.dat` and `rally.dat`, for reading and writing.

Source: ArduPilot, libraries/AP_Filesystem/README.md. Five numbers (magic, MAV_MISSION_TYPE, options, first item,
count), then the payload of a MISSION_ITEM_INT for each item, with numbers and home as in the mission protocol.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import partial

from msgspec.structs import replace

from firmware_py.common.intents import Answer, ReplacePlan, Request, Verdict
from firmware_py.common.plan import MAX_PLAN_ITEMS, Plan, PlanItem, PlanKind, first_item_number
from firmware_py.common.records import Severity
from firmware_py.common.reports import Home
from firmware_py.link.context import LinkContext
from firmware_py.link.files.area import PathParts
from firmware_py.link.files.tree import Generate, Origin, Query, Sink
from firmware_py.link.mission.items import home_item, item_message, item_of, new_plan_text
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.worker import Worker
from firmware_py.plans.problem import PlanProblem, PlanResult
from firmware_py.plans.validation import item_problem, problem_of

PATHS: Mapping[PlanKind, PathParts] = {
    PlanKind.MISSION: ("@MISSION", "mission.dat"),
    PlanKind.FENCE: ("@MISSION", "fence.dat"),
    PlanKind.RALLY: ("@MISSION", "rally.dat"),
}
_MAGIC = 0x763D
_HEAD = struct.Struct("<HHHHH")
_ITEM = mavlink.MAVLink_mission_item_int_message


def pack(plan: Plan, home: Home | None, home_count: int) -> bytes:
    """Return a plan as a file."""
    items = (*(home_item(home),) * (home_count if plan.items else 0), *plan.items)
    rows = [_HEAD.pack(_MAGIC, int(plan.kind), 0, 0, len(items))]
    for number, item in enumerate(items):
        message = item_message(item, (0, 0), plan.kind, number, home_count=home_count, current=False, whole=True)
        rows.append(_ITEM.unpacker.pack(*(getattr(message, name) for name in _ITEM.ordered_fieldnames)))
    return b"".join(rows)


def unpack(content: bytes, kind: PlanKind, home_count: int) -> Plan | PlanProblem:
    """Return the validated plan of an uploaded file, or its problem."""
    if len(content) < _HEAD.size:
        return _fault("shorter than its head")
    magic, number, options, first, count = _HEAD.unpack_from(content)
    if magic != _MAGIC:
        return _fault(f"begins with {magic:#06x} instead of {_MAGIC:#06x}")
    if number != int(kind):
        return _fault(f"holds a plan of kind {number} instead of {int(kind)}")
    if options or first:
        return _fault("only whole plans are taken")
    if count > MAX_PLAN_ITEMS + home_count:
        return PlanProblem(None, PlanResult.NO_SPACE, f"{count} items; at most {MAX_PLAN_ITEMS} are supported")
    if len(content) != _HEAD.size + count * _ITEM.unpacker.size:
        return _fault(f"{len(content)} bytes do not hold {count} items")
    items: list[PlanItem] = []
    for sequence in range(home_count, count):
        fields = _ITEM.unpacker.unpack_from(content, _HEAD.size + sequence * _ITEM.unpacker.size)
        message = _ITEM(**dict(zip(_ITEM.ordered_fieldnames, fields, strict=True)))
        if message.seq != sequence:
            return PlanProblem(sequence - home_count, PlanResult.INVALID_SEQUENCE, f"is numbered {message.seq}")
        item = item_of(message, home_count)
        if not isinstance(item, PlanProblem):
            items.append(item)
            item = item_problem(kind, sequence - home_count, item) or item
        if isinstance(item, PlanProblem):
            return replace(item, index=sequence - home_count)
    plan = Plan.of(kind, items)
    return problem_of(plan) or plan


def _fault(text: str) -> PlanProblem:
    return PlanProblem(None, PlanResult.INVALID, text)


class PlanFiles:
    """The three files. 2000 items are packed and validated on the worker, since that takes too long for the loop."""

    def __init__(self, context: LinkContext, worker: Worker) -> None:
        """Take the context and the worker."""
        self._context = context
        self._worker = worker

    def generated(self) -> Mapping[PathParts, Generate]:
        """Return the files that can be read."""
        return {path: self._maker(kind) for kind, path in PATHS.items()}

    def sinks(self) -> Mapping[PathParts, Sink]:
        """Return the files that can be written."""
        return {path: self._sink(kind) for kind, path in PATHS.items()}

    def _maker(self, kind: PlanKind) -> Generate:
        def make(_: Query) -> bytes:
            plan = self._context.request_handler.plans().of(kind)
            return pack(plan, self._context.home, first_item_number(self._context.autopilot, kind))

        return make

    def _sink(self, kind: PlanKind) -> Sink:
        def put_in_force(content: bytes, origin: Origin, done: Callable[[str], None]) -> None:
            home_count = first_item_number(self._context.autopilot, kind)

            def judged(plan: Plan | PlanProblem | Exception) -> None:
                if isinstance(plan, Plan):
                    self._replace(plan, origin, done)
                elif isinstance(plan, PlanProblem):
                    done(plan.message(home_count))
                else:
                    done(f"{type(plan).__name__}: {plan}")

            if not self._worker.submit(partial(unpack, content, kind, home_count), judged):
                done("disk busy, send the file again")

        return put_in_force

    def _replace(self, plan: Plan, origin: Origin, done: Callable[[str], None]) -> None:
        def stored(answer: Answer) -> None:
            if answer.verdict is Verdict.ACCEPTED:
                self._context.send_text_all(Severity.INFO, new_plan_text(plan, self._context.autopilot))
            done("" if answer.verdict is Verdict.ACCEPTED else answer.text or "refused")

        request = Request(origin.now_s, ReplacePlan(plan), origin.system, origin.component)
        self._context.request_handler.replace_plan(request, stored)
