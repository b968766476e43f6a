"""Validation of plans from links, files and the store."""

from __future__ import annotations

import math

from firmware_py.common.plan import MAX_PLAN_ITEMS, Plan, PlanItem, PlanKind
from firmware_py.plans.items import MISSION_FRAME, PLACE_FRAMES, ROWS, Command, ItemRow
from firmware_py.plans.polygons import polygons_problem
from firmware_py.plans.problem import PlanProblem, PlanResult
from firmware_py.plans.sequence import order_problem

__all__ = ["PlanProblem", "PlanResult", "item_problem", "problem_of"]

_MAX_LATITUDE, _MAX_LONGITUDE = 900_000_000, 1_800_000_000  # 1e-7 degrees
_INVALID_PARAM = {number: PlanResult(5 + number) for number in (1, 2, 3, 4)}
_TIME_OF_DAY = -1.0  # param1 of NAV_DELAY
_CACHE_SIZE = 4

_recent: list[tuple[Plan, PlanProblem | None]] = []


def problem_of(plan: Plan) -> PlanProblem | None:
    """Return the first problem of a plan, or None; cached."""
    # The cache compares object identities, because two plans with the same checksum can be forged.
    for recent, problem in _recent:
        if recent is plan:
            return problem
    problem = _first_problem(plan)
    _recent.insert(0, (plan, problem))
    del _recent[_CACHE_SIZE:]
    return problem


def _first_problem(plan: Plan) -> PlanProblem | None:
    if len(plan.items) > MAX_PLAN_ITEMS:
        return PlanProblem(
            None, PlanResult.NO_SPACE, f"{len(plan.items)} items; at most {MAX_PLAN_ITEMS} are supported"
        )
    for index, item in enumerate(plan.items):
        if problem := item_problem(plan.kind, index, item):
            return problem
    if plan.kind is PlanKind.MISSION:
        return order_problem(plan.items)
    return polygons_problem(plan.items) if plan.kind is PlanKind.FENCE else None


def item_problem(kind: PlanKind, index: int, item: PlanItem) -> PlanProblem | None:
    """Return the problem of an item, without its references to other items."""
    row = ROWS.get(item.command)
    if row is None or row.kind is not kind:
        name = f"command {item.command}" if row is None else row.name
        return PlanProblem(index, PlanResult.UNSUPPORTED, f"{name} is not known in a {kind.name.lower()} plan")
    if item.frame not in PLACE_FRAMES and (row.has_place or item.frame != MISSION_FRAME):
        return PlanProblem(index, PlanResult.UNSUPPORTED_FRAME, f"{row.name}: frame {item.frame} is not supported")
    for number, value in enumerate(item.params, start=1):
        if math.isinf(value):
            return PlanProblem(index, _INVALID_PARAM[number], f"{row.name}: param{number} is infinite")
    for meaning in row.meanings:
        value = item.params[meaning.number - 1]
        if not meaning.admits(value):
            text = f"{row.name}: param{meaning.number} is {value:g}; allowed: {meaning.allowed()}"
            return PlanProblem(index, _INVALID_PARAM[meaning.number], text)
    return _position_problem(row, index, item) or _special_problem(row, index, item)


def _position_problem(row: ItemRow, index: int, item: PlanItem) -> PlanProblem | None:
    if row.has_place and not -_MAX_LATITUDE <= item.x <= _MAX_LATITUDE:
        return PlanProblem(index, PlanResult.INVALID_PARAM5_X, f"{row.name}: the latitude is out of range")
    if row.has_place and not -_MAX_LONGITUDE <= item.y <= _MAX_LONGITUDE:
        return PlanProblem(index, PlanResult.INVALID_PARAM6_Y, f"{row.name}: the longitude is out of range")
    # Position 0, 0 is the present position in a mission and valid in a fence; in a rally point it means unset fields.
    if row.command is Command.RALLY_POINT and item.x == item.y == 0:
        return PlanProblem(index, PlanResult.INVALID_PARAM5_X, f"{row.name}: position 0, 0 is not accepted")
    if math.isinf(item.z):
        return PlanProblem(index, PlanResult.INVALID_PARAM7, f"{row.name}: the altitude is infinite")
    return None


def _special_problem(row: ItemRow, index: int, item: PlanItem) -> PlanProblem | None:
    """Return a problem that depends on several parameters."""
    if row.command is Command.SET_HOME and not item.params[0] and math.isnan(item.z):
        return PlanProblem(index, PlanResult.INVALID_PARAM7, f"{row.name}: the altitude is not a number")
    if row.command is Command.DELAY and item.params[0] < 0.0:
        if item.params[0] != _TIME_OF_DAY:
            return PlanProblem(index, PlanResult.INVALID_PARAM1, f"{row.name}: a time must be -1, or 0 or more")
        if not item.params[1] >= 0.0:
            return PlanProblem(index, PlanResult.INVALID_PARAM2, f"{row.name}: a time of day needs an hour")
    return None
