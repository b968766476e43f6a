"""A lossy UDP relay: drops, duplicates, delays and reorders datagrams in both directions, from a seed."""

import heapq
import random
import select
import socket
import threading
import time

import pytest

SHARE = 0.25
MAX_DELAY_S = 0.06  # later datagrams overtake a delayed one
RETRY_S = 0.25  # longer than the delay
RETRIES = 40


class Relay:
    """A context that forwards datagrams between a boat that sends to `port` and a station at `station_port`.

    A share (`share`) of the datagrams of each direction is dropped, the same share of the others duplicated, and the
    same share of all forwarded ones delayed, so that later ones overtake them. While `cut` is true, all are dropped.
    """

    def __init__(self, station_port, seed, share=SHARE, port=0):
        self._rng = random.Random(seed)
        self._share = share
        self.cut = False
        self._boat = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._boat.bind(("127.0.0.1", port))
        self._station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._station.connect(("127.0.0.1", station_port))
        self.port = self._boat.getsockname()[1]
        self._boat_address = None
        self._later = []  # heap of (time, number, socket, data)
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
                    continue  # the station is not started yet
                if ready is self._boat:
                    self._boat_address = address
                self._take(data, self._station if ready is self._boat else self._boat)
            while self._later and self._later[0][0] <= time.monotonic():
                self._send(*heapq.heappop(self._later)[2:])

    def _draw(self):
        return self._rng.random() < self._share

    def _take(self, data, target):
        if self.cut or self._draw():
            self.counts["dropped"] += 1
            return
        self.counts["carried"] += 1
        copies = 1
        if self._draw():
            copies = 2
            self.counts["doubled"] += 1
        for _ in range(copies):
            if self._draw():
                self.counts["delayed"] += 1
                self._number += 1
                send_s = time.monotonic() + self._rng.uniform(0.0, MAX_DELAY_S)
                heapq.heappush(self._later, (send_s, self._number, target, data))
            else:
                self._send(target, data)

    def _send(self, target, data):
        try:
            if target is self._station:
                target.send(data)
            elif self._boat_address is not None:
                target.sendto(data, self._boat_address)
        except ConnectionRefusedError:
            pass


def check_losses(relay):
    total = relay.counts["carried"] + relay.counts["dropped"]
    assert total > 40
    assert 0.1 < relay.counts["dropped"] / total < 0.4
    assert relay.counts["doubled"] > 3
    assert relay.counts["delayed"] > 3


def request_reply(station, ask, kind, wanted=lambda _: True):
    """Repeat a request until there is a reply of this kind that is `wanted`; return it."""
    for _ in range(RETRIES):
        ask()
        retry_s = time.monotonic() + RETRY_S
        while (remaining_s := retry_s - time.monotonic()) > 0.0:
            message = station.link.recv_match(type=kind, blocking=True, timeout=remaining_s)
            if message is not None and wanted(message):
                return message
    return pytest.fail(f"no {kind} after {RETRIES} requests")
