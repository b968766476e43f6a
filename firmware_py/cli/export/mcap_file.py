"""Write MCAP for Foxglove: a JSON topic for each kind of log message; position and texts also in Foxglove's schemas.

Foxglove allows one type per field, so unknown values are omitted, not null. A layout file for Foxglove is written next
to the MCAP file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from firmware_py.cli.export.messages import Message, read_messages
from firmware_py.common.records import Severity
from firmware_py.log.dataflash import Buffer
from firmware_py.log.log_time import utc_offset_s

LAYOUT_SUFFIX: Final = ".layout.json"
_POSITION, _LOG = "/position", "/log"
_STAMP: Final = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_NUMBER: Final = {"type": "number"}
# Topic -> schema of Foxglove.
_SCHEMAS: Final = {
    _POSITION: (
        "foxglove.LocationFix",
        {"timestamp": _STAMP, "frame_id": {"type": "string"}, "latitude": _NUMBER, "longitude": _NUMBER}
        | {"altitude": _NUMBER, "position_covariance_type": {"type": "integer"}}
        | {"position_covariance": {"type": "array", "items": _NUMBER}},
    ),
    _LOG: (
        "foxglove.Log",
        {"timestamp": _STAMP, "level": {"type": "integer"}, "message": {"type": "string"}, "name": {"type": "string"}},
    ),
}
# MAV_SEVERITY to foxglove.LogLevel; others are level 1.
_LEVELS: Final[Mapping[Any, int]] = {
    **dict.fromkeys(range(Severity.ERROR), 5),
    Severity.ERROR: 4,
    Severity.WARNING: 3,
    Severity.NOTICE: 2,
    Severity.INFO: 2,
}
_PLOTS: Final = {
    "Heading": ("/ATT.Yaw", "/ATT.DesYaw", "/XKF1.Yaw"),
    "Rudder": ("/STER.Demanded", "/STER.Achieved"),
    "Cross-track error, waypoint distance": ("/NTUN.XTrack", "/NTUN.WpDist"),
    "Battery": ("/BAT{Inst==0}.Volt", "/BAT{Inst==0}.Curr"),  # instance 1 is the servo supply
}


def write(_kind: str, buffer: Buffer, path: Path, out: Path) -> str:
    """Write the messages to `path` and the layout next to `out`; return a summary, empty without messages.

    `path` is a partial file, which the caller renames to `out`.
    """
    from mcap.writer import Writer  # type: ignore[import-not-found,unused-ignore] # noqa: PLC0415 - an extra

    offset_s = utc_offset_s(buffer) or 0.0
    channels: dict[str, int] = {}
    count = 0
    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="", library="rambler export")
        for message in read_messages(buffer):
            time_ns = max(0, round((message.t_s + offset_s) * 1e9))
            for topic, values in _topics_of(message, time_ns):
                if topic not in channels:
                    channels[topic] = _register_channel(writer, topic, values)
                data = json.dumps(_drop_unknown(values), allow_nan=False).encode()
                writer.add_message(channels[topic], log_time=time_ns, publish_time=time_ns, data=data)
                count += 1
        writer.finish()
    if count:
        out.with_name(out.name + LAYOUT_SUFFIX).write_text(json.dumps(_make_layout(), indent=1), encoding="ascii")
    return f"{count} messages on {len(channels)} topics; layout in {out.name + LAYOUT_SUFFIX}" if count else ""


def _register_channel(writer: Any, topic: str, values: dict[str, Any]) -> int:
    """Register the schema and the channel of a topic; return the channel id."""
    name, properties = _SCHEMAS.get(topic) or (
        f"rambler.{topic[1:]}",
        {key: {"type": "string"} if isinstance(value, str) else _NUMBER for key, value in values.items()},
    )
    schema = json.dumps({"title": name, "type": "object", "properties": properties}).encode()
    schema_id = writer.register_schema(name=name, encoding="jsonschema", data=schema)
    return int(writer.register_channel(topic=topic, message_encoding="json", schema_id=schema_id))


def _topics_of(message: Message, time_ns: int) -> list[tuple[str, dict[str, Any]]]:
    """Return the topics of a message with their values: one with its name, and for POS and MSG one of Foxglove."""
    values = message.values
    topics = [(f"/{message.name}", values)]
    stamp = {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}
    if message.name == "POS":
        position = {"latitude": values["Lat"], "longitude": values["Lng"], "altitude": values["Alt"]}
        unknown = {"position_covariance": [0.0] * 9, "position_covariance_type": 0}
        topics.append((_POSITION, {"timestamp": stamp, "frame_id": "earth", **position, **unknown}))
    elif message.name == "MSG":
        level = _LEVELS.get(values.get("Sev"), 1)
        topics.append((_LOG, {"timestamp": stamp, "level": level, "message": values["Message"], "name": "rambler"}))
    return topics


def _drop_unknown(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if not isinstance(value, float) or math.isfinite(value)}


def _make_layout() -> dict[str, Any]:
    """Return a layout for Foxglove: map and texts on the left, plots on the right."""
    panels: dict[str, Any] = {
        "map!rambler": {"layer": "map", "topicColors": {}, "followTopic": _POSITION, "zoomLevel": 15},
        "RosOut!rambler": {"topicToRender": _LOG, "searchTerms": [], "minLogLevel": 1},
    }
    plots = []
    for number, (title, paths) in enumerate(_PLOTS.items()):
        plots.append(f"Plot!rambler{number}")
        lines = [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths]
        panels[plots[-1]] = {
            "paths": lines, "foxglovePanelTitle": title, "xAxisVal": "timestamp", "showLegend": True, "isSynced": True,
        }  # fmt: skip
    left = {"first": "map!rambler", "second": "RosOut!rambler", "direction": "column", "splitPercentage": 70}
    right: Any = plots[-1]
    for count, plot in enumerate(reversed(plots[:-1]), start=2):
        right = {"first": plot, "second": right, "direction": "column", "splitPercentage": 100 / count}
    layout = {"first": left, "second": right, "direction": "row", "splitPercentage": 40}
    playback = {"speed": 1}
    return {"configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": playback, "layout": layout}
