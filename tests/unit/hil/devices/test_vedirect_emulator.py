"""The emulated charger and monitor, read by their bytes alone."""

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


def listen(emulator, until_s):
    data, now_s = b"", 0.0
    while (now_s := emulator.next_output_s()) <= until_s:
        data += emulator.take_output(now_s)
    return data


def fields(data):
    """Split into blocks by hand, each checked by its sum, and return their labels and values."""
    blocks, rest = [], data
    while rest:
        end = rest.index(b"\r\nChecksum\t") + len(b"\r\nChecksum\t") + 1
        assert sum(rest[:end]) % 256 == 0
        blocks.append(dict(line.split("\t") for line in rest[: end - 12].decode("ascii").split("\r\n") if line))
        rest = rest[end:]
    return blocks


def test_a_charger_tells_once_a_second_what_flows(plant):
    said = fields(listen(VeDirectEmulator(plant, Kind.CHARGER), 20.5))
    assert len(said) == 21
    assert "IL" not in said[-1]
    out_w = int(said[-1]["V"]) * int(said[-1]["I"]) * 1e-6
    assert out_w == pytest.approx(0.97 * int(said[-1]["PPV"]), abs=0.6)


def test_with_its_loads_on_it_the_current_is_what_they_leave(plant):
    last = fields(listen(VeDirectEmulator(plant, Kind.CHARGER_WITH_LOAD), 20.5))[-1]
    assert int(last["V"]) * int(last["IL"]) * 1e-6 == pytest.approx(4.0, abs=0.02)
    assert int(last["V"]) * (int(last["I"]) + int(last["IL"])) * 1e-6 == pytest.approx(0.97 * int(last["PPV"]), abs=0.6)


def test_a_monitor_tells_its_history_every_other_time_and_no_charge_that_it_does_not_know(plant):
    monitor = VeDirectEmulator(plant, Kind.MONITOR)
    monitor.known = False
    said = fields(listen(monitor, 4.5))
    assert ["H17" in one for one in said] == [False, True, False, False, True, False, False, True]
    assert said[0]["SOC"] == "---"
    assert int(said[-2]["V"]) > 12_000
