"""A quarter of all datagrams lost, doubled, delayed, both ways: all that is asked for comes, whole and right."""

import importlib.util
import sys
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.params import TABLE, Kind

SEEDS = [1, 2, 3, 4, 5]
RETRY_S = 0.25  # longer than the relay delays
RETRIES = 40
PATIENCE_S = 60.0
VEHICLE = """
[compass]
driver = "nmea"
port = "{directory}/no-compass"
baud = 38400
[rudder]
driver = "volz"
port = "{directory}/no-rudder"
baud = 115200
id = 1
"""


# Tests are imported without packages: what stands beside them is loaded by its path.
_SPEC = importlib.util.spec_from_file_location("relay", Path(__file__).with_name("relay.py"))
_MODULE = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_MODULE)
Relay, DELAY_S = _MODULE.Relay, _MODULE.DELAY_S


@pytest.fixture
def lossy(tmp_path, start, free_ports, connect):
    """Starts a boat and gives a station behind a relay of a seed."""
    relays = []

    def begin(seed):
        (station_port,) = free_ports(["udpin"])
        relays.append(Relay(station_port, seed))
        relays[-1].__enter__()
        (tmp_path / "boat.toml").write_text(VEHICLE.format(directory=tmp_path))
        words = ["run", str(tmp_path / "boat.toml"), "--wait", "--state", str(tmp_path / "state")]
        url = f"udpout:127.0.0.1:{relays[-1].port}"
        start("boat", [sys.executable, "-m", "firmware_py", *words, "--link", url])
        return relays[-1], connect(f"udpin:127.0.0.1:{station_port}")

    yield begin
    for relay in relays:
        relay.__exit__(None, None, None)


def asked(station, ask, kind, wanted=lambda _: True):
    """Ask until it is answered, as the protocols have it."""
    for _ in range(RETRIES):
        ask()
        again_s = time.monotonic() + RETRY_S
        while (left_s := again_s - time.monotonic()) > 0.0:
            message = station.link.recv_match(type=kind, blocking=True, timeout=left_s)
            if message is not None and wanted(message):
                return message
    return pytest.fail(f"no {kind} after {RETRIES} questions")


def parameter_list(station):
    """The list, again while much of it is missing, and then the last rows one by one."""
    rows = {}
    while len(rows) < len(TABLE) - 4:
        first = asked(station, lambda: station.mav.param_request_list_send(1, 1), "PARAM_VALUE")
        rows[first.param_index] = first
        while (row := station.link.recv_match(type="PARAM_VALUE", blocking=True, timeout=RETRY_S)) is not None:
            rows[row.param_index] = row
    for index in range(len(TABLE)):
        if index not in rows:
            rows[index] = asked(
                station,
                lambda index=index: station.mav.param_request_read_send(1, 1, b"", index),
                "PARAM_VALUE",
                lambda row, index=index: row.param_index == index,
            )
    return {row.param_id: row.param_value for row in rows.values()}


def check_parameters(station):
    expected = {row.name: row.default for row in TABLE} | {"STAT_BOOTCNT": 1.0}  # her first start
    assert parameter_list(station) == pytest.approx(expected)
    for number, row in enumerate(row for row in TABLE if row.kind is Kind.REAL and row.name.startswith("CTL_")):
        value = row.checked(min(row.default + 0.25 * (number + 1), row.maximum))
        expected[row.name] = value
        asked(
            station,
            lambda row=row, value=value: station.mav.param_set_send(1, 1, row.name.encode(), value, 9),
            "PARAM_VALUE",
            lambda told, row=row, value=value: (told.param_id, told.param_value) == (row.name, pytest.approx(value)),
        )
    assert parameter_list(station) == pytest.approx(expected)


def check_commands(station):
    """Each is acknowledged, retries too; the mode in the end is the one asked for last."""
    for mode in (0, 4, 0, 4, 0, 4):
        time.sleep(DELAY_S)  # a double of the one before is not to come after this one
        confirmation = iter(range(256))
        ack = asked(
            station,
            lambda mode=mode, confirmation=confirmation: station.mav.command_long_send(
                1, 1, mavlink.MAV_CMD_DO_SET_MODE, next(confirmation), 1, mode, 0, 0, 0, 0, 0
            ),
            "COMMAND_ACK",
            lambda ack: ack.command == mavlink.MAV_CMD_DO_SET_MODE,
        )
        assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    station.heard("HEARTBEAT", lambda beat: beat.custom_mode == 4)


def check_losses(relay):
    whole = relay.counts["carried"] + relay.counts["dropped"]
    assert whole > 40
    assert 0.1 < relay.counts["dropped"] / whole < 0.4
    assert relay.counts["doubled"] > 3
    assert relay.counts["delayed"] > 3


def test_parameters_and_commands_over_a_lossy_link(lossy):
    relay, station = lossy(SEEDS[0])
    check_parameters(station)
    check_commands(station)
    check_losses(relay)


@pytest.mark.proof
@pytest.mark.parametrize("seed", SEEDS[1:])
def test_the_same_over_more_seeds(lossy, seed):
    relay, station = lossy(seed)
    check_parameters(station)
    check_commands(station)
    check_losses(relay)
