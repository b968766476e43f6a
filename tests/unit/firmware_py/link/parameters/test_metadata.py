"""Component metadata: schema, compression, content and checksums."""

import json
import lzma
import re

import pytest

from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import TABLE
from firmware_py.link.files.area import mavlink_crc32
from firmware_py.link.parameters.files import ARDUPILOT, Metadata, parameter_files, parameter_json
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.dialect import mavlink
from support.paths import DATA

COMPONENT_INFORMATION, COMPONENT_METADATA = 395, 397  # message ids
DEFINITIONS = DATA / "mavlink" / "definitions"


@pytest.fixture(scope="module")
def files():
    parameter_files.cache_clear()
    return Metadata(Version(1, 2, 3), ARDUPILOT).files


@pytest.mark.parametrize("name", ["general", "parameter"])
def test_files_match_the_published_schema(files, name):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((DEFINITIONS / f"{name}.schema.json").read_text())
    jsonschema.Draft7Validator.check_schema(schema)
    jsonschema.Draft7Validator(schema).validate(json.loads(files["metadata", f"{name}.json"]))


@pytest.mark.parametrize("name", ["general", "parameter"])
def test_compressed_files_have_the_same_content_and_a_crc32_check(files, name):
    compressed = files["metadata", f"{name}.json.xz"]
    decoder = lzma.LZMADecompressor()
    assert decoder.decompress(compressed) == files["metadata", f"{name}.json"]
    assert decoder.check == lzma.CHECK_CRC32
    small = lzma.LZMADecompressor(memlimit=140_000)  # a dictionary of 64 KiB and the decoder
    assert small.decompress(compressed) == files["metadata", f"{name}.json"]
    assert len(compressed) < 8192  # eight seconds at 9600 baud


def test_every_parameter_is_described(files):
    published = {row["name"]: row for row in json.loads(files["metadata", "parameter.json"])["parameters"]}
    assert list(published) == [row.name for row in TABLE]
    for row in TABLE:
        entry = published[row.name]
        assert (entry["min"], entry["max"]) == (pytest.approx(row.minimum), pytest.approx(row.maximum))
        assert entry["default"] == pytest.approx(row.default)
        assert (entry.get("units", ""), entry["longDesc"]) == (row.unit, row.text)
        assert entry.get("rebootRequired", False) == row.reboot
        assert entry.get("readOnly", False) == row.read_only
        assert {item["value"]: item["description"] for item in entry.get("values", ())} == (row.choices or {})
        assert entry["group"] != "Other"
        assert entry["shortDesc"] == re.split(r":|;|\. |\.$", row.text)[0]
        assert entry.get("volatile", False) == row.read_only
        assert (entry["category"], entry["type"]) == ("Standard", "Int32" if row.kind is Kind.INTEGER else "Float")
        assert round(row.default, entry.get("decimalPlaces", 0)) == pytest.approx(row.default)


def test_checksums_match_the_served_files(rig, ftp_station, of):
    client = ftp_station(rig)
    (metadata,) = of(rig.command(mavlink.MAV_CMD_REQUEST_MESSAGE, COMPONENT_METADATA), "COMPONENT_METADATA")
    path = metadata.uri.decode().rstrip("\0").removeprefix("mftp://")
    general = client.get(path)
    assert mavlink_crc32(general) == metadata.file_crc
    content = json.loads(lzma.decompress(general))
    (entry,) = content.pop("metadataTypes")
    assert content == {"version": 1, "vendorName": "Rambler", "modelName": "Rambler", "firmwareVersion": "0.1.0"}
    parameters = client.get(entry["uri"].removeprefix("mftp://"))
    assert (entry["type"], mavlink_crc32(parameters)) == (1, entry["fileCrc"])
    assert lzma.decompress(parameters).decode() == parameter_json()
    assert json.loads(parameter_json())["version"] == 3
    (information,) = of(rig.command(mavlink.MAV_CMD_REQUEST_MESSAGE, COMPONENT_INFORMATION), "COMPONENT_INFORMATION")
    assert information.general_metadata_file_crc == metadata.file_crc
    assert information.general_metadata_uri == metadata.uri
    assert (information.peripherals_metadata_file_crc, information.peripherals_metadata_uri.rstrip(b"\0")) == (0, b"")


def test_files_are_reproducible(files):
    parameter_files.cache_clear()
    assert Metadata(Version(1, 2, 3), ARDUPILOT).files == files


def test_autopilot_type_generic_has_only_float_parameters():
    published = json.loads(
        Metadata(Version(1, 2, 3), mavlink.MAV_AUTOPILOT_GENERIC).files["metadata", "parameter.json"]
    )["parameters"]
    assert {row["type"] for row in published} == {"Float"}
    integers = [row for row, parameter in zip(published, TABLE, strict=True) if parameter.kind is Kind.INTEGER]
    assert {row["decimalPlaces"] for row in integers} == {0}


def test_decimals_show_four_digits_of_the_default(files):
    published = {row["name"]: row for row in json.loads(files["metadata", "parameter.json"])["parameters"]}
    decimals_of_size = {100.0: 1, 20.0: 1, 10.0: 1, 5.0: 2, 1.0: 2, 0.5: 3, 0.1: 3, 0.05: 4, 0.0: 2}
    compared = set()
    for row in TABLE:
        size = abs(row.default) or abs(row.minimum)
        if row.kind is Kind.REAL and size in decimals_of_size:
            assert published[row.name]["decimalPlaces"] == decimals_of_size[size], row.name
            compared.add(size)
    assert {0.0, 1.0, 100.0} <= compared
