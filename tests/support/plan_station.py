"""Messages of the mission protocol, and a second station."""

from pymavlink.dialects.v20 import common as mavlink

from firmware_py.plans.items import Command

OTHER = mavlink.MAVLink(None, srcSystem=254, srcComponent=190)


def count_message(number, kind=0):
    return mavlink.MAVLink_mission_count_message(1, 1, number, kind)


def clear_message(kind=0):
    return mavlink.MAVLink_mission_clear_all_message(1, 1, kind)


def ack_message(result):
    return mavlink.MAVLink_mission_ack_message(1, 1, result, 0)


def partial_message(first, last, kind=0):
    return mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, kind)


def acks(replies):
    return [reply.type for reply in replies if reply.get_type() == "MISSION_ACK"]


def exchange_as_other(station, message):
    """Send a message from system 254; return the replies."""
    return station.protocol(station.rig.give(message.pack(OTHER)))


def circle(station):
    return station.item(0, Command.INCLUDED_CIRCLE, kind=1, params=(5.0, 0, 0, 0))
