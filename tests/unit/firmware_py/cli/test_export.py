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
from firmware_py.log.dataflash import header
from firmware_py.log.schema import TYPES
from hil.__main__ import main as hil_main
from support.full_log import TICKS, write_log
from support.paths import REPLAY


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return write_log(tmp_path_factory.mktemp("logs"))


@pytest.fixture
def export(log, tmp_path):
    def exported(kind):
        out = tmp_path / f"boat.{kind}"
        assert main(["export", str(log), "--to", kind, "--out", str(out)]) == 0
        assert not list(tmp_path.glob("*.part"))
        return out

    return exported


def test_concatenated_logs_are_all_exported(log, tmp_path, capsys):
    """The second header describes all messages again."""
    both = tmp_path / "both.BIN"
    both.write_bytes(2 * log.read_bytes())
    for kind in ("csv", "gpx", "kml"):
        assert main(["export", str(both), "--to", kind, "--out", str(tmp_path / kind)]) == 0
    assert f"{2 * TICKS} rows" in capsys.readouterr().out


@pytest.mark.parametrize(("program", "words"), [(main, ["export", "--to", "csv"]), (hil_main, ["report"])])
def test_output_never_overwrites_the_log(program, words, log, tmp_path, capsys):
    mine = tmp_path / "00000001.BIN"
    content = log.read_bytes()
    mine.write_bytes(content)
    (tmp_path / "link").symlink_to(mine)
    for out in (mine, tmp_path / "link"):
        assert program([*words, str(mine), "--out", str(out)]) == 2
        assert "another" in capsys.readouterr().err
        assert mine.read_bytes() == content


def test_csv_has_one_row_per_tick(export):
    with export("csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == TICKS
    assert (rows[5]["mode"], rows[5]["armed"], rows[200]["armed"]) == ("GUIDED", "False", "True")
    assert float(rows[5]["heading_deg"]) == pytest.approx(57.29578, abs=1e-4)
    assert float(rows[5]["latitude_deg"]) == pytest.approx(40.10705, abs=1e-4)
    assert rows[6]["latitude_deg"] == ""  # no fix came with that tick


def test_parquet_has_the_same_table(export):
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(export("parquet"))
    with export("csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert table.column_names == list(rows[0])
    for name in ("time_s", "rudder_deg", "utc_s", "battery_v"):
        expected = [float(row[name]) if row[name] else None for row in rows]
        assert table.column(name).to_pylist() == pytest.approx(expected)
    assert set(table.column("mode").to_pylist()) == {"GUIDED"}


def test_mcap_has_every_message_with_gps_time(export):
    reader = pytest.importorskip("mcap.reader")
    path = export("mcap")
    first, topics, places = None, set(), []
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            first = first or message.log_time
            topics.add(channel.topic)
            assert channel.message_encoding == "json"
            if channel.topic == "/position":
                assert schema.name == "foxglove.LocationFix"
                places.append(json.loads(message.data))
    assert first * 1e-9 == pytest.approx(1.7e9, abs=2.0)  # the receiver's date
    assert places[0]["latitude"] == pytest.approx(40.10705, abs=1e-4)
    assert {"/ATT", "/CTL", "/NAV", "/log", "/BAT"} <= topics


# Of Foxglove's own reader of JSON schemas: a field has one of these types, and no choice between two.
JSON_TYPES = ("boolean", "string", "number", "integer", "object", "array")
PATH = re.compile(r"(/\w+)(?:\{(\w+)==\d+\})?\.(\w+)")


def test_mcap_messages_match_their_schemas(export):
    reader = pytest.importorskip("mcap.reader")
    lacking, validators = 0, {}
    with export("mcap").open("rb") as file:
        for schema, _, message in reader.make_reader(file).iter_messages():
            values = json.loads(message.data)
            if schema.name not in validators:
                described = json.loads(schema.data) | {"additionalProperties": False}
                assert all(field["type"] in JSON_TYPES for field in described["properties"].values()), schema.name
                jsonschema.Draft202012Validator.check_schema(described)
                validators[schema.name] = jsonschema.Draft202012Validator(described)
            validators[schema.name].validate(values)
            lacking += len(values) < len(validators[schema.name].schema["properties"])
    assert lacking, "nothing was unknown, so that nothing was tested"


def test_layout_refers_to_existing_fields(export):
    reader = pytest.importorskip("mcap.reader")
    path = export("mcap")
    fields, output = {}, {}
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            fields[channel.topic] = (schema.name, json.loads(schema.data)["properties"])
            output.setdefault(channel.topic, set()).update(json.loads(message.data))
    layout = json.loads((path.parent / "boat.mcap.layout.json").read_text())
    panels = layout["configById"]
    lines = [line["value"] for panel in panels.values() for line in panel.get("paths", ())]
    assert len(lines) >= 9
    for line in lines:
        topic, filtered, field = PATH.fullmatch(line).groups()
        for one in filter(None, (filtered, field)):
            assert fields[topic][1][one]["type"] == "number", line
            assert one in output[topic], line
    assert fields[panels["map!rambler"]["followTopic"]][0] == "foxglove.LocationFix"
    assert fields[panels["RosOut!rambler"]["topicToRender"]][0] == "foxglove.Log"
    assert sorted(leaves(layout["layout"])) == sorted(panels)


def leaves(node):
    """The panels of a layout's tree of splits."""
    if isinstance(node, str):
        return [node]
    assert node["direction"] in {"row", "column"}
    assert 0 < node["splitPercentage"] < 100
    return leaves(node["first"]) + leaves(node["second"])


def test_gpx_has_track_in_utc_and_mission(export):
    found = gpxpy.parse(export("gpx").read_text(encoding="utf-8"))
    ((segment,),) = [track.segments for track in found.tracks]
    assert len(segment.points) == TICKS // 5
    first = segment.points[0]
    assert (first.latitude, first.elevation) == pytest.approx((40.10705, 3.0), abs=1e-4)
    assert first.time.isoformat().startswith("2023-11-14T22:13:20")
    assert [one.name for one in found.waypoints] == ["1 NAV_WAYPOINT"]


def test_kml_has_track_mission_and_fence_and_is_valid(export):
    path = export("kml")
    assert fastkml.validator.validate(file_to_validate=path)
    (document,) = fastkml.kml.KML.parse(path).features
    track, _, polygon, circle = document.features
    assert track.geometry.coords[0] == pytest.approx((-11.45916, 40.10705, 0.0), abs=1e-4)
    assert [one.name for one in document.features[1:]] == ["1 NAV_WAYPOINT", "Fence, inclusion", "Fence, exclusion"]
    corners = polygon.geometry.exterior.coords
    assert (len(corners), corners[0]) == (4, corners[-1])
    degrees = [(north, east) for east, north, _ in circle.geometry.exterior.coords]
    assert (len(degrees), degrees[0]) == (37, degrees[-1])
    for north, east in degrees:  # 50 m about a place beside the equator
        assert math.hypot(north - 7e-7, east - 8e-7) * 111_195.0 == pytest.approx(50.0, rel=1e-3)


def test_missing_library_names_the_extra(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["export", str(log), "--to", "parquet", "--out", str(tmp_path / "x.parquet")]) == 2
    assert "pip" not in (error := capsys.readouterr().err)
    assert "pyarrow" in error
    assert "rambler-autopilot[export]" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["csv", "gpx"])
def test_empty_log_is_a_finding_and_leaves_no_file(kind, tmp_path, capsys):
    (tmp_path / "empty.BIN").write_bytes(header(TYPES, 0))
    assert main(["export", str(tmp_path / "empty.BIN"), "--to", kind, "--out", str(tmp_path / "out")]) == 1
    assert "nothing to export" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["empty.BIN"]


def test_missing_log_is_a_one_line_error(tmp_path, capsys):
    assert main(["export", str(tmp_path / "none.BIN"), "--to", "csv", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_log_version_without_plans_is_reported(tmp_path, capsys):
    old = tmp_path / "old.BIN"
    old.write_bytes((REPLAY / "mission_failsafe.BIN").read_bytes().replace(b"CMD\0", b"OLD\0", 1))  # no message CMD
    for kind in ("gpx", "kml"):
        assert main(["export", str(old), "--to", kind, "--out", str(tmp_path / kind)]) == 0
        output = capsys.readouterr().out
        assert re.search(r": \d+ fixes; mission and fence are not in logs of that version\n$", output)


def test_full_disk_names_the_output(log, tmp_path, capsys, monkeypatch):
    def full(*_words):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("firmware_py.cli.export.table.write", full)
    assert main(["export", str(log), "--to", "csv", "--out", str(tmp_path / "a.csv")]) == 2
    assert f"{tmp_path / 'a.csv'}: No space left on device" in capsys.readouterr().err
