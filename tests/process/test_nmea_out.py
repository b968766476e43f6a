"""NMEA 0183 out of a boat under way: over UDP to two libraries, over TCP to gpsd."""

import json
import shutil
import socket
import subprocess
from contextlib import closing

import pynmea2
import pytest
from pynmeagps import NMEAReader

from support.harness import Hil
from support.program import unused_ports

PATIENCE_S = 60.0


@pytest.fixture
def boat(tmp_path):
    """A boat whose only links are outputs: UDP, and TCP for who comes."""
    hil = Hil(tmp_path, ["nmea:udpout", "nmea:tcpin"])
    yield hil
    hil.program.close()


def test_two_libraries_and_gpsd_read_what_she_says(boat):
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as listener:
        listener.bind(("127.0.0.1", boat.ports[0]))
        listener.settimeout(PATIENCE_S)
        heard, place = {}, None
        while not {"HDT", "HDG", "ROT", "RMC", "GGA", "RSA"} <= set(heard) or place is None:
            for line in listener.recv(4096).splitlines(keepends=True):
                parsed = pynmea2.parse(line.decode("ascii"), check=True)
                assert NMEAReader.parse(line, validate=1) is not None
                heard[parsed.sentence_type] = parsed
                if parsed.sentence_type == "RMC" and parsed.status == "A":
                    place = (parsed.latitude, parsed.longitude)
    assert 0.0 <= float(heard["HDT"].heading) < 360.0
    if shutil.which("gpsd") is None:
        pytest.skip("read by two libraries; gpsd is not here: apt-get install gpsd")
    fix = gpsd_fix(boat.ports[1])
    assert fix["lat"] == pytest.approx(place[0], abs=0.01)
    assert fix["lon"] == pytest.approx(place[1], abs=0.01)


def gpsd_fix(port):
    """Have gpsd connect, and return the first place that it tells."""
    (own,) = unused_ports(["tcp"])
    command = ["gpsd", "-N", "-n", "-S", str(own), f"tcp://127.0.0.1:{port}"]
    gpsd = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with closing(connected(own, gpsd)) as client:
            client.settimeout(PATIENCE_S)
            client.sendall(b'?WATCH={"enable":true,"json":true};\n')
            for line in client.makefile():
                said = json.loads(line)
                if said["class"] == "TPV" and said.get("mode", 0) >= 2 and "lat" in said:
                    return said
        pytest.fail("gpsd tells no place")
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
