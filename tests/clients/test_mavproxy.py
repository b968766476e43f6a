"""MAVProxy with a running HIL, without a terminal: commands on its standard input, and its output."""

import math

import pytest

from firmware_py.common.parameter_table import TABLE
from hil.sim.truth import ROWS_PER_SECOND

STEADY_MESSAGES = 40
CHANGED_PARAMETERS = {"MDL_K": 0.4, "MDL_T_S": 0.5, "MDL_ALPHA_S2": 0.0, "STAT_BOOTCNT": 1}


def test_mavproxy_reads_and_commands_the_boat(tmp_path, start_hil, mavproxy):
    hil = start_hil("udpout")
    client = mavproxy(hil.ports[0])
    client.expect("online system 1")
    client.expect(f"Saved {len(TABLE)} parameters")
    check_parameter_file(tmp_path / "home" / "mav.parm")
    check_parameters(client)
    check_arming_and_modes(client)
    check_telemetry(client)
    heading_deg = steer(client)
    swing_compass(client)
    assert int(ask(client, "link", r"link 1 OK \(\d+ packets.*?(\d+)\.\d% loss").group(1)) < 5
    reboot(client)
    assert "Failed to set CTL_K2 to 1e30 (invalid returned value 0.3" in client.text()
    client.hang_up()
    client.exit_code()  # MAVProxy ends with 1 after the end of its input
    truth = hil.end()
    errors_deg = [
        math.remainder(math.degrees(heading_rad) - heading_deg, 360.0) for heading_rad in truth.heading_low_rad
    ]
    assert sum(abs(error_deg) < 3.0 for error_deg in errors_deg) > ROWS_PER_SECOND


def ask(client, line, pattern):
    client.say(line)
    return client.expect(pattern)


def check_parameter_file(path):
    """Check that all parameters have their defaults, or the values of the vehicle file."""
    rows = dict(line.split()[:2] for line in path.read_text().splitlines() if not line.startswith("#"))
    expected = {row.name: CHANGED_PARAMETERS.get(row.name, row.default) for row in TABLE}
    assert {name: float(text) for name, text in rows.items()} == pytest.approx(expected, abs=1e-5)


def check_parameters(client):
    names = sorted(row.name for row in TABLE if row.name.startswith("CTL_"))
    output = ask(client, "param show CTL_*", rf"(?s){names[0]}.*{names[-1]} +\S+").group()
    assert [line.split()[0] for line in output.splitlines()] == names
    set_parameter(client, "CTL_K1", "37.5")
    set_parameter(client, "LOOP_RATE_HZ", "12")
    client.say("param set CTL_K2 1e30")  # it is repeated for some seconds; checked at the end
    # Read from the boat again; otherwise MAVProxy shows stored values.
    ask(client, "param fetch", f"Saved {len(TABLE)} parameters")
    ask(client, "param show CTL_K1", r"CTL_K1 +37\.5\s")
    ask(client, "param show LOOP_RATE_HZ", r"LOOP_RATE_HZ +12(\.0)?\s")
    ask(client, "param show CTL_K2", r"CTL_K2 +0\.3")


def set_parameter(client, name, value):
    """Set a parameter and wait for its acknowledged value, which MAVProxy stores."""
    client.say(f"param set {name} {value}")

    def is_set():
        return float(ask(client, f"param show {name}", rf"{name} +(\S+)")[1]) == float(value)

    client.wait_for(is_set, f"{name} was not set")


def check_arming_and_modes(client):
    ask(client, "disarm", "DISARMED")
    ask(client, "arm throttle", r"(?<!DIS)ARMED")
    ask(client, "arm uncheck all", "AP: ARMING_CHECK is read-only")
    ask(client, "time", r"\d\d:\d\d:\d\d")  # afterwards the whole output of the command is there
    ask(client, "arm list", r"\ball\b")
    assert "checks disabled" not in client.text()  # although the boat was armed before MAVProxy connected
    ask(client, "bat", "No battery information")  # not measured
    for name in ("HOLD", "STEERING", "MANUAL", "RTL", "GUIDED"):
        ask(client, f"mode {name}", f"{name}> ")  # the prompt
    ask(client, "mode ACRO", "DO_SET_MODE: DENIED")


def reboot(client):
    ask(client, "reboot", "PREFLIGHT_REBOOT_SHUTDOWN: TEMPORARILY_REJECTED")
    ask(client, "disarm", "DISARMED")
    ask(client, "reboot", "PREFLIGHT_REBOOT_SHUTDOWN: ACCEPTED")
    client.expect("Mode HOLD")  # after the restart


def check_telemetry(client):
    heartbeat = ask(client, "status HEARTBEAT", r"HEARTBEAT \{(.*)\}").group(1)
    assert "type : 11, autopilot : 3" in heartbeat
    assert "custom_mode : 15" in heartbeat
    fix = ask(client, "status GPS_RAW_INT", r"fix_type : (\d), lat : (\d+), lon : (\d+),")
    assert fix.group(1) == "3"
    assert [int(fix.group(index)) / 1e7 for index in (2, 3)] == pytest.approx([36.0, 121.0], abs=1e-3)


def swing_compass(client):
    """Start a compass swing, try to accept its result too early, and cancel it."""
    ask(client, "magcal start", "DO_START_MAG_CAL: ACCEPTED")
    ask(client, "magcal accept", "DO_ACCEPT_MAG_CAL: TEMPORARILY_REJECTED")
    ask(client, "magcal cancel", "DO_CANCEL_MAG_CAL: ACCEPTED")


def steer(client):
    """Turn to 20 degrees, wait until the heading is steady, and return the heading that MAVProxy shows.

    A fast turn at the start is first estimated as a wave, so the first heading may be wrong by some degrees.
    """
    ask(client, "setyaw 20 0 0", "CONDITION_YAW: ACCEPTED")
    first_near = None  # number of the first message near 20 degrees

    def is_steady():
        nonlocal first_near
        output = ask(client, "status VFR_HUD", r"(\d+): VFR_HUD \{.*heading : (\d+),")
        number, heading_deg = int(output[1]), int(output[2])
        if abs(heading_deg - 20) > 2:
            first_near = None
        elif first_near is None:
            first_near = number
        return first_near is not None and number - first_near >= STEADY_MESSAGES and heading_deg

    return client.wait_for(is_steady, "heading 20 was not reached")
