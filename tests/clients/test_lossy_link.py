"""Parameters and commands over a link that loses, duplicates or delays a quarter of all datagrams."""

import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import TABLE
from support.relay import MAX_DELAY_S, RETRY_S, check_losses, request_reply

SEEDS = [1, 2, 3, 4, 5]


def parameter_list(station):
    """Return the parameters: request the list while much of it is missing, then the last rows one by one."""
    rows = {}
    while len(rows) < len(TABLE) - 4:
        first = request_reply(station, lambda: station.mav.param_request_list_send(1, 1), "PARAM_VALUE")
        rows[first.param_index] = first
        while (row := station.link.recv_match(type="PARAM_VALUE", blocking=True, timeout=RETRY_S)) is not None:
            rows[row.param_index] = row
    for index in range(len(TABLE)):
        if index not in rows:
            rows[index] = request_reply(
                station,
                lambda index=index: station.mav.param_request_read_send(1, 1, b"", index),
                "PARAM_VALUE",
                lambda row, index=index: row.param_index == index,
            )
    return {row.param_id: row.param_value for row in rows.values()}


def check_parameters(station):
    expected = {row.name: row.default for row in TABLE} | {"STAT_BOOTCNT": 1.0}  # the first start
    assert parameter_list(station) == pytest.approx(expected)
    for number, row in enumerate(row for row in TABLE if row.kind is Kind.REAL and row.name.startswith("CTL_")):
        value = row.check(min(row.default + 0.25 * (number + 1), row.maximum))
        expected[row.name] = value
        request_reply(
            station,
            lambda row=row, value=value: station.mav.param_set_send(1, 1, row.name.encode(), value, 9),
            "PARAM_VALUE",
            lambda reply, row=row, value=value: (reply.param_id, reply.param_value) == (row.name, pytest.approx(value)),
        )
    assert parameter_list(station) == pytest.approx(expected)


def check_commands(station):
    """Check that each command is acknowledged, also a repeated one, and that the last one determines the mode."""
    for mode in (0, 4, 0, 4, 0, 4):
        # Wait for delayed duplicates of the previous command, and for its acknowledgement, which waits for the disk.
        time.sleep(2.0 * MAX_DELAY_S + 0.3)
        while station.link.recv_match(type="COMMAND_ACK") is not None:
            pass
        confirmation = iter(range(256))
        ack = request_reply(
            station,
            lambda mode=mode, confirmation=confirmation: station.mav.command_long_send(
                1, 1, mavlink.MAV_CMD_DO_SET_MODE, next(confirmation), 1, mode, 0, 0, 0, 0, 0
            ),
            "COMMAND_ACK",
            lambda ack: ack.command == mavlink.MAV_CMD_DO_SET_MODE,
        )
        assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    station.receive("HEARTBEAT", lambda heartbeat: heartbeat.custom_mode == 4)


def test_parameters_and_commands_over_a_lossy_link(lossy):
    relay, station = lossy(SEEDS[0])
    check_parameters(station)
    check_commands(station)
    check_losses(relay)


@pytest.mark.proof
@pytest.mark.parametrize("seed", SEEDS[1:])
def test_parameters_and_commands_over_a_lossy_link_with_more_seeds(lossy, seed):
    relay, station = lossy(seed)
    check_parameters(station)
    check_commands(station)
    check_losses(relay)
