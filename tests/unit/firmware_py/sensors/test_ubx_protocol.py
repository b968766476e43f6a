"""UBX packets and NAV-PVT, down to the single field."""

import pytest

from firmware_py.common.records import FixType
from firmware_py.sensors import ubx_protocol
from firmware_py.sensors.message_error import MALFORMED, MessageError


def test_a_packet_and_its_parts(ubx):
    # The poll of NAV-PVT of the receiver description: B5 62 01 07 00 00 08 19.
    assert ubx(0x0107, b"") == bytes.fromhex("b5620107 0000 0819")
    (packet,) = ubx_protocol.framer().feed(bytes.fromhex("b5620107 0000 0819"))
    assert (packet.fault, ubx_protocol.message(packet.data), ubx_protocol.payload(packet.data)) == ("", 0x0107, b"")


def test_the_recorded_first_solution(recordings):
    packets = ubx_protocol.framer().feed((recordings / "ubx" / "gpsd_ublox-neo-m8n.log").read_bytes())
    solution = ubx_protocol.parse_nav_pvt(ubx_protocol.payload(packets[1].data))
    assert (solution.fix, solution.satellites) == (FixType.DGPS, 14)
    assert (solution.lat_deg, solution.lon_deg) == pytest.approx((-34.9062263, 138.6081197))


def test_the_size_of_u_blox_7_is_enough_and_less_is_not(solution):
    payload = ubx_protocol.payload(solution())
    assert ubx_protocol.parse_nav_pvt(payload[:84]) == ubx_protocol.parse_nav_pvt(payload)
    with pytest.raises(MessageError) as refusal:
        ubx_protocol.parse_nav_pvt(payload[:83])
    assert refusal.value.error == MALFORMED
