"""Tracks, missions and fences in GPX and KML; those that cross the 180th meridian are split."""

import math
import re
from itertools import pairwise
from xml.etree import ElementTree as ET

import gpxpy
import pytest

from firmware_py.cli.export.tracks import Point, Tracks, make_gpx, make_kml, normalise_longitude_deg, read_tracks
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.records import FixType, Inputs, PositionSample, Tick
from firmware_py.log import ardupilot, schema
from firmware_py.log.ardupilot_plans import encode_plan
from firmware_py.log.dataflash import MessageType, header
from firmware_py.plans.items import Command

# AC_PolyFenceType of ArduPilot.
INCLUSION_CIRCLE, EXCLUSION_CIRCLE, RETURN_POINT, EXCLUSION_POLYGON, INCLUSION_POLYGON = 92, 93, 95, 97, 98


def points(*longitudes_deg):
    return [
        Point(float(index), -16.8 + 0.001 * index, normalise_longitude_deg(longitude_deg), 0.0)
        for index, longitude_deg in enumerate(longitudes_deg)
    ]


def waypoint(number, latitude_deg, longitude_deg):
    return {"CNum": number, "CId": Command.WAYPOINT, "Lat": latitude_deg, "Lng": longitude_deg}


def corner(kind, latitude_deg, longitude_deg, *, count=4, radius_m=0.0):
    return {"Type": kind, "Count": count, "Lat": latitude_deg, "Lng": longitude_deg, "Radius": radius_m}


def test_fixes_and_the_last_plans_of_a_log_are_read():
    places_deg = [
        (40.0, -10.0),
        (90.0, 179.5),
        (-90.0, -180.0),
        (90.001, 0.0),
        (0.0, -180.001),
        (None, 1.0),
        (1.0, None),
    ]
    fixes = [
        PositionSample(
            float(t_s), FixType.FIX_3D, *(None if x is None else math.radians(x) for x in place), utc_s=1.7e9
        )
        for t_s, place in enumerate(places_deg)
    ]
    fixes.append(PositionSample(8.0, FixType.FIX_3D, 0.0, math.pi, 2.5))
    data = header((*schema.TYPES, *ardupilot.TYPES), 0) + schema.encode_inputs(
        Inputs(Tick(0, 0.0, 0.0, 0, 1.0), positions=fixes)
    )
    for positions in ([(1, 1)], [(3, 4), (0, 0), (0, 5), (6, 0)]):
        data += encode_plan(
            9.0, Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT, 3, x=x, y=y) for x, y in positions]), 3
        )
    for radius_m in (10.0, 50.0):
        data += encode_plan(
            9.0,
            Plan.of(PlanKind.FENCE, [PlanItem(Command.EXCLUDED_CIRCLE, 0, params=(radius_m, 0, 0, 0), x=7, y=8)]),
            3,
        )
    tracks = read_tracks(data)
    rows = [(point.t_s, point.latitude_deg, point.longitude_deg, point.altitude_m) for point in tracks.points]
    first = (0.0, pytest.approx(40.0), -10.0, 0.0)
    assert rows == [first, (1.0, 90.0, 179.5, 0.0), (2.0, -90.0, -180.0, 0.0), (8.0, 0.0, -180.0, 2.5)]
    assert [(item["CNum"], item["Lat"], item["Lng"]) for item in tracks.mission] == [
        (1, pytest.approx(3e-7), pytest.approx(4e-7)), (3, 0.0, 5e-7), (4, pytest.approx(6e-7), 0.0)
    ]  # fmt: skip
    assert [item["Radius"] for item in tracks.fence] == [50.0]
    assert tracks.offset_s == 1.7e9


def test_fix_of_a_version_without_altitude_is_at_sea_level():
    fix = MessageType(200, "FIX", "TimeUS,T,LatR,LngR", "Qddd", "ssrr", "F000")
    assert read_tracks(header((fix,), 0) + fix.pack(0, 5.0, 0.0, 0.0)).points == [Point(5.0, 0.0, 0.0, 0.0)]


TRACKS = Tracks(
    [Point(10.0, 1.0, 2.0, 3.25), Point(12.5, -1.0, -2.0, 0.0)],
    mission=[
        {"CNum": 1, "CId": Command.WAYPOINT, "Lat": 1.5, "Lng": 2.5},
        {"CNum": 2, "CId": 999, "Lat": -1.5, "Lng": -2.5},
    ],
)


def xml_text(element):
    return re.sub(r' xmlns="[^"]*"', "", ET.tostring(element, "unicode"))


@pytest.mark.parametrize(
    ("offset_s", "times"),
    [(None, ("", "")), (1.7e9, ("<time>2023-11-14T22:13:30.000Z</time>", "<time>2023-11-14T22:13:32.500Z</time>"))],
)
def test_gpx_has_waypoints_and_the_track(offset_s, times):
    TRACKS.offset_s = offset_s
    assert xml_text(make_gpx(TRACKS)) == (
        '<gpx version="1.1" creator="rambler export">'
        '<wpt lat="1.5000000" lon="2.5000000"><name>1 NAV_WAYPOINT</name></wpt>'
        '<wpt lat="-1.5000000" lon="-2.5000000"><name>2 999</name></wpt>'
        "<trk><name>Rambler</name><trkseg>"
        f'<trkpt lat="1.0000000" lon="2.0000000"><ele>3.2</ele>{times[0]}</trkpt>'
        f'<trkpt lat="-1.0000000" lon="-2.0000000"><ele>0.0</ele>{times[1]}</trkpt>'
        "</trkseg></trk></gpx>"
    )


@pytest.mark.parametrize(
    ("offset_s", "name"), [(None, "Track"), (1.7e9, "2023-11-14T22:13:30.000Z to 2023-11-14T22:13:32.500Z")]
)
def test_kml_has_track_mission_and_fence(offset_s, name):
    def line(title, text):
        geometry = f"<LineString><tessellate>1</tessellate><coordinates>{text}</coordinates></LineString>"
        return f"<Placemark><name>{title}</name>{geometry}</Placemark>"

    def point(title, text):
        return f"<Placemark><name>{title}</name><Point><coordinates>{text}</coordinates></Point></Placemark>"

    def polygon(kind, text):
        ring = f"<outerBoundaryIs><LinearRing><coordinates>{text}</coordinates></LinearRing></outerBoundaryIs>"
        return f"<Placemark><name>Fence, {kind}</name><Polygon>{ring}</Polygon></Placemark>"

    places = [(0, 0), (0, 1), (1, 0), (2, 2), (2, 3), (3, 2)]  # two triangles in succession
    TRACKS.offset_s, TRACKS.fence = offset_s, [corner(EXCLUSION_POLYGON, *place, count=3) for place in places]
    TRACKS.fence += [
        corner(RETURN_POINT, 5.0, 5.0),
        corner(INCLUSION_POLYGON, 0, 0, count=2),
    ]  # a return point and an incomplete polygon
    assert xml_text(make_kml(TRACKS)) == (
        "<kml><Document><name>Rambler</name>"
        + line(name, "2.0000000,1.0000000,0 -2.0000000,-1.0000000,0")
        + line("Mission", "2.5000000,1.5000000,0 -2.5000000,-1.5000000,0")
        + point("1 NAV_WAYPOINT", "2.5000000,1.5000000,0")
        + point("2 999", "-2.5000000,-1.5000000,0")
        + polygon(
            "exclusion", "0.0000000,0.0000000,0 1.0000000,0.0000000,0 0.0000000,1.0000000,0 0.0000000,0.0000000,0"
        )
        + polygon(
            "exclusion", "2.0000000,2.0000000,0 3.0000000,2.0000000,0 2.0000000,3.0000000,0 2.0000000,2.0000000,0"
        )
        + "</Document></kml>"
    )


def kml_lines(tracks, path):
    """Yield the longitudes and latitudes of the lines of an element in KML."""
    for element in make_kml(tracks).iterfind(f".//{path}/coordinates"):
        yield [tuple(map(float, position.split(",")[:2])) for position in element.text.split()]


@pytest.mark.parametrize(
    ("longitudes_deg", "lengths"),
    [
        ((179.9998, 179.9999, -179.9999, -179.9998), [2, 2]),
        ((-179.9999, 179.9999, -179.9999), [1, 1, 1]),
        ((180.0, -180.0, -179.9999), [3]),
        ((179.99999999, -179.9999), [2]),
        ((179.9998, 179.9999), [2]),
        ((-0.1, 0.1), [2]),
    ],
)
def test_track_is_split_at_the_180th_meridian(longitudes_deg, lengths):
    root = make_gpx(Tracks(points(*longitudes_deg)))
    gpx = gpxpy.parse(ET.tostring(root, "unicode"))
    assert [len(segment.points) for segment in gpx.tracks[0].segments] == lengths
    assert all(-180.0 <= float(point.get("lon")) < 180.0 for point in root.iter("trkpt"))
    lines = list(kml_lines(Tracks(points(*longitudes_deg)), "LineString"))
    assert [len(line) for line in lines] == lengths
    for line in lines:
        assert all(abs(a[0] - b[0]) < 180.0 for a, b in pairwise(line))


def test_waypoint_on_the_180th_meridian_is_below_180():
    root = make_gpx(Tracks(points(0.0), mission=[waypoint(1, -16.8, 180.0), waypoint(2, -16.8, -180.0)]))
    assert [element.get("lon") for element in root.iter("wpt")] == ["-180.0000000"] * 2


def test_mission_line_is_split_at_the_180th_meridian():
    mission = [waypoint(1, -16.8, 179.97), waypoint(2, -16.6, -179.99), waypoint(3, -16.6, -180.0)]
    _, east, west = kml_lines(Tracks(points(0.0), mission=mission), "LineString")  # after the line of the track
    assert east == [(179.97, -16.8), (180.0, pytest.approx(-16.65))]
    assert west == [(-180.0, pytest.approx(-16.65)), (-179.99, -16.6), (-180.0, -16.6)]


def test_mission_line_along_the_180th_meridian_is_split_at_its_start():
    mission = [waypoint(1, -16.8, 180.0), waypoint(2, -16.6, -180.0)]
    _, east, west = kml_lines(Tracks(points(0.0), mission=mission), "LineString")
    assert (east, west) == ([(180.0, -16.8), (180.0, -16.8)], [(-180.0, -16.8), (-180.0, -16.6)])


SQUARE = [(-16.79, 179.99), (-16.79, -179.97), (-16.81, -179.97), (-16.81, 179.99)]


@pytest.mark.parametrize("first_corner", range(4))
@pytest.mark.parametrize(("shift_deg", "is_split"), [(0.0, True), (0.005, True), (-0.04, False), (-50.0, False)])
def test_fence_that_crosses_the_180th_meridian_is_split_into_lines(first_corner, shift_deg, is_split):
    corners = SQUARE[first_corner:] + SQUARE[:first_corner]
    positions = [(north, (shift_deg + east + 180.0) % 360.0 - 180.0) for north, east in corners]
    tracks = Tracks(points(0.0), fence=[corner(INCLUSION_POLYGON, *position) for position in positions])
    rings, (_, *outlines) = list(kml_lines(tracks, "LinearRing")), kml_lines(tracks, "LineString")
    assert (len(rings), len(outlines)) == ((0, 3) if is_split else (1, 0))
    for line in (*rings, *outlines):
        assert all(abs(a[0] - b[0]) < 180.0 for a, b in pairwise(line))
    assert [line[0] for line in rings] == [line[-1] for line in rings]


@pytest.mark.parametrize("kind", [INCLUSION_CIRCLE, EXCLUSION_CIRCLE])
def test_circle_that_crosses_the_180th_meridian_is_split_into_lines(kind):
    tracks = Tracks(points(0.0), fence=[corner(kind, 0.0, 180.0, radius_m=500.0)])
    assert list(kml_lines(tracks, "LinearRing")) == []
    outlines = list(kml_lines(tracks, "LineString"))[1:]
    assert sum(map(len, outlines)) == 37 + 2 * (len(outlines) - 1)


@pytest.mark.parametrize(
    ("times_s", "lengths"), [((0.0, 60.0, 120.0), [3]), ((0.0, 60.5), [1, 1]), ((5.0, 5.0), [2]), ((5.0, 4.9), [1, 1])]
)
def test_track_is_split_after_a_minute_without_a_fix_and_at_a_step_back(times_s, lengths):
    tracks = Tracks([Point(t_s, 10.0, 20.0, 0.0) for t_s in times_s])
    assert [len(leg) for leg in tracks.split_legs()] == lengths
