"""Write GPX or KML: the track, and the mission and fence in force at the end of the log."""

from __future__ import annotations

import datetime as dt
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any, Final

from firmware_py.cli.export.messages import Message, read_declared_names, read_messages
from firmware_py.common.angles import degrees, radians
from firmware_py.common.geodesy import Place
from firmware_py.log.dataflash import Buffer
from firmware_py.log.log_time import utc_offset_s
from firmware_py.plans.items import ROWS

_GPX, _KML = "http://www.topografix.com/GPX/1/1", "http://www.opengis.net/kml/2.2"
# Numbers of AC_PolyFenceType (ArduPilot).
_POLYGONS: Final = {98: "inclusion", 97: "exclusion"}
_CIRCLES: Final = {92: "inclusion", 93: "exclusion"}
_CIRCLE_CORNERS: Final = 36
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
    """Track, mission and fence of a log; items have the values of a CMD or FNCE record by column.

    `offset_s` is UTC less process time, None without a date.
    """

    points: list[Point] = field(default_factory=list)
    mission: list[dict[str, Any]] = field(default_factory=list)
    fence: list[dict[str, Any]] = field(default_factory=list)
    offset_s: float | None = None

    def split_legs(self) -> Iterator[list[Point]]:
        """Split the track at long gaps and at crossings of the 180th meridian."""
        leg: list[Point] = []
        for point in self.points:
            has_gap = bool(leg) and not 0.0 <= point.t_s - leg[-1].t_s <= _MAX_GAP_S
            if has_gap or (leg and abs(point.longitude_deg - leg[-1].longitude_deg) > _HALF_TURN_DEG):
                yield leg
                leg = []
            leg.append(point)
        if leg:
            yield leg

    def format_time(self, point: Point) -> str:
        """Return the time of a fix in UTC (ISO 8601), empty if the log has no date."""
        if self.offset_s is None:
            return ""
        moment = dt.datetime.fromtimestamp(point.t_s + self.offset_s, tz=dt.UTC)
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def write(kind: str, buffer: Buffer, path: Path, _out: Path) -> str:
    """Write the tracks; return a summary, empty without fixes."""
    tracks = read_tracks(buffer)
    if not tracks.points:
        return ""
    tree = ET.ElementTree((make_gpx if kind == "gpx" else make_kml)(tracks))
    ET.indent(tree)
    tree.write(path, encoding="utf-8", xml_declaration=True)
    fixes = f"{len(tracks.points)} fixes"
    if "CMD" not in read_declared_names(buffer):
        return f"{fixes}; mission and fence are not in logs of that version"
    return f"{fixes}, {len(tracks.mission)} waypoints, {len(tracks.fence)} fence points"


def read_tracks(buffer: Buffer) -> Tracks:
    """Read fixes, mission and fence of a log."""
    tracks = Tracks(offset_s=utc_offset_s(buffer))
    for message in read_messages(buffer, {"FIX", "CMD", "FNCE"}):
        values = message.values
        if message.name == "FIX":
            position = (degrees(values["LatR"]), normalise_longitude_deg(degrees(values["LngR"])))
            if abs(position[0]) <= 90.0 and abs(position[1]) <= 180.0:  # also false for NaN
                altitude_m = values.get("Alt", 0.0)
                tracks.points.append(Point(values["T"], *position, altitude_m if altitude_m == altitude_m else 0.0))  # noqa: PLR0124
        elif message.name == "CMD":
            _append_item(tracks.mission, message, "CNum")
        else:
            _append_item(tracks.fence, message, "Seq")
    tracks.mission = [item for item in tracks.mission if item["Lat"] or item["Lng"]]
    return tracks


def _append_item(plan: list[dict[str, Any]], message: Message, number_key: str) -> None:
    """Append an item to a plan. A number that does not increase begins a new plan."""
    if plan and message.values[number_key] <= plan[-1][number_key]:
        plan.clear()
    plan.append(message.values)


def _add_element(parent: ET.Element, tag: str, text: str = "", **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, tag, attributes)
    element.text = text or None
    return element


def make_gpx(tracks: Tracks) -> ET.Element:
    """Return a GPX document: the mission as waypoints and the track."""
    root = ET.Element("gpx", {"xmlns": _GPX, "version": "1.1", "creator": "rambler export"})
    for item in tracks.mission:
        longitude_deg = normalise_longitude_deg(item["Lng"])
        waypoint = _add_element(root, "wpt", lat=f"{item['Lat']:.7f}", lon=f"{longitude_deg:.7f}")
        _add_element(waypoint, "name", _item_title(item))
    track = _add_element(root, "trk")
    _add_element(track, "name", "Rambler")
    for leg in tracks.split_legs():
        segment = _add_element(track, "trkseg")
        for point in leg:
            element = _add_element(segment, "trkpt", lat=f"{point.latitude_deg:.7f}", lon=f"{point.longitude_deg:.7f}")
            _add_element(element, "ele", f"{point.altitude_m:.1f}")
            if time := tracks.format_time(point):
                _add_element(element, "time", time)
    return root


def make_kml(tracks: Tracks) -> ET.Element:
    """Return a KML document: track, mission and fence."""
    root = ET.Element("kml", {"xmlns": _KML})
    document = _add_element(root, "Document")
    _add_element(document, "name", "Rambler")
    for leg in tracks.split_legs():
        times = filter(None, map(tracks.format_time, (leg[0], leg[-1])))
        _add_line(document, " to ".join(times) or "Track", _positions_of(leg))
    mission = [(item["Lng"], item["Lat"]) for item in tracks.mission]
    if len(mission) > 1:
        for line in _split_at_meridian(mission):
            _add_line(document, "Mission", line)
    for item, position in zip(tracks.mission, mission, strict=True):
        placemark = _add_element(document, "Placemark")
        _add_element(placemark, "name", _item_title(item))
        _add_element(_add_element(placemark, "Point"), "coordinates", _coordinates([position]))
    for (kind, count), group in groupby(tracks.fence, lambda item: (item["Type"], item["Count"])):
        if kind in _CIRCLES:
            for item in group:
                _add_ring(document, _CIRCLES[kind], _circle_corners(item["Lat"], item["Lng"], item["Radius"]))
        elif kind in _POLYGONS:
            corners = [(item["Lng"], item["Lat"]) for item in group]
            for start in range(0, len(corners) - int(count) + 1, int(count)):
                _add_ring(document, _POLYGONS[kind], corners[start : start + int(count)])
    return root


def _add_ring(document: ET.Element, kind: str, corners: Sequence[MapPoint]) -> None:
    parts = list(_split_at_meridian([*corners, corners[0]]))
    if len(parts) > 1:  # lines, since a polygon cannot cross the 180th meridian
        for line in parts:
            _add_line(document, f"Fence, {kind}", line)
        return
    placemark = _add_element(document, "Placemark")
    _add_element(placemark, "name", f"Fence, {kind}")
    outer = _add_element(_add_element(_add_element(placemark, "Polygon"), "outerBoundaryIs"), "LinearRing")
    _add_element(outer, "coordinates", _coordinates(parts[0]))


def normalise_longitude_deg(longitude_deg: float) -> float:
    """Return a longitude below 180 degrees, as GPX 1.1 requires."""
    return -_HALF_TURN_DEG if round(longitude_deg, 7) >= _HALF_TURN_DEG else longitude_deg


def _split_at_meridian(positions: Sequence[MapPoint]) -> Iterator[list[MapPoint]]:
    """Split a line at its crossings of the 180th meridian; the parts meet on the meridian."""
    line = [positions[0]]
    for previous, position in pairwise(positions):
        if abs(position[0] - previous[0]) > _HALF_TURN_DEG:
            edge_deg = math.copysign(_HALF_TURN_DEG, previous[0])
            span_deg = position[0] + 2.0 * edge_deg - previous[0]
            fraction = (edge_deg - previous[0]) / span_deg if span_deg else 0.0
            latitude_deg = previous[1] + fraction * (position[1] - previous[1])
            yield [*line, (edge_deg, latitude_deg)]
            line = [(-edge_deg, latitude_deg)]
        line.append(position)
    yield line


def _circle_corners(latitude_deg: float, longitude_deg: float, radius_m: float) -> list[MapPoint]:
    centre = Place(radians(latitude_deg), radians(longitude_deg))
    angles = (math.tau * corner / _CIRCLE_CORNERS for corner in range(_CIRCLE_CORNERS))
    positions = (centre.at_offset(radius_m * math.cos(angle), radius_m * math.sin(angle)) for angle in angles)
    return [(degrees(position.longitude_rad), degrees(position.latitude_rad)) for position in positions]


def _add_line(document: ET.Element, name: str, positions: Sequence[MapPoint]) -> None:
    placemark = _add_element(document, "Placemark")
    _add_element(placemark, "name", name)
    line = _add_element(placemark, "LineString")
    _add_element(line, "tessellate", "1")
    _add_element(line, "coordinates", _coordinates(positions))


def _positions_of(points: Sequence[Point]) -> list[MapPoint]:
    return [(point.longitude_deg, point.latitude_deg) for point in points]


def _coordinates(positions: Sequence[MapPoint]) -> str:
    return " ".join(f"{longitude_deg:.7f},{latitude_deg:.7f},0" for longitude_deg, latitude_deg in positions)


def _item_title(item: dict[str, Any]) -> str:
    row = ROWS.get(int(item["CId"]))
    return f"{item['CNum']} {row.name if row else item['CId']}"
