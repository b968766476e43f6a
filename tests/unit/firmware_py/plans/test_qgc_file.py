"""Plan files of QGroundControl: reading, refusals in one line, and writing."""

import contextlib
import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.plan import PlanItem, Plans
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.qgc_file import read_plan, write_plan

WAYPOINT, LOITER_TIME, RETURN, JUMP = 16, 19, 20, 177  # MAV_CMD
FENCE_RETURN, INCLUDED_VERTEX, EXCLUDED_VERTEX, EXCLUDED_CIRCLE, RALLY_POINT = 5000, 5001, 5002, 5004, 5100


def simple(number, command, params, frame=3, **fields):
    entry = {"type": "SimpleItem", "command": command, "frame": frame, "params": params, "doJumpId": number}
    return entry | {"autoContinue": True, "Altitude": 0, "AltitudeMode": 1, "AMSLAltAboveTerrain": None} | fields


def document(items=(), polygons=(), circles=(), points=(), **fence):
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": 3,
            "vehicleType": 11,
            "cruiseSpeed": 15,
            "plannedHomePosition": [36.0, 121.0, 5.0],
            "items": list(items),
        },
        "geoFence": {"version": 2, "polygons": list(polygons), "circles": list(circles), **fence},
        "rallyPoints": {"version": 2, "points": list(points)},
    }


QGC = document(
    items=[
        simple(1, WAYPOINT, [0, 0, 0, None, 36.1, 121.1, 0]),
        simple(2, LOITER_TIME, [600, 0, 50, 1, 36.2, 121.2, 0], autoContinue=False),
        simple(3, JUMP, [1, 3, 0, 0, 0, 0, 0], frame=2),
        simple(4, RETURN, [0, 0, 0, 0, None, None, None], frame=2),
    ],
    polygons=[
        {"version": 1, "inclusion": True, "polygon": [[36.0, 121.0], [36.0, 122.0], [37.0, 121.5]]},
        {"version": 1, "inclusion": False, "polygon": [[36.1, 121.4], [36.1, 121.5], [36.2, 121.5], [36.2, 121.4]]},
    ],
    circles=[{"version": 1, "inclusion": False, "circle": {"center": [36.3, 121.5], "radius": 250.5}}],
    points=[[36.01, 121.02, 0], [36.03, 121.04, 1.5]],
    breachReturn=[36.05, 121.5, 7.5],
)


def change(section, **changes):
    return QGC | {section: QGC[section] | changes}


def survey(items, *, version=2):
    transects = {"version": version, "CameraShots": 0, "VisualTransectPoints": [[36.0, 121.0]]}
    if items is not None:
        transects["Items"] = items
    return {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": 5,
        "polygon": [[36.0, 121.0]],
        "TransectStyleComplexItem": transects,
    }


@pytest.mark.parametrize("version", [{"version": 1}, {"version": 2}, {}])
def test_survey_is_replaced_by_its_items(version):
    lanes = [simple(number, WAYPOINT, [0, 0, 0, None, 36.0 + 0.001 * number, 121.0, 0]) for number in range(2, 6)]
    jump, scan = simple(6, JUMP, [2, 1, 0, 0, 0, 0, 0], frame=2), survey(lanes)
    scan["TransectStyleComplexItem"] = {"Items": lanes, **version}
    text = json.dumps(document([simple(1, WAYPOINT, [0, 0, 0, None, 36.0, 121.0, 0]), scan, jump]))
    mission = read_plan(text, "a.plan")[0]
    assert [item.x for item in mission.items[:-1]] == [360_000_000, *range(360_020_000, 360_060_000, 10_000)]
    assert mission.items[-1].params[:2] == (1.0, 1.0)  # the first lane, by its doJumpId


@pytest.mark.parametrize("keys", [{"polygons"}, {"circles"}, {"polygons", "circles"}])
def test_fence_with_polygons_or_circles_is_accepted(keys):
    section = {"version": 2.0} | {key: QGC["geoFence"][key] for key in keys}
    assert read_plan(json.dumps({"fileType": "Plan", "geoFence": section}), "a.plan")[0].items


def test_all_items_of_a_plan_are_read():
    mission, fence, rally = read_plan(json.dumps(QGC), "a.plan")
    assert repr(mission.items) == repr(
        (
            PlanItem(WAYPOINT, 3, True, (0.0, 0.0, 0.0, math.nan), 361_000_000, 1_211_000_000, 0.0),
            PlanItem(LOITER_TIME, 3, False, (600.0, 0.0, 50.0, 1.0), 362_000_000, 1_212_000_000, 0.0),
            PlanItem(JUMP, 2, True, (0.0, 3.0, 0.0, 0.0)),
            PlanItem(RETURN, 2, True, (0.0, 0.0, 0.0, 0.0), 0, 0, math.nan),
        )
    )
    no_params = (0.0, 0.0, 0.0, 0.0)
    vertices = [(polygon["inclusion"], len(polygon["polygon"]), *place) for polygon in QGC["geoFence"]["polygons"]
                for place in polygon["polygon"]]  # fmt: skip
    assert fence.items == (
        *(
            PlanItem(
                INCLUDED_VERTEX if inclusion else EXCLUDED_VERTEX,
                0,
                True,
                (count, 0.0, 0.0, 0.0),
                round(x * 1e7),
                round(y * 1e7),
            )
            for inclusion, count, x, y in vertices
        ),
        PlanItem(EXCLUDED_CIRCLE, 0, True, (250.5, 0.0, 0.0, 0.0), 363_000_000, 1_215_000_000, 0.0),
        PlanItem(FENCE_RETURN, 3, True, no_params, 360_500_000, 1_215_000_000, 7.5),
    )
    assert rally.items == (
        PlanItem(RALLY_POINT, 3, True, no_params, 360_100_000, 1_210_200_000, 0.0),
        PlanItem(RALLY_POINT, 3, True, no_params, 360_300_000, 1_210_400_000, 1.5),
    )


def test_written_plan_has_the_content_of_the_file_read():
    plans = Plans()
    for plan in read_plan(json.dumps(QGC), "a.plan"):
        plans = plans.replaced(plan)
    keys = ("type", "autoContinue", "command", "doJumpId", "frame", "params")
    items = [{key: item[key] for key in keys} for item in QGC["mission"]["items"]]
    items[3]["params"] = [0, 0, 0, 0, 0, 0, None]
    mission = {
        "version": 2, "firmwareType": 3, "vehicleType": 11, "cruiseSpeed": 0.5, "hoverSpeed": 0.5,
        "globalPlanAltitudeMode": 1, "plannedHomePosition": [36.1, 121.1, 0.0], "items": items,
    }  # fmt: skip
    assert json.loads(write_plan(plans)) == QGC | {"groundStation": "Rambler", "mission": mission}
    assert read_plan(write_plan(plans), "b.plan") == (plans.mission, plans.fence, plans.rally)


def test_absent_parts_have_their_defaults():
    items = [simple(None, WAYPOINT, [0] * 7), simple(None, JUMP, [1, 3, 0, 0, 0, 0, 0])]
    for entry in items:
        del entry["doJumpId"], entry["autoContinue"]
    content = document(items, polygons=QGC["geoFence"]["polygons"], breachReturn=[36.05, 121.5])
    mission, fence, _ = read_plan(json.dumps(content), "a.plan")
    assert [(item.params[0], item.autocontinue) for item in mission.items] == [(0.0, True), (0.0, True)]
    assert (fence.items[-1].x, fence.items[-1].z) == (360_500_000, 0.0)
    assert len(read_plan(json.dumps(document(items[:1] * 2000)), "a.plan")[0].items) == 2000


@pytest.mark.parametrize(
    ("content", "error"),
    [
        ("{", "not JSON"),
        ('{"fileType": "Mission"}', "fileType is not Plan"),
        ('{"fileType": "Plan"}', "neither mission"),
        ('{"fileType": "Plan", "mission": NaN}', "NaN is not JSON"),
        ('{"a": ' * 200_000, "nested too deeply"),  # beyond the depth that any Python from 3.11 to 3.14 reads
        ('{"fileType": "Plan", "mission": []}', "mission: expected an object"),
        ('{"fileType": "Plan", "mission": {"items": {}}}', "mission: items: expected a list"),
        (document([{"type": "ComplexItem", "complexItemType": "survey"}]), "item 1: 'survey' is not a simple"),
        (QGC | {"version": 2}, "a.plan: version 2 is not supported, only 1"),
        (QGC | {"version": "1"}, "a.plan: version '1' is not supported"),
        (QGC | {"version": True}, "a.plan: version True is not supported"),
        (QGC | {"geofence": {}}, "a.plan: key 'geofence' is not known; known are fileType, geoFence"),
        (change("mission", version=1), "mission: version 1 is not supported, only 2"),
        (change("mission", Items=[]), "mission: key 'Items' is not known"),
        ({"fileType": "Plan", "mission": {"version": 2}}, "mission: items: expected a list, found None"),
        (QGC | {"geoFence": {"version": 1, "polygon": [[1, 2]] * 3}}, "geoFence: version 1 is not supported"),
        (change("geoFence", version=3), "geoFence: version 3 is not supported, only 2"),
        (change("geoFence", polygon=[]), "geoFence: key 'polygon' is not known"),
        (QGC | {"geoFence": {}}, "geoFence: it has neither polygons nor circles"),
        (QGC | {"geoFence": {"version": 2, "breachReturn": [1, 2]}}, "geoFence: it has neither"),
        *(
            (change("geoFence", breachReturn=place), f"geoFence: expected [latitude, longitude], found {place}")
            for place in ([1], [1, 2, 3, 4])
        ),
        (change("rallyPoints", version=1), "rallyPoints: version 1 is not supported, only 2"),
        (QGC | {"rallyPoints": {"version": 2, "Points": []}}, "rallyPoints: key 'Points' is not known"),
        (QGC | {"rallyPoints": {"version": 2}}, "rallyPoints: points: expected a list"),
        (
            document(polygons=[{"version": 2, "inclusion": True, "polygon": [[1, 2]]}]),
            "geoFence: item 1: version 2 is not supported, only 1",
        ),
        (
            document(circles=[{"inclusion": True, "circle": {}, "Circle": {}}]),
            "geoFence: item 1: key 'Circle' is not known",
        ),
        (
            document(circles=[{"inclusion": True, "circle": {"center": [1, 2], "radius": 9, "unit": "ft"}}]),
            "geoFence: item 1: key 'unit' is not known",
        ),
        (document([simple(1, WAYPOINT, [0] * 7, autocontinue=False)]), "item 1: key 'autocontinue' is not known"),
        (document([simple("1", WAYPOINT, [0] * 7)]), "item 1: expected a number"),
        (
            document(
                [simple(4, WAYPOINT, [0] * 7), simple(4, WAYPOINT, [0] * 7), simple(5, JUMP, [4, 1, 0, 0, 0, 0, 0])]
            ),
            "item 3: DO_JUMP: 2 items with doJumpId 4",
        ),
        (document([survey([], version=3)]), "item 1: TransectStyleComplexItem: version 3 is not supported"),
        (document([survey([])]), "item 1: TransectStyleComplexItem has no Items"),
        (document([survey(None)]), "item 1: Items: expected a list"),
        (document([survey([survey([])])]), "item 1: 'survey' is not a simple item"),
        (document([survey([simple(1, WAYPOINT, [0] * 7)] * 1001)] * 2), "items: 2002 including surveys"),
        (document([7]), "item 1: expected an object"),
        (document([simple(1, WAYPOINT, [0] * 6)]), "item 1: expected 7 params"),
        (document([simple(1, WAYPOINT, [0, 0, 0, 0, None, 0, 0])]), "item 1: expected a number"),
        (document([simple(1, WAYPOINT, [0, 0, 0, 0, True, 0, 0])]), "item 1: expected a number"),
        (document([simple(1, WAYPOINT, [0, 0, 0, 0, 91, 0, 0])]), "item 1: latitude 91 is not"),
        (document([simple(1, WAYPOINT, [1e39, 0, 0, 0, 0, 0, 0])]), "item 1: param1 is too large"),
        (document([simple(1, WAYPOINT, [10**400, 0, 0, 0, 0, 0, 0])]), "item 1:"),
        (document([simple(1, 65536, [0] * 7)]), "item 1: expected a whole number from 0 to 65535, found 65536"),
        (document([simple(65536, WAYPOINT, [0] * 7)]), "item 1: expected a whole number from 0 to 65535, found 65536"),
        (document([simple(1, JUMP, [5, 1, 0, 0, 0, 0, 0])]), "item 1: DO_JUMP: 0 items"),
        (document([simple(1, JUMP, [None, 1, 0, 0, 0, 0, 0])]), "item 1: DO_JUMP: 0 items"),
        *(
            (document([simple(1, WAYPOINT, [0] * 7, frame=frame)]), "item 1: expected a whole number from 0 to 255")
            for frame in (-1, 256, 0.5)
        ),
        (document([simple(1, WAYPOINT, [0] * 7, autoContinue=1)]), "item 1: expected true or false"),
        (document(polygons=[{"inclusion": True, "polygon": []}]), "geoFence: item 1: the polygon has no"),
        (document(polygons=[{"polygon": [[1, 2]]}]), "geoFence: item 1: expected true or false"),
        *(
            (document(circles=[{"inclusion": True, "circle": {"center": centre}}]), "item 1: expected [latitude, longi")
            for centre in ([1], [1, 2, 3, 4], 5)
        ),
        *(
            (document(points=[point]), "rallyPoints: item 1: expected [latitude, longitude, altitude]")
            for point in ([1, 2], [1, 2, 3, 4])
        ),
        (QGC | {"x" * 38: 0}, f"key '{'x' * 38}' is not known"),
        (QGC | {"x" * 39: 0}, f"key '{'x' * 36}... is not known"),
        (document([simple(1, WAYPOINT, [0] * 7)] * 2001), "at most 2000"),
    ],
)
def test_invalid_plan_is_refused_with_the_reason(content, error):
    text = content if isinstance(content, str) else json.dumps(content)
    with pytest.raises(PlanFileError) as refusal:
        read_plan(text, "a.plan")
    assert str(refusal.value).startswith("a.plan: ")
    assert error in str(refusal.value)
    assert "\n" not in str(refusal.value)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(
    json_values,
    st.sampled_from(["mission", "geoFence", "rallyPoints"]),
    st.sampled_from(["items", "polygons", "points"]),
)
def test_any_json_is_read_or_refused(value, section, key):
    for content in (value, {key: [value]}):
        with contextlib.suppress(PlanFileError):
            read_plan(json.dumps({"fileType": "Plan", section: content}), "a")
