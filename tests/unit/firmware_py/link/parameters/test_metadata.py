"""Component metadata against the published schemas."""

import json
import lzma

import pytest

from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import TABLE
from firmware_py.link.files.area import mavlink_crc32
from firmware_py.link.parameters.files import Metadata, parameter_files, parameter_json
from firmware_py.link.telemetry.identity import Version
from support.paths import DATA

DEFINITIONS = DATA / "mavlink" / "definitions"


@pytest.fixture(scope="module")
def files():
    return Metadata(Version(1, 2, 3), 3).files


@pytest.mark.parametrize("name", ["general", "parameter"])
def test_the_files_are_valid_by_the_published_schema(files, name):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((DEFINITIONS / f"{name}.schema.json").read_text())
    jsonschema.Draft7Validator.check_schema(schema)
    jsonschema.Draft7Validator(schema).validate(json.loads(files["metadata", f"{name}.json"]))


@pytest.mark.parametrize("name", ["general", "parameter"])
def test_the_compressed_files_hold_the_same_with_the_check_that_stations_know(files, name):
    compressed = files["metadata", f"{name}.json.xz"]
    decoder = lzma.LZMADecompressor()
    assert decoder.decompress(compressed) == files["metadata", f"{name}.json"]
    assert decoder.check == lzma.CHECK_CRC32
    assert len(compressed) < 8192  # eight seconds at 9600 baud


def test_every_parameter_is_described(files):
    published = {row["name"]: row for row in json.loads(files["metadata", "parameter.json"])["parameters"]}
    assert list(published) == [row.name for row in TABLE]
    for row in TABLE:
        one = published[row.name]
        assert (one["min"], one["max"]) == (pytest.approx(row.minimum), pytest.approx(row.maximum))
        assert one["default"] == pytest.approx(row.default)
        assert (one.get("units", ""), one["longDesc"]) == (row.unit, row.text)
        assert one.get("rebootRequired", False) == row.reboot
        assert one.get("readOnly", False) == row.read_only
        assert {item["value"]: item["description"] for item in one.get("values", ())} == (row.choices or {})
        assert one["group"] != "Other"
        assert one["shortDesc"]
        assert round(row.default, one.get("decimalPlaces", 0)) == pytest.approx(row.default)


def test_the_checksums_are_those_of_the_files_as_served(rig, ftp_station, of):
    client = ftp_station(rig)
    (reports,) = of(rig.command(512, 397), "COMPONENT_METADATA")
    path = reports.uri.decode().rstrip("\0").removeprefix("mftp://")
    general = client.get(path)
    assert mavlink_crc32(general) == reports.file_crc
    (entry,) = json.loads(lzma.decompress(general))["metadataTypes"]
    parameters = client.get(entry["uri"].removeprefix("mftp://"))
    assert (entry["type"], mavlink_crc32(parameters)) == (1, entry["fileCrc"])
    assert lzma.decompress(parameters).decode() == parameter_json()
    (old,) = of(rig.command(512, 395), "COMPONENT_INFORMATION")
    assert (old.general_metadata_file_crc, old.general_metadata_uri) == (reports.file_crc, reports.uri)


def test_the_same_table_makes_the_same_bytes(files):
    parameter_files.cache_clear()
    assert Metadata(Version(1, 2, 3), 3).files == files


def test_for_another_identity_every_type_is_a_float():
    published = json.loads(Metadata(Version(1, 2, 3), 0).files["metadata", "parameter.json"])["parameters"]
    assert {row["type"] for row in published} == {"Float"}
    assert all(row["decimalPlaces"] == 0 for row, own in zip(published, TABLE, strict=True) if own.kind is Kind.INTEGER)
