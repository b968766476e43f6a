"""Plans over a link that loses, doubles, delays and reorders a quarter of the frames, both ways."""

import heapq
import itertools
import random

import pytest
from pymavlink.dialects.v20 import common as mavlink

ITEMS = 40
TICK_S = 0.1
LONGEST_S = 900.0
SILENCE_S = 1.0  # then a station says its last word again


class Relay:
    """Takes messages and gives them after a while, or not, or twice."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.waiting = []
        self.order = itertools.count()

    def put(self, message, now_s):
        if self.random.random() < 0.25:
            return
        for _ in range(2 if self.random.random() < 0.25 else 1):
            delay_s = self.random.uniform(0.3, 1.0) if self.random.random() < 0.25 else self.random.uniform(0.0, 0.05)
            heapq.heappush(self.waiting, (now_s + delay_s, next(self.order), message))

    def due(self, now_s):
        found = []
        while self.waiting and self.waiting[0][0] <= now_s:
            found.append(heapq.heappop(self.waiting)[2])
        return found


class FarStation:
    """A plain ground station: one question at a time, asked again after a second, given up never."""

    def __init__(self, station, seed):
        self.near = station
        self.up, self.down = Relay(seed), Relay(seed + 1)

    def send(self, message):
        self.up.put(message, self.near.rig.now_s)

    def received(self):
        """Let a tick go by; return what has come."""
        rig = self.near.rig
        for message in self.up.due(rig.now_s):
            for reply in self.near.answers(message):
                self.down.put(reply, rig.now_s)
        for message in self.near.protocol(rig.tick(seconds=TICK_S)):
            self.down.put(message, rig.now_s)
        return self.down.due(rig.now_s)

    def ask(self, question, wanted):
        """Ask until an answer is as wanted."""
        asked_s = -1.0
        while self.near.rig.now_s < LONGEST_S:
            if self.near.rig.now_s - asked_s >= 1.0:
                self.send(question)
                asked_s = self.near.rig.now_s
            for message in self.received():
                if wanted(message):
                    return message
        raise AssertionError(f"{question} was never answered")

    def upload(self, items):
        """PlanUpload a plan; return the result of it."""
        last, sent_s = mavlink.MAVLink_mission_count_message(1, 1, len(items), 0), self.near.rig.now_s
        self.send(last)
        while self.near.rig.now_s < LONGEST_S:
            for message in self.received():
                if message.get_type() == "MISSION_ACK":
                    return message
                if message.seq < len(items):  # else of an upload that is over
                    last, sent_s = items[message.seq], self.near.rig.now_s
                    self.send(last)
            if self.near.rig.now_s - sent_s >= 3.0:
                sent_s = self.near.rig.now_s
                self.send(last)
        raise AssertionError("the upload never ended")

    def download(self):
        count = self.ask(
            mavlink.MAVLink_mission_request_list_message(1, 1, 0), lambda one: one.get_type() == "MISSION_COUNT"
        )
        return [
            self.ask(
                mavlink.MAVLink_mission_request_int_message(1, 1, sequence, 0),
                lambda one, sequence=sequence: one.get_type() == "MISSION_ITEM_INT" and one.seq == sequence,
            )
            for sequence in range(count.count)
        ]


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(1, 20))])
def test_plans_come_and_go_whole_over_a_bad_link(station, seed):
    far = FarStation(station, seed)
    items = station.mission(ITEMS)
    ack = far.upload(items)
    assert (ack.type, ack.opaque_id) == (0, station.rig.request_handler.plans().mission.identity)
    assert station.places() == list(range(1, 1 + ITEMS))
    assert station.all_fields(far.download()[1:]) == station.all_fields(items[1:])
    # And another after it, with all that is still on its way from the first.
    again = station.mission(20, start=1000)
    far.upload(again)
    for _ in range(200):
        far.received()
    assert station.places() in (list(range(1001, 1021)), list(range(1, 1 + ITEMS)))


class Line:
    """Loses, doubles and delays a quarter, byte for byte."""

    def __init__(self, chances):
        self.chances = chances
        self.waiting = []
        self.order = itertools.count()

    def put(self, data, now_s):
        if self.chances.random() < 0.25:
            return
        for _ in range(2 if self.chances.random() < 0.25 else 1):
            delay_s = self.chances.uniform(0.0, 0.06) if self.chances.random() < 0.25 else 0.0
            heapq.heappush(self.waiting, (now_s + delay_s, next(self.order), data))

    def due(self, now_s):
        while self.waiting and self.waiting[0][0] <= now_s:
            yield heapq.heappop(self.waiting)[2]


def upload_s(station, items, seed):
    """How long an upload takes from a station that knows MISSION_REQUEST_INT alone and repeats itself in silence."""
    rig, chances = station.rig, random.Random(seed)
    up, down, parser = Line(chances), Line(chances), mavlink.MAVLink(None)
    last = mavlink.MAVLink_mission_count_message(1, 1, len(items), 0)
    begun_s, sent_s, tick_s = rig.now_s, -SILENCE_S, rig.now_s

    def carry():
        sent, rig.transport.sent = rig.transport.sent, []
        for _, data in sent:
            down.put(data, rig.now_s)

    while rig.now_s < LONGEST_S:
        for data in down.due(rig.now_s):
            for message in parser.parse_buffer(data) or []:
                if message.get_type() == "MISSION_ACK":
                    assert message.type == 0
                    return rig.now_s - begun_s
                if message.get_type() == "MISSION_REQUEST_INT":
                    last, sent_s = items[message.seq], -SILENCE_S
        if rig.now_s - sent_s >= SILENCE_S:
            sent_s = rig.now_s
            up.put(rig.frame(last), rig.now_s)
        rig.now_s += 0.01
        for data in up.due(rig.now_s):
            rig.transport.inbox.append(("station", data))
            rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
        if rig.now_s - tick_s >= TICK_S:
            tick_s = rig.now_s
            rig.tick_silently(seconds=0.0)
        carry()
    raise AssertionError("the upload never ended")


def test_a_lost_frame_costs_a_second_or_two(make_station):
    """Doubles and what a station repeats in silence were taken for answers that take long: minutes at worst."""
    took_s = sorted(upload_s(station := make_station(), station.mission(24), seed) for seed in range(16))
    assert took_s[len(took_s) // 2] < 12.0
    assert took_s[-1] < 30.0
