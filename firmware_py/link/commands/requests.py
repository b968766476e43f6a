"""Commands that ask for messages, once or at an interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from firmware_py.common.intents import Answer, Verdict
from firmware_py.link.commands.server import ACCEPTED, NEITHER, CommandCall, CommandRow
from firmware_py.link.context import LinkContext, within
from firmware_py.link.peers import Peer
from firmware_py.link.telemetry import identity
from firmware_py.link.telemetry.fields import INT32_MAX, UINT16_MAX
from firmware_py.link.telemetry.table import ROWS_OF, TABLE
from firmware_py.link.wire.dialect import Message, mavlink

_HOME_POSITION = 242
_MESSAGE_INTERVAL = 244
_UNKNOWN_MESSAGE = Answer(Verdict.UNSUPPORTED)
_NOT_NOW = Answer(Verdict.TEMPORARILY_REJECTED)


def _number(value: float) -> int:
    """Return a message id, or -1 for an invalid number."""
    return int(value) if within(value, 0, 0xFFFFFF) and value == int(value) else -1


# Messages that do not depend on the snapshot, by context and requested index.
# Index NaN means all, as 0 does.
FIXED: Mapping[int, Callable[[LinkContext, float], Sequence[Message]]] = {
    148: lambda context, _index: (identity.autopilot_version(context.version),),
    300: lambda _session, _index: (identity.protocol_version(),),
    395: lambda context, _index: (context.metadata.old_message(context.now_s),),
    397: lambda context, _index: (context.metadata.message(context.now_s),),
    435: lambda _session, index: identity.available_modes(0 if math.isnan(index) else _number(index)),
}


def _current(context: LinkContext, number: int) -> Sequence[Message] | None:
    """Return the telemetry messages with this number that have content now; None for an unknown number."""
    if number not in ROWS_OF:
        return None
    telemetry = context.telemetry_context()
    if telemetry is None:
        return ()
    built = (TABLE[row].build(telemetry) for row in ROWS_OF[number])
    return tuple(message for message in built if message is not None)


def _deliver(context: LinkContext, call: CommandCall, number: int, index: float = 0.0) -> Answer:
    messages = FIXED[number](context, index) if number in FIXED else _current(context, number)
    if messages is None:
        return _UNKNOWN_MESSAGE
    for message in messages:
        context.send(call.peer, message)
    return ACCEPTED if messages else _NOT_NOW


def request_message(context: LinkContext, call: CommandCall) -> Answer:
    """Send one message now; param2 is the index of AVAILABLE_MODES, or the message id for MESSAGE_INTERVAL."""
    number, index = _number(call.parameters[0]), call.parameters[1]
    if number == _MESSAGE_INTERVAL:
        return _send_interval(context, call, _number(index))
    return _deliver(context, call, number, index)


def home_position(context: LinkContext, call: CommandCall) -> Answer:
    """Send HOME_POSITION now."""
    return _deliver(context, call, _HOME_POSITION)


def capabilities(context: LinkContext, call: CommandCall) -> Answer:
    """Send AUTOPILOT_VERSION now."""
    return _deliver(context, call, 148)


def protocol_version(context: LinkContext, call: CommandCall) -> Answer:
    """Send PROTOCOL_VERSION now."""
    return _deliver(context, call, 300)


def set_message_interval(context: LinkContext, call: CommandCall) -> Answer:  # noqa: ARG001 - an action like the others
    """Set the interval of a message to this peer: microseconds, -1 off, 0 default."""
    number = _number(call.parameters[0])
    if number not in ROWS_OF:
        return _UNKNOWN_MESSAGE
    if not call.peer.streams.set_interval(number, call.parameters[1], call.now_s):
        return call.denied("interval must be 20 ms (satellite: 10 s) to 1 h, 0 or -1; HEARTBEAT is fixed")
    return ACCEPTED


def control_high_latency(context: LinkContext, call: CommandCall) -> Answer:
    """Start or stop HIGH_LATENCY2 on every satellite link."""
    wanted = call.parameters[0]
    if wanted not in (0.0, 1.0):
        return call.denied(NEITHER)
    context.high_latency = wanted == 1.0
    interval_s = context.request_handler.parameters()["LNK_SAT_S"] if context.high_latency else None
    for peer in context.peers:
        if peer.quiet and not peer.by_message:
            peer.streams.set_high_latency(interval_s, call.now_s)
    return ACCEPTED


def get_message_interval(context: LinkContext, call: CommandCall) -> Answer:
    """Send MESSAGE_INTERVAL: microseconds, -1 off, 0 for a message that the boat does not send."""
    return _send_interval(context, call, _number(call.parameters[0]))


def _send_interval(context: LinkContext, call: CommandCall, number: int) -> Answer:
    interval_us = call.peer.streams.interval_us(number)
    if number > UINT16_MAX:
        return _UNKNOWN_MESSAGE
    interval_us_or_0 = 0 if interval_us is None else min(interval_us, INT32_MAX)
    context.send(call.peer, mavlink.MAVLink_message_interval_message(max(number, 0), interval_us_or_0))
    return ACCEPTED if interval_us is not None else _UNKNOWN_MESSAGE


def request_data_stream(peer: Peer, message: Message, now_s: float) -> None:
    """Set the rates of a group of messages by the old REQUEST_DATA_STREAM, which MAVProxy still uses."""
    wanted = message.start_stop == 1
    peer.streams.set_stream(message.req_stream_id, float(message.req_message_rate) if wanted else 0.0, now_s)


COMMANDS = (
    CommandRow(410, "GET_HOME_POSITION", home_position, "send HOME_POSITION", repeatable=True),
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
    CommandRow(519, "REQUEST_PROTOCOL_VERSION", protocol_version, "send PROTOCOL_VERSION", repeatable=True),
    CommandRow(
        520,
        "REQUEST_AUTOPILOT_CAPABILITIES",
        capabilities,
        "send AUTOPILOT_VERSION",
        repeatable=True,
    ),
    CommandRow(
        2600,
        "CONTROL_HIGH_LATENCY",
        control_high_latency,
        "HIGH_LATENCY2 on the satellite links (param1 = 1) or silence (0)",
    ),
)
