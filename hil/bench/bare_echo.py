"""The bare limit of an answer: a process that reads bytes and writes them on, and does nothing else.

`python -m hil.bench.bare_echo pty FROM TO` carries from one terminal to another;
`python -m hil.bench.bare_echo udp` answers on a UDP port of its own, whose number it prints.
Either prints a line when it is ready, and lasts until it is ended.
"""

from __future__ import annotations

import os
import select
import socket
import sys
from typing import NoReturn

from hil.bench.steady import steady

READ_BYTES = 4096


def echo_pty(source: str, target: str) -> NoReturn:
    """Write what comes from one terminal to another."""
    inward, outward = (os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK) for path in (source, target))
    print("ready", flush=True)
    while True:
        select.select([inward], [], [])
        os.write(outward, os.read(inward, READ_BYTES))


def echo_udp() -> NoReturn:
    """Send each datagram back to where it came from."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        print(server.getsockname()[1], flush=True)
        while True:
            select.select([server], [], [])
            server.sendto(*server.recvfrom(READ_BYTES))


if __name__ == "__main__":
    with steady():
        if sys.argv[1] == "pty":
            echo_pty(*sys.argv[2:4])
        else:
            echo_udp()
