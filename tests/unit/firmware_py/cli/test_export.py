"""Exports of a log, read back with independent libraries."""

import csv
import errno
import json
import math
import re
import sys

import fastkml
import fastkml.validator
import gpxpy
import jsonschema
import pytest

from firmware_py.__main__ import main
from firmware_py.cli.export import mcap_file, table
from firmware_py.cli.export.messages import Message, read_messages
from firmware_py.log.ardupilot import MSG
from firmware_py.log.dataflash import MessageType, header
from firmware_py.log.schema import TYPES
from hil.__main__ import main as hil_main
from support.full_log import TICKS, write_log
from support.paths import REPLAY


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return write_log(tmp_path_factory.mktemp("logs"))


@pytest.fixture
def export(log, tmp_path):
    """Export the log in a format; return the path of the output."""

    def run(file_format):
        out = tmp_path / f"boat.{file_format}"
        assert main(["export", str(log), "--to", file_format, "--out", str(out)]) == 0
        assert not list(tmp_path.glob("*.part"))
        return out

    return run


@pytest.fixture
def csv_rows(export):
    with export("csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def mcap_messages(export):
    """Schema, channel and message of each message of an MCAP file."""
    reader = pytest.importorskip("mcap.reader")
    with export("mcap").open("rb") as file:
        return list(reader.make_reader(file).iter_messages())


def test_concatenated_logs_are_all_exported(log, tmp_path, capsys):
    """The second header describes all messages again."""
    path = tmp_path / "both.BIN"
    path.write_bytes(2 * log.read_bytes())
    for file_format in ("csv", "gpx", "kml"):
        assert main(["export", str(path), "--to", file_format, "--out", str(tmp_path / file_format)]) == 0
    assert f"{2 * TICKS} rows" in capsys.readouterr().out


@pytest.mark.parametrize(("program", "words"), [(main, ["export", "--to", "csv"]), (hil_main, ["report"])])
def test_output_never_overwrites_the_log(program, words, log, tmp_path, capsys):
    path = tmp_path / "00000001.BIN"
    content = log.read_bytes()
    path.write_bytes(content)
    (tmp_path / "link").symlink_to(path)
    for out in (path, tmp_path / "link"):
        assert program([*words, str(path), "--out", str(out)]) == 2
        assert "another" in capsys.readouterr().err
        assert path.read_bytes() == content


def test_csv_has_one_row_per_tick_in_degrees_metres_and_seconds(csv_rows):
    assert len(csv_rows) == TICKS
    assert (csv_rows[5]["armed"], csv_rows[200]["mode"], csv_rows[200]["armed"]) == ("False", "GUIDED", "True")
    numbers = {name: float(text) for name, text in csv_rows[200].items() if text and name not in ("mode", "armed")}
    motion = {"tick": 200, "time_s": 120.0, "late_s": 0.001, "utc_s": 1700000200.0, "faults": 0, "distance_m": 40.0}
    motion |= {"latitude_deg": 40.1070457, "longitude_deg": -11.4591559, "speed_over_ground_m_s": 0.5}
    motion |= {"course_over_ground_deg": 85.9436693, "satellites": 8, "hdop": 1.25, "cross_track_m": 1.5}
    angles = {"rudder_command_deg": 14.3239449, "rudder_deg": 11.4591559, "heading_deg": 57.2957795}
    angles |= {"error_deg": 57.2957795}
    angles |= {"yaw_rate_deg_s": 0.572957795, "roll_deg": 5.72957795, "pitch_deg": -11.4591559, "wave_period_s": 0.1}
    angles |= {"goal_deg": 114.591559, "estimated_heading_deg": 58.4416951, "rudder_bias_deg": 5.72957795}
    power = {"servo_c": 31.0, "servo_v": 12.0, "servo_a": 0.2, "battery_v": 12.9, "battery_a": -0.5, "charge": 0.8}
    water = {"water_speed_m_s": 0.4, "current_north_m_s": 0.2, "current_east_m_s": -0.1, "wave_sd_deg": 5.72957795}
    assert numbers == pytest.approx(motion | angles | power | water, rel=1e-8)
    assert csv_rows[201]["latitude_deg"] == csv_rows[201]["water_speed_m_s"] == ""  # a tick without these messages


def test_parquet_has_the_same_table(export, csv_rows):
    table = pytest.importorskip("pyarrow.parquet").read_table(export("parquet"))
    assert table.column_names == list(csv_rows[0])
    for name in ("time_s", "rudder_deg", "utc_s", "battery_v"):
        expected = [float(row[name]) if row[name] else None for row in csv_rows]
        assert table.column(name).to_pylist() == pytest.approx(expected)
    assert set(table.column("mode").to_pylist()) == {"GUIDED"}


def test_mcap_has_every_message_with_gps_time(mcap_messages):
    assert {channel.message_encoding for _, channel, _ in mcap_messages} == {"json"}
    topics = {channel.topic for _, channel, _ in mcap_messages}
    assert {"/ATT", "/CTL", "/NAV", "/log", "/BAT"} <= topics
    assert topics & {"/FMT", "/FMTU", "/CHK", "/REQ"} == set()  # formats and parts of longer texts
    first = {}
    for schema, channel, message in mcap_messages:
        first.setdefault(channel.topic, (schema.name, message.log_time, message.publish_time, json.loads(message.data)))
    time_ns, stamp = 1_700_000_000_000_000_000, {"sec": 1_700_000_000, "nsec": 0}  # the date of the receiver
    values = {"timestamp": stamp, "level": 2, "message": "rambler 1.2.3.dev0 (git 0123abcd-dirty)", "name": "rambler"}
    assert first["/log"] == ("foxglove.Log", time_ns, time_ns, values)
    values = {"timestamp": stamp, "frame_id": "earth", "latitude": 40.1070457, "altitude": 3.0}
    values |= {"longitude": pytest.approx(-11.4591559), "position_covariance": [0.0] * 9, "position_covariance_type": 0}
    assert first["/position"] == ("foxglove.LocationFix", time_ns, time_ns, values)


@pytest.mark.parametrize(
    ("severity", "level"), [(0, 5), (1, 5), (2, 5), (3, 4), (4, 3), (5, 2), (6, 2), (7, 1), (8, 1), (None, 1)]
)
def test_severity_of_a_message_is_a_level_of_foxglove(severity, level):
    """Levels of foxglove.Log: debug 1, info 2, warning 3, error 4, fatal 5."""
    message = Message("MSG", 1.0, {"Message": "x", "Sev": severity})
    _, (topic, values) = mcap_file._topics_of(message, 2_500_000_000)
    expected = {"timestamp": {"sec": 2, "nsec": 500_000_000}, "level": level, "message": "x", "name": "rambler"}
    assert (topic, values) == ("/log", expected)


# The reader of Foxglove accepts one of these types per field, and no alternatives.
JSON_TYPES = ("boolean", "string", "number", "integer", "object", "array")
FIELD_PATH = re.compile(r"(/\w+)(?:\{(\w+)==\d+\})?\.(\w+)")


def test_mcap_messages_match_their_schemas(mcap_messages):
    incomplete, validators = 0, {}
    for schema, _, message in mcap_messages:
        values = json.loads(message.data)
        if schema.name not in validators:
            content = json.loads(schema.data) | {"additionalProperties": False}
            assert all(field["type"] in JSON_TYPES for field in content["properties"].values()), schema.name
            jsonschema.Draft202012Validator.check_schema(content)
            validators[schema.name] = jsonschema.Draft202012Validator(content)
        validators[schema.name].validate(values)
        incomplete += len(values) < len(validators[schema.name].schema["properties"])
    assert incomplete, "the log must contain messages with unknown values"


def test_layout_refers_to_existing_fields(mcap_messages, tmp_path):
    schemas, fields = {}, {}
    for schema, channel, message in mcap_messages:
        schemas[channel.topic] = (schema.name, json.loads(schema.data)["properties"])
        fields.setdefault(channel.topic, set()).update(json.loads(message.data))
    layout = json.loads((tmp_path / "boat.mcap.layout.json").read_text())
    panels = layout["configById"]
    lines = [line["value"] for panel in panels.values() for line in panel.get("paths", ())]
    assert len(lines) >= 9
    for line in lines:
        topic, filter_field, field = FIELD_PATH.fullmatch(line).groups()
        for name in filter(None, (filter_field, field)):
            assert schemas[topic][1][name]["type"] == "number", line
            assert name in fields[topic], line
    assert schemas[panels["map!rambler"]["followTopic"]][0] == "foxglove.LocationFix"
    assert schemas[panels["RosOut!rambler"]["topicToRender"]][0] == "foxglove.Log"
    assert sorted(leaves(layout["layout"])) == sorted(panels)


def leaves(node):
    """Return the panels of the tree of a layout."""
    if isinstance(node, str):
        return [node]
    assert node["direction"] in {"row", "column"}
    assert 0 < node["splitPercentage"] < 100
    return leaves(node["first"]) + leaves(node["second"])


def test_messages_of_an_undated_log_have_the_time_of_the_process(tmp_path):
    reader = pytest.importorskip("mcap.reader")
    (tmp_path / "a.BIN").write_bytes(header((MSG,), 0) + MSG.pack(2_500_000, b"x", 6))
    assert main(["export", str(tmp_path / "a.BIN"), "--to", "mcap", "--out", str(tmp_path / "a.mcap")]) == 0
    with (tmp_path / "a.mcap").open("rb") as file:
        rows = list(reader.make_reader(file).iter_messages())
    times_ns = {channel.topic: message.log_time for _, channel, message in rows}
    assert times_ns["/MSG"] == times_ns["/log"] == 2_500_000_000


def test_integers_of_a_log_are_scaled():
    kind = MessageType(200, "INT", "TimeUS,A,B,C,D,E,F,G", "QcCeELaN", "s" + "-" * 7, "F" + "-" * 7)
    data = header((kind,), 0) + kind.pack(2_500_000, -150, 250, -350, 450, 1_234_567_890, b"array", b"text")
    (message,) = read_messages(data, {"INT"})
    assert message.t_s == 2.5
    values = {"TimeUS": 2_500_000, "A": -1.5, "B": 2.5, "C": -3.5, "D": 4.5, "E": 123.456789}
    assert message.values.pop("G") == "text"
    assert message.values == pytest.approx(values)  # without the array


def test_gpx_has_track_in_utc_and_mission(export):
    gpx = gpxpy.parse(export("gpx").read_text(encoding="utf-8"))
    ((segment,),) = [track.segments for track in gpx.tracks]
    assert len(segment.points) == TICKS // 5
    point = segment.points[0]
    assert (point.latitude, point.elevation) == pytest.approx((40.10705, 3.0), abs=1e-4)
    assert point.time.isoformat().startswith("2023-11-14T22:13:20")
    assert [waypoint.name for waypoint in gpx.waypoints] == ["1 NAV_WAYPOINT"]


def test_kml_is_valid_and_has_track_mission_and_fence(export):
    path = export("kml")
    assert fastkml.validator.validate(file_to_validate=path)
    (document,) = fastkml.kml.KML.parse(path).features
    track, _, polygon, circle = document.features
    assert track.geometry.coords[0] == pytest.approx((-11.45916, 40.10705, 0.0), abs=1e-4)
    assert [row.name for row in document.features[1:]] == ["1 NAV_WAYPOINT", "Fence, inclusion", "Fence, exclusion"]
    corners = polygon.geometry.exterior.coords
    assert (len(corners), corners[0]) == (4, corners[-1])
    positions = [(north, east) for east, north, _ in circle.geometry.exterior.coords]
    assert (len(positions), positions[0]) == (37, positions[-1])
    for north, east in positions:  # 50 m around a position near the equator
        assert math.hypot(north - 7e-7, east - 8e-7) * 111_195.0 == pytest.approx(50.0, rel=1e-3)


def test_missing_library_names_the_extra(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["export", str(log), "--to", "parquet", "--out", str(tmp_path / "x.parquet")]) == 2
    error = capsys.readouterr().err
    assert ("pip" in error, "pyarrow" in error, "rambler-autopilot[export]" in error) == (False, True, True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("file_format", ["csv", "gpx"])
def test_empty_log_is_a_finding_and_leaves_no_file(file_format, tmp_path, capsys):
    (tmp_path / "empty.BIN").write_bytes(header(TYPES, 0))
    assert main(["export", str(tmp_path / "empty.BIN"), "--to", file_format, "--out", str(tmp_path / "out")]) == 1
    assert "nothing to export" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["empty.BIN"]


def test_missing_log_is_a_one_line_error(tmp_path, capsys):
    assert main(["export", str(tmp_path / "none.BIN"), "--to", "csv", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("file_format", ["gpx", "kml"])
def test_log_version_without_plans_is_reported(file_format, tmp_path, capsys):
    path = tmp_path / "old.BIN"
    path.write_bytes((REPLAY / "mission_failsafe.BIN").read_bytes().replace(b"CMD\0", b"OLD\0", 1))
    assert main(["export", str(path), "--to", file_format, "--out", str(tmp_path / "out")]) == 0
    text = r": \d+ fixes; mission and fence are not in logs of that version\n$"
    assert re.search(text, capsys.readouterr().out)


def test_full_disk_error_names_the_output(log, tmp_path, capsys, monkeypatch):
    def raise_full(*_arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("firmware_py.cli.export.table.write", raise_full)
    assert main(["export", str(log), "--to", "csv", "--out", str(tmp_path / "a.csv")]) == 2
    assert f"{tmp_path / 'a.csv'}: No space left on device" in capsys.readouterr().err


def test_rows_of_a_table_contain_no_absent_values():
    """The log stores an absent number as NaN."""
    rows = list(table.read_rows((REPLAY / "two_compasses.BIN").read_bytes()))
    assert len(rows) > 100
    assert all(value is not None and value == value for row in rows for value in row.values())  # noqa: PLR0124


def test_foxglove_layout_shows_map_texts_and_four_plots_of_the_same_height():
    layout = mcap_file._make_layout()
    plots = [panel for name, panel in layout["configById"].items() if name.startswith("Plot")]
    assert len(plots) == 4
    assert {panel["showLegend"] and panel["isSynced"] for panel in plots} == {True}
    lines = [line for panel in plots for line in panel["paths"]]
    assert {(line["enabled"], line["timestampMethod"]) for line in lines} == {(True, "receiveTime")}
    assert layout["configById"]["RosOut!rambler"]["minLogLevel"] == 1  # from debug on, so that all are shown
    assert layout["playbackConfig"] == {"speed": 1}
    shares = dict(panel_shares(layout["layout"], 1.0))
    expected = {"map!rambler": 0.4 * 0.7, "RosOut!rambler": 0.4 * 0.3}
    assert shares == pytest.approx(expected | {f"Plot!rambler{number}": 0.6 / 4 for number in range(4)})


def panel_shares(node, share):
    """Yield the panels of a layout with their share of the window."""
    if isinstance(node, str):
        yield node, share
        return
    yield from panel_shares(node["first"], share * node["splitPercentage"] / 100)
    yield from panel_shares(node["second"], share * (1 - node["splitPercentage"] / 100))
