"""Reads the data of a flood and does nothing else: `python sink.py UDP_PORT TCP_PORT DESCRIPTOR`.

Prints a line when it is ready, and lasts until it is ended.
"""

import os
import select
import socket
import sys

READ_BYTES = 65536


def swallow_all(udp_port, tcp_port, descriptor):
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
            elif not received(ready):
                clients.remove(ready)
                ready.close()


def received(end):
    try:
        return end.recv(READ_BYTES) or end.type is socket.SOCK_DGRAM
    except OSError:
        return b""


if __name__ == "__main__":
    swallow_all(*map(int, sys.argv[1:]))
