"""A satellite link with an emulated modem and network in simulated time, and messages with the key of the shore."""

import hashlib
import hmac
import struct

import msgspec
import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.records import RudderCommand
from firmware_py.common.reports import Output
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.open_transport import SatelliteSupport, open_transport
from hil.devices.iridium import IridiumModem
from hil.devices.iridium_network import IridiumNetwork
from support.link import SNAPSHOT, FakeRequestHandler, MemoryTransport, MemoryVault

KEY = bytes(range(32))
START_UTC_S = 1_793_491_200.0  # 2026-11-01
EPOCH_S = 1_420_070_400  # 2015-01-01, from which the numbers of messages count


class ModemLine:
    """A ByteLine with an emulated device at the other end."""

    name = "/dev/ttyModem"
    connected = True

    def __init__(self, device):
        self.device = device
        self.openings = 1
        self.now_s = 0.0
        self.waiting = b""

    def fileno(self):
        return 200

    def read(self):
        data, self.waiting = self.waiting[:4096], self.waiting[4096:]
        return data

    def write(self, data):
        self.device.receive(self.now_s, data)
        return True


class SatelliteBoat:
    """An endpoint with a satellite link and another link; `run` advances the time."""

    def __init__(self, *, key=None, vault=None, parameters=(), seed=1, options="", **network):
        self.network = IridiumNetwork(np.random.default_rng(seed), **network)
        self.modem = IridiumModem(self.network)
        self.line = ModemLine(self.modem)
        self.vault = vault or MemoryVault()
        self.request_handler = FakeRequestHandler()
        for name, value in dict(parameters).items():
            self.request_handler.values = self.request_handler.values.replaced(name, value)
        self.now_s = 0.0
        self.start_utc_s = START_UTC_S
        self.events = []
        self.changes = {}
        self.beside = MemoryTransport()
        self.start(key)

    def start(self, key=None):
        """Start the program with the stored state."""
        utc_s = lambda: self.start_utc_s + self.now_s  # noqa: E731
        ashore = SatelliteSupport(self.vault, utc_s, self.events.append)
        self.transport = open_transport("sbd:/dev/ttyModem", lambda _path, _baud: self.line, ashore)
        keys = MemoryVault()
        self.endpoint = Endpoint(
            [self.transport, self.beside], self.request_handler, utc_s=utc_s, version=Version(), vault=keys
        )
        if key is not None:
            self.endpoint._signing.set_key(key, 0)

    @property
    def intents(self):
        return self.request_handler.intents

    def status(self):
        return self.endpoint.status(self.now_s)[0].satellite

    def publish_events(self, *events):
        self._publish(events)

    def run(self, seconds, idle_s=None):
        """Advance the time; while the modem is idle, in steps of `idle_s` if it is set."""
        self.run_to(self.now_s + seconds, idle_s)

    def run_to(self, end_s, idle_s=None, step_s=0.5):
        """Advance the time to end_s, in whole steps."""
        while self.now_s < end_s:
            busy = idle_s is None or not self.transport._driver.modem.is_ready or self.line.waiting
            self.now_s += step_s if busy else idle_s
            self.line.now_s = self.now_s
            self.line.waiting += self.modem.take_output(self.now_s)
            ready = [200] if self.line.waiting else []
            self.endpoint.service(self.now_s, [*ready, self.transport.descriptors()[-1]])
            while self.endpoint.busy:
                self.endpoint.service(self.now_s, [])
            self._publish(())

    def _publish(self, events):
        snapshot = msgspec.structs.replace(SNAPSHOT, t_s=self.now_s, rate_hz=1.0, **self.changes)
        self.endpoint.publish(Output(RudderCommand(0.0, True), snapshot, tuple(events)), self.now_s)

    def delivered(self):
        """Return the frames that have arrived on shore since the last call, decoded by pymavlink."""
        messages = [message for _, _, message in self.network.delivered]
        self.network.delivered.clear()
        return [frame for message in messages for frame in mavlink.MAVLink(None).parse_buffer(message) or ()]

    def keyed(self, message, *, at_s=None, number=None, key=KEY, imei=None, system=255):
        """Return the short form of a message of the shore, encoded independently from its description."""
        written_s = self.start_utc_s + (self.now_s if at_s is None else at_s)
        number = int((written_s - EPOCH_S) * 100) if number is None else number
        frame = message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=190))
        payload = frame[10:-2]
        head = b"\xb5" + number.to_bytes(5, "little") + struct.pack("<BBH", system, 190, message.id)
        covered = head + payload
        context = b"sbd short form 1" + (imei or self.modem.imei).encode()
        return covered + hmac.new(key, context + covered, hashlib.sha256).digest()[:8]


def set_mode(mode, target=1):
    return mavlink.MAVLink_command_long_message(target, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, mode, 0, 0, 0, 0, 0)
