"""Plans over a link that loses, duplicates, delays and reorders a quarter of the frames in both directions."""

import heapq
import itertools
import random

import pytest
from pymavlink.dialects.v20 import common as mavlink

ITEMS = 40
TICK_S = 0.1
MAX_TIME_S = 900.0
STATION_REPEAT_S = 1.0


class LossyLink:
    """Delivers frames late, not at all, or twice; each with a probability of a quarter.

    `delay_s` is the range of the delay of late frames. Others have at most `max_usual_delay_s`; None: no delay.
    """

    def __init__(self, rng, delay_s, max_usual_delay_s=None):
        self.rng = rng
        self.delay_s, self.max_usual_delay_s = delay_s, max_usual_delay_s
        self.in_transit = []
        self.order = itertools.count()

    def put(self, frame, now_s):
        if self.rng.random() < 0.25:
            return
        for _ in range(2 if self.rng.random() < 0.25 else 1):
            if self.rng.random() < 0.25:
                delay_s = self.rng.uniform(*self.delay_s)
            else:
                delay_s = self.rng.uniform(0.0, self.max_usual_delay_s) if self.max_usual_delay_s else 0.0
            heapq.heappush(self.in_transit, (now_s + delay_s, next(self.order), frame))

    def arrived(self, now_s):
        while self.in_transit and self.in_transit[0][0] <= now_s:
            yield heapq.heappop(self.in_transit)[2]


class FarStation:
    """A ground station behind two lossy links; `near` exchanges messages with the boat without loss."""

    def __init__(self, station, seed):
        self.near = station
        self.up, self.down = (LossyLink(random.Random(s), (0.3, 1.0), 0.05) for s in (seed, seed + 1))

    def send(self, message):
        self.up.put(message, self.near.rig.now_s)

    def run_tick(self):
        """Simulate one tick; return the messages that arrive at the station."""
        rig = self.near.rig
        for message in self.up.arrived(rig.now_s):
            for reply in self.near.exchange(message):
                self.down.put(reply, rig.now_s)
        for message in self.near.tick(seconds=TICK_S):
            self.down.put(message, rig.now_s)
        return list(self.down.arrived(rig.now_s))

    def ask(self, request, is_reply):
        """Repeat a request each second until its reply arrives."""
        sent_s = -1.0
        while self.near.rig.now_s < MAX_TIME_S:
            if self.near.rig.now_s - sent_s >= 1.0:
                self.send(request)
                sent_s = self.near.rig.now_s
            for message in self.run_tick():
                if is_reply(message):
                    return message
        raise AssertionError(f"no reply to {request}")

    def upload(self, items):
        """Upload a plan; return the MISSION_ACK."""
        last, sent_s = mavlink.MAVLink_mission_count_message(1, 1, len(items), 0), self.near.rig.now_s
        self.send(last)
        while self.near.rig.now_s < MAX_TIME_S:
            for message in self.run_tick():
                if message.get_type() == "MISSION_ACK":
                    return message
                if message.seq < len(items):  # otherwise of a former upload
                    last, sent_s = items[message.seq], self.near.rig.now_s
                    self.send(last)
            if self.near.rig.now_s - sent_s >= 3.0:
                sent_s = self.near.rig.now_s
                self.send(last)
        raise AssertionError("no end of the upload")

    def download(self):
        request = mavlink.MAVLink_mission_request_list_message(1, 1, 0)
        count = self.ask(request, lambda reply: reply.get_type() == "MISSION_COUNT")
        return [
            self.ask(
                mavlink.MAVLink_mission_request_int_message(1, 1, number, 0),
                lambda reply, number=number: reply.get_type() == "MISSION_ITEM_INT" and reply.seq == number,
            )
            for number in range(count.count)
        ]


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(1, 20))])
def test_plans_are_complete_over_a_lossy_link(station, seed):
    far = FarStation(station, seed)
    items = station.mission(ITEMS)
    ack = far.upload(items)
    assert (ack.type, ack.opaque_id) == (0, station.handler.plans().mission.identity)
    assert station.places() == list(range(1, 1 + ITEMS))
    assert station.all_fields(far.download()[1:]) == station.all_fields(items[1:])
    # A second upload, while messages of the first one are still in transit.
    far.upload(station.mission(20, start=1000))
    for _ in range(200):
        far.run_tick()
    assert station.places() in (list(range(1001, 1021)), list(range(1, 1 + ITEMS)))


def upload_time_s(station, items, seed):
    """Upload from a station that accepts only MISSION_REQUEST_INT and repeats its last message; return the time."""
    rig, rng = station.rig, random.Random(seed)
    up, down = (LossyLink(rng, (0.0, 0.06)) for _ in range(2))
    parser, last = mavlink.MAVLink(None), mavlink.MAVLink_mission_count_message(1, 1, len(items), 0)
    start_s, sent_s, tick_s = rig.now_s, -STATION_REPEAT_S, rig.now_s
    while rig.now_s < MAX_TIME_S:
        for message in itertools.chain.from_iterable(parser.parse_buffer(d) or [] for d in down.arrived(rig.now_s)):
            if message.get_type() == "MISSION_ACK":
                assert message.type == 0
                return rig.now_s - start_s
            if message.get_type() == "MISSION_REQUEST_INT":
                last, sent_s = items[message.seq], -STATION_REPEAT_S
        if rig.now_s - sent_s >= STATION_REPEAT_S:
            sent_s = rig.now_s
            up.put(rig.frame(last), rig.now_s)
        rig.now_s += 0.01
        for data in up.arrived(rig.now_s):
            rig.transport.inbox.append(("station", data))
            rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
        if rig.now_s - tick_s >= TICK_S:
            tick_s = rig.now_s
            rig.tick_silently(seconds=0.0)
        sent, rig.transport.sent = rig.transport.sent, []
        for _, data in sent:
            down.put(data, rig.now_s)
    raise AssertionError("no end of the upload")


def test_lost_frame_delays_an_upload_by_a_second_or_two(make_station):
    """Duplicates and repeated items must not count as slow replies, which would extend the interval to minutes."""
    times_s = sorted(upload_time_s(station := make_station(), station.mission(24), seed) for seed in range(16))
    assert times_s[len(times_s) // 2] < 12.0
    assert times_s[-1] < 30.0
