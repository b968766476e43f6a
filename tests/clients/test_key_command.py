"""`rambler key` and `rambler run` on one state directory: a key that is set by the command, and a lost key."""

import io
import json
import socket
import sys

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.__main__ import main
from firmware_py.link.signing import key_of_passphrase

PASSPHRASE = "seaworthy"
HOLD, DENIED, ACCEPTED = 4, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_ACCEPTED


@pytest.fixture
def rambler_key(tmp_path, monkeypatch, capsys):
    """Return a function that runs `rambler key` beside the boat; it returns exit code and output."""

    def run(action, *options, typed=""):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(typed.encode())))
        code = main(["key", action, "--state", str(tmp_path / "state"), *options])
        return code, *capsys.readouterr()

    return run


def test_key_set_by_the_command_is_required_and_a_lost_key_refuses_radio_commands(
    tmp_path, rambler_key, boot, free_ports, connect
):
    (tmp_path / "state").mkdir()
    assert rambler_key("set", typed=f"{PASSPHRASE}\n")[0] == 0
    assert json.loads(rambler_key("show-state", "--json")[1])["state"] == "present"
    cable_port, radio_port, shore_port = free_ports(["tcpin", "udpin", "udpin"])
    urls = [
        f"tcpin:127.0.0.1:{cable_port}?trusted=1",
        f"udpin:127.0.0.1:{radio_port}",
        f"udpout:127.0.0.1:{shore_port}?policy=open",
    ]
    program = boot("first", *urls[:2])
    radio_station = connect(f"udpout:127.0.0.1:{radio_port}", 201)
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == DENIED
    radio_station.link.setup_signing(key_of_passphrase(PASSPHRASE))
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    # The running autopilot has locked the directory.
    for action in ("set", "remove"):
        code, out, error = rambler_key(action, typed="another\n")
        assert (code, out, error.count("\n")) == (2, "", 1)
        assert "in use by another autopilot; end that one, or set the key over a trusted link" in error
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    program.send_signal(2)
    assert program.exit_code() == 0
    # Both slots are damaged: commands are accepted on the trusted link only, and other stations get the reason.
    files = sorted((tmp_path / "state").glob("signing.key.*"))
    assert len(files) == 2
    for path in files:
        path.write_bytes(path.read_bytes()[:60])
    assert json.loads(rambler_key("show-state", "--json")[1])["state"] == "lost"
    # Bound before the boat sends its text, which it sends once.
    shore = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    shore.bind(("127.0.0.1", shore_port))
    shore.settimeout(30.0)
    program = boot("second", *urls)
    while b"Signing key lost" not in (received := shore.recvfrom(2048))[0]:
        pass
    shore_mav = mavlink.MAVLink(None, srcSystem=202)
    shore.sendto(mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", 33.0, 9).pack(shore_mav), received[1])
    shore.close()
    cable_station = connect(f"tcp:127.0.0.1:{cable_port}", 203)
    assert cable_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    assert cable_station.parameter("CTL_K1") != 33.0
    cable_station.mav.setup_signing_send(1, 1, list(key_of_passphrase(PASSPHRASE)), 0)
    cable_station.receive("STATUSTEXT", lambda text: text.text == "Signing key set")
    cable_station.receive("STATUSTEXT", lambda text: text.text == "Signing key problem cleared")
    assert "signing.key lost: signing.key.0 is damaged, signing.key.1 is damaged" in program.text()
    program.send_signal(2)
    assert program.exit_code() == 0
    assert rambler_key("remove")[:2] == (0, f"{tmp_path / 'state'}: absent\n")
    assert not any(key_of_passphrase(PASSPHRASE).hex().encode() in path.read_bytes() for path in files)
