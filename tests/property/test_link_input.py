"""No input of the link raises an exception, and no value out of range reaches the loop."""

import gc
import math
import random
import re
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import (
    Arm,
    BenchRudder,
    EnableFence,
    ForgetParameters,
    ManualRudder,
    PauseMission,
    ReplacePlan,
    Restart,
    SetHome,
    SetMissionItem,
    SetMode,
    SetParameter,
    SteerHeading,
    SteerPosition,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameter_table import TABLE as PARAMETERS
from firmware_py.common.records import FixType, PositionSample, RudderCommand, RudderFeedback
from firmware_py.common.reports import MissionReport, MissionState, Output, Snapshot
from firmware_py.link.commands.table import TABLE as COMMAND_TABLE
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.telemetry.table import TABLE
from firmware_py.plans.validation import problem_of
from support.link import FakeRequestHandler, MemoryTransport

AVAILABLE_MODES = 435  # message number
MAX_INTERVAL_S = 3600.0
MIN_INTERVAL_S = 0.02

FIX = PositionSample(0.0, FixType.FIX_3D, 0.7, 0.2)
SERVO = RudderFeedback(0.0, 0.3)
SNAPSHOT = Snapshot(
    t_s=1.0, tick=1, mode=Mode.GUIDED, armed=True, heading_rad=1.0, heading_ok=True, yaw_rate_rad_s=0.0,
    roll_rad=None, pitch_rad=None, goal_heading_rad=1.0, heading_error_rad=0.0, bearing_rad=None, distance_m=None,
    rudder_rad=0.0, rudder_command_rad=0.0, rudder_ok=True, servo=None, position=FIX, position_ok=True, faults=0,
    rate_hz=10.0, skipped_total=0, late_s=0.0, mission=MissionReport(MissionState.ACTIVE, 2, 40),
)  # fmt: skip


class CheckedHandler(FakeRequestHandler):
    """Accepts all requests except invalid parameters, and stores them."""

    def decide(self, request):
        assert math.isfinite(request.t_s)
        return super().decide(request)


class PiecewiseTransport(MemoryTransport):
    """Delivers one piece per call, like a socket."""

    def receive(self, descriptor):
        return [self.inbox.pop(0)] if self.inbox else []


class Rig:
    def __init__(self):
        self.pipe = PiecewiseTransport()
        self.request_handler = CheckedHandler()
        self.endpoint = Endpoint([self.pipe], self.request_handler, utc_s=lambda: 0.0, version=Version())
        self.station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.endpoint.publish(Output(RudderCommand(0.0, True), SNAPSHOT), 0.0)
        self.pipe.sent.clear()
        self.now_s = 0.0

    def feed(self, data):
        self.now_s += 0.001
        for start in range(0, len(data), 1024):
            self.pipe.inbox.append(("station", data[start : start + 1024]))
        while self.pipe.inbox or self.endpoint.busy:
            self.endpoint.service(self.now_s, [self.pipe.descriptor])

    def replies(self):
        data = b"".join(data for _, data in self.pipe.sent)
        self.pipe.sent.clear()
        return mavlink.MAVLink(None).parse_buffer(data) or []

    def ping(self, number):
        return mavlink.MAVLink_ping_message(0, number, 0, 0).pack(self.station)


def is_valid_intent(intent):
    """Return whether all values of an intent are in range."""
    if isinstance(intent, SteerHeading):
        return abs(intent.heading_rad) <= 2.0 * math.pi and intent.turn in (-1, 0, 1)
    if isinstance(intent, SteerPosition):
        return abs(intent.latitude_rad) <= math.pi / 2 and abs(intent.longitude_rad) <= math.pi
    if isinstance(intent, ManualRudder):
        return intent.deflection is None or abs(intent.deflection) <= 1.0
    if isinstance(intent, SetMode):
        return isinstance(intent.mode, int) and 0 <= intent.mode < 2**32
    if isinstance(intent, SetParameter):
        return any(row.name == intent.name for row in PARAMETERS)
    if isinstance(intent, SetMissionItem):
        return isinstance(intent.index, int) and 0 <= intent.index <= 0xFFFF
    if isinstance(intent, ReplacePlan):
        return problem_of(intent.plan) is None
    if isinstance(intent, SetHome):
        position = (intent.latitude_rad, intent.longitude_rad)
        if position == (None, None):
            return True
        return abs(position[0]) <= math.pi / 2 and abs(position[1]) <= math.pi and abs(intent.altitude_m) <= 1e5
    if isinstance(intent, BenchRudder):
        return abs(intent.deflection) <= 1.0 and 0.0 <= intent.seconds <= 60.0
    return isinstance(intent, (Arm, EnableFence, ForgetParameters, PauseMission, Restart))


def check_valid(rig):
    assert all(is_valid_intent(intent) for intent in rig.request_handler.intents)
    for row, value in zip(PARAMETERS, rig.request_handler.values.values(), strict=True):
        assert row.check(value) == value
    for peer in rig.endpoint._peers:
        for row in TABLE:
            interval_us = peer.streams.interval_us(row.number)
            assert interval_us == -1 or MIN_INTERVAL_S <= interval_us * 1e-6 <= MAX_INTERVAL_S


SIZES = {"B": 8, "b": -8, "H": 16, "h": -16, "I": 32, "i": -32, "Q": 64, "q": -64}
COMMAND_NUMBERS = [row.command for row in COMMAND_TABLE]
FLOATS = st.floats(width=32) | st.sampled_from([math.nan, math.inf, -math.inf, 3.4028234663852886e38, 1.0, 0.0, 360.0])
NAMES = st.sampled_from([row.name.encode() for row in PARAMETERS]) | st.binary(max_size=16)


def element_strategy(code, name):
    """Return a strategy for one element of a field by its struct code."""
    if code in "fd":
        return FLOATS
    bits = SIZES[code]
    low, high = (0, 2**bits - 1) if bits > 0 else (-(2 ** (-bits - 1)), 2 ** (-bits - 1) - 1)
    if name in ("target_system", "target_component", "target"):
        return st.sampled_from([0, 1])
    numbers = [number for number in (0, 1, 2, 16, 30, 76, *COMMAND_NUMBERS, 1500) if low <= number <= high]
    return st.sampled_from([low, high, *numbers]) | st.integers(low, high)


def field_codes(kind):
    """Return the struct codes of the fields of a message, of pymavlink or added by the project."""
    if kind.native_format:
        return kind.native_format.decode()[1:]
    return ["c" if part.endswith("s") else part[-1] for part in format_parts(kind)]


def field_lengths(kind):
    """Return the lengths of arrays and texts, 0 for single values."""
    if kind.native_format:
        return kind.array_lengths
    return [int(part[:-1] or 0) for part in format_parts(kind)]


def format_parts(kind):
    return re.findall(r"\d*[a-zA-Z]", kind.unpacker.format.lstrip("<"))


def field_strategies(kind):
    """Return strategies for all fields of a message in the order of its constructor."""
    strategies = {}
    for name, code, length in zip(kind.ordered_fieldnames, field_codes(kind), field_lengths(kind), strict=True):
        if code == "c":
            strategies[name] = NAMES if name == "param_id" else st.binary(max_size=max(length, 1))
        elif length:
            strategies[name] = st.lists(element_strategy(code, name), min_size=length, max_size=length)
        else:
            strategies[name] = element_strategy(code, name)
    return [strategies[name] for name in kind.fieldnames]


KINDS = [kind for _, kind in sorted(mavlink.mavlink_map.items())]
HANDLED_NUMBERS = sorted(Rig().endpoint._handlers)
MESSAGES = {kind.id: st.tuples(*field_strategies(kind)).map(lambda values, kind=kind: kind(*values)) for kind in KINDS}
COMMANDS = st.builds(
    mavlink.MAVLink_command_long_message,
    st.just(1), st.just(1), st.sampled_from(COMMAND_NUMBERS),
    st.integers(0, 255), *(FLOATS,) * 7,
)  # fmt: skip


@pytest.mark.parametrize("number", HANDLED_NUMBERS)
@settings(max_examples=settings().max_examples // 5)
@given(data=st.data())
def test_handled_message_with_any_values_is_validated_and_the_link_replies(number, data):
    rig = Rig()
    for message in data.draw(st.lists(MESSAGES[number], min_size=1, max_size=4)):
        rig.feed(message.pack(rig.station))
    check_valid(rig)
    rig.replies()
    rig.feed(rig.ping(7))
    assert any(reply.get_type() == "PING" and reply.seq == 7 for reply in rig.replies())


@given(data=st.data())
def test_any_message_of_the_dialect_is_accepted_or_refused(data):
    rig = Rig()
    for number in data.draw(st.lists(st.sampled_from(sorted(MESSAGES)), min_size=1, max_size=8)):
        rig.feed(data.draw(MESSAGES[number]).pack(rig.station))
    check_valid(rig)


@given(st.lists(COMMANDS, min_size=1, max_size=5))
def test_every_command_with_any_parameters_is_acknowledged(commands):
    rig = Rig()
    for command in commands:
        rig.feed(command.pack(rig.station))
    check_valid(rig)
    acks = [reply for reply in rig.replies() if reply.get_type() == "COMMAND_ACK"]
    assert [ack.command for ack in acks] == [command.command for command in commands]


COORDINATES = st.integers(-(2**31), 2**31 - 1) | st.sampled_from([0, 450_000_000, 2**31 - 1])
EXTREME_VALUES = st.sampled_from([math.nan, math.inf, -math.inf, 3.4028234663852886e38, -1.0, 0.0, 0.5, 1.0, 2.0])
ANY_COMMAND = st.sampled_from(COMMAND_NUMBERS)


@given(
    ANY_COMMAND,
    st.lists(EXTREME_VALUES | FLOATS, min_size=7, max_size=7),
    COORDINATES,
    COORDINATES,
    st.booleans(),
    st.booleans(),
)
def test_refused_command_changes_nothing(number, values, x, y, as_command_int, armed):
    rig = Rig()
    rig.endpoint.publish(Output(RudderCommand(0.0, True), replace(SNAPSHOT, armed=armed, servo=SERVO)), 0.05)
    rig.replies()
    previous = rig.request_handler.values
    if as_command_int:
        message = mavlink.MAVLink_command_int_message(1, 1, 0, number, 0, 0, *values[:4], x, y, values[6])
    else:
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *values)
    rig.feed(message.pack(rig.station))
    check_valid(rig)
    (ack,) = [reply for reply in rig.replies() if reply.get_type() == "COMMAND_ACK"]
    assert ack.command == number
    assert ack.result in range(5)
    if ack.result != mavlink.MAV_RESULT_ACCEPTED:
        # The handler accepts all but invalid parameters, so that any other intent would have been executed.
        assert all(isinstance(intent, SetParameter) for intent in rig.request_handler.intents)
        assert rig.request_handler.values == previous


def test_valid_frames_in_a_megabyte_of_noise_get_a_reply():
    rng = random.Random(11)
    rig = Rig()
    replied_at_once, replied = 0, set()
    for number in range(500):
        chunk = bytearray(rng.randbytes(2000))
        for _ in range(20):
            chunk[rng.randrange(2000)] = rng.choice((0xFD, 0xFE))
        rig.feed(bytes(chunk) + rig.ping(number))
        numbers = {reply.seq for reply in rig.replies() if reply.get_type() == "PING"}
        replied_at_once += number in numbers
        replied |= numbers
    rig.now_s += 10.0
    rig.feed(b"\x00")  # discards an incomplete frame
    replied |= {reply.seq for reply in rig.replies() if reply.get_type() == "PING"}
    check_valid(rig)
    # A false start of a frame may delay the last frame of a chunk until the next chunk.
    assert replied_at_once >= 450
    assert replied == set(range(500))


EXTREME_FLOATS = (math.nan, math.inf, -math.inf, 3.4028234663852886e38, -3.4028234663852886e38)
FLOAT_FIELDS = [
    (number, name)
    for number in HANDLED_NUMBERS
    for name, code in zip(
        mavlink.mavlink_map[number].ordered_fieldnames, field_codes(mavlink.mavlink_map[number]), strict=True
    )
    if code in "fd"
]


def test_each_float_field_alone_at_extreme_values_is_validated():
    """All other fields are zero, so that no other field causes a refusal."""
    for number, name in FLOAT_FIELDS:
        rig = Rig()
        kind = mavlink.mavlink_map[number]
        for value in EXTREME_FLOATS:
            fields = dict.fromkeys(kind.fieldnames, 0)
            for field, code, length in zip(
                kind.ordered_fieldnames, field_codes(kind), field_lengths(kind), strict=True
            ):
                fields[field] = b"CTL_K1" if code == "c" else [0] * length if length else 0
                if field == name:
                    fields[field] = [value] * length if length else value
            for command in COMMAND_NUMBERS if "command" in fields else [None]:
                if command is not None:
                    fields["command"] = command
                rig.feed(kind(*(fields[field] for field in kind.fieldnames)).pack(rig.station))
            check_valid(rig)


NOISE_BYTES = 100_000_000
PIECE_BYTES = 1_000_000


def damage_frame(frames, rng):
    """Return a frame that is truncated, extended, or has another length or flipped bits."""
    frame = bytearray(rng.choice(frames))
    kind = rng.randrange(4)
    if kind == 0:
        del frame[rng.randrange(len(frame)) :]
    elif kind == 1:
        frame += rng.randbytes(rng.randrange(1, 300))
    elif kind == 2:
        frame[1] = rng.randrange(256)
    else:
        for _ in range(rng.randrange(1, 4)):
            frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
    return bytes(frame)


def feed_noise(total_bytes, rng):
    """Feed noise and damaged frames with a ping after each piece, which must get a reply; return the rig."""
    rig = Rig()
    frames = [
        mavlink.MAVLink_command_long_message(1, 1, number, 0, 1, 4, 0, 0, 0, 0, 0).pack(rig.station)
        for number in COMMAND_NUMBERS
    ]
    frames += [
        rig.ping(1),
        mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", 30.0, mavlink.MAV_PARAM_TYPE_REAL32).pack(rig.station),
    ]
    for number in range(max(1, total_bytes // PIECE_BYTES)):
        size = min(total_bytes, PIECE_BYTES)
        damaged_frames = b"".join(damage_frame(frames, rng) for _ in range(size // 100))
        rig.feed(rng.randbytes(size - len(damaged_frames)) + damaged_frames)
        rig.pipe.sent.clear()
        rig.now_s += 1.0
        rig.feed(b"\x00")
        rig.feed(rig.ping(number))
        replies = [reply.seq for reply in rig.replies() if reply.get_type() == "PING"]
        assert number in replies
        assert all(map(is_valid_intent, rig.request_handler.intents))
        rig.request_handler.requests.clear()
    return rig


def test_link_replies_after_noise_and_damaged_frames():
    rig = feed_noise(300_000, random.Random(21))
    check_valid(rig)


@pytest.mark.proof
@pytest.mark.timeout(1800)
def test_memory_does_not_grow_with_a_hundred_megabytes_of_noise():
    rng = random.Random(22)
    feed_noise(2_000_000, rng)
    gc.collect()
    tracemalloc.start()
    try:
        rig = feed_noise(10_000_000, rng)
        traced_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert traced_bytes < 2_000_000
    check_valid(rig)
    previous = resident_kib()
    check_valid(feed_noise(NOISE_BYTES - 12_000_000, rng))
    assert resident_kib() - previous < 8 * 1024


def resident_kib():
    rows = Path("/proc/self/status").read_text().splitlines()
    return next(int(row.split()[1]) for row in rows if row.startswith("VmRSS"))


def test_queues_are_bounded_in_a_flood_of_requests():
    rig = Rig()
    request = mavlink.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, AVAILABLE_MODES, 0, 0, 0, 0, 0, 0
    ).pack(rig.station)
    rig.pipe.send = lambda _address, _data: False
    for _ in range(50):
        rig.feed(request * 20)
    (peer,) = rig.endpoint._peers
    assert sum(len(queue) for queue in peer.outbox._queues) < 300
