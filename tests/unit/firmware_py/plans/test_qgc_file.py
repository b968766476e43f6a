"""What QGroundControl writes is read, what is broken is refused in one clear line."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.plan import PlanItem, Plans
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.qgc_file import read_plan, write_plan


def simple(number, command, params, frame=3, **more):
    entry = {"type": "SimpleItem", "command": command, "frame": frame, "params": params, "doJumpId": number}
    return entry | {"autoContinue": True, "Altitude": 0, "AltitudeMode": 1, "AMSLAltAboveTerrain": None} | more


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
        simple(1, 16, [0, 0, 0, None, 36.1, 121.1, 0]),
        simple(2, 19, [600, 0, 50, 1, 36.2, 121.2, 0], autoContinue=False),
        simple(3, 177, [1, 3, 0, 0, 0, 0, 0], frame=2),
        simple(4, 20, [0, 0, 0, 0, 0, 0, 0], frame=2),
    ],
    polygons=[
        {"version": 1, "inclusion": True, "polygon": [[36.0, 121.0], [36.0, 122.0], [37.0, 121.5]]},
        {"version": 1, "inclusion": False, "polygon": [[36.1, 121.4], [36.1, 121.5], [36.2, 121.5], [36.2, 121.4]]},
    ],
    circles=[{"version": 1, "inclusion": False, "circle": {"center": [36.3, 121.5], "radius": 250.5}}],
    points=[[36.01, 121.02, 0], [36.03, 121.04, 1.5]],
    breachReturn=[36.05, 121.5, 0],
)


def changed(section, **more):
    return QGC | {section: QGC[section] | more}


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


def test_a_survey_is_unfolded_into_its_own_items():
    lanes = [simple(number, 16, [0, 0, 0, None, 36.0 + 0.001 * number, 121.0, 0]) for number in range(2, 6)]
    again = simple(6, 177, [2, 1, 0, 0, 0, 0, 0], frame=2)
    text = json.dumps(document([simple(1, 16, [0, 0, 0, None, 36.0, 121.0, 0]), survey(lanes), again]))
    mission = read_plan(text, "a.plan")[0]
    assert [item.x for item in mission.items[:-1]] == [360_000_000, *range(360_020_000, 360_060_000, 10_000)]
    assert mission.items[-1].params[:2] == (1.0, 1.0)  # the first lane, by its doJumpId


@pytest.mark.parametrize("keys", [{"polygons"}, {"circles"}, {"polygons", "circles"}])
def test_a_fence_has_polygons_or_circles(keys):
    section = {"version": 2.0} | {key: QGC["geoFence"][key] for key in keys}
    assert read_plan(json.dumps({"fileType": "Plan", "geoFence": section}), "a.plan")[0].items


def test_a_plan_of_qgroundcontrol():
    mission, fence, rally = read_plan(json.dumps(QGC), "a.plan")
    assert repr(mission.items) == repr(
        (
            PlanItem(16, 3, True, (0.0, 0.0, 0.0, math.nan), 361_000_000, 1_211_000_000, 0.0),
            PlanItem(19, 3, False, (600.0, 0.0, 50.0, 1.0), 362_000_000, 1_212_000_000, 0.0),
            PlanItem(177, 2, True, (0.0, 3.0, 0.0, 0.0)),
            PlanItem(20, 2, True, (0.0, 0.0, 0.0, 0.0)),
        )
    )
    assert [(item.command, item.params[0]) for item in fence.items] == [
        *[(5001, 3.0)] * 3,
        *[(5002, 4.0)] * 4,
        (5004, 250.5),
        (5000, 0.0),
    ]
    assert [(item.command, item.x, item.y, item.z) for item in rally.items] == [
        (5100, 360_100_000, 1_210_200_000, 0.0),
        (5100, 360_300_000, 1_210_400_000, 1.5),
    ]


def test_a_plan_that_is_written_is_read_back():
    plans = Plans()
    for plan in read_plan(json.dumps(QGC), "a.plan"):
        plans = plans.replaced(plan)
    assert read_plan(write_plan(plans), "b.plan") == (plans.mission, plans.fence, plans.rally)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("{", "not JSON"),
        ('{"fileType": "Mission"}', "fileType is not Plan"),
        ('{"fileType": "Plan"}', "neither mission"),
        ('{"fileType": "Plan", "mission": NaN}', "NaN is not JSON"),
        ('{"a": ' * 200_000, "nested too deeply"),  # beyond the depth that any Python from 3.11 to 3.14 reads
        ('{"fileType": "Plan", "mission": []}', "mission: expected an object"),
        ('{"fileType": "Plan", "mission": {"items": {}}}', "mission: items: expected a list"),
        (
            json.dumps(document([{"type": "ComplexItem", "complexItemType": "survey"}])),
            "item 1: 'survey' is not a simple",
        ),
        (json.dumps(QGC | {"version": 2}), "a.plan: version 2 is not supported, only 1"),
        (json.dumps(QGC | {"version": "1"}), "a.plan: version '1' is not supported"),
        (json.dumps(QGC | {"version": True}), "a.plan: version True is not supported"),
        (json.dumps(QGC | {"geofence": {}}), "a.plan: key 'geofence' is not known; known are fileType, geoFence"),
        (json.dumps(changed("mission", version=1)), "mission: version 1 is not supported, only 2"),
        (json.dumps(changed("mission", Items=[])), "mission: key 'Items' is not known"),
        (json.dumps({"fileType": "Plan", "mission": {"version": 2}}), "mission: items: expected a list, found None"),
        (
            json.dumps(QGC | {"geoFence": {"version": 1, "polygon": [[1, 2]] * 3}}),
            "geoFence: version 1 is not supported",
        ),
        (json.dumps(changed("geoFence", version=3)), "geoFence: version 3 is not supported, only 2"),
        (json.dumps(changed("geoFence", polygon=[])), "geoFence: key 'polygon' is not known"),
        (json.dumps(QGC | {"geoFence": {}}), "geoFence: it has neither polygons nor circles"),
        (json.dumps(QGC | {"geoFence": {"version": 2, "breachReturn": [1, 2]}}), "geoFence: it has neither"),
        (json.dumps(changed("rallyPoints", version=1)), "rallyPoints: version 1 is not supported, only 2"),
        (json.dumps(QGC | {"rallyPoints": {"version": 2, "Points": []}}), "rallyPoints: key 'Points' is not known"),
        (json.dumps(QGC | {"rallyPoints": {"version": 2}}), "rallyPoints: points: expected a list"),
        (
            json.dumps(document(polygons=[{"version": 2, "inclusion": True, "polygon": [[1, 2]]}])),
            "geoFence: item 1: version 2 is not supported, only 1",
        ),
        (
            json.dumps(document(circles=[{"inclusion": True, "circle": {}, "Circle": {}}])),
            "geoFence: item 1: key 'Circle' is not known",
        ),
        (
            json.dumps(
                document(circles=[{"inclusion": True, "circle": {"center": [1, 2], "radius": 9, "unit": "ft"}}])
            ),
            "geoFence: item 1: key 'unit' is not known",
        ),
        (json.dumps(document([simple(1, 16, [0] * 7, autocontinue=False)])), "item 1: key 'autocontinue' is not known"),
        (json.dumps(document([simple("1", 16, [0] * 7)])), "item 1: expected a number"),
        (
            json.dumps(
                document([simple(4, 16, [0] * 7), simple(4, 16, [0] * 7), simple(5, 177, [4, 1, 0, 0, 0, 0, 0])])
            ),
            "item 3: DO_JUMP: 2 items with doJumpId 4",
        ),
        (json.dumps(document([survey([], version=3)])), "item 1: TransectStyleComplexItem: version 3 is not supported"),
        (json.dumps(document([survey([])])), "item 1: TransectStyleComplexItem has no Items"),
        (json.dumps(document([survey(None)])), "item 1: Items: expected a list"),
        (json.dumps(document([survey([survey([])])])), "item 1: 'survey' is not a simple item"),
        (json.dumps(document([survey([simple(1, 16, [0] * 7)] * 1001)] * 2)), "items: 2002 including surveys"),
        (json.dumps(document([7])), "item 1: expected an object"),
        (json.dumps(document([simple(1, 16, [0] * 6)])), "item 1: expected 7 params"),
        (json.dumps(document([simple(1, 16, [0, 0, 0, 0, None, 0, 0])])), "item 1: expected a number"),
        (json.dumps(document([simple(1, 16, [0, 0, 0, 0, True, 0, 0])])), "item 1: expected a number"),
        (json.dumps(document([simple(1, 16, [0, 0, 0, 0, 91, 0, 0])])), "item 1: latitude 91 is not"),
        (json.dumps(document([simple(1, 16, [1e39, 0, 0, 0, 0, 0, 0])])), "item 1: param1 is too large"),
        (json.dumps(document([simple(1, 16, [10**400, 0, 0, 0, 0, 0, 0])])), "item 1:"),
        (json.dumps(document([simple(1, 1e9, [0] * 7)])), "item 1: expected a whole number"),
        (json.dumps(document([simple(1, 177, [5, 1, 0, 0, 0, 0, 0])])), "item 1: DO_JUMP: 0 items"),
        (json.dumps(document([simple(1, 177, [None, 1, 0, 0, 0, 0, 0])])), "item 1: DO_JUMP: 0 items"),
        (json.dumps(document([simple(1, 16, [0] * 7, frame=-1)])), "item 1: expected a whole number"),
        (json.dumps(document([simple(1, 16, [0] * 7, autoContinue=1)])), "item 1: expected true or false"),
        (json.dumps(document(polygons=[{"inclusion": True, "polygon": []}])), "geoFence: item 1: the polygon has no"),
        (json.dumps(document(polygons=[{"polygon": [[1, 2]]}])), "geoFence: item 1: expected true or false"),
        (json.dumps(document(circles=[{"inclusion": True, "circle": {"center": [1]}}])), "geoFence: item 1:"),
        (json.dumps(document(points=[[1, 2]])), "rallyPoints: item 1: expected [latitude, longitude, altitude]"),
        (json.dumps(document([simple(1, 16, [0] * 7)] * 2001)), "at most 2000"),
    ],
)
def test_broken_plans_are_refused(text, error):
    with pytest.raises(PlanFileError) as refused:
        read_plan(text, "a.plan")
    assert str(refused.value).startswith("a.plan: ")
    assert error in str(refused.value)
    assert "\n" not in str(refused.value)


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
    for text in (
        json.dumps({"fileType": "Plan", section: value}),
        json.dumps({"fileType": "Plan", section: {key: [value]}}),
    ):
        try:
            read_plan(text, "a")
        except PlanFileError:
            pass
