"""GPX and KML: the track, and the mission and fence in force at the end."""

from __future__ import annotations

import datetime as dt
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any, Final

from firmware_py.cli.export.messages import Message, declared, messages
from firmware_py.common.angles import degrees, radians
from firmware_py.common.geodesy import Place
from firmware_py.log.dataflash import Buffer
from firmware_py.log.log_time import utc_offset_s
from firmware_py.plans.items import ROWS

_GPX, _KML = "http://www.topografix.com/GPX/1/1", "http://www.opengis.net/kml/2.2"
# AC_PolyFenceType
_POLYGONS: Final = {98: "inclusion", 97: "exclusion"}
_CIRCLES: Final = {92: "inclusion", 93: "exclusion"}
_CORNERS: Final = 36  # of a circle
_MAX_GAP_S: Final = 60.0  # a longer gap splits the track
_HALF_TURN_DEG: Final = 180.0

MapPoint = tuple[float, float]  # longitude and latitude in degrees


@dataclass(slots=True)
class Point:
    """A fix with its process time."""

    t_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_m: float


@dataclass(slots=True)
class Tracks:
    """Track, mission and fence of a log."""

    points: list[Point] = field(default_factory=list)
    mission: list[dict[str, Any]] = field(default_factory=list)
    fence: list[dict[str, Any]] = field(default_factory=list)
    shift_s: float | None = None

    def legs(self) -> Iterator[list[Point]]:
        """Yield the parts of the track between long gaps and crossings of the 180th meridian."""
        leg: list[Point] = []
        for point in self.points:
            gap = bool(leg) and not 0.0 <= point.t_s - leg[-1].t_s <= _MAX_GAP_S
            if gap or (leg and abs(point.longitude_deg - leg[-1].longitude_deg) > _HALF_TURN_DEG):
                yield leg
                leg = []
            leg.append(point)
        if leg:
            yield leg

    def time(self, point: Point) -> str:
        """Return the time in UTC; empty if the log has no date."""
        if self.shift_s is None:
            return ""
        moment = dt.datetime.fromtimestamp(point.t_s + self.shift_s, tz=dt.UTC)
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def write(kind: str, buffer: Buffer, path: Path, _out: Path) -> str:
    """Write the tracks; return a summary, empty without fixes."""
    tracks = gather(buffer)
    if not tracks.points:
        return ""
    tree = ET.ElementTree((_gpx if kind == "gpx" else _kml)(tracks))
    ET.indent(tree)
    tree.write(path, encoding="utf-8", xml_declaration=True)
    fixes = f"{len(tracks.points)} fixes"
    if "CMD" not in declared(buffer):
        return f"{fixes}; mission and fence are not in logs of that version"
    return f"{fixes}, {len(tracks.mission)} waypoints, {len(tracks.fence)} fence points"


def gather(buffer: Buffer) -> Tracks:
    """Read fixes, mission and fence of a log."""
    tracks = Tracks(shift_s=utc_offset_s(buffer))
    for message in messages(buffer, {"FIX", "CMD", "FNCE"}):
        values = message.values
        if message.name == "FIX":
            place = (degrees(values["LatR"]), _longitude_deg(degrees(values["LngR"])))
            if abs(place[0]) <= 90.0 and abs(place[1]) <= 180.0:  # NaN is neither
                altitude_m = values.get("Alt", 0.0)
                tracks.points.append(Point(values["T"], *place, altitude_m if altitude_m == altitude_m else 0.0))  # noqa: PLR0124
        elif message.name == "CMD":
            _append(tracks.mission, message, "CNum")
        else:
            _append(tracks.fence, message, "Seq")
    tracks.mission = [one for one in tracks.mission if one["Lat"] or one["Lng"]]
    return tracks


def _append(plan: list[dict[str, Any]], message: Message, number: str) -> None:
    """Append an item; a lower number begins a new plan."""
    if plan and message.values[number] <= plan[-1][number]:
        plan.clear()
    plan.append(message.values)


def _child(parent: ET.Element, tag: str, text: str = "", **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, tag, attributes)
    element.text = text or None
    return element


def _gpx(tracks: Tracks) -> ET.Element:
    root = ET.Element("gpx", {"xmlns": _GPX, "version": "1.1", "creator": "rambler export"})
    for item in tracks.mission:
        waypoint = _child(root, "wpt", lat=f"{item['Lat']:.7f}", lon=f"{_longitude_deg(item['Lng']):.7f}")
        _child(waypoint, "name", _title(item))
    track = _child(root, "trk")
    _child(track, "name", "Rambler")
    for leg in tracks.legs():
        segment = _child(track, "trkseg")
        for point in leg:
            element = _child(segment, "trkpt", lat=f"{point.latitude_deg:.7f}", lon=f"{point.longitude_deg:.7f}")
            _child(element, "ele", f"{point.altitude_m:.1f}")
            if time := tracks.time(point):
                _child(element, "time", time)
    return root


def _kml(tracks: Tracks) -> ET.Element:
    root = ET.Element("kml", {"xmlns": _KML})
    document = _child(root, "Document")
    _child(document, "name", "Rambler")
    for leg in tracks.legs():
        _line(document, " to ".join(filter(None, map(tracks.time, (leg[0], leg[-1])))) or "Track", _places(leg))
    mission = [(item["Lng"], item["Lat"]) for item in tracks.mission]
    if len(mission) > 1:
        for part in _split(mission):
            _line(document, "Mission", part)
    for item, place in zip(tracks.mission, mission, strict=True):
        placemark = _child(document, "Placemark")
        _child(placemark, "name", _title(item))
        _child(_child(placemark, "Point"), "coordinates", _coordinates([place]))
    for (kind, count), group in groupby(tracks.fence, lambda one: (one["Type"], one["Count"])):
        if kind in _CIRCLES:
            for one in group:
                _ring(document, _CIRCLES[kind], _circle(one["Lat"], one["Lng"], one["Radius"]))
        elif kind in _POLYGONS:
            corners = [(one["Lng"], one["Lat"]) for one in group]
            for first in range(0, len(corners) - int(count) + 1, int(count)):
                _ring(document, _POLYGONS[kind], corners[first : first + int(count)])
    return root


def _ring(document: ET.Element, kind: str, corners: Sequence[MapPoint]) -> None:
    parts = list(_split([*corners, corners[0]]))
    if len(parts) > 1:  # as an outline: a polygon cannot cross the 180th meridian
        for part in parts:
            _line(document, f"Fence, {kind}", part)
        return
    placemark = _child(document, "Placemark")
    _child(placemark, "name", f"Fence, {kind}")
    outer = _child(_child(_child(placemark, "Polygon"), "outerBoundaryIs"), "LinearRing")
    _child(outer, "coordinates", _coordinates(parts[0]))


def _longitude_deg(longitude_deg: float) -> float:
    """Return a longitude below 180 degrees, as GPX 1.1 requires."""
    return -_HALF_TURN_DEG if round(longitude_deg, 7) >= _HALF_TURN_DEG else longitude_deg


def _split(places: Sequence[MapPoint]) -> Iterator[list[MapPoint]]:
    """Yield the parts of a line on either side of the 180th meridian, each extended to it."""
    part = [places[0]]
    for before, place in pairwise(places):
        if abs(place[0] - before[0]) > _HALF_TURN_DEG:
            edge_deg = math.copysign(_HALF_TURN_DEG, before[0])
            change_deg = place[0] + 2.0 * edge_deg - before[0]
            fraction = (edge_deg - before[0]) / change_deg if change_deg else 0.0
            latitude_deg = before[1] + fraction * (place[1] - before[1])
            yield [*part, (edge_deg, latitude_deg)]
            part = [(-edge_deg, latitude_deg)]
        part.append(place)
    yield part


def _circle(latitude_deg: float, longitude_deg: float, radius_m: float) -> list[MapPoint]:
    centre = Place(radians(latitude_deg), radians(longitude_deg))
    angles = (math.tau * corner / _CORNERS for corner in range(_CORNERS))
    places = (centre.at_offset(radius_m * math.cos(angle), radius_m * math.sin(angle)) for angle in angles)
    return [(degrees(place.longitude_rad), degrees(place.latitude_rad)) for place in places]


def _line(document: ET.Element, name: str, places: Sequence[MapPoint]) -> None:
    placemark = _child(document, "Placemark")
    _child(placemark, "name", name)
    line = _child(placemark, "LineString")
    _child(line, "tessellate", "1")
    _child(line, "coordinates", _coordinates(places))


def _places(points: Sequence[Point]) -> list[MapPoint]:
    return [(point.longitude_deg, point.latitude_deg) for point in points]


def _coordinates(places: Sequence[MapPoint]) -> str:
    return " ".join(f"{longitude_deg:.7f},{latitude_deg:.7f},0" for longitude_deg, latitude_deg in places)


def _title(item: dict[str, Any]) -> str:
    row = ROWS.get(int(item["CId"]))
    return f"{item['CNum']} {row.name if row else item['CId']}"
