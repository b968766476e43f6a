"""Tracks, missions and fences that cross the 180th meridian are split."""

from itertools import pairwise
from xml.etree import ElementTree as ET

import gpxpy
import pytest

from firmware_py.cli.export.tracks import Point, Tracks, make_gpx, make_kml, normalise_longitude_deg


def points(*longitudes_deg):
    return [
        Point(float(index), -16.8 + 0.001 * index, normalise_longitude_deg(longitude_deg), 0.0)
        for index, longitude_deg in enumerate(longitudes_deg)
    ]


def waypoint(number, latitude_deg, longitude_deg):
    return {"CNum": number, "CId": 16, "Lat": latitude_deg, "Lng": longitude_deg}


def corner(kind, latitude_deg, longitude_deg, *, count=4, radius_m=0.0):
    return {"Type": kind, "Count": count, "Lat": latitude_deg, "Lng": longitude_deg, "Radius": radius_m}


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


SQUARE = [(-16.79, 179.99), (-16.79, -179.97), (-16.81, -179.97), (-16.81, 179.99)]


@pytest.mark.parametrize("first_corner", range(4))
@pytest.mark.parametrize(("shift_deg", "is_split"), [(0.0, True), (0.005, True), (-0.04, False), (-50.0, False)])
def test_fence_that_crosses_the_180th_meridian_is_split_into_lines(first_corner, shift_deg, is_split):
    corners = SQUARE[first_corner:] + SQUARE[:first_corner]
    positions = [(north, (shift_deg + east + 180.0) % 360.0 - 180.0) for north, east in corners]
    tracks = Tracks(points(0.0), fence=[corner(98, *position) for position in positions])
    rings, (_, *outlines) = list(kml_lines(tracks, "LinearRing")), kml_lines(tracks, "LineString")
    assert (len(rings), len(outlines)) == ((0, 3) if is_split else (1, 0))
    for line in (*rings, *outlines):
        assert all(abs(a[0] - b[0]) < 180.0 for a, b in pairwise(line))
    assert [line[0] for line in rings] == [line[-1] for line in rings]


def test_circle_that_crosses_the_180th_meridian_is_split_into_lines():
    tracks = Tracks(points(0.0), fence=[corner(93, 0.0, 180.0, radius_m=500.0)])
    assert list(kml_lines(tracks, "LinearRing")) == []
    outlines = list(kml_lines(tracks, "LineString"))[1:]
    assert sum(map(len, outlines)) == 37 + 2 * (len(outlines) - 1)


@pytest.mark.parametrize(
    ("times_s", "lengths"), [((0.0, 60.0, 120.0), [3]), ((0.0, 60.5), [1, 1]), ((5.0, 5.0), [2]), ((5.0, 4.9), [1, 1])]
)
def test_track_is_split_after_a_minute_without_a_fix_and_at_a_step_back(times_s, lengths):
    tracks = Tracks([Point(t_s, 10.0, 20.0, 0.0) for t_s in times_s])
    assert [len(leg) for leg in tracks.split_legs()] == lengths
