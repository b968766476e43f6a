"""NMEA 0183 out of a boat under way: over UDP and a serial line to two libraries, over TCP to gpsd."""

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

PATIENCE_S = 60.0


@pytest.fixture
def plotter():
    """The end of a serial line that a plotter reads, and the name of the boat's."""
    end, boats = os.openpty()
    tty.setraw(boats)
    with os.fdopen(end, "rb", buffering=0) as file:
        yield file, os.ttyname(boats)
    os.close(boats)


@pytest.fixture
def boat(tmp_path, plotter):
    """A boat whose only links are outputs: UDP, TCP for who comes, and a serial line."""
    hil = Hil(tmp_path, ["nmea:udpout", "nmea:tcpin"], links=[f"nmea:serial:{plotter[1]}:38400"])
    yield hil
    hil.program.close()


def test_two_libraries_and_gpsd_read_the_nmea_output(boat, plotter):
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as listener:
        listener.bind(("127.0.0.1", boat.ports[0]))
        listener.settimeout(PATIENCE_S)
        sentences, place = {}, None
        while not {"HDT", "HDG", "ROT", "RMC", "GGA", "RSA"} <= set(sentences) or place is None:
            for line in listener.recv(4096).splitlines(keepends=True):
                parsed = read_by_both(line)
                sentences[parsed.sentence_type] = parsed
                if parsed.sentence_type == "RMC" and parsed.status == "A":
                    place = (parsed.latitude, parsed.longitude)
    assert 0.0 <= float(sentences["HDT"].heading) < 360.0
    lines = (plotter[0].readline() for _ in range(100))  # in whose first there may be no fix yet
    assert {"HDT", "RMC"} <= {read_by_both(line).sentence_type for line in lines}
    if shutil.which("gpsd") is None:
        pytest.skip("read by two libraries; gpsd is not here: apt-get install gpsd")
    fix = gpsd_fix(boat.ports[1])
    assert fix["lat"] == pytest.approx(place[0], abs=0.01)
    assert fix["lon"] == pytest.approx(place[1], abs=0.01)


def read_by_both(line):
    """What a sentence says, read by one library and understood by the other."""
    assert NMEAReader.parse(line, validate=1) is not None
    return pynmea2.parse(line.decode("ascii"), check=True)


def gpsd_fix(port):
    """Let gpsd connect; return the first position that it reports."""
    (own,) = unused_ports(["tcp"])
    command = ["gpsd", "-N", "-n", "-S", str(own), f"tcp://127.0.0.1:{port}"]
    gpsd = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with closing(connected(own, gpsd)) as client:
            client.settimeout(PATIENCE_S)
            client.sendall(b'?WATCH={"enable":true,"json":true};\n')
            for line in client.makefile():
                output = json.loads(line)
                if output["class"] == "TPV" and output.get("mode", 0) >= 2 and "lat" in output:
                    return output
        pytest.fail("gpsd reports no position")
    finally:
        gpsd.kill()
        gpsd.wait()


def connected(port, gpsd):
    """Connect to gpsd once it listens."""
    while gpsd.poll() is None:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        except ConnectionRefusedError:
            continue
    pytest.fail("gpsd has ended")
    return None
