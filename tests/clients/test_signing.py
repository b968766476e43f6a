"""Signed links of `rambler run` with pymavlink and MAVProxy, and after a kill."""

import os
import shutil
import signal
import sys
from hashlib import sha256
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

PASSPHRASE = "seaworthy"
KEY = sha256(PASSPHRASE.encode()).digest()
HOLD, DENIED, ACCEPTED = 4, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_ACCEPTED


def key_files(tmp_path):
    return sorted((tmp_path / "state").glob("signing.key.*"))


def test_key_set_on_a_trusted_link_is_required_on_the_other(tmp_path, boot, free_ports, connect):
    cable_port, radio_port = free_ports(["tcpin", "udpin"])
    urls = [f"tcpin:127.0.0.1:{cable_port}?trusted=1", f"udpin:127.0.0.1:{radio_port}"]
    program = boot("first", *urls)
    cable_station, radio_station = (
        connect(f"tcp:127.0.0.1:{cable_port}"),
        connect(f"udpout:127.0.0.1:{radio_port}", 201),
    )
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    radio_station.mav.setup_signing_send(1, 1, list(KEY), 0)
    radio_station.receive("STATUSTEXT", lambda text: "SETUP_SIGNING refused" in text.text)
    cable_station.mav.setup_signing_send(1, 1, list(KEY), 0)
    cable_station.receive("STATUSTEXT", lambda text: text.text == "Signing key set")
    # A station without the key can read parameters, but not command.
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == DENIED
    assert radio_station.parameter("CTL_K2") == pytest.approx(0.3)
    # A station with the key can command; the messages that it receives are signed.
    radio_station.link.setup_signing(KEY)
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    assert radio_station.link.mav.signing.goodsig_count > 0
    modes = {path.stat().st_mode & 0o777 for path in key_files(tmp_path)}
    assert modes == {0o600}
    # After a kill the key is kept, and timestamps continue after all used ones.
    program.send_signal(signal.SIGKILL)
    program.exit_code()
    program = boot("second", *urls)
    other_station = connect(f"udpout:127.0.0.1:{radio_port}", 202)
    assert other_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == DENIED
    radio_station.mav.heartbeat_send(6, 8, 0, 0, 0)  # its timestamp is too old; it takes that of the next message
    radio_station.receive("HEARTBEAT")
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    # Only a trusted link can remove the key.
    other_station.mav.setup_signing_send(1, 1, [0] * 32, 0)
    other_station.receive("STATUSTEXT", lambda text: "SETUP_SIGNING refused" in text.text)
    cable_station = connect(f"tcp:127.0.0.1:{cable_port}", 203)
    cable_station.mav.setup_signing_send(1, 1, [0] * 32, 0)
    cable_station.receive("STATUSTEXT", lambda text: text.text == "Signing key removed")
    assert other_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    files = key_files(tmp_path)
    assert len(files) == 2

    def is_erased():
        return not any(KEY.hex().encode() in path.read_bytes() for path in files)

    program.wait_for(is_erased, "the key is still on the disk")


def parameter_text(client, name):
    client.say(f"param show {name}")
    return client.expect(rf"{name} +(\S+)\s")[1]


def test_mavproxy_sets_up_a_key_and_commands_with_it(tmp_path, boot, start, free_ports, connect):
    script = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip("mavproxy.py is not beside this Python; install the extra [clients]")
    cable_port, radio_port = free_ports(["tcpin", "udpin"])
    boot("boat", f"tcpin:127.0.0.1:{cable_port}?trusted=1&policy=signed-commands", f"udpin:127.0.0.1:{radio_port}")
    home = tmp_path / "home"
    home.mkdir()
    env = {**os.environ, "HOME": str(home), "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, script, f"--master=tcp:127.0.0.1:{cable_port}", f"--state-basedir={home}"]
    client = start("mavproxy", command, cwd=home, env=env)
    client.expect("online system 1")
    client.say("mode HOLD")
    client.expect("COMMAND_LONG refused: not signed|DENIED")
    client.say(f"signing setup {PASSPHRASE}")
    client.expect("Signing key set")
    client.say("param fetch")
    client.expect(r"Saved \d+ parameters")
    client.say("param set CTL_K1 37.5")
    client.wait_for(lambda: parameter_text(client, "CTL_K1") == "37.5", "CTL_K1 was not set")
    client.say("param fetch")  # from the boat; otherwise MAVProxy shows stored values
    client.expect(r"Saved \d+ parameters")
    assert parameter_text(client, "CTL_K1") == "37.5"
    # The key is that which pymavlink derives from the same passphrase.
    radio_station = connect(f"udpout:127.0.0.1:{radio_port}", 201)
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == DENIED
    radio_station.link.setup_signing(KEY)
    assert radio_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    client.say("signing remove")
    client.expect("Signing key removed")
