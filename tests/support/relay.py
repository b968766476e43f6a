"""A lossy sea between two UDP ends: drops, doubles, delays and reorders datagrams, seeded, both ways."""

import heapq
import random
import select
import socket
import threading
import time

import pytest

PART = 0.25
DELAY_S = 0.06  # at most; what follows overtakes what is delayed
RETRY_S = 0.25  # longer than that
RETRIES = 40


class Relay:
    """Carries datagrams between a boat that sends to `port` and a station at `station_port`; a context.

    Of the datagrams of each way a quarter is dropped, a quarter of the rest doubled, and of
    all that go on a quarter is delayed, so that later ones overtake them; another `part` is another share. Nothing
    is carried while it is `cut`.
    """

    def __init__(self, station_port, seed, part=PART, port=0):
        self._chances = random.Random(seed)
        self._part = part
        self.cut = False
        self._boat = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._boat.bind(("127.0.0.1", port))
        self._station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._station.connect(("127.0.0.1", station_port))
        self.port = self._boat.getsockname()[1]
        self._boat_address = None
        self._later = []  # heap of (when, number, socket, data)
        self._number = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.counts = {"carried": 0, "dropped": 0, "doubled": 0, "delayed": 0}

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        self._boat.close()
        self._station.close()

    def _run(self):
        while not self._ended.is_set():
            until_s = self._later[0][0] - time.monotonic() if self._later else 0.05
            for ready in select.select([self._boat, self._station], [], [], max(0.0, min(until_s, 0.05)))[0]:
                try:
                    data, address = ready.recvfrom(4096)
                except ConnectionRefusedError:
                    continue  # the station is not there yet
                if ready is self._boat:
                    self._boat_address = address
                self._take(data, self._station if ready is self._boat else self._boat)
            while self._later and self._later[0][0] <= time.monotonic():
                self._send(*heapq.heappop(self._later)[2:])

    def _chance(self):
        return self._chances.random() < self._part

    def _take(self, data, way):
        if self.cut or self._chance():
            self.counts["dropped"] += 1
            return
        self.counts["carried"] += 1
        copies = 1
        if self._chance():
            copies = 2
            self.counts["doubled"] += 1
        for _ in range(copies):
            if self._chance():
                self.counts["delayed"] += 1
                self._number += 1
                when_s = time.monotonic() + self._chances.uniform(0.0, DELAY_S)
                heapq.heappush(self._later, (when_s, self._number, way, data))
            else:
                self._send(way, data)

    def _send(self, way, data):
        try:
            if way is self._station:
                way.send(data)
            elif self._boat_address is not None:
                way.sendto(data, self._boat_address)
        except ConnectionRefusedError:
            pass


def check_losses(relay):
    whole = relay.counts["carried"] + relay.counts["dropped"]
    assert whole > 40
    assert 0.1 < relay.counts["dropped"] / whole < 0.4
    assert relay.counts["doubled"] > 3
    assert relay.counts["delayed"] > 3


def request_reply(station, ask, kind, wanted=lambda _: True):
    """Ask until it is answered, as the protocols have it."""
    for _ in range(RETRIES):
        ask()
        again_s = time.monotonic() + RETRY_S
        while (left_s := again_s - time.monotonic()) > 0.0:
            message = station.link.recv_match(type=kind, blocking=True, timeout=left_s)
            if message is not None and wanted(message):
                return message
    return pytest.fail(f"no {kind} after {RETRIES} questions")
