"""Measures how fast a running autopilot sends a log: chunk by chunk, as MAVSDK and QGroundControl ask for it.

    python log_speed.py PORT        the autopilot's link is udpout:127.0.0.1:PORT

It takes the largest log and prints its size, the time and the rate.
"""

import socket
import struct
import sys
import time

from pymavlink.dialects.v20 import common as mavlink

CHUNK_BYTES = 512 * 90
PATIENCE_S = 2.0


def frames(datagram):
    """The message ids and payloads in a datagram of MAVLink 2."""
    start = 0
    while start < len(datagram):
        length = datagram[start + 1]
        yield int.from_bytes(datagram[start + 7 : start + 10], "little"), datagram[start + 10 : start + 10 + length]
        start += length + 12


class Station:
    """Just enough of a ground station, so that it is not what is measured."""

    def __init__(self, port):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(PATIENCE_S)
        self._boat = self._socket.recvfrom(4096)[1]
        self._mav = mavlink.MAVLink(None, 255, 190)

    def send(self, message):
        self._socket.sendto(message.pack(self._mav), self._boat)

    def payloads(self, number):
        """The payloads of a message, until nothing comes."""
        while True:
            try:
                datagram = self._socket.recv(4096)
            except TimeoutError:
                return
            yield from (payload for found, payload in frames(datagram) if found == number)

    def largest(self):
        """The number and size of the largest log."""
        self.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
        sizes = {}
        for payload in self.payloads(118):
            _, size, number, count, _ = struct.unpack("<IIHHH", payload.ljust(14, b"\0"))
            sizes[number] = size
            if len(sizes) >= count:
                break
        return max(sizes.items(), key=lambda entry: entry[1])

    def fetch(self, number, start, count):
        """One chunk; asks again for all of it when something is missing."""
        found, have = {}, 0
        while have < count:
            self.send(mavlink.MAVLink_log_request_data_message(1, 1, number, start, count))
            for payload in self.payloads(120):
                whole = payload.ljust(97, b"\0")
                offset, _, length = struct.unpack_from("<IHB", whole)
                if offset not in found:
                    found[offset] = whole[7 : 7 + length]
                    have += length
                if have >= count:
                    break
        return b"".join(found[offset] for offset in sorted(found))


def main():
    station = Station(int(sys.argv[1]))
    number, size = station.largest()
    begun_s, content = time.perf_counter(), bytearray()
    while len(content) < size:
        content += station.fetch(number, len(content), min(CHUNK_BYTES, size - len(content)))
    seconds = time.perf_counter() - begun_s
    print(f"log {number}: {size} bytes in {seconds:.2f} s, {size / seconds / 1e6:.2f} MB/s")


if __name__ == "__main__":
    main()
