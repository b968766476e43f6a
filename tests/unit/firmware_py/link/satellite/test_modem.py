"""A modem that is less kind than the emulated one, by a script of what it says to each command."""

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
    """Answers at once but to AT+CSQ and sessions; `sessions` are the words behind +SBDIX:, the last one for ever."""

    def __init__(self, *sessions, measure_s=2.0, session_s=10.0, signal=5):
        self.sessions = deque(sessions or ("0, 1, 0, 0, 0, 0",))
        self.measure_s, self.session_s, self.signal = measure_s, session_s, signal
        self.calls = []
        self.echo = self.damages = False
        self.held = b"+SBDSX: 0, 1, 0, -1, 0, 0"
        self.refuses = ()
        self.later = []
        self.events = []
        self.now_s = 0.0
        limits = Limits(day=50, month=1500, credit_bytes=50)
        self.driver = SatelliteDriver(
            Ledger(), Settings(limits, 2, 43200.0), lambda _ledger: None, self.events.append, seed=3
        )

    def say(self, data, after_s=0.0):
        self.later.append((self.now_s + after_s, data))

    def run(self, seconds):
        """Let time pass in steps of half a second."""
        for _ in range(round(2 * seconds)):
            self.now_s += 0.5
            replies = b"".join(data for at_s, data in self.later if at_s <= self.now_s)
            self.later = [(at_s, data) for at_s, data in self.later if at_s > self.now_s]
            if replies:
                self.driver.feed(replies, self.now_s)
            if out := self.driver.update(self.now_s, 1.79e9 + self.now_s):
                self.answer(out)
        return self

    def answer(self, out):
        command = out.rstrip(b"\r") if out.startswith(b"AT") else b"the message"
        if self.echo and out.startswith(b"AT"):
            self.say(out)
        if command == b"ATE0":
            self.echo = False
        if command in self.refuses:
            self.say(b"\r\nERROR\r\n")
        elif command.startswith(b"AT+SBDWB"):
            self.say(b"\r\nREADY\r\n")
        elif command == b"AT+SBDRB":
            self.say((READ_OUT[:-1] + b"?" if self.damages else READ_OUT) + b"\r\nOK\r\n")
        elif command in (b"AT+SBDIX", b"AT+SBDIXA"):
            self.calls.append(command)
            words = self.sessions[0] if len(self.sessions) == 1 else self.sessions.popleft()
            self.say(b"\r\n+SBDIX: %b\r\n\r\nOK\r\n" % words.encode(), self.session_s)
        else:
            replies = {
                b"AT+CGSN": IMEI,
                b"AT+SBDSX": self.held,
                b"AT+CSQ": b"+CSQ:%d" % self.signal,
                b"the message": b"0",
            }.get(command, b"")
            self.say(b"\r\n%b\r\n\r\nOK\r\n" % replies, self.measure_s if command == b"AT+CSQ" else 0.0)

    @property
    def texts(self):
        return [event.text for event in self.events]


def report(modem):
    modem.driver.queue.offer(Kind.REPORT, bytes(50))
    return modem


@pytest.mark.parametrize("measure_s", [1.0, 20.0, 45.0])
def test_a_signal_that_takes_long_to_be_measured_is_believed_then(measure_s):
    modem = report(ScriptedModem(measure_s=measure_s)).run(120)
    assert (len(modem.calls), len(modem.driver.queue)) == (1, 0)


@pytest.mark.parametrize(("refused", "calls"), [((b"AT+SBDMTA=1", b"AT&K0"), 1), ((b"ATE0",), 0), ((b"AT+CGSN",), 0)])
def test_a_modem_without_alerts_or_flow_control_is_called_over_all_the_same(refused, calls):
    modem = report(ScriptedModem())
    modem.refuses = refused
    modem.run(120)
    assert len(modem.calls) == calls


def test_a_message_too_long_for_it_is_not_called_for_again_and_again():
    modem = report(ScriptedModem("1, 1, 0, 0, 0, 1")).run(3600)
    assert (len(modem.calls), modem.driver.ledger.day_used) == (1, 1)


def test_a_message_that_was_not_handed_over_is_looked_for_again_ever_more_rarely():
    modem = report(ScriptedModem("0, 1, 2, 0, 0, 0"))
    modem.run(6 * 3600)
    assert modem.driver.counts.sent == 1
    assert 6 <= len(modem.calls) <= 15
    assert modem.texts == ["Satellite out of reach: message not handed over"]
    modem.sessions = deque(("0, 1, 1, 7, 14, 0", "0, 1, 0, 0, 0, 0"))
    modem.run(3700)
    assert modem.driver.received == [(7, MESSAGE)]
    assert modem.texts[1:] == ["Satellite link recovered"]


def test_a_ring_during_a_session_is_followed_after_it():
    modem = report(ScriptedModem("0, 1, 0, 0, 0, 0", "0, 2, 1, 7, 14, 0", "0, 3, 0, 0, 0, 0"))
    while not modem.calls:
        modem.run(0.5)
    modem.say(b"\r\nSBDRING\r\n")
    modem.run(3600)
    assert modem.calls == [b"AT+SBDIX", b"AT+SBDIXA"]
    assert modem.driver.received == [(7, MESSAGE)]


def test_a_modem_that_was_reset_and_echoes_hands_its_message_over():
    modem = ScriptedModem("0, 1, 1, 7, 14, 0", "0, 2, 0, 0, 0, 0").run(10)
    modem.echo = True
    report(modem).run(120)
    assert modem.driver.received == [(7, MESSAGE)]
    assert modem.driver.counts.refused == {}


@pytest.mark.parametrize(("ring", "waiting", "ringing"), [(0, 0, False), (1, 0, True), (0, 1, True), (0, -1, False)])
def test_a_message_ashore_is_known_from_the_set_up(ring, waiting, ringing):
    modem = ScriptedModem()
    modem.held = b"+SBDSX: 0, 1, 0, -1, %d, %d" % (ring, waiting)
    while not modem.driver.modem.ready and modem.now_s < 10.0:
        modem.run(0.5)
    assert modem.driver.modem.ringing is ringing


def test_a_message_damaged_on_the_line_is_read_again_after_the_set_up():
    modem = ScriptedModem("0, 1, 1, 7, 14, 0").run(10)
    modem.damages = True
    report(modem)
    while not modem.driver.counts.refused:
        modem.run(0.5)
    assert modem.run(0.5).driver.modem.failing_since_s == modem.now_s
    modem.damages, modem.held = False, b"+SBDSX: 0, 1, 1, 7, 0, 0"
    modem.run(9)
    assert modem.driver.received == []
    assert modem.run(8).driver.received == [(7, MESSAGE)]
    assert (len(modem.calls), modem.driver.modem.failing_since_s) == (1, None)


@pytest.mark.parametrize(
    ("words", "signal", "reason"),
    [
        ("33, 1, 0, 0, 0, 0", 5, "status 33, antenna fault"),
        ("65, 1, 0, 0, 0, 0", 5, "status 65, not known"),
        ("0, 1, 0, 0, 0, 0", 1, "signal 1 of 5"),
    ],
)
def test_a_satellite_that_is_not_reached_for_half_an_hour_is_reported_once_and_why(words, signal, reason):
    modem = report(ScriptedModem(words, signal=signal)).run(1700)
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


def test_what_waits_for_credits_and_a_ring_that_no_peer_can_pay_for_are_seen():
    modem = ScriptedModem("0, 1, 0, 0, 0, 0")
    modem.driver.ledger = Ledger(day=20717, month=680, day_used=50, month_used=50, total=50)
    modem.run(10)
    assert modem.driver.blocked_reason == ""
    modem.say(b"\r\nSBDRING\r\n")
    modem.run(60)
    assert (modem.calls, modem.driver.blocked_reason) == ([], "credits used up")
    report(modem).run(60)
    assert (modem.calls, modem.driver.blocked_reason) == ([], "credits used up")
    assert modem.texts == ["Satellite credits used up: 50 today, 50 this month"]
