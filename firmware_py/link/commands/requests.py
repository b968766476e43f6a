"""Commands that request messages, once or at an interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from firmware_py.common.intents import Answer, Verdict
from firmware_py.link.commands.server import ACCEPTED, PARAM1_NOT_0_OR_1, CommandCall, CommandRow
from firmware_py.link.context import LinkContext, within
from firmware_py.link.peers import Peer
from firmware_py.link.telemetry import identity
from firmware_py.link.telemetry.fields import INT32_MAX, UINT16_MAX
from firmware_py.link.telemetry.table import ROWS_OF, TABLE
from firmware_py.link.wire.dialect import Message, mavlink

# Message ids
_AUTOPILOT_VERSION = 148
_HOME_POSITION = 242
_MESSAGE_INTERVAL = 244
_PROTOCOL_VERSION = 300
_COMPONENT_INFORMATION = 395
_COMPONENT_METADATA = 397
_AVAILABLE_MODES = 435

_UNSUPPORTED = Answer(Verdict.UNSUPPORTED)
_NOT_NOW = Answer(Verdict.TEMPORARILY_REJECTED)


def _to_message_id(value: float) -> int:
    """Return a message id, or -1 for an invalid value."""
    return int(value) if within(value, 0, 0xFFFFFF) and value == int(value) else -1


# Builders of messages that do not depend on the snapshot, by message id; their arguments are the context and the
# requested index. Index NaN means all, as 0 does.
_INDEPENDENT_BUILDERS: Mapping[int, Callable[[LinkContext, float], Sequence[Message]]] = {
    _AUTOPILOT_VERSION: lambda context, _index: (identity.autopilot_version(context.version),),
    _PROTOCOL_VERSION: lambda _context, _index: (identity.protocol_version(),),
    _COMPONENT_INFORMATION: lambda context, _index: (context.metadata.information_message(context.now_s),),
    _COMPONENT_METADATA: lambda context, _index: (context.metadata.message(context.now_s),),
    _AVAILABLE_MODES: lambda _context, index: identity.available_modes(
        0 if math.isnan(index) else _to_message_id(index)
    ),
}


def _build_telemetry(context: LinkContext, number: int) -> Sequence[Message] | None:
    """Return the telemetry messages with this id that have content now; None for an unknown id."""
    if number not in ROWS_OF:
        return None
    telemetry = context.telemetry_context()
    if telemetry is None:
        return ()
    messages = (TABLE[row].build(telemetry) for row in ROWS_OF[number])
    return tuple(message for message in messages if message is not None)


def _send_messages(context: LinkContext, call: CommandCall, number: int, index: float = 0.0) -> Answer:
    messages = (
        _INDEPENDENT_BUILDERS[number](context, index)
        if number in _INDEPENDENT_BUILDERS
        else _build_telemetry(context, number)
    )
    if messages is None:
        return _UNSUPPORTED
    for message in messages:
        context.send(call.peer, message)
    return ACCEPTED if messages else _NOT_NOW


def request_message(context: LinkContext, call: CommandCall) -> Answer:
    """Send message param1 once; param2 is the index of AVAILABLE_MODES, or the message id for MESSAGE_INTERVAL."""
    number, index = _to_message_id(call.parameters[0]), call.parameters[1]
    if number == _MESSAGE_INTERVAL:
        return _send_interval(context, call, _to_message_id(index))
    return _send_messages(context, call, number, index)


def send_home_position(context: LinkContext, call: CommandCall) -> Answer:
    """Send HOME_POSITION once."""
    return _send_messages(context, call, _HOME_POSITION)


def send_autopilot_version(context: LinkContext, call: CommandCall) -> Answer:
    """Send AUTOPILOT_VERSION once."""
    return _send_messages(context, call, _AUTOPILOT_VERSION)


def send_protocol_version(context: LinkContext, call: CommandCall) -> Answer:
    """Send PROTOCOL_VERSION once."""
    return _send_messages(context, call, _PROTOCOL_VERSION)


def set_message_interval(context: LinkContext, call: CommandCall) -> Answer:  # noqa: ARG001 - common interface of actions
    """Set the interval of a message to this peer in microseconds; -1 is off, 0 is the default."""
    number = _to_message_id(call.parameters[0])
    if number not in ROWS_OF:
        return _UNSUPPORTED
    if not call.peer.streams.set_interval(number, call.parameters[1], call.now_s):
        return call.deny("interval must be 20 ms (satellite: 10 s) to 1 h, 0 or -1; HEARTBEAT is fixed")
    return ACCEPTED


def control_high_latency(context: LinkContext, call: CommandCall) -> Answer:
    """Start or stop HIGH_LATENCY2 on every satellite link without paid messages."""
    state = call.parameters[0]
    if state not in (0.0, 1.0):
        return call.deny(PARAM1_NOT_0_OR_1)
    context.high_latency = state == 1.0
    interval_s = context.request_handler.parameters()["LNK_SAT_S"] if context.high_latency else None
    for peer in context.peers:
        if peer.is_satellite and not peer.has_paid_messages:
            peer.streams.set_high_latency(interval_s, call.now_s)
    return ACCEPTED


def get_message_interval(context: LinkContext, call: CommandCall) -> Answer:
    """Send MESSAGE_INTERVAL in microseconds; -1 is off, 0 is a message that the boat does not send."""
    return _send_interval(context, call, _to_message_id(call.parameters[0]))


def _send_interval(context: LinkContext, call: CommandCall, number: int) -> Answer:
    interval_us = call.peer.streams.interval_us(number)
    if number > UINT16_MAX:
        return _UNSUPPORTED
    reported_us = 0 if interval_us is None else min(interval_us, INT32_MAX)
    context.send(call.peer, mavlink.MAVLink_message_interval_message(max(number, 0), reported_us))
    return ACCEPTED if interval_us is not None else _UNSUPPORTED


def request_data_stream(peer: Peer, message: Message, now_s: float) -> None:
    """Set the rate of a group of messages by the deprecated REQUEST_DATA_STREAM, which MAVProxy uses."""
    rate_hz = float(message.req_message_rate) if message.start_stop == 1 else 0.0
    peer.streams.set_stream(message.req_stream_id, rate_hz, now_s)


COMMANDS = (
    CommandRow(410, "GET_HOME_POSITION", send_home_position, "send HOME_POSITION", repeatable=True),
    CommandRow(510, "GET_MESSAGE_INTERVAL", get_message_interval, "send MESSAGE_INTERVAL", repeatable=True),
    CommandRow(
        511,
        "SET_MESSAGE_INTERVAL",
        set_message_interval,
        "send message param1 each param2 us on this link; -1 off, 0 default",
        repeatable=True,
    ),
    CommandRow(
        512,
        "REQUEST_MESSAGE",
        request_message,
        "send message param1 once; param2: the index of AVAILABLE_MODES, the message id for MESSAGE_INTERVAL",
        repeatable=True,
    ),
    CommandRow(519, "REQUEST_PROTOCOL_VERSION", send_protocol_version, "send PROTOCOL_VERSION", repeatable=True),
    CommandRow(
        520, "REQUEST_AUTOPILOT_CAPABILITIES", send_autopilot_version, "send AUTOPILOT_VERSION", repeatable=True
    ),
    CommandRow(
        2600,
        "CONTROL_HIGH_LATENCY",
        control_high_latency,
        "HIGH_LATENCY2 on the satellite links (param1 = 1) or silence (0)",
    ),
)
