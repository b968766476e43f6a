"""Plans as files of file transfer: `@MISSION/mission.dat`, `fence.dat` and `rally.dat`, for reading and writing.

Source: ArduPilot, libraries/AP_Filesystem/README.md. The header has five numbers (magic, MAV_MISSION_TYPE, options,
first item, count). The payload of a MISSION_ITEM_INT for each item follows, with numbers and home as in the mission
protocol.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import partial

from firmware_py.common.intents import Answer, ReplacePlan, Request, Verdict
from firmware_py.common.plan import MAX_PLAN_ITEMS, Plan, PlanItem, PlanKind, first_item_number
from firmware_py.common.records import Severity
from firmware_py.common.reports import Home
from firmware_py.link.context import LinkContext
from firmware_py.link.files.area import PathParts
from firmware_py.link.files.tree import Generate, Origin, Query, Sink
from firmware_py.link.mission.items import home_item, item_message, new_plan_text, valid_item
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.worker import Worker
from firmware_py.plans.problem import PlanProblem, PlanResult
from firmware_py.plans.validation import problem_of

PATHS: Mapping[PlanKind, PathParts] = {
    PlanKind.MISSION: ("@MISSION", "mission.dat"),
    PlanKind.FENCE: ("@MISSION", "fence.dat"),
    PlanKind.RALLY: ("@MISSION", "rally.dat"),
}
_MAGIC = 0x763D
_HEADER = struct.Struct("<HHHHH")
_ITEM = mavlink.MAVLink_mission_item_int_message


def pack(plan: Plan, home: Home | None, home_count: int) -> bytes:
    """Encode a plan as a file."""
    items = (*(home_item(home),) * (home_count if plan.items else 0), *plan.items)
    encoded = [_HEADER.pack(_MAGIC, int(plan.kind), 0, 0, len(items))]
    for sequence, item in enumerate(items):
        message = item_message(item, (0, 0), plan.kind, sequence, home_count=home_count, is_current=False, is_int=True)
        encoded.append(_ITEM.unpacker.pack(*(getattr(message, name) for name in _ITEM.ordered_fieldnames)))
    return b"".join(encoded)


def unpack(content: bytes, kind: PlanKind, home_count: int) -> Plan | PlanProblem:
    """Decode and validate an uploaded file; return the plan, or its first problem."""
    if len(content) < _HEADER.size:
        return _file_problem("file shorter than its header")
    magic, kind_number, options, first_item, count = _HEADER.unpack_from(content)
    if magic != _MAGIC:
        return _file_problem(f"begins with {magic:#06x} instead of {_MAGIC:#06x}")
    if kind_number != int(kind):
        return _file_problem(f"plan type {kind_number} instead of {int(kind)}")
    if options or first_item:
        return _file_problem("partial plan files are not supported")
    if count > MAX_PLAN_ITEMS + home_count:
        return PlanProblem(None, PlanResult.NO_SPACE, f"{count} items; at most {MAX_PLAN_ITEMS} are supported")
    if len(content) != _HEADER.size + count * _ITEM.unpacker.size:
        return _file_problem(f"{len(content)} bytes do not match {count} items")
    items: list[PlanItem] = []
    for sequence in range(home_count, count):
        fields = _ITEM.unpacker.unpack_from(content, _HEADER.size + sequence * _ITEM.unpacker.size)
        message = _ITEM(**dict(zip(_ITEM.ordered_fieldnames, fields, strict=True)))
        if message.seq != sequence:
            return PlanProblem(sequence - home_count, PlanResult.INVALID_SEQUENCE, f"is numbered {message.seq}")
        item = valid_item(message, kind, sequence - home_count, home_count)
        if isinstance(item, PlanProblem):
            return item
        items.append(item)
    plan = Plan.of(kind, items)
    return problem_of(plan) or plan


def _file_problem(text: str) -> PlanProblem:
    return PlanProblem(None, PlanResult.INVALID, text)


class PlanFiles:
    """The plan files. The worker encodes and validates them: 2000 items take too long for the loop."""

    def __init__(self, context: LinkContext, worker: Worker) -> None:
        """Store the context and the worker."""
        self._context = context
        self._worker = worker

    def generated(self) -> Mapping[PathParts, Generate]:
        """Return the generators of the readable files by path."""
        return {path: self._make_generator(kind) for kind, path in PATHS.items()}

    def sinks(self) -> Mapping[PathParts, Sink]:
        """Return the sinks of the writable files by path."""
        return {path: self._make_sink(kind) for kind, path in PATHS.items()}

    def _make_generator(self, kind: PlanKind) -> Generate:
        def generate(_: Query) -> bytes:
            plan = self._context.request_handler.plans().of(kind)
            return pack(plan, self._context.home, first_item_number(self._context.autopilot, kind))

        return generate

    def _make_sink(self, kind: PlanKind) -> Sink:
        def apply_file(content: bytes, origin: Origin, finish: Callable[[str], None]) -> None:
            home_count = first_item_number(self._context.autopilot, kind)

            def receive_result(plan: Plan | PlanProblem | Exception) -> None:
                if isinstance(plan, Plan):
                    self._replace_plan(plan, origin, finish)
                elif isinstance(plan, PlanProblem):
                    finish(plan.message(home_count))
                else:
                    finish(f"{type(plan).__name__}: {plan}")

            if not self._worker.submit(partial(unpack, content, kind, home_count), receive_result):
                finish("disk busy, send the file again")

        return apply_file

    def _replace_plan(self, plan: Plan, origin: Origin, finish: Callable[[str], None]) -> None:
        def receive_answer(answer: Answer) -> None:
            if answer.verdict is Verdict.ACCEPTED:
                self._context.send_text_all(Severity.INFO, new_plan_text(plan, self._context.autopilot))
            finish("" if answer.verdict is Verdict.ACCEPTED else answer.text or "refused")

        request = Request(origin.now_s, ReplacePlan(plan), origin.system, origin.component)
        self._context.request_handler.replace_plan(request, receive_answer)
