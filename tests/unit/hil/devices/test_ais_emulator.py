"""The emulated transponder, read by pyais: what it passes on of whom, how often, and what it does not hear."""

import math
from collections import Counter

import numpy as np
import pyais
import pytest

from hil.devices.ais import AisEmulator, interval_s
from hil.ship.traffic import OWN_MMSI, PATTERNS, Ship

START_DEG = (36.0, 121.0)


class Boat:
    """A boat at the boat start."""

    def latitude_deg(self):
        return START_DEG[0]

    def longitude_deg(self):
        return START_DEG[1]

    def speed_over_ground_m_s(self):
        return 0.4

    def course_over_ground_rad(self):
        return math.radians(90.0)

    def utc_s(self):
        return 1.767e9


def emulator(*ships, seed=1, **options):
    return AisEmulator(Boat(), START_DEG, ships, np.random.default_rng(seed), own_mmsi=OWN_MMSI, **options)


def listen(device, seconds):
    data, now_s = b"", 0.0
    while (now_s := device.next_output_s()) <= seconds:
        data += device.take_output(now_s)
    return data


def read(data):
    """Return the messages that pyais makes of the sentences."""
    parts, messages = [], []
    for line in data.splitlines():
        parts.append(line)
        if line.split(b",")[1] == line.split(b",")[2]:
            messages.append((b"VDO" in line, pyais.decode(*parts).asdict()))
            parts = []
    return messages


@pytest.mark.parametrize(
    ("ship", "wanted_s"),
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
def test_report_intervals(ship, wanted_s):
    assert interval_s(ship) == wanted_s
    found = [one for own, one in read(listen(emulator(ship, lost=0.0), 1800.0)) if not own and "lat" in one]
    assert len(found) == pytest.approx(1800.0 / wanted_s, abs=1)


def test_messages_of_a_ship():
    ship = Ship(211000001, "ANNA", 2000.0, -3000.0, 6.0, 123.0)
    reports = [one for own, one in read(listen(emulator(ship, lost=0.0), 400.0)) if not own]
    first = next(one for one in reports if one["msg_type"] == 1)
    assert (first["mmsi"], first["course"], first["heading"]) == (211000001, 123.0, 123)
    assert first["speed"] == pytest.approx(6.0 * 3600.0 / 1852.0, abs=0.06)
    assert first["lat"] == pytest.approx(START_DEG[0] + 2000.0 / 111_194.93, abs=1e-3)
    assert first["lon"] < START_DEG[1]
    static = next(one for one in reports if one["msg_type"] == 5)
    assert (static["shipname"], static["ship_type"], static["to_bow"], static["to_port"]) == ("ANNA", 70, 150, 14)
    yacht = [one for _, one in read(listen(emulator(Ship(5, "BOB", 0.0, 9.0, 3.0, station="B"), lost=0.0), 400.0))]
    assert {one["msg_type"] for one in yacht} == {18, 24}
    assert any(one.get("shipname") == "BOB" for one in yacht)


def test_own_messages():
    own = [one for is_own, one in read(listen(emulator(), 100.0)) if is_own]
    assert len(own) == 4
    assert {one["mmsi"] for one in own} == {OWN_MMSI}
    assert own[0]["lat"] == pytest.approx(36.0)
    assert own[0]["speed"] == pytest.approx(0.8, abs=0.05)
    assert own[0]["course"] == pytest.approx(90.0)


def test_range_and_losses():
    far = Ship(1, "FAR", 50_000.0, 0.0, 5.0)
    assert all(own for own, _ in read(listen(emulator(far), 300.0)))
    near = Ship(1, "NEAR", 5_000.0, 0.0, 5.0)
    reports = read(listen(emulator(near, lost=0.3, range_m=1e6), 20_000.0))
    received = [one for own, one in reports if not own and "lat" in one]
    assert len(received) == pytest.approx(0.7 * 2000, abs=80)


def test_a_seed_repeats_the_messages():
    ships = [Ship(number, f"S{number}", 1000.0, 0.0, 5.0) for number in range(1, 6)]
    output = [listen(emulator(*ships, seed=seed), 120.0) for seed in (1, 1, 2)]
    assert output[0] == output[1] != output[2]


def test_channel_capacity():
    ships = [Ship(number, f"S{number}", 20_000.0, 0.0, 5.0) for number in range(1, 3001)]
    device = emulator(*ships, lost=0.0)
    count = sum(1 for line in listen(device, 20.0).splitlines() if b"VDM" in line)
    assert count <= 75 * 21
    assert device.unsent > 3000


def test_invalid_stations():
    leaper = next(ship for ship in PATTERNS["spoofed"](0.4, np.random.default_rng(1)) if ship.trick == "leaps")
    reports = [one["lat"] for own, one in read(listen(emulator(leaper, lost=0.0), 60.0)) if not own and "lat" in one]
    assert max(reports) - min(reports) > 0.3
    ships = PATTERNS["absurd"](0.4, np.random.default_rng(1))[1:]
    data = listen(emulator(*ships, lost=0.0), 200.0)
    kinds = Counter(line[:6] for line in data.split(b"\r\n"))
    assert kinds[b"!AIVDM"] > 50
    assert b"\x00\xff" in data
