"""`rambler key` and a process of `rambler run` on one state directory: the key set by hand, and one that is lost."""

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

    def run(what, *more, typed=""):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(typed.encode())))
        code = main(["key", what, "--state", str(tmp_path / "state"), *more])
        return code, *capsys.readouterr()

    return run


def test_a_key_set_by_hand_is_the_stations_and_one_that_is_lost_shuts_the_boat(
    tmp_path, rambler_key, boot, free_ports, connect
):
    (tmp_path / "state").mkdir()
    assert rambler_key("set", typed=f"{PASSPHRASE}\n")[0] == 0
    assert json.loads(rambler_key("show-state", "--json")[1])["state"] == "present"
    cable, radio, sea = free_ports(["tcpin", "udpin", "udpin"])
    urls = [f"tcpin:127.0.0.1:{cable}?trusted=1", f"udpin:127.0.0.1:{radio}", f"udpout:127.0.0.1:{sea}?policy=open"]
    program = boot("first", *urls[:2])
    far = connect(f"udpout:127.0.0.1:{radio}", 201)
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == DENIED
    far.link.setup_signing(key_of_passphrase(PASSPHRASE))
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    # Under way the boat has locked the directory.
    for what in ("set", "remove"):
        code, out, error = rambler_key(what, typed="another\n")
        assert (code, out, error.count("\n")) == (2, "", 1)
        assert "in use by another autopilot; end that one, or set the key over a trusted link" in error
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    program.send_signal(2)
    assert program.exit_code() == 0
    # Both slots are lost: commands are accepted on the cable only, and other stations get the reason.
    files = sorted((tmp_path / "state").glob("signing.key.*"))
    assert len(files) == 2
    for path in files:
        path.write_bytes(path.read_bytes()[:60])
    assert json.loads(rambler_key("show-state", "--json")[1])["state"] == "lost"
    shore = socket.socket(
        socket.AF_INET, socket.SOCK_DGRAM
    )  # bound before the boat sends its text, which it sends once
    shore.bind(("127.0.0.1", sea))
    shore.settimeout(30.0)
    program = boot("second", *urls)
    while b"Signing key lost" not in (received := shore.recvfrom(2048))[0]:
        pass
    of_shore = mavlink.MAVLink(None, srcSystem=202)
    shore.sendto(mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", 33.0, 9).pack(of_shore), received[1])
    shore.close()
    near = connect(f"tcp:127.0.0.1:{cable}", 203)
    assert near.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    assert near.parameter("CTL_K1") != 33.0
    near.mav.setup_signing_send(1, 1, list(key_of_passphrase(PASSPHRASE)), 0)
    near.receive("STATUSTEXT", lambda text: text.text == "Signing key set")
    near.receive("STATUSTEXT", lambda text: text.text == "Signing key problem cleared")
    assert "signing.key lost: signing.key.0 is damaged, signing.key.1 is damaged" in program.text()
    program.send_signal(2)
    assert program.exit_code() == 0
    assert rambler_key("remove")[:2] == (0, f"{tmp_path / 'state'}: absent\n")
    assert not any(key_of_passphrase(PASSPHRASE).hex().encode() in path.read_bytes() for path in files)
