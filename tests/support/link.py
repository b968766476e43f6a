"""A link on a transport in memory, with a request handler that records the requests."""

import msgspec
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, SetParameter, Verdict
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import RudderCommand, Stored
from firmware_py.common.reports import Output, Snapshot
from firmware_py.core.compass_swing import CompassSwing
from firmware_py.link.endpoint import NO_STORAGE, Endpoint
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.urls import PLAIN

SNAPSHOT = Snapshot(
    t_s=12.5,
    tick=125,
    mode=Mode.GUIDED,
    armed=True,
    heading_rad=1.0,
    heading_ok=True,
    yaw_rate_rad_s=0.01,
    roll_rad=0.1,
    pitch_rad=-0.2,
    goal_heading_rad=2.0,
    heading_error_rad=1.0,
    bearing_rad=None,
    distance_m=None,
    rudder_rad=0.2,
    rudder_command_rad=0.25,
    rudder_ok=True,
    servo=None,
    position=None,
    position_ok=False,
    faults=0,
    rate_hz=10.0,
    skipped_total=0,
    late_s=0.0005,
)


KEY = bytes(range(100, 132))
NOW = 27_992_960_000_000  # timestamp of a signature at `Rig.utc_s`: 10 us since 2015


class DecideTogether:
    """Mixin: `decide_together` accepts all requests or none, with `decide` for each."""

    def decide_together(self, requests):
        previous, answer = self.values, Answer(Verdict.ACCEPTED)
        for request in requests:
            answer = self.decide(request)
            if answer.verdict is not Verdict.ACCEPTED:
                self.values = previous
                break
        return answer


class FakeRequestHandler(DecideTogether):
    """Request handler with a fixed answer, which stores parameters and plans."""

    def __init__(self):
        self.requests = []
        self.answer = Answer(Verdict.ACCEPTED)
        self.values = ParameterSet()
        self.compass_swing = CompassSwing()
        self.stored_plans = Plans()
        self.at_once = True  # parameters and plans are stored at once, orders with `orders_at_once`
        self.orders_at_once = True
        self.plans_stored = True  # whether storing succeeds
        self.orders_stored = True
        self.waiting = []  # otherwise: calls with the success that finish the storing

    @property
    def intents(self):
        return [request.intent for request in self.requests]

    def decide(self, request):
        self.requests.append(request)
        if isinstance(request.intent, SetParameter) and self.answer.verdict is Verdict.ACCEPTED:
            try:
                self.values = self.values.replaced(request.intent.name, request.intent.value)
            except ValueError as error:
                return Answer(Verdict.DENIED, str(error))
        return self.answer

    def parameters(self):
        return self.values

    def plans(self):
        return self.stored_plans

    def replace_plan(self, request, done):
        if self.decide(request).verdict is not Verdict.ACCEPTED:
            done(self.answer)
            return

        def finish(is_stored):
            if is_stored:
                self.stored_plans = self.stored_plans.replaced(request.intent.plan)
            done(self.answer if is_stored else Answer(Verdict.FAILED, "the disk is full"))

        if self.at_once:
            finish(self.plans_stored)
        else:
            self.waiting.append(finish)

    def when_stored(self, call):
        if self.at_once:
            call(True)
        else:
            self.waiting.append(call)

    def when_orders_stored(self, call):
        if self.orders_at_once:
            call(self.orders_stored)
        else:
            self.waiting.append(call)


class MemoryTransport:
    """Transport with lists of bytes and one descriptor; addresses are strings."""

    name = "memory"

    def __init__(
        self,
        descriptor=100,
        addresses=("station",),
        *,
        byte_rate=None,
        has_radio_rates=False,
        is_datagram=True,
        is_exposed=False,
        options=PLAIN,
    ):
        self.descriptor = descriptor
        self.served = tuple(addresses)  # permanent peers
        self.connected = ()  # peers that have connected to the boat
        self.dropped = []
        self.byte_rate = byte_rate
        self.has_radio_rates = has_radio_rates
        self.is_datagram = is_datagram
        self.is_exposed = is_exposed
        self.options = options
        self.inbox = []
        self.sent = []
        self.is_writable = True
        self.blocked_reason = ""
        self.closed = False
        self.polled_s = None

    def descriptors(self):
        return (self.descriptor,)

    def receive(self, descriptor):
        inbox, self.inbox = self.inbox, []
        return inbox

    def send(self, address, data):
        if self.is_writable:
            self.sent.append((address, data))
            assert len(self.sent) < 20_000, "the link sends without end"
        return self.is_writable

    def addresses(self):
        return self.served

    def connections(self):
        return self.connected

    def host(self, address):
        return address[0] if isinstance(address, tuple) else address

    def drop(self, address):
        self.dropped.append(address)
        self.connected = tuple(other for other in self.connected if other != address)

    def poll(self, now_s):
        self.polled_s = now_s

    def close(self):
        self.closed = True


class MemoryVault:
    """A vault in memory."""

    def __init__(self):
        self.contents = []
        self.both = []  # of each saved content: whether both slots had to be written
        self.damage = ""
        self.at_once = True  # contents are stored at once
        self.waiting = []  # otherwise: calls with the success that finish the storing

    def load(self):
        return Stored(self.contents[-1] if self.contents else None, self.damage)

    def save(self, content, *, both_slots=False):
        self.contents.append(content)
        self.both.append(both_slots)

    def when_stored(self, call):
        if self.at_once:
            call(True)
        else:
            self.waiting.append(call)


class Rig:
    """An endpoint, and a ground station that uses pymavlink; `identity` is the MAV_AUTOPILOT type of the boat."""

    def __init__(self, vault=None, *, identity=3, storage=NO_STORAGE, start_events=(), **transport):
        self.vault = vault or MemoryVault()
        self.utc_s = 1.7e9
        self.transport = MemoryTransport(**transport)
        self.request_handler = FakeRequestHandler()
        self.request_handler.values = self.request_handler.values.replaced("LNK_IDENTITY", identity)
        self.endpoint = Endpoint(
            [self.transport],
            self.request_handler,
            utc_s=lambda: self.utc_s,
            version=Version(0, 1, 0, "0123abcd", 77),
            vault=self.vault,
            offer_utc=lambda utc_s, now_s: self.offered_utc.append((utc_s, now_s)),
            storage=storage,
            start_events=start_events,
        )
        self.offered_utc = []
        self.station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.now_s = 0.0

    def give(self, data, address="station"):
        """Let the link receive bytes; return the messages that it sends."""
        self.transport.inbox.append((address, data))
        self.endpoint.service(self.now_s, [self.transport.descriptor])
        self.finish()
        return self.replies()

    def finish(self):
        """Call the link until it has no more work; return the number of calls."""
        for calls in range(1_000):
            if not self.endpoint.busy:
                return calls
            self.endpoint.service(self.now_s, [])
        raise AssertionError("the link stays busy")

    def send(self, *messages, address="station"):
        """Send messages to the link; return the messages that it sends."""
        return self.give(b"".join(self.frame(message) for message in messages), address)

    def prove(self, address="station"):
        """Send two heartbeats, the second after a reply: the address is proven and its peer becomes active."""
        ground_station, no_autopilot = mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID
        beat = mavlink.MAVLink_heartbeat_message(ground_station, no_autopilot, 0, 0, 0, 3)
        return [*self.send(beat, address=address), *self.send(beat, address=address)]

    def frame(self, message):
        data = message.pack(self.station)
        self.station.seq = (self.station.seq + 1) % 256
        return data

    def command(self, number, *values, confirmation=0, target=(1, 1)):
        values = (*values, *(0.0,) * (7 - len(values)))
        return self.send(mavlink.MAVLink_command_long_message(*target, number, confirmation, *values))

    def tick(self, **changes):
        """Publish a tick; return the messages that the link sends."""
        self.tick_silently(**changes)
        return self.replies()

    def ticks(self, count):
        """Publish ticks; return the messages that the link sends in all of them."""
        return [message for _ in range(count) for message in self.tick()]

    def tick_silently(self, *, seconds=0.1, events=(), **changes):
        """Publish a tick; `replies` returns the messages."""
        self.now_s += seconds
        snapshot = msgspec.structs.replace(SNAPSHOT, t_s=self.now_s, **changes)
        self.endpoint.publish(Output(RudderCommand(0.0, True), snapshot, tuple(events)), self.now_s)

    def replies(self, address=None):
        """Return the messages that were sent since the last call, decoded by pymavlink."""
        sent, self.transport.sent = self.transport.sent, []
        decoder = mavlink.MAVLink(None)
        data = b"".join(data for to, data in sent if address in (None, to))
        return decoder.parse_buffer(data) or []


UNREQUESTED = 0xFFFF  # parameter index of values that are sent without a request


def without_unrequested(messages):
    """Return the messages without parameter values that were not requested, such as those of arming checks."""
    return [message for message in messages if getattr(message, "param_index", None) != UNREQUESTED]


def sign(rig, key=KEY):
    """Let the station of a rig sign its frames."""
    signing = rig.station.signing
    signing.secret_key, signing.timestamp, signing.sign_outgoing = key, NOW, True


def of_type(messages, name):
    return [message for message in messages if message.get_type() == name]


def results(messages):
    """Return the results of the COMMAND_ACKs."""
    return [message.result for message in of_type(messages, "COMMAND_ACK")]
