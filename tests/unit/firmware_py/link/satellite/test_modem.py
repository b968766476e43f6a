"""Driver with a scripted modem that has more faults than the emulated one."""

from collections import deque

import pytest

from firmware_py.common.records import Severity
from firmware_py.link.satellite.driver import SatelliteDriver, Settings
from firmware_py.link.satellite.messages import Kind
from firmware_py.link.satellite.record import Ledger, Limits

IMEI = b"300234010753370"
MESSAGE = b"\xfdhers\nand more"
READ_OUT = b"\x00\x0e" + MESSAGE + (sum(MESSAGE) & 0xFFFF).to_bytes(2, "big")


class ScriptedModem:
    """Modem with immediate replies except to AT+CSQ and sessions.

    `sessions` are the values of +SBDIX; the last one is repeated.
    """

    def __init__(self, *sessions, measure_s=2.0, session_s=10.0, signal=5):
        self.sessions = deque(sessions or ("0, 1, 0, 0, 0, 0",))
        self.measure_s, self.session_s, self.signal = measure_s, session_s, signal
        self.calls = []
        self.echoes = self.damages = False
        self.sbdsx = b"+SBDSX: 0, 1, 0, -1, 0, 0"
        self.rejected_commands = ()
        self.pending = []
        self.events = []
        self.now_s = 0.0
        limits = Limits(day=50, month=1500, credit_bytes=50)
        self.driver = SatelliteDriver(
            Ledger(), Settings(limits, 2, 43200.0), lambda _ledger: None, self.events.append, seed=3
        )

    def send(self, data, after_s=0.0):
        self.pending.append((self.now_s + after_s, data))

    def run(self, seconds):
        """Run in steps of half a second."""
        for _ in range(round(2 * seconds)):
            self.now_s += 0.5
            replies = b"".join(data for at_s, data in self.pending if at_s <= self.now_s)
            self.pending = [(at_s, data) for at_s, data in self.pending if at_s > self.now_s]
            if replies:
                self.driver.feed(replies, self.now_s)
            if output := self.driver.update(self.now_s, 1.79e9 + self.now_s):
                self.reply(output)
        return self

    def reply(self, output):
        command = output.rstrip(b"\r") if output.startswith(b"AT") else b"the message"
        if self.echoes and output.startswith(b"AT"):
            self.send(output)
        if command == b"ATE0":
            self.echoes = False
        if command in self.rejected_commands:
            self.send(b"\r\nERROR\r\n")
        elif command.startswith(b"AT+SBDWB"):
            self.send(b"\r\nREADY\r\n")
        elif command == b"AT+SBDRB":
            self.send((READ_OUT[:-1] + b"?" if self.damages else READ_OUT) + b"\r\nOK\r\n")
        elif command in (b"AT+SBDIX", b"AT+SBDIXA"):
            self.calls.append(command)
            values = self.sessions[0] if len(self.sessions) == 1 else self.sessions.popleft()
            self.send(b"\r\n+SBDIX: %b\r\n\r\nOK\r\n" % values.encode(), self.session_s)
        else:
            replies = {
                b"AT+CGSN": IMEI,
                b"AT+SBDSX": self.sbdsx,
                b"AT+CSQ": b"+CSQ:%d" % self.signal,
                b"the message": b"0",
            }.get(command, b"")
            self.send(b"\r\n%b\r\n\r\nOK\r\n" % replies, self.measure_s if command == b"AT+CSQ" else 0.0)

    @property
    def texts(self):
        return [event.text for event in self.events]


def queue_report(modem):
    modem.driver.queue.offer(Kind.REPORT, bytes(50))
    return modem


@pytest.mark.parametrize("measure_s", [1.0, 20.0, 45.0])
def test_session_starts_after_a_slow_signal_measurement(measure_s):
    modem = queue_report(ScriptedModem(measure_s=measure_s)).run(120)
    assert (len(modem.calls), len(modem.driver.queue)) == (1, 0)


@pytest.mark.parametrize(("rejected", "calls"), [((b"AT+SBDMTA=1", b"AT&K0"), 1), ((b"ATE0",), 0), ((b"AT+CGSN",), 0)])
def test_modem_may_reject_alerts_and_flow_control_only(rejected, calls):
    modem = queue_report(ScriptedModem())
    modem.rejected_commands = rejected
    modem.run(120)
    assert len(modem.calls) == calls


def test_queued_message_too_long_for_the_modem_causes_one_session():
    modem = queue_report(ScriptedModem("1, 1, 0, 0, 0, 1")).run(3600)
    assert (len(modem.calls), modem.driver.ledger.day_used) == (1, 1)


def test_undelivered_message_is_requested_at_increasing_intervals():
    modem = queue_report(ScriptedModem("0, 1, 2, 0, 0, 0"))
    modem.run(6 * 3600)
    assert modem.driver.counts.sent == 1
    assert 6 <= len(modem.calls) <= 15
    assert modem.texts == ["Satellite out of reach: message not handed over"]
    modem.sessions = deque(("0, 1, 1, 7, 14, 0", "0, 1, 0, 0, 0, 0"))
    modem.run(3700)
    assert modem.driver.received == [(7, MESSAGE)]
    assert modem.texts[1:] == ["Satellite link recovered"]


def test_ring_during_a_session_causes_another_session():
    modem = queue_report(ScriptedModem("0, 1, 0, 0, 0, 0", "0, 2, 1, 7, 14, 0", "0, 3, 0, 0, 0, 0"))
    while not modem.calls:
        modem.run(0.5)
    modem.send(b"\r\nSBDRING\r\n")
    modem.run(3600)
    assert modem.calls == [b"AT+SBDIX", b"AT+SBDIXA"]
    assert modem.driver.received == [(7, MESSAGE)]


def test_message_is_read_from_a_modem_that_echoes_after_a_reset():
    modem = ScriptedModem("0, 1, 1, 7, 14, 0", "0, 2, 0, 0, 0, 0").run(10)
    modem.echoes = True
    queue_report(modem).run(120)
    assert modem.driver.received == [(7, MESSAGE)]
    assert modem.driver.counts.refused == {}


@pytest.mark.parametrize(("ring", "waiting", "ringing"), [(0, 0, False), (1, 0, True), (0, 1, True), (0, -1, False)])
def test_setup_detects_a_waiting_message(ring, waiting, ringing):
    modem = ScriptedModem()
    modem.sbdsx = b"+SBDSX: 0, 1, 0, -1, %d, %d" % (ring, waiting)
    while not modem.driver.modem.is_ready and modem.now_s < 10.0:
        modem.run(0.5)
    assert modem.driver.modem.is_ringing is ringing


def test_message_damaged_on_the_line_is_read_again_after_the_setup():
    modem = ScriptedModem("0, 1, 1, 7, 14, 0").run(10)
    modem.damages = True
    queue_report(modem)
    while not modem.driver.counts.refused:
        modem.run(0.5)
    assert modem.run(0.5).driver.modem.failing_since_s == modem.now_s
    modem.damages, modem.sbdsx = False, b"+SBDSX: 0, 1, 1, 7, 0, 0"
    modem.run(9)
    assert modem.driver.received == []
    assert modem.run(8).driver.received == [(7, MESSAGE)]
    assert (len(modem.calls), modem.driver.modem.failing_since_s) == (1, None)


@pytest.mark.parametrize(
    ("values", "signal", "reason"),
    [
        ("33, 1, 0, 0, 0, 0", 5, "status 33, antenna fault"),
        ("65, 1, 0, 0, 0, 0", 5, "status 65, not known"),
        ("0, 1, 0, 0, 0, 0", 1, "signal 1 of 5"),
    ],
)
def test_outage_of_half_an_hour_is_reported_once_with_its_reason(values, signal, reason):
    modem = queue_report(ScriptedModem(values, signal=signal)).run(1700)
    assert modem.driver.blocked_reason == reason
    assert modem.events == []
    modem.run(6000)
    assert [(event.severity, event.text) for event in modem.events] == [
        (Severity.WARNING, f"Satellite out of reach: {reason}")
    ]
    modem.sessions, modem.signal = deque(["0, 1, 0, 0, 0, 0"]), 5
    modem.run(600)
    assert modem.texts[1:] == ["Satellite link recovered"]
    assert modem.driver.blocked_reason == ""


def test_used_credits_are_the_blocked_reason_of_a_ring_and_a_report():
    modem = ScriptedModem("0, 1, 0, 0, 0, 0")
    modem.driver.ledger = Ledger(day=20717, month=680, day_used=50, month_used=50, total=50)
    modem.run(10)
    assert modem.driver.blocked_reason == ""
    modem.send(b"\r\nSBDRING\r\n")
    modem.run(60)
    assert (modem.calls, modem.driver.blocked_reason) == ([], "credits used up")
    queue_report(modem).run(60)
    assert (modem.calls, modem.driver.blocked_reason) == ([], "credits used up")
    assert modem.texts == ["Satellite credits used up: 50 today, 50 this month"]
