"""State that the services of the link share, and messages to one or all peers."""

import math

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, Arm, SetHome, SetMode, SteerHeading, SteerPosition, Verdict
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.records import Event, Severity
from firmware_py.common.reports import Home
from firmware_py.faults.table import Fault
from firmware_py.link.context import LinkContext, Suppliers, within
from firmware_py.link.parameters.files import ARDUPILOT
from firmware_py.link.peers import Peer
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.outbox import UnsignedSealer
from firmware_py.link.wire.urls import LinkClass, LinkOptions
from support.link import SNAPSHOT, FakeRequestHandler, MemoryTransport

BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)  # of a ground station
BREACHED = 1 << Fault.FENCE_BREACHED


@pytest.fixture
def context():
    return LinkContext(FakeRequestHandler(), Suppliers(lambda: 1.7e9, lambda: 0.25, written=lambda: (3, 99)), Version())


def kinds(messages):
    return [message.get_type() for message in messages]


@pytest.mark.parametrize(
    ("value", "is_within"),
    [(-1.0, True), (2.0, True), (-1.1, False), (2.1, False), (math.nan, False), (math.inf, False)],
)
def test_limits_of_a_received_number_are_allowed(value, is_within):
    assert within(value, -1.0, 2.0) is is_within


def test_telemetry_has_the_state_after_the_latest_tick(context):
    assert (context.telemetry_context(), context.home) == (None, None)
    snapshot = replace(SNAPSHOT, home=Home(0.7, -0.2, 1.0))
    context.update_snapshot(snapshot)
    assert context.home == Home(0.7, -0.2, 1.0)
    limit_rad = math.radians(context.request_handler.parameters()["RUD_LIMIT_DEG"])
    assert context.telemetry_context() == TelemetryContext(
        snapshot=snapshot, utc_s=1.7e9, rudder_limit_rad=limit_rad, autopilot=3, load=0.25, refused_frames=0,
        written=(3, 99),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("faults", "breaches"),
    [
        ((0, 0), (0, 0.0)),
        ((BREACHED,), (1, 1.0)),
        ((BREACHED, BREACHED), (1, 1.0)),
        ((0, BREACHED, 0, BREACHED | 1, 1), (2, 4.0)),
    ],
)
def test_each_fence_breach_is_counted_once(context, faults, breaches):
    for t_s, bits in enumerate(faults, 1):
        context.update_snapshot(replace(SNAPSHOT, t_s=float(t_s), faults=bits))
    assert context.telemetry_context().fence_breaches == breaches


@pytest.mark.parametrize(("age_s", "pulse_us"), [(0.0, 1600), (0.5, 1600), (0.6, None)])
def test_override_is_reported_until_its_timeout(context, age_s, pulse_us):
    context.request_handler.values = context.request_handler.values.replaced("MAN_TIMEOUT_S", 0.5)
    context.update_snapshot(SNAPSHOT)
    context.override_us = 8.0, 1600
    context.now_s = 8.0 + age_s
    assert context.telemetry_context().override_us == pulse_us


@pytest.mark.parametrize(
    ("message", "is_addressee"),
    [
        *(
            (mavlink.MAVLink_param_request_list_message(system, component), system < 2 and component < 2)
            for system in (0, 1, 2)
            for component in (0, 1, 2)
        ),
        (mavlink.MAVLink_manual_control_message(0, 0, 0, 0, 0, 0), True),
        (mavlink.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0), True),
        (mavlink.MAVLink_manual_control_message(2, 0, 0, 0, 0, 0), False),
        (BEAT, True),
    ],
)
def test_message_is_addressed_to_the_boat_or_to_all(context, message, is_addressee):
    assert context.is_addressee(message) is is_addressee


@pytest.mark.parametrize("verdict", [Verdict.ACCEPTED, Verdict.DENIED])
@pytest.mark.parametrize(
    ("intent", "mode", "home_report_due"),
    [
        (SetMode(Mode.HOLD), Mode.HOLD, False),
        (SteerHeading(1.0, change_mode=True), Mode.GUIDED, False),
        (SteerHeading(1.0), None, False),
        (SteerPosition(0.1, 0.2, change_mode=True), Mode.GUIDED, False),
        (SteerPosition(0.1, 0.2), None, False),
        (SetHome(), None, True),
        (Arm(True), None, False),
    ],
)
def test_accepted_request_sets_the_intended_mode_or_the_home_report(context, verdict, intent, mode, home_report_due):
    context.request_handler.answer = Answer(verdict)
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    message = sender.decode(bytearray(BEAT.pack(sender)))
    assert context.request(message, intent, 5.0) == Answer(verdict)
    (request,) = context.request_handler.requests
    assert (request.t_s, request.intent, request.system, request.component) == (5.0, intent, 255, 190)
    expected = (mode, home_report_due) if verdict is Verdict.ACCEPTED else (None, False)
    assert (context.intended_mode, context.home_report_due) == expected


def sent_to(peer):
    """Return the messages that a peer was sent, and forget them."""
    peer.outbox.flush(0.0)
    sent, peer.transport.sent = peer.transport.sent, []
    return mavlink.MAVLink(None).parse_buffer(b"".join(data for _, data in sent)) or []


def test_peer_that_uses_mavlink1_is_notified_once(context, texts):
    peer = Peer(MemoryTransport(), "station", UnsignedSealer(), 0.0)
    context.introduce(peer)
    assert sent_to(peer) == []
    peer.outbox.is_mavlink1_only = True
    for report in ("MAVLink 1 in use: fence, rally and signing need MAVLink 2", ""):
        context.introduce(peer)
        assert "".join(texts(sent_to(peer))) == report


def test_text_is_sent_to_one_or_to_all_peers(context, texts):
    peers = [Peer(MemoryTransport(), number, UnsignedSealer(), 0.0) for number in range(2)]
    context.peers = peers
    context.send_text_all(Severity.NOTICE, "to all")
    assert [texts(sent_to(peer)) for peer in peers] == [["to all"]] * 2
    context.send_text(peers[0], Severity.NOTICE, "to one")
    for _ in range(3):
        context.send_text_limited(peers[1], Severity.NOTICE, "repeated", 5.0)
    context.flush_all()
    assert [texts(sent_to(peer)) for peer in peers] == [["to one"], ["repeated"]]
    assert context.heartbeat().system_status == mavlink.MAV_STATE_BOOT
    context.update_snapshot(SNAPSHOT)
    assert context.heartbeat().system_status == mavlink.MAV_STATE_ACTIVE


@pytest.mark.parametrize(("autopilot", "kind"), [(ARDUPILOT, Kind.INTEGER), (0, Kind.REAL)])
def test_parameter_value_has_the_type_that_the_autopilot_declares(autopilot, kind):
    handler = FakeRequestHandler()
    handler.values = handler.values.replaced("LNK_IDENTITY", autopilot).replaced("LNK_SYSID", 7)
    context = LinkContext(handler, Suppliers(lambda: 0.0, lambda: 0.0), Version())
    value = context.parameter_value(INDEX["LNK_SYSID"], 5)
    assert (value.param_id, value.param_value, value.param_type) == ("LNK_SYSID", 7.0, kind)
    assert (value.param_count, value.param_index) == (len(TABLE), 5)
    assert (context.system, context.component, context.autopilot) == (7, 1, autopilot)


def test_long_texts_are_numbered_from_one(rig, of):
    events = [Event(Severity.WARNING, "x" * 60), Event(Severity.NOTICE, "y" * 60)]
    parts = [(text.id, text.chunk_seq, text.severity) for text in of(rig.tick(events=events), "STATUSTEXT")]
    assert parts == [(1, 0, 4), (1, 1, 4), (2, 0, 5), (2, 1, 5)]


@pytest.mark.parametrize(
    ("link_class", "expected"), [("FAST", ["warning", "notice"]), ("MESSAGES", ["warning"]), ("SATELLITE", [])]
)
def test_paid_links_get_only_warnings_or_nothing(make_rig, texts, link_class, expected):
    rig = make_rig(options=LinkOptions(link_class=LinkClass[link_class]))
    rig.tick()
    events = [Event(Severity.WARNING, "warning"), Event(Severity.NOTICE, "notice")]
    assert texts(rig.tick(events=events)) == expected


@pytest.mark.parametrize(("armed", "first"), [(True, [*["PARAM_VALUE"] * 2, "HEARTBEAT"]), (False, ["HEARTBEAT"])])
def test_arming_checks_are_sent_before_the_first_heartbeat_of_an_armed_boat(make_rig, armed, first):
    """MAVProxy evaluates them then, before it requests anything, and would report that they are disabled."""
    rig = make_rig(addresses=())
    rig.tick(armed=armed)
    replies = rig.send(BEAT, address="station")
    assert kinds(replies) == first
    checks = [(value.param_id, value.param_value) for value in replies[:-1]]
    assert checks == ([("ARMING_CHECK", 1.0), ("ARMING_SKIPCHK", 0.0)] if armed else [])
    replies = [*rig.send(BEAT, address="station"), *rig.tick(armed=armed)]
    assert kinds(replies).count("PARAM_VALUE") == 0


def test_silent_peer_is_sent_arming_checks_before_each_heartbeat(rig, of):
    """On a link that the boat opens itself, a station may start or restart at any time."""
    sent_kinds = [kind for kind in kinds(rig.ticks(50)) if kind in ("HEARTBEAT", "PARAM_VALUE")]
    assert sent_kinds == ["PARAM_VALUE", "PARAM_VALUE", "HEARTBEAT"] * 5
    rig.send(BEAT)
    assert of(rig.ticks(20), "PARAM_VALUE") == []
    assert len(of(rig.ticks(50), "PARAM_VALUE")) > 2
