"""Two stations of one id upload at the same time over UDP: each is the way that it comes by."""

import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

PATIENCE_S = 20.0
MISSION = 0


class Uploader:
    """A station 255/190 on a socket of its own, which answers one message at a time."""

    def __init__(self, port, latitude):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self.socket.connect(("127.0.0.1", port))
        self.mav = mavlink.MAVLink(self, srcSystem=255, srcComponent=190)
        self.parser = mavlink.MAVLink(None)
        self.waiting = []
        self.latitude = latitude
        self.mav.heartbeat_send(6, 8, 0, 0, 0)

    def write(self, data):
        self.socket.send(data)

    def answer(self, *kinds):
        """The next message of the mission protocol, or of the kinds given."""
        while True:
            while self.waiting:
                message = self.waiting.pop(0)
                if message.get_type() in (kinds or ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")):
                    return message
            self.waiting += self.parser.parse_buffer(self.socket.recv(4096)) or []

    def count(self, items):
        self.mav.mission_count_send(1, 1, items, MISSION)

    def item(self, sequence):
        self.mav.mission_item_int_send(
            1, 1, sequence, 6, 16, 0, 1, 0, 0, 0, 0, self.latitude + sequence, 1_210_000_000, 0, MISSION
        )

    def download(self):
        """The latitudes of the mission in force, without home."""
        self.mav.mission_request_list_send(1, 1, MISSION)
        rows = range(1, self.answer("MISSION_COUNT").count)
        for row in rows:
            self.mav.mission_request_int_send(1, 1, row, MISSION)
        latitudes = [self.answer("MISSION_ITEM_INT").x for _ in rows]
        self.mav.mission_ack_send(1, 1, mavlink.MAV_MISSION_ACCEPTED, MISSION)
        return latitudes


@pytest.fixture
def uploaders(boot, free_ports):
    """Starts a boat and gives two stations, on one link or on one each; and closes them."""
    opened = []

    def begin(links):
        ports = free_ports(["udpout"] * links)
        boot("boat", *(f"udpin:127.0.0.1:{port}" for port in ports))
        opened.extend(
            Uploader(port, latitude) for port, latitude in zip((ports * 2)[:2], (10**8, 2 * 10**8), strict=True)
        )
        return opened

    yield begin
    for uploader in opened:
        uploader.socket.close()


@pytest.mark.parametrize("links", [1, 2])
def test_two_uploads_at_once_are_never_mixed(uploaders, links):
    first, second = uploaders(links)
    first.count(4)
    second.count(3)
    seen = {first: [], second: []}
    acks = {}
    left = [first, second]
    while left:
        for station in list(left):
            message = station.answer()
            if message.get_type() == "MISSION_ACK":
                acks[station] = message.type
                left.remove(station)
                continue
            seen[station].append(message.seq)
            station.item(message.seq)
    (winner,) = (station for station, result in acks.items() if result == mavlink.MAV_MISSION_ACCEPTED)
    loser = second if winner is first else first
    count = 4 if winner is first else 3
    assert acks[loser] == mavlink.MAV_MISSION_DENIED
    assert (sorted(set(seen[winner])), seen[loser]) == (list(range(count)), [])
    for station in (winner, loser):
        assert station.download() == [winner.latitude + sequence for sequence in range(1, count)]


def test_a_refused_count_ends_the_own_upload(uploaders):
    station, other = uploaders(1)
    station.count(4)
    assert station.answer().seq == 0
    station.count(2500)
    acks = []
    while not acks:
        message = station.answer()
        acks += [message.type] if message.get_type() == "MISSION_ACK" else []
    assert acks == [mavlink.MAV_MISSION_NO_SPACE]
    # The way is free for the other one at once.
    other.count(1)
    assert other.answer().seq == 0
    other.item(0)
    assert other.answer().type == mavlink.MAV_MISSION_ACCEPTED
