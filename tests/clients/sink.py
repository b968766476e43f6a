"""Receives and discards the data of a flood: `python sink.py UDP_PORT TCP_PORT DESCRIPTOR`.

It prints a line when it is ready, and runs until it is ended.
"""

import os
import select
import socket
import sys

READ_BYTES = 65536


def discard_all(udp_port, tcp_port, descriptor):
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind(("127.0.0.1", udp_port))
    tcp = socket.create_server(("127.0.0.1", tcp_port))
    os.set_blocking(descriptor, False)
    clients = []
    print("ready", flush=True)
    while True:
        for ready in select.select([udp, tcp, descriptor, *clients], [], [])[0]:
            if ready is tcp:
                clients.append(tcp.accept()[0])
            elif ready == descriptor:
                os.read(descriptor, READ_BYTES)
            elif not is_open(ready):
                clients.remove(ready)
                ready.close()


def is_open(end):
    """Read from a socket; return whether it is still open."""
    try:
        return bool(end.recv(READ_BYTES)) or end.type is socket.SOCK_DGRAM
    except OSError:
        return False


if __name__ == "__main__":
    discard_all(*map(int, sys.argv[1:]))
