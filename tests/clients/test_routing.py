"""A companion computer on one link and a station on another: the autopilot forwards messages between them."""

COMPANION = 191


def test_a_station_commands_the_companion_behind_the_boat(boot, free_ports, connect):
    ports = free_ports(["udpin", "tcpin"])
    boot("boat", f"udpout:127.0.0.1:{ports[0]}", f"tcpin:127.0.0.1:{ports[1]}")
    companion = connect(f"tcp:127.0.0.1:{ports[1]}", source_system=1)
    companion.mav.srcComponent = COMPANION
    station = connect(f"udpin:127.0.0.1:{ports[0]}", source_system=255)
    companion.show_presence()
    station.receive("HEARTBEAT", lambda heartbeat: heartbeat.get_srcComponent() == COMPANION)
    companion.receive("HEARTBEAT", lambda heartbeat: heartbeat.get_srcSystem() == 255)
    station.mav.command_long_send(1, COMPANION, 2000, 0, *[0.0] * 7)
    command = companion.receive("COMMAND_LONG", lambda message: message.command == 2000)
    assert (command.get_srcSystem(), command.target_component) == (255, COMPANION)
    companion.mav.command_ack_send(2000, 0, 0, 0, 255, command.get_srcComponent())
    ack = station.receive("COMMAND_ACK", lambda ack: ack.command == 2000)
    assert (ack.get_srcComponent(), ack.result) == (COMPANION, 0)
