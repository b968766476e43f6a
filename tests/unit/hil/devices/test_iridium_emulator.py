"""The emulated Iridium modem, by the words of the AT Command Reference."""

import numpy as np
import pytest

from hil.devices.iridium import IridiumModem
from hil.devices.iridium_network import IridiumNetwork


class Bench:
    """Types commands and reads what comes."""

    def __init__(self, **network):
        self.network = IridiumNetwork(np.random.default_rng(1), **network)
        self.modem = IridiumModem(self.network)
        self.now_s = 0.0

    def type(self, data, seconds=1.0):
        self.modem.receive(self.now_s, data)
        return self.wait(seconds)

    def wait(self, seconds):
        self.now_s += seconds
        return self.modem.take_output(self.now_s)


@pytest.fixture
def bench():
    made = Bench()
    assert made.type(b"AT\r") == b"AT\r\r\nOK\r\n"
    made.type(b"ATE0\r")
    return made


def test_echo(bench):
    assert bench.type(b"AT+CGSN\r") == b"\r\n300234010753370\r\n\r\nOK\r\n"


def test_message_from_the_boat(bench):
    assert bench.type(b"AT+SBDWB=5\r") == b"\r\nREADY\r\n"
    assert bench.type(b"hello\x02\x15") == b"\r\n2\r\n\r\nOK\r\n"
    bench.type(b"AT+SBDWB=5\r")
    assert bench.type(b"hello\x02\x14") == b"\r\n0\r\n\r\nOK\r\n"
    assert bench.type(b"AT+SBDIX\r", 30.0) == b"\r\n+SBDIX: 0, 0, 0, 0, 0, 0\r\n\r\nOK\r\n"
    assert [message for _, _, message in bench.network.delivered] == [b"hello"]
    assert bench.type(b"AT+SBDWB=341\r") == b"\r\n3\r\n\r\nOK\r\n"


def test_message_to_the_boat(bench):
    bench.type(b"AT+SBDMTA=1\r")
    bench.network.send(b"hi")
    bench.network.send(b"again")
    assert b"SBDRING" in bench.wait(3.0)
    answer = bench.type(b"AT+SBDIXA\r", 30.0)
    number = bench.modem._in_number
    assert f"+SBDIX: 0, 0, 1, {number}, 2, 1".encode() in answer
    assert bench.type(b"AT+SBDRB\r") == b"\0\2hi\x00\xd1\r\nOK\r\n"
    assert b"+SBDSX: 0, 1, 1, " in bench.type(b"AT+SBDSX\r")
    bench.type(b"AT+SBDD1\r")
    assert b"+SBDSX: 0, 1, 0, -1, 0, 1" in bench.type(b"AT+SBDSX\r")


def test_failed_session(bench):
    bench.network.failed = 1.0
    bench.type(b"AT+SBDWB=1\r")
    bench.type(b"x\x00x")
    bench.type(b"AT+SBDIX\r", 30.0)
    bench.network.failed = 0.0
    assert b"+SBDIX: 0, 0, " in bench.type(b"AT+SBDIX\r", 30.0)
    assert bench.network.bill.total == 1


def test_session_and_unknown_commands(bench):
    bench.type(b"AT+SBDIX\r", 0.1)
    assert b"CSQ" not in bench.type(b"AT+CSQ\r", 40.0)
    assert bench.type(b"AT+NONSENSE\r") == b"\r\nERROR\r\n"
    assert b"+CSQ:5" in bench.type(b"AT+CSQ\r", 2.0)


def test_no_service():
    bench = Bench(signal=lambda _now_s: 0)
    assert b"+SBDIX: 32, " in bench.type(b"AT+SBDIX\r", 30.0)
