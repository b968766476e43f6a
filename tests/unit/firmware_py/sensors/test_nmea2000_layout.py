"""Fields of NMEA 2000: the generated table, the documented vectors of canboat, and values that are not available."""

import importlib.util
import json
import math
import os
from pathlib import Path

import pytest

from firmware_py.sensors import nmea2000_table
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.nmea2000_layout import read_numbers, read_texts
from firmware_py.sensors.nmea2000_table import LAYOUTS
from hil.devices import nmea2000_frames as n2k
from support.paths import DATA, ROOT

VECTORS = DATA / "nmea2000" / "canboat_vectors.json"
# Names of texts of canboat's lookups that are used as numbers.
CODES = {
    "True": 0, "Magnetic": 1, "no GNSS": 0, "GNSS fix": 1, "DGNSS fix": 2, "Low": 0, "High": 1,
    "Under way using engine": 0, "Under way sailing": 8, "Channel A VDL reception": 0, "Channel B VDL reception": 1,
    "No integrity checking": 0, "True (boat referenced)": 3, "No Order": 0, "Apparent": 2,
}  # fmt: skip


def camel_case(name):
    for unit in ("_rad_s", "_m_s", "_rad", "_deg", "_m", "_s", "_days"):
        if name.endswith(unit):
            name = name.removesuffix(unit)
            break
    first, *others = name.split("_")
    return first + "".join(word.capitalize() for word in others)


def vectors():
    return json.loads(VECTORS.read_text())["samples"] if VECTORS.exists() else []


def script():
    spec = importlib.util.spec_from_file_location("nmea2000_table_script", ROOT / ".ci" / "nmea2000_table.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_table_is_that_of_the_database():
    table = script()
    generated = table.table_of(json.loads(table.EXTRACT.read_text()))
    assert generated == (ROOT / "firmware_py" / "sensors" / "nmea2000_table.py").read_text()
    names = {}
    exec(generated, names)
    assert names["LAYOUTS"] == nmea2000_table.LAYOUTS


def test_extract_has_the_messages_of_a_complete_database():
    path = Path(os.environ.get("CANBOAT_DATABASE", "missing"))
    if not path.exists():
        pytest.skip("CANBOAT_DATABASE names no complete database")
    table = script()
    assert table.table_of(table.extract_of(json.loads(path.read_text()))) == table.table_of(
        json.loads(table.EXTRACT.read_text())
    )


@pytest.mark.parametrize("sample", vectors(), ids=lambda sample: f"{sample['pgn']}-{sample['data'][:8]}")
def test_documented_vectors(sample):
    layout, data = LAYOUTS[sample["pgn"]], bytes.fromhex(sample["data"])
    values, texts = read_numbers(layout, data), read_texts(layout, data)
    compared = 0
    for name, stated in sample["expects"].items():
        expected = stated
        if name == "mothershipUserId":
            continue  # 0 is no MMSI
        key = next((key for key in [*texts, *values] if camel_case(key) == name), None)
        if key is None:
            continue
        if key in texts:
            assert texts[key] == stated
        else:
            if isinstance(expected, str):
                if expected not in CODES:
                    continue
                expected = CODES[expected]
            elif expected is not None and abs(expected) > 900 and ("itude" in name):
                expected = None  # canboat has no code for "not available" in 64 bits
            assert values[key] == (expected if expected is None else pytest.approx(expected, rel=1e-9, abs=6e-4))
        compared += 1
    assert compared >= len(sample["expects"]) // 3


@pytest.mark.parametrize(
    ("bits", "expected"),
    [("0000", 0.0), ("FFFF", None), ("FEFF", None), ("FDFF", None), ("70F5", 6.2832), ("71F5", None), ("6FF5", 6.2831)],
)
def test_angle_that_is_not_available_reserved_or_out_of_range_is_none(bits, expected):
    values = read_numbers(LAYOUTS[127250], bytes.fromhex(f"FF{bits}FF7FFF7FFD"))
    assert values["heading_rad"] == (expected if expected is None else pytest.approx(expected, abs=1e-12))


@pytest.mark.parametrize(
    ("bits", "expected"),
    [("FF7F", None), ("FE7F", None), ("FD7F", None), ("0000", 0.0), ("FFFF", -1e-4), ("B87A", math.pi),
     ("B97A", None), ("4885", -math.pi), ("4785", None), ("0080", None)],
)  # fmt: skip
def test_signed_value_that_is_not_available_or_out_of_range_is_none(bits, expected):
    values = read_numbers(LAYOUTS[127250], bytes.fromhex(f"FF0000FF7F{bits}FD"))
    assert values["variation_rad"] == (expected if expected is None else pytest.approx(expected, abs=1e-4))


def test_short_message_is_an_error_and_omitted_last_fields_are_none():
    with pytest.raises(MessageError, match="Vessel Heading: 7 bytes"):
        read_numbers(LAYOUTS[127250], bytes(7))
    data = n2k.vessel_a(211000001, 50.0, -3.0, 1.0, 1.0)
    assert read_numbers(LAYOUTS[129038], data[:27])["sequence_id"] is None
    assert read_numbers(LAYOUTS[129038], data[:27])["user_id"] == 211000001
    with pytest.raises(MessageError, match="26 bytes"):
        read_numbers(LAYOUTS[129038], data[:26])


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        (b"ANNA@@@@", "ANNA"),
        (b"ANNA    ", "ANNA"),
        (b"ANNA\x00\xff\xff\xff", "ANNA"),
        (b"\xff" * 8, ""),
        (b"A \x1fN\x80~\x7f", "A ?N?~?"),
    ],
)
def test_texts_are_printable_and_end_at_their_filling(raw, expected):
    data = n2k.static_a(211000001, "", "", 0, (0, 0, 0, 0))
    data = data[:16] + raw.ljust(20, b"@") + data[36:]
    assert read_texts(LAYOUTS[129794], data)["name"] == expected


def test_signs_and_units_of_the_emulator_agree():
    """The emulator has its own encoder."""
    assert read_numbers(LAYOUTS[127251], n2k.rate_of_turn(-0.02))["rate_rad_s"] == pytest.approx(-0.02, abs=1e-7)
    values = read_numbers(LAYOUTS[127257], n2k.attitude(0.1, -0.2, 0.3))
    assert [values[name] for name in ("roll_rad", "pitch_rad", "yaw_rad")] == pytest.approx([0.1, -0.2, 0.3])
    values = read_numbers(LAYOUTS[127245], n2k.rudder(-0.35, instance=1))
    assert (values["instance"], values["position_rad"]) == (1, pytest.approx(-0.35))
    values = read_numbers(LAYOUTS[128267], n2k.depth(12.34, -0.5))
    assert (values["depth_m"], values["offset_m"]) == (pytest.approx(12.34), pytest.approx(-0.5))
    values = read_numbers(LAYOUTS[130306], n2k.wind(7.5, 5.0, 2))
    assert (values["wind_speed_m_s"], values["wind_angle_rad"], values["reference"]) == (7.5, pytest.approx(5.0), 2)
    values = read_numbers(LAYOUTS[129025], n2k.position(-34.5, 151.25))
    assert (values["latitude_deg"], values["longitude_deg"]) == pytest.approx((-34.5, 151.25))
