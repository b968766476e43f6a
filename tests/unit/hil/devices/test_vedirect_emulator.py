"""Output bytes of the emulated charger and battery monitor."""

import numpy as np
import pytest

from hil.devices.vedirect import Kind, VeDirectEmulator
from hil.ship.disturbances import Supply
from hil.ship.power_plant import Place, PowerPlant

NOON_UTC_S = 1_782_000_000.0 - 1_782_000_000.0 % 86_400.0 + 43_200.0


@pytest.fixture
def plant():
    return PowerPlant(
        Supply(clouds=0.0, charge=0.5), Place(36.0, 0.0, NOON_UTC_S), np.random.default_rng(1), lambda: 0.0
    )


def collect_output(emulator, until_s):
    data, now_s = b"", 0.0
    while (now_s := emulator.next_output_s()) <= until_s:
        data += emulator.take_output(now_s)
    return data


def parse_blocks(data):
    """Split the data into blocks, check their checksums, and return the labels and values of each."""
    blocks, rest = [], data
    while rest:
        end = rest.index(b"\r\nChecksum\t") + len(b"\r\nChecksum\t") + 1
        assert sum(rest[:end]) % 256 == 0
        blocks.append(dict(line.split("\t") for line in rest[: end - 12].decode("ascii").split("\r\n") if line))
        rest = rest[end:]
    return blocks


def test_charger_reports_panel_and_battery_power(plant):
    output = parse_blocks(collect_output(VeDirectEmulator(plant, Kind.CHARGER), 20.5))
    assert len(output) == 21
    assert "IL" not in output[-1]
    battery_w = int(output[-1]["V"]) * int(output[-1]["I"]) * 1e-6
    assert battery_w == pytest.approx(0.97 * int(output[-1]["PPV"]), abs=0.6)


def test_charger_with_load_output_reports_the_load(plant):
    last = parse_blocks(collect_output(VeDirectEmulator(plant, Kind.CHARGER_WITH_LOAD), 20.5))[-1]
    assert int(last["V"]) * int(last["IL"]) * 1e-6 == pytest.approx(4.0, abs=0.02)
    assert int(last["V"]) * (int(last["I"]) + int(last["IL"])) * 1e-6 == pytest.approx(0.97 * int(last["PPV"]), abs=0.6)


def test_monitor_sends_the_history_in_every_second_block(plant):
    monitor = VeDirectEmulator(plant, Kind.MONITOR)
    monitor.is_soc_known = False
    output = parse_blocks(collect_output(monitor, 4.5))
    assert ["H17" in block for block in output] == [False, True, False, False, True, False, False, True]
    assert output[0]["SOC"] == "---"
    assert int(output[-2]["V"]) > 12_000
