"""Signed links against `rambler run` itself: pymavlink's and MAVProxy's signers, and a sudden end."""

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


def test_a_key_set_over_the_cable_guards_the_radio(tmp_path, boot, free_ports, connect):
    cable, radio = free_ports(["tcpin", "udpin"])
    urls = [f"tcpin:127.0.0.1:{cable}?trusted=1", f"udpin:127.0.0.1:{radio}"]
    program = boot("first", *urls)
    near, far = connect(f"tcp:127.0.0.1:{cable}"), connect(f"udpout:127.0.0.1:{radio}", 201)
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    far.mav.setup_signing_send(1, 1, list(KEY), 0)
    far.receive("STATUSTEXT", lambda text: "SETUP_SIGNING refused" in text.text)
    near.mav.setup_signing_send(1, 1, list(KEY), 0)
    near.receive("STATUSTEXT", lambda text: text.text == "Signing key set")
    # Who has no key may look on, but no more.
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == DENIED
    assert far.parameter("CTL_K2") == pytest.approx(0.3)
    # Who has it may command, and hears nothing but what is signed.
    far.link.setup_signing(KEY)
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    assert far.link.mav.signing.goodsig_count > 0
    modes = {path.stat().st_mode & 0o777 for path in key_files(tmp_path)}
    assert modes == {0o600}
    # After a power cut the key is still there, and timestamps continue after all used ones.
    program.send_signal(signal.SIGKILL)
    program.exit_code()
    program = boot("second", *urls)
    stranger = connect(f"udpout:127.0.0.1:{radio}", 202)
    assert stranger.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == DENIED
    far.mav.heartbeat_send(6, 8, 0, 0, 0)  # behind; the answer brings it up
    far.receive("HEARTBEAT")
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    # Removed where it was set, and nowhere else.
    stranger.mav.setup_signing_send(1, 1, [0] * 32, 0)
    stranger.receive("STATUSTEXT", lambda text: "SETUP_SIGNING refused" in text.text)
    near = connect(f"tcp:127.0.0.1:{cable}", 203)
    near.mav.setup_signing_send(1, 1, [0] * 32, 0)
    near.receive("STATUSTEXT", lambda text: text.text == "Signing key removed")
    assert stranger.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    files = key_files(tmp_path)
    assert len(files) == 2
    gone = lambda: not any(KEY.hex().encode() in path.read_bytes() for path in files)  # noqa: E731
    program.wait_for(gone, "the key is still on the disk")


def parameter_text(client, name):
    client.say(f"param show {name}")
    return client.expect(rf"{name} +(\S+)\s")[1]


def test_mavproxy_sets_up_a_key_and_commands_with_it(tmp_path, boot, start, free_ports, connect):
    script = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip("mavproxy.py is not beside this Python; install the extra [clients]")
    cable, radio = free_ports(["tcpin", "udpin"])
    boot("boat", f"tcpin:127.0.0.1:{cable}?trusted=1&policy=signed-commands", f"udpin:127.0.0.1:{radio}")
    home = tmp_path / "home"
    home.mkdir()
    env = {**os.environ, "HOME": str(home), "PYTHONUNBUFFERED": "1"}
    words = [sys.executable, script, f"--master=tcp:127.0.0.1:{cable}", f"--state-basedir={home}"]
    client = start("mavproxy", words, cwd=home, env=env)
    client.expect("online system 1")
    client.say("mode HOLD")
    client.expect("COMMAND_LONG refused: not signed|DENIED")
    client.say(f"signing setup {PASSPHRASE}")
    client.expect("Signing key set")
    client.say("param fetch")
    client.expect(r"Saved \d+ parameters")
    client.say("param set CTL_K1 37.5")
    client.wait_for(lambda: parameter_text(client, "CTL_K1") == "37.5", "it was not set")
    client.say("param fetch")  # from the boat, not from the memory of MAVProxy
    client.expect(r"Saved \d+ parameters")
    assert parameter_text(client, "CTL_K1") == "37.5"
    # The key is the one that pymavlink makes of the same words.
    far = connect(f"udpout:127.0.0.1:{radio}", 201)
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == DENIED
    far.link.setup_signing(KEY)
    assert far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == ACCEPTED
    client.say("signing remove")
    client.expect("Signing key removed")
