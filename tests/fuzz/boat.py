"""The link and the real autopilot on a transport in memory, with checks of both."""

import functools
import hashlib
import math
from unittest.mock import patch

from firmware_py.common.intents import Restart, Verdict
from firmware_py.common.parameter_table import TABLE as PARAMETERS
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderFeedback,
    Tick,
)
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.resume import Moment, restore, resume_of
from firmware_py.core.resume import to_bytes as resume_to_bytes
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.link import context
from firmware_py.link.endpoint import NO_STORAGE, Endpoint
from firmware_py.link.files.tree import FileRoot
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import checksum
from firmware_py.link.wire.urls import PLAIN, LinkOptions, Policy, parse_options
from firmware_py.plans.validation import problem_of
from fuzz.target import MAX_RECORDS, check_finite, check_line
from support.link import MemoryTransport, MemoryVault

# Bits of the first byte of an input.
KEY, OPTIONS, STREAM, SLOW, KEY_LOST = 0x01, 0x0E, 0x10, 0x20, 0x40
LINK_OPTIONS = (
    PLAIN,
    *map(
        parse_options,
        (
            "trusted=1", "policy=open", "policy=signed-commands", "policy=signed-only",
            "trusted=1&policy=signed-commands", "systems=255", "class=satellite",
        ),
    ),
)  # fmt: skip
SECRET = bytes(range(1, 33))
UTC_S = 1.7e9
STORE_TIME, RESUME_TIME = Moment(UTC_S, "a", 500.0), Moment(UTC_S + 1.0, "a", 700.0)
NOW_UNITS = int((UTC_S - 1_420_070_400) * 100_000)
STATIONS = {"one": (255, 190), "two": (254, 190)}
MAX_ROUNDS = 5000
MAX_QUEUED = 600
POSITION_RAD = (0.6283, 2.1118)
LOG = bytes(range(256)) * 12


class MemoryStorage:
    """Storage in memory that completes its jobs when the test calls `answer`."""

    def __init__(self):
        self.parameters, self.plans, self.pending_calls = {}, {}, []

    def save_parameters(self, changed):
        self.parameters.update(changed)

    def clear_parameters(self):
        self.parameters.clear()

    def save_plan(self, plan, done):
        def store(is_stored):
            if is_stored:
                self.plans[plan.kind] = plan_to_text(plan)
            done(is_stored)

        self.pending_calls.append(store)

    def save_resume(self, text):
        pass

    def when_parameters_stored(self, call):
        self.pending_calls.append(call)

    when_resume_stored = when_parameters_stored

    def answer(self, *, is_stored):
        pending_calls, self.pending_calls = self.pending_calls, []
        for call in pending_calls:
            call(is_stored)


class CheckedAutopilot:
    """The autopilot as request handler of the link, with checks of its answers and of its state."""

    def __init__(self, autopilot, storage):
        self.autopilot, self.storage = autopilot, storage
        self.allowed = True  # whether the present sender may command
        self.changed = False  # whether a request was accepted
        self.parameters, self.plans = autopilot.parameters, autopilot.plans
        self.compass_swing = autopilot.compass_swing
        self.when_stored, self.when_orders_stored = autopilot.when_stored, autopilot.when_orders_stored

    def decide(self, request):
        return self.decide_together((request,))

    def decide_together(self, requests):
        assert self.allowed, requests
        assert all(math.isfinite(request.t_s) for request in requests)
        previous, previous_parameters = self.autopilot._ahead, dict(self.storage.parameters)
        answer = self.autopilot.decide_together(requests)
        if answer.verdict is not Verdict.ACCEPTED:
            check_line(answer.text)
            assert self.autopilot._ahead is previous
            assert self.storage.parameters == previous_parameters
            return answer
        self.changed = True
        check_state(self.autopilot._ahead)
        return answer

    def replace_plan(self, request, done):
        assert self.allowed, request
        self.changed = True
        previous = self.autopilot._ahead.plans

        def finish(answer):
            if answer.verdict is Verdict.ACCEPTED:
                plan = request.intent.plan
                assert problem_of(plan) is None
                assert self.autopilot.plans().of(plan.kind) == plan
                assert plan_from_text(self.storage.plans[plan.kind]) == (plan, ())
            else:
                check_line(answer.text)
            done(answer)

        self.autopilot.replace_plan(request, finish)
        assert self.autopilot._ahead.plans == previous  # in force once it is stored


def check_state(state):
    check_finite(state.modes)
    check_finite(state.home)
    if state.parameters is not start_state().parameters:
        for row, value in zip(PARAMETERS, state.parameters.values(), strict=True):
            assert row.check(value) == value, row.name


def inputs_at(index, t_s, requests=(), *, heading=True, position=True):
    return Inputs(
        Tick(index, t_s, 0.0, 0, 10.0),
        (HeadingSample(t_s, 1.0, NorthReference.TRUE),) if heading else (),
        (PositionSample(t_s, FixType.FIX_3D, *POSITION_RAD, 2.0, 0.5, 1.0, 11, 0.9, UTC_S + t_s),) if position else (),
        (RudderFeedback(t_s, 0.1, 30.0, 12.0, 0.1, 0, True),),
        (),
        requests,
    )


@functools.cache
def start_state():
    """Return the state after two seconds with heading, position and rudder."""
    state = State.at_start(ParameterSet())
    for index in range(20):
        state, _ = step(state, inputs_at(index, 0.1 * index))
    return state


# Cached: it is constant and would take half of the time of an input.
make_metadata = functools.cache(context.Metadata)


class Boat:
    """A boat of one input: link, autopilot, and their actions."""

    def __init__(self, setup, root=None):
        self.now_s, self.index = 2.0, 20
        self.storage = MemoryStorage()
        self.autopilot = Autopilot(start_state(), self.storage)
        self.handler = CheckedAutopilot(self.autopilot, self.storage)
        self.options: LinkOptions = LINK_OPTIONS[(setup & OPTIONS) >> 1]
        self.transport = MemoryTransport(
            addresses=() if not setup & STREAM else tuple(STATIONS),
            byte_rate=5760.0 if setup & SLOW else None,
            is_datagram=not setup & STREAM,
            options=self.options,
        )
        self.vault = MemoryVault()
        if setup & KEY:
            self.vault.save(b"key %s\ntimestamp %d\n" % (SECRET.hex().encode(), NOW_UNITS))
        elif setup & KEY_LOST:
            self.vault.damage = "damaged"
        self.file_root = NO_STORAGE
        if root is not None:
            (root / "logs").mkdir()
            (root / "uploads").mkdir()
            for number in (1, 2, 3):
                (root / "logs" / f"{number:08d}.BIN").write_bytes(LOG[: 1024 * number])
            (root / "secret").write_bytes(b"secret")
            (root / "uploads" / "link").symlink_to(root)
            logs = root / "logs"
            self.file_root = FileRoot(
                lambda: {int(path.stem): path for path in logs.glob("*.BIN")}, logs, root / "uploads"
            )
        with patch.object(context, "Metadata", make_metadata):
            self.endpoint = Endpoint(
                [self.transport], self.handler, utc_s=lambda: UTC_S + self.now_s, version=Version(), vault=self.vault,
                offer_utc=lambda utc_s, now_s: check_finite((utc_s, now_s)), storage=self.file_root,
            )  # fmt: skip
        self.signed = 0
        self.sequence = 0

    @property
    def requires_signature(self):
        """Return whether every command needs a signature by the rules of access-control.md."""
        if self.endpoint._signing.problem:  # the key was lost
            return not self.options.trusted
        policy = self.options.policy
        if policy is Policy.AUTO:
            return self.endpoint._signing.has_key and not self.options.trusted
        return policy is not Policy.OPEN

    def frame(self, number, body, station, *, signed, late):
        """Return a complete frame, optionally signed with SECRET. `late`: with an early timestamp."""
        kind = mavlink.mavlink_map[number]
        payload = body[: kind.unpacker.size].rstrip(b"\0") or b"\0"
        self.sequence = (self.sequence + 1) % 256
        header = bytes((len(payload), signed, 0, self.sequence, *STATIONS[station], *number.to_bytes(3, "little")))
        crc = checksum(header + payload, bytes((kind.crc_extra,)))
        data = b"\xfd" + header + payload + crc.to_bytes(2, "little")
        if not signed:
            return data
        self.signed += 1
        data += b"\1" + (NOW_UNITS + (10 if late else 1000 * self.signed)).to_bytes(6, "little")
        return data + hashlib.sha256(SECRET + data).digest()[:6]

    def receive(self, data, station, *, signed):
        self.handler.allowed = (signed and self.endpoint._signing.has_key) or not self.requires_signature
        if self.options.systems is not None and STATIONS[station][0] not in self.options.systems:
            self.handler.allowed = False
        previous = self.autopilot._ahead
        self.transport.inbox.append((station, data))
        self.endpoint.service(self.now_s, [self.transport.descriptor])
        self.complete_jobs()
        if not self.handler.allowed:
            assert self.autopilot._ahead is previous
        self.handler.allowed = True

    def complete_jobs(self):
        rounds = 0
        while self.endpoint.busy:
            rounds += 1
            assert rounds < MAX_ROUNDS, "endless work"
            self.endpoint.service(self.now_s, [])

    def tick(self, seconds, flags=0):
        self.now_s += seconds
        self.index += 1
        self.storage.answer(is_stored=not flags & 1)
        inputs = inputs_at(
            self.index, self.now_s, self.autopilot.take_requests(), heading=not flags & 2, position=not flags & 4
        )
        output = self.autopilot.step(inputs)
        if any(isinstance(request.intent, Restart) for request in inputs.requests):
            self.autopilot.restart = None  # the boat would restart; here it continues
        check_finite(output.command)
        check_finite(output.snapshot)
        assert abs(output.command.shaft_rad) <= math.pi
        for event in output.events:
            check_line(event.text)
        check_state(self.autopilot.state)
        self.endpoint.publish(output, self.now_s)
        self.complete_jobs()
        self.check_sent()

    def check_sent(self):
        for _, data in self.transport.sent:
            position = 0
            while position < len(data):
                assert data[position] == 0xFD
                position += 12 + data[position + 1] + (13 if data[position + 2] & 1 else 0)
            assert position == len(data)
        self.transport.sent.clear()
        for peer in self.endpoint._peers:
            assert sum(len(queue) for queue in peer.outbox._queues) < MAX_QUEUED
        assert len(self.vault.contents) <= 4 * MAX_RECORDS

    def end(self):
        """Run a tick with the accepted data, check the stored state and close the link."""
        if self.handler.changed:
            self.tick(0.1)
            self.check_stored()
        self.endpoint.close()
        self.check_sent()

    def check_stored(self):
        """Check that a restart and a log restore the present state."""
        state = self.autopilot.state
        text = state_to_text(state)
        decoded, notes = state_from_text(text)
        assert notes == ()
        assert state_to_text(decoded) == text
        for kind, stored in self.storage.plans.items():
            assert plan_from_text(stored) == (state.plans.of(kind), ())
        start = State.at_start(state.parameters.replaced("BOOT_RESUME", 2), state.plans or Plans())
        resumed, notes = restore(start, resume_to_bytes(resume_of(state, STORE_TIME)), RESUME_TIME)
        assert notes == ()
        _, output = step(resumed, inputs_at(0, 0.0))
        check_finite(output.command)
