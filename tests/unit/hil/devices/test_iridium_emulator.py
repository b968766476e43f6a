"""The emulated Iridium modem follows the AT Command Reference."""

import numpy as np
import pytest

from hil.devices.iridium import IridiumModem
from hil.devices.iridium_network import IridiumNetwork


class Bench:
    """A modem with a clock."""

    def __init__(self, **network):
        self.network = IridiumNetwork(np.random.default_rng(1), **network)
        self.modem = IridiumModem(self.network)
        self.now_s = 0.0

    def send(self, data, wait_s=1.0):
        self.modem.receive(self.now_s, data)
        return self.wait(wait_s)

    def wait(self, wait_s):
        self.now_s += wait_s
        return self.modem.take_output(self.now_s)


@pytest.fixture
def bench():
    bench = Bench()
    assert bench.send(b"AT\r") == b"AT\r\r\nOK\r\n"
    bench.send(b"ATE0\r")
    return bench


def test_message_from_the_boat_is_delivered_after_its_checksum_matches(bench):
    assert bench.send(b"AT+CGSN\r") == b"\r\n300234010753370\r\n\r\nOK\r\n"
    assert bench.send(b"AT+SBDWB=5\r") == b"\r\nREADY\r\n"
    assert bench.send(b"hello\x02\x15") == b"\r\n2\r\n\r\nOK\r\n"
    bench.send(b"AT+SBDWB=5\r")
    assert bench.send(b"hello\x02\x14") == b"\r\n0\r\n\r\nOK\r\n"
    assert bench.send(b"AT+SBDIX\r", 30.0) == b"\r\n+SBDIX: 0, 0, 0, 0, 0, 0\r\n\r\nOK\r\n"
    assert [message for _, _, message in bench.network.delivered] == [b"hello"]
    assert bench.send(b"AT+SBDWB=341\r") == b"\r\n3\r\n\r\nOK\r\n"


def test_message_to_the_boat_is_announced_and_read(bench):
    bench.send(b"AT+SBDMTA=1\r")
    bench.network.send(b"hi")
    bench.network.send(b"again")
    assert b"SBDRING" in bench.wait(3.0)
    reply = bench.send(b"AT+SBDIXA\r", 30.0)
    assert f"+SBDIX: 0, 0, 1, {bench.modem._in_number}, 2, 1".encode() in reply
    assert bench.send(b"AT+SBDRB\r") == b"\0\2hi\x00\xd1\r\nOK\r\n"
    assert b"+SBDSX: 0, 1, 1, " in bench.send(b"AT+SBDSX\r")
    bench.send(b"AT+SBDD1\r")
    assert b"+SBDSX: 0, 1, 0, -1, 0, 1" in bench.send(b"AT+SBDSX\r")


def test_failed_session_keeps_number_and_message(bench):
    bench.network.failed = 1.0
    bench.send(b"AT+SBDWB=1\r")
    bench.send(b"x\x00x")
    bench.send(b"AT+SBDIX\r", 30.0)
    bench.network.failed = 0.0
    assert b"+SBDIX: 0, 0, " in bench.send(b"AT+SBDIX\r", 30.0)
    assert bench.network.bill.total == 1


def test_commands_are_ignored_during_a_session(bench):
    bench.send(b"AT+SBDIX\r", 0.1)
    assert b"CSQ" not in bench.send(b"AT+CSQ\r", 40.0)
    assert b"+CSQ:5" in bench.send(b"AT+CSQ\r", 2.0)
    assert bench.send(b"AT+NONSENSE\r") == b"\r\nERROR\r\n"


def test_session_without_signal_fails_with_32():
    assert b"+SBDIX: 32, " in Bench(signal=lambda _now_s: 0).send(b"AT+SBDIX\r", 30.0)
