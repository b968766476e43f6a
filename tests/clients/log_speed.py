"""Measures how fast a running autopilot sends a log, requested in chunks as by MAVSDK and QGroundControl.

    python log_speed.py PORT        the autopilot's link is udpout:127.0.0.1:PORT

It downloads the largest log and prints its size, the time and the rate.
"""

import socket
import struct
import sys
import time

from pymavlink.dialects.v20 import common as mavlink

CHUNK_BYTES = 512 * 90
PATIENCE_S = 2.0


def frames(datagram):
    """Yield the message ids and payloads in a datagram of MAVLink 2."""
    start = 0
    while start < len(datagram):
        length = datagram[start + 1]
        yield int.from_bytes(datagram[start + 7 : start + 10], "little"), datagram[start + 10 : start + 10 + length]
        start += length + 12


class Station:
    """A minimal ground station, so that its own speed does not matter."""

    def __init__(self, port):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(PATIENCE_S)
        self._boat = self._socket.recvfrom(4096)[1]
        self._mav = mavlink.MAVLink(None, 255, 190)

    def send(self, message):
        self._socket.sendto(message.pack(self._mav), self._boat)

    def payloads(self, number):
        """Yield the payloads of a message until PATIENCE_S passes without a datagram."""
        while True:
            try:
                datagram = self._socket.recv(4096)
            except TimeoutError:
                return
            yield from (payload for message_id, payload in frames(datagram) if message_id == number)

    def find_largest(self):
        """Return the number and the size of the largest log."""
        self.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
        sizes = {}
        for payload in self.payloads(118):
            _, size, number, count, _ = struct.unpack("<IIHHH", payload.ljust(14, b"\0"))
            sizes[number] = size
            if len(sizes) >= count:
                break
        return max(sizes.items(), key=lambda entry: entry[1])

    def fetch(self, number, start, count):
        """Return one chunk; request all of it again while data are missing."""
        data_by_offset, received_bytes = {}, 0
        while received_bytes < count:
            self.send(mavlink.MAVLink_log_request_data_message(1, 1, number, start, count))
            for payload in self.payloads(120):
                message = payload.ljust(97, b"\0")
                offset, _, length = struct.unpack_from("<IHB", message)
                if offset not in data_by_offset:
                    data_by_offset[offset] = message[7 : 7 + length]
                    received_bytes += length
                if received_bytes >= count:
                    break
        return b"".join(data_by_offset[offset] for offset in sorted(data_by_offset))


def main():
    station = Station(int(sys.argv[1]))
    number, size = station.find_largest()
    start_s, content = time.perf_counter(), bytearray()
    while len(content) < size:
        content += station.fetch(number, len(content), min(CHUNK_BYTES, size - len(content)))
    seconds = time.perf_counter() - start_s
    print(f"log {number}: {size} bytes in {seconds:.2f} s, {size / seconds / 1e6:.2f} MB/s")


if __name__ == "__main__":
    main()
