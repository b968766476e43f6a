"""Tracks, missions and fences across the 180th meridian are split."""

from itertools import pairwise
from xml.etree import ElementTree as ET

import gpxpy
import pytest

from firmware_py.cli.export.tracks import Point, Tracks, _gpx, _kml, _longitude_deg


def points(*longitudes_deg):
    return [
        Point(float(n), -16.8 + 0.001 * n, _longitude_deg(longitude_deg), 0.0)
        for n, longitude_deg in enumerate(longitudes_deg)
    ]


def waypoint(number, latitude_deg, longitude_deg):
    return {"CNum": number, "CId": 16, "Lat": latitude_deg, "Lng": longitude_deg}


def corner(kind, latitude_deg, longitude_deg, *, count=4, radius_m=0.0):
    return {"Type": kind, "Count": count, "Lat": latitude_deg, "Lng": longitude_deg, "Radius": radius_m}


def lines(tracks, path):
    """The longitudes and latitudes of all such lines in KML."""
    for element in _kml(tracks).iterfind(f".//{path}/coordinates"):
        yield [tuple(map(float, place.split(",")[:2])) for place in element.text.split()]


@pytest.mark.parametrize(
    ("longitudes_deg", "parts"),
    [
        ((179.9998, 179.9999, -179.9999, -179.9998), [2, 2]),
        ((-179.9999, 179.9999, -179.9999), [1, 1, 1]),
        ((180.0, -180.0, -179.9999), [3]),
        ((179.99999999, -179.9999), [2]),
        ((179.9998, 179.9999), [2]),
        ((-0.1, 0.1), [2]),
    ],
)
def test_track_is_split_at_the_180th_meridian(longitudes_deg, parts):
    root = _gpx(Tracks(points(*longitudes_deg)))
    found = gpxpy.parse(ET.tostring(root, "unicode"))
    assert [len(segment.points) for segment in found.tracks[0].segments] == parts
    assert all(-180.0 <= float(point.get("lon")) < 180.0 for point in root.iter("trkpt"))
    kml = list(lines(Tracks(points(*longitudes_deg)), "LineString"))
    assert [len(line) for line in kml] == parts
    for line in kml:
        assert all(abs(a[0] - b[0]) < 180.0 for a, b in pairwise(line))


def test_waypoint_on_the_180th_meridian_is_below_180():
    root = _gpx(Tracks(points(0.0), mission=[waypoint(1, -16.8, 180.0), waypoint(2, -16.8, -180.0)]))
    assert [one.get("lon") for one in root.iter("wpt")] == ["-180.0000000"] * 2


def test_mission_line_is_cut_at_the_180th_meridian():
    mission = [waypoint(1, -16.8, 179.97), waypoint(2, -16.6, -179.99), waypoint(3, -16.6, -180.0)]
    _, east, west = lines(Tracks(points(0.0), mission=mission), "LineString")  # behind the track
    assert east == [(179.97, -16.8), (180.0, pytest.approx(-16.65))]
    assert west == [(-180.0, pytest.approx(-16.65)), (-179.99, -16.6), (-180.0, -16.6)]


SQUARE = [(-16.79, 179.99), (-16.79, -179.97), (-16.81, -179.97), (-16.81, 179.99)]


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize(("shift_deg", "across"), [(0.0, True), (0.005, True), (-0.04, False), (-50.0, False)])
def test_fence_across_is_an_outline_in_parts(first, shift_deg, across):
    turned = SQUARE[first:] + SQUARE[:first]
    places = [(north, (shift_deg + east + 180.0) % 360.0 - 180.0) for north, east in turned]
    tracks = Tracks(points(0.0), fence=[corner(98, *place) for place in places])
    rings, (_, *outlines) = list(lines(tracks, "LinearRing")), lines(tracks, "LineString")
    assert (len(rings), len(outlines)) == ((0, 3) if across else (1, 0))
    for line in (*rings, *outlines):
        assert all(abs(a[0] - b[0]) < 180.0 for a, b in pairwise(line))
    assert [line[0] for line in rings] == [line[-1] for line in rings]


def test_circle_across_is_an_outline_in_parts():
    tracks = Tracks(points(0.0), fence=[corner(93, 0.0, 180.0, radius_m=500.0)])
    assert list(lines(tracks, "LinearRing")) == []
    outlines = list(lines(tracks, "LineString"))[1:]
    assert sum(map(len, outlines)) == 37 + 2 * (len(outlines) - 1)
