"""The .plan files of QGroundControl: mission, fence and rally points in one JSON document.

Source: QGroundControl developer guide (docs.qgroundcontrol.com), "Plan File Format".
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from firmware_py.common.plan import MAX_PLAN_ITEMS, Plan, PlanItem, PlanKind, Plans
from firmware_py.plans.items import Command, has_position
from firmware_py.plans.numbers import PlanFileError, add_location, make_item, scale_position, shorten
from firmware_py.plans.polygons import polygons_of

_GLOBAL, _RELATIVE = 0, 3  # MAV_FRAME
_ARDUPILOT, _SURFACE_BOAT = 3, 11  # MAV_AUTOPILOT, MAV_TYPE
_PLANNING_SPEED_M_S = 0.5

# All keys of QGroundControl in the supported version of each object. Other keys are refused, because ignoring them
# would change the plan silently.
_DOCUMENT_KEYS = frozenset({"fileType", "groundStation", "mission", "geoFence", "rallyPoints"})
_MISSION_KEYS = frozenset(
    {"items", "plannedHomePosition", "firmwareType", "vehicleType", "cruiseSpeed", "hoverSpeed"}
    | {"globalPlanAltitudeMode"}
)
_FENCE_KEYS = frozenset({"polygons", "circles", "breachReturn"})
_RALLY_KEYS = frozenset({"points"})
_ITEM_KEYS = frozenset(
    {"type", "command", "frame", "params", "autoContinue", "doJumpId"}
    | {"Altitude", "AltitudeMode", "AMSLAltAboveTerrain", "MISSION_ITEM_ID"}
)
_TRANSECTS = "TransectStyleComplexItem"


def read_plan(text: str, source: str) -> tuple[Plan, ...]:
    """Read the plans of a .plan file; raise PlanFileError with `source`, section, item and remedy."""
    document = _read_document(text, source)
    plans = []
    for section, read in (("mission", _read_mission), ("geoFence", _read_fence), ("rallyPoints", _read_rally)):
        if section not in document:
            continue
        try:
            plans.append(read(document[section]))
        except PlanFileError as error:
            raise add_location(source, f": {section}", error) from None
    if not plans:
        raise PlanFileError(f"{source}: it has neither mission, geoFence nor rallyPoints; save it again")
    return tuple(plans)


def _read_document(text: str, source: str) -> Mapping[str, Any]:
    def refuse_constant(name: str) -> float:
        raise ValueError(f"{name} is not JSON")

    try:
        document = json.loads(text, parse_constant=refuse_constant)
    except RecursionError:
        raise PlanFileError(f"{source}: it is nested too deeply; save it again with QGroundControl") from None
    except ValueError as error:
        raise PlanFileError(f"{source}: not JSON: {error}; save it again with QGroundControl") from None
    if not isinstance(document, dict) or document.get("fileType") != "Plan":
        raise PlanFileError(f"{source}: fileType is not Plan; save it with QGroundControl as a .plan")
    try:
        return _check_object(document, 1, _DOCUMENT_KEYS)
    except PlanFileError as error:
        raise add_location(source, "", error) from None


def _to_object(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise PlanFileError(f"expected an object, found {shorten(value)}")
    return value


def _check_object(value: Any, version: int, keys: frozenset[str]) -> Mapping[str, Any]:
    """Return an object of this version or without a version; raise PlanFileError for unknown keys."""
    data = _to_object(value)
    file_version = data.get("version", version)
    if type(file_version) not in (int, float) or file_version != version:
        raise PlanFileError(
            f"version {shorten(file_version)} is not supported, only {version}; save it with a current QGroundControl"
        )
    _check_keys(data, keys | {"version"})
    return data


def _check_keys(data: Mapping[str, Any], keys: frozenset[str]) -> None:
    if unknown := sorted(data.keys() - keys):
        raise PlanFileError(f"key {shorten(unknown[0])} is not known; known are {', '.join(sorted(keys))}")


def _read_list(data: Mapping[str, Any], key: str) -> list[Any]:
    value = data.get(key)
    if not isinstance(value, list):
        raise PlanFileError(f"{key}: expected a list, found {shorten(value)}")
    if len(value) > MAX_PLAN_ITEMS:
        raise PlanFileError(f"{key}: {len(value)} entries; at most {MAX_PLAN_ITEMS} are kept")
    return value


def _read_number(value: Any, unset: float | None = None) -> float:
    """Read a number; null means `unset`, if that is not None."""
    if value is None and unset is not None:
        return unset
    if type(value) not in (int, float):
        raise PlanFileError(f"expected a number, found {shorten(value)}")
    try:
        return float(value)
    except OverflowError:
        raise PlanFileError(f"{shorten(value)} is too large") from None


def _read_integer(value: Any, high: int) -> int:
    number = _read_number(value)
    if not (0 <= number <= high and number == math.floor(number)):
        raise PlanFileError(f"expected a whole number from 0 to {high}, found {shorten(value)}")
    return int(number)


def _read_bool(value: Any) -> bool:
    if not isinstance(value, bool):
        raise PlanFileError(f"expected true or false, found {shorten(value)}")
    return value


def _read_coordinates(value: Any, min_length: int) -> list[float]:
    if not isinstance(value, list) or not min_length <= len(value) <= 3:
        raise PlanFileError(f"expected [latitude, longitude{', altitude' * (min_length - 2)}], found {shorten(value)}")
    return [_read_number(part) for part in value]


def _read_mission(section: Any) -> Plan:
    entries: list[tuple[int, Any]] = []
    for number, entry in enumerate(_read_list(_check_object(section, 2, _MISSION_KEYS), "items"), start=1):
        entries += [(number, item) for item in _read_numbered(_list_simple_items, entry, number)]
    if len(entries) > MAX_PLAN_ITEMS:
        raise PlanFileError(f"items: {len(entries)} including surveys; at most {MAX_PLAN_ITEMS} are kept")
    jump_ids = [
        _read_numbered(partial(_read_jump_id, index=index), entry, number)
        for index, (number, entry) in enumerate(entries)
    ]
    items = [_read_numbered(lambda entry: _read_item(entry, jump_ids), entry, number) for number, entry in entries]
    return Plan.of(PlanKind.MISSION, items)


def _list_simple_items(entry: Any) -> list[Mapping[str, Any]]:
    """Return a simple item as a list, or the items of a survey or corridor scan."""
    data = _to_object(entry)
    if data.get("type") != "ComplexItem" or _TRANSECTS not in data:
        return [data]
    transects = _to_object(data[_TRANSECTS])
    if transects.get("version", 1) not in (1, 2):
        raise PlanFileError(f"{_TRANSECTS}: version {shorten(transects['version'])} is not supported, only 1 and 2")
    items = [_to_object(item) for item in _read_list(transects, "Items")]
    if not items:
        raise PlanFileError(f"{_TRANSECTS} has no Items; open it in QGroundControl and save it again")
    return items


def _read_numbered(read: Any, entry: Any, number: int) -> Any:
    try:
        return read(entry)
    except PlanFileError as error:
        raise PlanFileError(f"item {number}: {error}") from None


def _read_jump_id(entry: Mapping[str, Any], index: int) -> int:
    return _read_integer(entry.get("doJumpId", index + 1), 0xFFFF)


def _read_item(entry: Mapping[str, Any], jump_ids: Sequence[int]) -> PlanItem:
    item_type = entry.get("type")
    if item_type != "SimpleItem":
        name = entry.get("complexItemType", item_type)
        raise PlanFileError(
            f"{shorten(name)} is not a simple item and contains none; upload it from QGroundControl, "
            "or save it from the boat afterwards"
        )
    _check_keys(entry, _ITEM_KEYS)
    command = _read_integer(entry.get("command"), 0xFFFF)
    values = entry.get("params")
    if not isinstance(values, list) or len(values) != 7:
        raise PlanFileError(f"expected 7 params, found {shorten(values)}")
    unset_position = None if has_position(command) else 0.0
    unset = (math.nan, math.nan, math.nan, math.nan, unset_position, unset_position, math.nan)
    params = [_read_number(value, default) for value, default in zip(values, unset, strict=True)]
    if command == Command.JUMP:
        count = jump_ids.count(params[0])
        if count != 1:
            raise PlanFileError(f"DO_JUMP: {count} items with doJumpId {params[0]:g} instead of 1")
        params[0] = float(jump_ids.index(params[0]))
    frame = _read_integer(entry.get("frame"), 0xFF)
    return make_item(command, frame, params, autocontinue=_read_bool(entry.get("autoContinue", True)))


def _read_fence(value: Any) -> Plan:
    section = _check_object(value, 2, _FENCE_KEYS)
    if not section.keys() & {"polygons", "circles"}:
        raise PlanFileError("it has neither polygons nor circles; save it again with QGroundControl")
    items: list[PlanItem] = []
    for number, polygon in enumerate(_read_list({"polygons": [], **section}, "polygons"), start=1):
        items += _read_numbered(_read_polygon, polygon, number)
    for number, circle in enumerate(_read_list({"circles": [], **section}, "circles"), start=1):
        items.append(_read_numbered(_read_circle, circle, number))
    if section.get("breachReturn") is not None:
        latitude_deg, longitude_deg, *altitude_m = _read_coordinates(section["breachReturn"], 2)
        params = [0.0, 0.0, 0.0, 0.0, latitude_deg, longitude_deg, *(altitude_m or [0.0])]
        items.append(make_item(int(Command.FENCE_RETURN), _RELATIVE, params, autocontinue=True))
    return Plan.of(PlanKind.FENCE, items)


def _read_polygon(entry: Any) -> list[PlanItem]:
    data = _check_object(entry, 1, frozenset({"inclusion", "polygon"}))
    command = Command.INCLUDED_VERTEX if _read_bool(data.get("inclusion")) else Command.EXCLUDED_VERTEX
    corners = [_read_coordinates(corner, 2) for corner in _read_list(data, "polygon")]
    count = float(len(corners))
    if not corners:
        raise PlanFileError("the polygon has no vertices")
    places = [scale_position(corner[0], corner[1]) for corner in corners]
    return [PlanItem(int(command), _GLOBAL, params=(count, 0.0, 0.0, 0.0), x=x, y=y) for x, y in places]


def _read_circle(entry: Any) -> PlanItem:
    data = _check_object(entry, 1, frozenset({"inclusion", "circle"}))
    command = Command.INCLUDED_CIRCLE if _read_bool(data.get("inclusion")) else Command.EXCLUDED_CIRCLE
    circle = _check_object(data.get("circle"), 1, frozenset({"center", "radius"}))
    latitude_deg, longitude_deg, *_ = _read_coordinates(circle.get("center"), 2)
    params = [_read_number(circle.get("radius")), 0.0, 0.0, 0.0, latitude_deg, longitude_deg, 0.0]
    return make_item(int(command), _GLOBAL, params, autocontinue=True)


def _read_rally(section: Any) -> Plan:
    items = []
    for number, point in enumerate(_read_list(_check_object(section, 2, _RALLY_KEYS), "points"), start=1):
        latitude_deg, longitude_deg, altitude_m = _read_numbered(
            lambda value: _read_coordinates(value, 3), point, number
        )
        params = [0.0, 0.0, 0.0, 0.0, latitude_deg, longitude_deg, altitude_m]
        items.append(make_item(int(Command.RALLY_POINT), _RELATIVE, params, autocontinue=True))
    return Plan.of(PlanKind.RALLY, items)


def write_plan(plans: Plans) -> str:
    """Write the three plans as a .plan file."""
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "Rambler",
        "mission": _make_mission_section(plans.mission),
        "geoFence": _make_fence_section(plans.fence),
        "rallyPoints": {
            "version": 2,
            "points": [[*_to_degrees(item), _finite_or_none(item.z)] for item in plans.rally.items],
        },
    }
    return json.dumps(document, indent=4, allow_nan=False) + "\n"


def _to_degrees(item: PlanItem) -> list[float]:
    return [round(item.x * 1e-7, 7), round(item.y * 1e-7, 7)]


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _make_mission_section(plan: Plan) -> Mapping[str, Any]:
    items = []
    for index, item in enumerate(plan.items):
        param1 = item.params[0] + 1.0 if item.command == Command.JUMP else item.params[0]
        x_and_y = _to_degrees(item) if has_position(item.command) else [item.x, item.y]
        params = [_finite_or_none(value) for value in (param1, *item.params[1:])]
        items.append(
            {
                "type": "SimpleItem",
                "autoContinue": item.autocontinue,
                "command": item.command,
                "doJumpId": index + 1,
                "frame": item.frame,
                "params": [*params, *x_and_y, _finite_or_none(item.z)],
            }
        )
    first_position = next((item for item in plan.items if has_position(item.command)), PlanItem(0))
    return {
        "version": 2,
        "firmwareType": _ARDUPILOT,
        "vehicleType": _SURFACE_BOAT,
        "cruiseSpeed": _PLANNING_SPEED_M_S,
        "hoverSpeed": _PLANNING_SPEED_M_S,
        "globalPlanAltitudeMode": 1,  # relative to home
        "plannedHomePosition": [*_to_degrees(first_position), 0.0],
        "items": items,
    }


def _make_fence_section(plan: Plan) -> Mapping[str, Any]:
    items = plan.items
    polygons = [
        {
            "version": 1,
            "inclusion": polygon.inclusion,
            "polygon": [_to_degrees(item) for item in items[polygon.first_index : polygon.first_index + polygon.count]],
        }
        for polygon in polygons_of(items)
    ]
    circles = [
        {
            "version": 1,
            "inclusion": item.command == Command.INCLUDED_CIRCLE,
            "circle": {"center": _to_degrees(item), "radius": item.params[0]},
        }
        for item in items
        if item.command in (Command.INCLUDED_CIRCLE, Command.EXCLUDED_CIRCLE)
    ]
    section: dict[str, Any] = {"version": 2, "polygons": polygons, "circles": circles}
    for item in items:
        if item.command == Command.FENCE_RETURN:
            section["breachReturn"] = [*_to_degrees(item), _finite_or_none(item.z) or 0.0]
    return section
