"""The emulated transponder, decoded by pyais: content, intervals, range, losses and capacity."""

import math
from types import SimpleNamespace

import numpy as np
import pyais
import pytest

from hil.devices.ais import AisEmulator, interval_s
from hil.ship.traffic import OWN_MMSI, PATTERNS, Ship

START_DEG = (36.0, 121.0)
BOAT = SimpleNamespace(
    latitude_deg=lambda: START_DEG[0],
    longitude_deg=lambda: START_DEG[1],
    speed_over_ground_m_s=lambda: 0.4,
    course_over_ground_rad=lambda: math.radians(90.0),
    utc_s=lambda: 1.767e9,
)


def emulator(*ships, seed=1, **options):
    return AisEmulator(BOAT, START_DEG, ships, np.random.default_rng(seed), own_mmsi=OWN_MMSI, **options)


def collect_output(device, until_s):
    data = b""
    while (now_s := device.next_output_s()) <= until_s:
        data += device.take_output(now_s)
    return data


def decode(device, until_s, *, own=False):
    """Return the messages of other ships, or those of the boat, as pyais decodes them."""
    parts, messages = [], []
    for line in collect_output(device, until_s).splitlines():
        parts.append(line)
        if line.split(b",")[1] == line.split(b",")[2]:
            if (b"VDO" in line) == own:
                messages.append(pyais.decode(*parts).asdict())
            parts = []
    return messages


def decode_positions(device, until_s):
    return [message for message in decode(device, until_s) if "lat" in message]


@pytest.mark.parametrize(
    ("ship", "expected_s"),
    [
        (Ship(1, "A", 0.0, 0.0, 5.0), 10.0),
        (Ship(1, "A", 0.0, 0.0, 10.0), 6.0),
        (Ship(1, "A", 0.0, 0.0, 15.0), 2.0),
        (Ship(1, "A", 0.0, 0.0, 0.1, at_anchor=True), 180.0),
        (Ship(1, "A", 0.0, 0.0, 3.0, station="B"), 30.0),
        (Ship(1, "A", 0.0, 0.0, 0.5, station="B"), 180.0),
        (Ship(1, "A", 0.0, 0.0, station="mark"), 180.0),
    ],
)
def test_position_reports_have_the_interval_of_the_ship(ship, expected_s):
    assert interval_s(ship) == expected_s
    reports = decode_positions(emulator(ship, lost=0.0), 1800.0)
    assert len(reports) == pytest.approx(1800.0 / expected_s, abs=1)


def test_messages_of_a_ship_contain_position_and_static_data():
    ship = Ship(211000001, "ANNA", 2000.0, -3000.0, 6.0, 123.0)
    messages = decode(emulator(ship, lost=0.0), 400.0)
    report = next(message for message in messages if message["msg_type"] == 1)
    assert (report["mmsi"], report["course"], report["heading"]) == (211000001, 123.0, 123)
    assert report["speed"] == pytest.approx(6.0 * 3600.0 / 1852.0, abs=0.06)
    assert report["lat"] == pytest.approx(START_DEG[0] + 2000.0 / 111_194.93, abs=1e-3)
    assert report["lon"] < START_DEG[1]
    static = next(message for message in messages if message["msg_type"] == 5)
    assert (static["shipname"], static["ship_type"], static["to_bow"], static["to_port"]) == ("ANNA", 70, 150, 14)
    messages = decode(emulator(Ship(5, "BOB", 0.0, 9.0, 3.0, station="B"), lost=0.0), 400.0)
    assert {message["msg_type"] for message in messages} == {18, 24}
    assert any(message.get("shipname") == "BOB" for message in messages)


def test_own_messages_contain_the_motion_of_the_boat():
    messages = decode(emulator(), 100.0, own=True)
    assert len(messages) == 4
    assert {message["mmsi"] for message in messages} == {OWN_MMSI}
    assert messages[0]["lat"] == pytest.approx(36.0)
    assert messages[0]["speed"] == pytest.approx(0.8, abs=0.05)
    assert messages[0]["course"] == pytest.approx(90.0)


def test_ships_out_of_range_and_lost_messages_are_not_received():
    assert decode(emulator(Ship(1, "FAR", 50_000.0, 0.0, 5.0)), 300.0) == []
    device = emulator(Ship(1, "NEAR", 5_000.0, 0.0, 5.0), lost=0.3, range_m=1e6)
    assert len(decode_positions(device, 20_000.0)) == pytest.approx(0.7 * 2000, abs=80)


def test_seed_determines_the_messages():
    ships = [Ship(number, f"S{number}", 1000.0, 0.0, 5.0) for number in range(1, 6)]
    output = [collect_output(emulator(*ships, seed=seed), 120.0) for seed in (1, 1, 2)]
    assert output[0] == output[1] != output[2]


def test_full_channel_drops_messages():
    ships = [Ship(number, f"S{number}", 20_000.0, 0.0, 5.0) for number in range(1, 3001)]
    device = emulator(*ships, lost=0.0)
    count = sum(1 for line in collect_output(device, 20.0).splitlines() if b"VDM" in line)
    assert count <= 75 * 21
    assert device.unsent > 3000


def test_invalid_stations_jump_or_send_damaged_sentences():
    leaper = next(ship for ship in PATTERNS["spoofed"](0.4, np.random.default_rng(1)) if ship.error_kind == "leaps")
    latitudes = [report["lat"] for report in decode_positions(emulator(leaper, lost=0.0), 60.0)]
    assert max(latitudes) - min(latitudes) > 0.3
    ships = PATTERNS["absurd"](0.4, np.random.default_rng(1))[1:]
    data = collect_output(emulator(*ships, lost=0.0), 200.0)
    assert sum(line.startswith(b"!AIVDM") for line in data.split(b"\r\n")) > 50
    assert b"\x00\xff" in data
