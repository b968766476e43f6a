"""NMEA 0183 output of a boat: over UDP and a serial line to two libraries, over TCP to gpsd."""

import json
import os
import shutil
import socket
import subprocess
import tty
from contextlib import closing

import pynmea2
import pytest
from pynmeagps import NMEAReader

from support.harness import Hil
from support.program import unused_ports

TIMEOUT_S = 60.0


@pytest.fixture
def plotter():
    """A serial line: the file that a plotter reads, and the port of the boat."""
    master, slave = os.openpty()
    tty.setraw(slave)
    with os.fdopen(master, "rb", buffering=0) as file:
        yield file, os.ttyname(slave)
    os.close(slave)


@pytest.fixture
def boat(tmp_path, plotter):
    """A boat whose only links are NMEA outputs: UDP, a TCP server and a serial line."""
    hil = Hil(tmp_path, ["nmea:udpout", "nmea:tcpin"], links=[f"nmea:serial:{plotter[1]}:38400"])
    yield hil
    hil.program.close()


def test_two_libraries_and_gpsd_read_the_nmea_output(boat, plotter):
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as listener:
        listener.bind(("127.0.0.1", boat.ports[0]))
        listener.settimeout(TIMEOUT_S)
        sentences, position = {}, None
        while not {"HDT", "HDG", "ROT", "RMC", "GGA", "RSA"} <= set(sentences) or position is None:
            for line in listener.recv(4096).splitlines(keepends=True):
                parsed = parse_with_both_libraries(line)
                sentences[parsed.sentence_type] = parsed
                if parsed.sentence_type == "RMC" and parsed.status == "A":
                    position = (parsed.latitude, parsed.longitude)
    assert 0.0 <= float(sentences["HDT"].heading) < 360.0
    lines = (plotter[0].readline() for _ in range(100))  # the first lines may have no fix
    assert {"HDT", "RMC"} <= {parse_with_both_libraries(line).sentence_type for line in lines}
    if shutil.which("gpsd") is None:
        pytest.skip("checked with two libraries; gpsd is not installed: apt-get install gpsd")
    fix = gpsd_fix(boat.ports[1])
    assert fix["lat"] == pytest.approx(position[0], abs=0.01)
    assert fix["lon"] == pytest.approx(position[1], abs=0.01)


def parse_with_both_libraries(line):
    """Parse a sentence with both libraries; return the result of pynmea2."""
    assert NMEAReader.parse(line, validate=1) is not None
    return pynmea2.parse(line.decode("ascii"), check=True)


def gpsd_fix(port):
    """Let gpsd connect; return the first position that it reports."""
    (gpsd_port,) = unused_ports(["tcp"])
    command = ["gpsd", "-N", "-n", "-S", str(gpsd_port), f"tcp://127.0.0.1:{port}"]
    gpsd = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with closing(connect(gpsd_port, gpsd)) as client:
            client.settimeout(TIMEOUT_S)
            client.sendall(b'?WATCH={"enable":true,"json":true};\n')
            for line in client.makefile():
                output = json.loads(line)
                if output["class"] == "TPV" and output.get("mode", 0) >= 2 and "lat" in output:
                    return output
        pytest.fail("gpsd reports no position")
    finally:
        gpsd.kill()
        gpsd.wait()


def connect(port, gpsd):
    """Connect to gpsd once it listens."""
    while gpsd.poll() is None:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=TIMEOUT_S)
        except ConnectionRefusedError:
            continue
    pytest.fail("gpsd has ended")
    return None
