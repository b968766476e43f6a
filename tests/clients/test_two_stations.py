"""Two stations with the same id upload at the same time over UDP: their addresses distinguish them."""

import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

PATIENCE_S = 20.0
MISSION = 0


class Uploader:
    """A station 255/190 with its own socket, which replies to one message at a time."""

    def __init__(self, port, latitude):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self.socket.connect(("127.0.0.1", port))
        self.mav = mavlink.MAVLink(self, srcSystem=255, srcComponent=190)
        self.parser = mavlink.MAVLink(None)
        self.unread = []
        self.latitude = latitude
        self.mav.heartbeat_send(6, 8, 0, 0, 0)

    def write(self, data):
        self.socket.send(data)

    def receive(self, *kinds):
        """Return the next message of the mission protocol, or of the given kinds."""
        while True:
            while self.unread:
                message = self.unread.pop(0)
                if message.get_type() in (kinds or ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")):
                    return message
            self.unread += self.parser.parse_buffer(self.socket.recv(4096)) or []

    def send_count(self, items):
        self.mav.mission_count_send(1, 1, items, MISSION)

    def send_item(self, sequence):
        self.mav.mission_item_int_send(
            1, 1, sequence, 6, 16, 0, 1, 0, 0, 0, 0, self.latitude + sequence, 1_210_000_000, 0, MISSION
        )

    def download(self):
        """Return the latitudes of the active mission, without home."""
        self.mav.mission_request_list_send(1, 1, MISSION)
        rows = range(1, self.receive("MISSION_COUNT").count)
        for row in rows:
            self.mav.mission_request_int_send(1, 1, row, MISSION)
        latitudes = [self.receive("MISSION_ITEM_INT").x for _ in rows]
        self.mav.mission_ack_send(1, 1, mavlink.MAV_MISSION_ACCEPTED, MISSION)
        return latitudes


@pytest.fixture
def uploaders(boot, free_ports):
    """Return a function that starts a boat; it returns two stations on one link, or each on its own."""
    opened = []

    def start(links):
        ports = free_ports(["udpout"] * links)
        boot("boat", *(f"udpin:127.0.0.1:{port}" for port in ports))
        opened.extend(
            Uploader(port, latitude) for port, latitude in zip((ports * 2)[:2], (10**8, 2 * 10**8), strict=True)
        )
        return opened

    yield start
    for uploader in opened:
        uploader.socket.close()


@pytest.mark.parametrize("links", [1, 2])
def test_two_uploads_at_once_are_never_mixed(uploaders, links):
    first, second = uploaders(links)
    first.send_count(4)
    second.send_count(3)
    requested = {first: [], second: []}
    acks = {}
    uploading = [first, second]
    while uploading:
        for station in list(uploading):
            message = station.receive()
            if message.get_type() == "MISSION_ACK":
                acks[station] = message.type
                uploading.remove(station)
                continue
            requested[station].append(message.seq)
            station.send_item(message.seq)
    (winner,) = (station for station, result in acks.items() if result == mavlink.MAV_MISSION_ACCEPTED)
    loser = second if winner is first else first
    count = 4 if winner is first else 3
    assert acks[loser] == mavlink.MAV_MISSION_DENIED
    assert (sorted(set(requested[winner])), requested[loser]) == (list(range(count)), [])
    for station in (winner, loser):
        assert station.download() == [winner.latitude + sequence for sequence in range(1, count)]


def test_refused_count_ends_the_upload_of_its_station(uploaders):
    station, other = uploaders(1)
    station.send_count(4)
    assert station.receive().seq == 0
    station.send_count(2500)
    acks = []
    while not acks:
        message = station.receive()
        acks += [message.type] if message.get_type() == "MISSION_ACK" else []
    assert acks == [mavlink.MAV_MISSION_NO_SPACE]
    # The other station can upload at once.
    other.send_count(1)
    assert other.receive().seq == 0
    other.send_item(0)
    assert other.receive().type == mavlink.MAV_MISSION_ACCEPTED
