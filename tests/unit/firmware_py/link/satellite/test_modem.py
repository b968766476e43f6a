"""Driver with a scripted modem that has more faults than the emulated one."""

import random
from collections import deque
from itertools import pairwise

import pytest
from msgspec.structs import replace

from firmware_py.common.records import Severity
from firmware_py.link.satellite.driver import SatelliteDriver, Settings
from firmware_py.link.satellite.messages import Kind
from firmware_py.link.satellite.record import Ledger, Limits

IMEI = b"300234010753370"
MESSAGE = b"\xfdhers\nand more"  # with an end of line
SESSION, SIGNAL, SERIAL_NUMBER, STATUS = (b"AT+SBDIX", b"AT+SBDIXA"), b"AT+CSQ", b"AT+CGSN", b"AT+SBDSX"
# +SBDIX: status and number of the sent message; status, number and length of the received one; queued messages.
DELIVERED, RECEIVED = "0, 1, 0, 0, 0, 0", "0, 1, 1, 7, 14, 0"  # sent; sent, and a message received


class ScriptedModem:
    """Modem with immediate replies except to those commands that have a delay in `delays_s`.

    `sessions` are the values of +SBDIX; the last one is repeated. The modem replies to `commands` with `replies`.
    """

    def __init__(self, *sessions, signal=5, delays_s=()):
        self.sessions = deque(sessions or (DELIVERED,))
        self.delays_s = dict.fromkeys(SESSION, 10.0) | {SIGNAL: 2.0} | dict(delays_s)
        self.replies = {SERIAL_NUMBER: IMEI, STATUS: b"+SBDSX: 0, 1, 0, -1, 0, 0", b"the message": b"0"}
        self.replies[SIGNAL] = b"+CSQ:%d" % signal
        self.message, self.piece_bytes = MESSAGE, 4096
        self.commands = []
        self.echoes = self.damages = self.is_silent = False
        self.rejected_commands = ()
        self.pending = []
        self.events = []
        self.now_s = 0.0
        limits = Limits(day=50, month=1500, credit_bytes=50)
        self.driver = SatelliteDriver(
            Ledger(),
            Settings(limits, min_signal=2, mailbox_s=43_200.0),
            lambda _ledger: None,
            self.events.append,
            seed=3,
        )

    def send(self, data, after_s=0.0):
        self.pending.append((self.now_s + after_s, data))

    @property
    def calls(self):
        """The commands that started a session."""
        return [command for _, command in self.commands if command in SESSION]

    def intervals_s(self, *commands):
        """Return the intervals between these commands."""
        return [
            later - earlier for earlier, later in pairwise(at_s for at_s, name in self.commands if name in commands)
        ]

    def run(self, seconds, step_s=0.5):
        """Run in steps."""
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            replies = b"".join(data for at_s, data in self.pending if at_s <= self.now_s)
            self.pending = [(at_s, data) for at_s, data in self.pending if at_s > self.now_s]
            for start in range(0, len(replies), self.piece_bytes):
                self.driver.feed(replies[start : start + self.piece_bytes], self.now_s)
            if output := self.driver.update(self.now_s, 1.79e9 + self.now_s):
                self.reply(output)
        return self

    def reply(self, output):
        command = output.rstrip(b"\r") if output.startswith(b"AT") else b"the message"
        self.commands.append((self.now_s, command))
        if self.is_silent:
            return
        if self.echoes and output.startswith(b"AT"):
            self.send(output)
        if command == b"ATE0":
            self.echoes = False
        delay_s = self.delays_s.get(command, 0.0)
        if command in self.rejected_commands:
            self.send(b"\r\nERROR\r\n")
        elif command.startswith(b"AT+SBDWB"):
            self.send(b"\r\nREADY\r\n")
        elif command == b"AT+SBDRB":
            checksum = (sum(self.message) + self.damages) & 0xFFFF
            read_out = len(self.message).to_bytes(2, "big") + self.message + checksum.to_bytes(2, "big")
            self.send(read_out + b"\r\nOK\r\n")
        elif command in SESSION:
            values = self.sessions[0] if len(self.sessions) == 1 else self.sessions.popleft()
            self.send(b"\r\n+SBDIX: %b\r\n\r\nOK\r\n" % values.encode(), delay_s)
        else:
            self.send(b"\r\n%b\r\n\r\nOK\r\n" % self.replies.get(command, b""), delay_s)

    @property
    def texts(self):
        return [event.text for event in self.events]


def queue_report(modem):
    modem.driver.queue.offer(Kind.REPORT, bytes(50))
    return modem


@pytest.mark.parametrize(
    ("command", "delay_s", "sent"),
    [(SIGNAL, 50.5, 1), (SIGNAL, 51.0, 0), (SESSION[0], 120.5, 1), (SESSION[0], 121.0, 0), (b"the message", 10.5, 1),
     (b"the message", 11.0, 0)],
)  # fmt: skip
def test_reply_is_awaited_until_its_timeout(command, delay_s, sent):
    modem = queue_report(ScriptedModem(delays_s={command: delay_s}))
    assert modem.run(150).driver.counts.sent == sent


@pytest.mark.parametrize(
    ("command", "reply", "calls"),
    [
        *((SIGNAL, reply, 1) for reply in (b"+CSQ:5", b"+CSQ:2", b"+CSQ:000005", b"x\r\n" * 7 + b"+CSQ:5")),
        *(
            (SIGNAL, reply, 0)
            for reply in (b"+CSQ:1", b"+CSQ:6", b"+CSQ:5, 5", b"+CSQ:5\r\n+CSQ:5", b"+CSQ:", b"+CSQ:x")
        ),
        *((SIGNAL, reply, 0) for reply in (b"+CSQ:0000005", b"+CSQ:5\r\nERROR", b"x\r\n" * 8 + b"+CSQ:5")),
        *((SERIAL_NUMBER, reply, 0) for reply in (IMEI[1:], b"FIFTEEN LETTERS", IMEI + b"\r\nERROR")),
        *((b"the message", reply, 0) for reply in (b"1", b"", b"0\r\nERROR")),
        *((STATUS, reply, 0) for reply in (b"+SBDSX: 0, 1, 0, -1, 0", b"+SBDSX: 0, 1, 0, -, 0, 0")),
    ],
)
def test_session_needs_valid_replies_and_a_sufficient_signal(command, reply, calls):
    modem = queue_report(ScriptedModem())
    modem.replies[command] = reply
    assert len(modem.run(30).calls) == calls
    assert (modem.driver.counts.sent, modem.driver.ledger.total) == (calls, calls)


@pytest.mark.parametrize(("rejected", "calls"), [((b"AT+SBDMTA=1", b"AT&K0"), 1), ((b"ATE0",), 0), ((b"AT+CGSN",), 0)])
def test_modem_may_reject_alerts_and_flow_control_only(rejected, calls):
    modem = queue_report(ScriptedModem())
    modem.rejected_commands = rejected
    modem.run(120)
    assert len(modem.calls) == calls
    if rejected == (SERIAL_NUMBER,):  # ten seconds, and half a second for each reply
        assert set(modem.intervals_s(SERIAL_NUMBER)) == {13.0}


def test_queued_message_too_long_for_the_modem_causes_one_session():
    modem = queue_report(ScriptedModem("1, 1, 0, 0, 0, 1")).run(3600)
    assert (len(modem.calls), modem.driver.ledger.day_used) == (1, 1)


def test_undelivered_message_is_requested_at_increasing_intervals():
    modem = queue_report(ScriptedModem("0, 1, 2, 0, 0, 0"))
    modem.run(6 * 3600)
    assert modem.driver.counts.sent == 1
    assert 6 <= len(modem.calls) <= 15
    assert modem.texts == ["Satellite out of reach: message not handed over"]
    modem.sessions = deque((RECEIVED, DELIVERED))
    modem.run(3700)
    assert modem.driver.received == [(7, MESSAGE)]
    assert modem.texts[1:] == ["Satellite link recovered"]


def test_ring_during_a_session_causes_another_session():
    modem = queue_report(ScriptedModem(DELIVERED, "0, 2, 1, 7, 14, 0", "0, 3, 0, 0, 0, 0"))
    while not modem.calls:
        modem.run(0.5)
    modem.send(b"\r\nSBDRING\r\n")
    modem.run(3600)
    assert modem.calls == [b"AT+SBDIX", b"AT+SBDIXA"]
    assert modem.driver.received == [(7, MESSAGE)]


def test_message_is_read_from_a_modem_that_echoes_after_a_reset():
    modem = ScriptedModem(RECEIVED, "0, 2, 0, 0, 0, 0").run(10)
    modem.echoes = True
    queue_report(modem).run(120)
    assert modem.driver.received == [(7, MESSAGE)]
    assert modem.driver.counts.refused == {}


@pytest.mark.parametrize(("ring", "waiting", "ringing"), [(0, 0, False), (1, 0, True), (0, 1, True), (0, -1, False)])
def test_setup_detects_a_waiting_message(ring, waiting, ringing):
    modem = ScriptedModem()
    modem.replies[STATUS] = b"+SBDSX: 0, 1, 0, -1, %d, %d" % (ring, waiting)
    while not modem.driver.modem.is_ready and modem.now_s < 10.0:
        modem.run(0.5)
    assert modem.driver.modem.is_ringing is ringing


def test_message_damaged_on_the_line_is_read_again_after_the_setup():
    modem = ScriptedModem(RECEIVED).run(10)
    modem.damages = True
    queue_report(modem)
    while not modem.driver.counts.refused:
        modem.run(0.5)
    assert modem.run(0.5).driver.modem.failing_since_s == modem.now_s
    modem.damages, modem.replies[STATUS] = False, b"+SBDSX: 0, 1, 1, 7, 0, 0"
    modem.run(9)
    assert modem.driver.received == []
    assert modem.run(8).driver.received == [(7, MESSAGE)]
    assert (len(modem.calls), modem.driver.modem.failing_since_s) == (1, None)


@pytest.mark.parametrize(
    ("values", "signal", "reason"),
    [
        ("33, 1, 0, 0, 0, 0", 5, "status 33, antenna fault"),
        ("65, 1, 0, 0, 0, 0", 5, "status 65, not known"),
        (DELIVERED, 1, "signal 1 of 5"),
    ],
)
def test_outage_of_half_an_hour_is_reported_once_with_its_reason(values, signal, reason):
    modem = queue_report(ScriptedModem(values, signal=signal)).run(1804.5)  # the setup takes 4.5 s
    assert modem.driver.blocked_reason == reason
    assert modem.events == []
    modem.run(0.5)
    assert len(modem.events) == 1
    modem.run(6000)
    assert [(event.severity, event.text) for event in modem.events] == [
        (Severity.WARNING, f"Satellite out of reach: {reason}")
    ]
    modem.sessions, modem.replies[SIGNAL] = deque([DELIVERED]), b"+CSQ:5"
    modem.run(600)
    assert modem.texts[1:] == ["Satellite link recovered"]
    assert modem.driver.blocked_reason == ""


def test_used_credits_are_the_blocked_reason_of_a_ring_and_a_report():
    modem = ScriptedModem(DELIVERED)
    modem.driver.ledger = Ledger(day=20717, month=680, day_used=50, month_used=50, total=50)
    modem.run(10)
    assert modem.driver.blocked_reason == ""
    modem.send(b"\r\nSBDRING\r\n")
    modem.run(60)
    assert (modem.calls, modem.driver.blocked_reason) == ([], "credits used up")
    queue_report(modem).run(60)
    assert (modem.calls, modem.driver.blocked_reason) == ([], "credits used up")
    assert modem.texts == ["Satellite credits used up: 50 today, 50 this month"]


@pytest.mark.parametrize(
    ("status", "later_s"), [(13, [600.0, 1200.0, 2400.0, 3600.0, 3600.0]), (32, [300.0] * 5), (36, [300.0] * 5)]
)
def test_waits_after_failures_increase(status, later_s):
    """They double while each failure may have been charged; status 36 has a minimum."""
    modem = queue_report(ScriptedModem(f"{status}, 1, 0, 0, 0, 0", delays_s={SIGNAL: 0.0}))
    modem.run(100 if status != 36 else 600, step_s=0.02).run(5 * 3600, step_s=1.0)
    draws = random.Random(3)
    first_s = [draws.uniform(0.0, max_s) for max_s in (5.0, 5.0, 30.0, 30.0)]
    expected_s = [*first_s, *(mean_s * draws.uniform(0.8, 1.2) for mean_s in later_s)]
    assert next(at_s for at_s, name in modem.commands if name in SESSION) < 0.5
    waits_s = [interval_s - 10.0 for interval_s in modem.intervals_s(*SESSION)]
    if status == 36:
        expected_s = [max(wait_s, 180.0) for wait_s in expected_s]
    assert waits_s[:3] == pytest.approx(expected_s[:3], abs=0.1)
    assert waits_s[3:9] == pytest.approx(expected_s[3:], abs=5.0)


def test_signal_is_measured_at_increasing_intervals_until_it_is_sufficient():
    modem = queue_report(ScriptedModem(signal=1)).run(400)
    assert modem.intervals_s(SIGNAL) == [17.0, 32.0, 62.0, 122.0, 122.0]  # a measurement takes two seconds
    modem.replies[SIGNAL] = b"+CSQ:2"
    assert modem.run(120).calls == [SESSION[0]]
    queue_report(modem).replies[SIGNAL] = b"+CSQ:1"
    modem.commands.clear()
    assert modem.run(30).intervals_s(SIGNAL) == [17.0]


@pytest.mark.parametrize(("pause_s", "measurements"), [(15.0, 1), (15.5, 2)])
def test_old_signal_is_measured_again(pause_s, measurements):
    modem = queue_report(ScriptedModem()).run(4.5)
    modem.run(1.5)
    modem.now_s += 0.5
    modem.driver.feed(b"+CSQ:5\r\nOK\r\n", modem.now_s)
    modem.pending.clear()
    modem.run(pause_s, step_s=pause_s).run(1)
    assert [command for _, command in modem.commands].count(SIGNAL) == measurements


@pytest.mark.parametrize(
    ("status", "sent", "charged"),
    [
        *((status, 1, 1) for status in ("0", "1", "4")),
        *((status, 0, 1) for status in ("13", "17", "18", "19", "no number")),
        *((status, 0, 0) for status in ("5", "10", "12", "14", "16", "20", "32", "36", "-1")),
    ],
)
def test_failure_is_charged_if_the_message_may_have_arrived(status, sent, charged):
    modem = queue_report(ScriptedModem(f"{status}, 1, 0, 0, 0, 0"))
    while not modem.driver.counts.sent + modem.driver.counts.failed and modem.now_s < 60.0:
        modem.run(0.5)
    assert (modem.driver.counts.sent, modem.driver.ledger.total) == (sent, charged)


@pytest.mark.parametrize("piece_bytes", [1, 4096])
@pytest.mark.parametrize(("size", "is_received"), [(1, True), (255, True), (256, True), (340, True), (341, False)])
def test_received_message_has_at_most_340_bytes(size, is_received, piece_bytes):
    modem = queue_report(ScriptedModem(RECEIVED, DELIVERED))
    modem.piece_bytes = piece_bytes
    modem.message = bytes(size - 1) + b"x"
    modem.run(40)
    assert modem.driver.received == [(7, modem.message)] * is_received
    assert modem.driver.counts.refused == ({} if is_received else {"damaged on the line of the modem": 1})


@pytest.mark.parametrize(("values", "count", "charged"), [(DELIVERED, 0, 1), ("0, 1, 1, 7, 101, 0", 1, 3)])
def test_mailbox_is_checked_at_its_interval(values, count, charged):
    """A check costs one credit, or that of the received message."""
    modem = ScriptedModem(values, DELIVERED)
    modem.message = bytes(101)
    modem.run(43_190, step_s=10.0)
    assert modem.calls == []
    modem.run(60)
    assert (43_200.0, SIGNAL) in modem.commands
    counts = modem.driver.counts
    assert (counts.sessions, counts.failed, counts.sent, counts.sent_bytes, counts.received) == (1, 0, 0, 0, count)
    assert (len(modem.driver.received), modem.driver.ledger.total) == (count, charged)
    modem.run(43_100, step_s=10.0)
    assert len(modem.calls) == 1
    assert len(modem.run(100).calls) == 2


def test_mailbox_is_not_checked_with_interval_zero():
    modem = ScriptedModem()
    modem.driver.settings = replace(modem.driver.settings, mailbox_s=0.0)
    assert modem.run(90_000, step_s=10.0).calls == []


def test_next_message_in_the_network_is_received_at_once():
    modem = queue_report(ScriptedModem("0, 1, 1, 7, 14, 1", "0, 2, 1, 8, 14, 0", DELIVERED)).run(60)
    assert modem.driver.received == [(7, MESSAGE), (8, MESSAGE)]
    assert (len(modem.calls), modem.driver.counts.received, modem.driver.ledger.total) == (2, 2, 3)
    assert [command for _, command in modem.commands].count(SIGNAL) == 2


def test_lost_line_ends_the_session_and_the_modem_is_set_up_again():
    modem = queue_report(ScriptedModem())
    while not modem.calls:
        modem.run(0.5)
    modem.pending.clear()
    modem.driver.feed(b"\r\n+SBDIX: 0, ", modem.now_s)
    modem.driver.restart(modem.now_s)
    assert (modem.driver.counts.failed, modem.driver.ledger.total, modem.driver.modem.is_ready) == (1, 1, False)
    modem.run(60)
    assert (len(modem.calls), modem.driver.counts.sent, modem.driver.ledger.total) == (2, 1, 2)
    modem.driver.restart(modem.now_s)
    assert modem.driver.counts.failed == 1


def test_silent_modem_is_reported_after_a_minute():
    modem = ScriptedModem()
    modem.is_silent = True
    modem.run(92)  # the setup fails after three replies of ten seconds are missing
    assert modem.events == []
    modem.run(0.5)
    assert modem.texts == ["Satellite modem not responding"]
    modem.is_silent = False
    modem.run(60)
    assert [event.severity for event in modem.events] == [Severity.WARNING, Severity.NOTICE]


def test_first_session_of_a_day_has_all_credits():
    modem = ScriptedModem()
    modem.driver.ledger = Ledger(day=20000, month=657, day_used=50, month_used=60, total=70)
    ledger = modem.run(5).driver.ledger
    assert (ledger.day_used, ledger.month_used, ledger.total) == (0, 0, 70)
    assert queue_report(modem).run(30).driver.ledger.day_used == 1
    modem.driver.update(modem.now_s, 1.79e9 + 86_400.0)
    assert modem.driver.ledger.day_used == 0


@pytest.mark.parametrize(
    ("used", "size", "calls", "reports"),
    [(44, 50, 1, 0), (44, 51, 0, 0), (45, 50, 0, 1), (49, 50, 0, 1), (49, 0, 1, 0)],
)
def test_last_credit_of_a_priority_is_used(used, size, calls, reports):
    modem = ScriptedModem()
    modem.driver.ledger = Ledger(day=20717, month=680, day_used=used, month_used=used, total=used)
    if size:
        modem.driver.queue.offer(Kind.REPORT, bytes(size))
    else:
        modem.send(b"\r\nSBDRING\r\n")
    assert (len(modem.run(30).calls), len(modem.events)) == (calls, reports)


@pytest.mark.parametrize(("spaces", "calls"), [(250, 1), (251, 0)])
def test_last_256_bytes_of_an_unfinished_line_are_stored(spaces, calls):
    modem = queue_report(ScriptedModem())
    while modem.commands[-1:] != [(modem.now_s, SIGNAL)]:
        modem.run(0.5)
    modem.pending.clear()
    modem.driver.feed(b"x" * 100 + b"+CSQ:5" + b" " * spaces, modem.now_s)
    modem.driver.feed(b"\r\nOK\r\n", modem.now_s)
    assert len(modem.run(5).calls) == calls
