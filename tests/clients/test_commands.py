"""Commands and telemetry other than heading goals, with pymavlink: accepted commands show in the telemetry."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.cli.run import EXIT_SHUT_DOWN
from support.harness import is_replay_identical

ACCEPTED, REJECTED, FAILED = (
    mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED, mavlink.MAV_RESULT_FAILED,
)  # fmt: skip
GUIDED, HOLD = 15, 4
FORCE = 20190226
ARM, SET_MODE, SERVO = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_SET_SERVO
REBOOT, CALIBRATE = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
STORAGE, HOME = mavlink.MAV_CMD_PREFLIGHT_STORAGE, mavlink.MAV_CMD_DO_SET_HOME


def test_requested_messages_are_sent(start_hil, connect):
    hil = start_hil("udpout")
    station = connect(f"udpin:127.0.0.1:{hil.ports[0]}")
    position = station.receive("GLOBAL_POSITION_INT")
    assert station.command(HOME, 1) == ACCEPTED
    home = station.receive("HOME_POSITION")
    origin = station.receive("GPS_GLOBAL_ORIGIN")
    assert (home.latitude, home.longitude) == (origin.latitude, origin.longitude)
    assert abs(home.latitude - position.lat) < 1000
    local = station.receive("LOCAL_POSITION_NED", lambda message: message.time_boot_ms > position.time_boot_ms + 1000)
    assert math.hypot(local.x, local.y) < 20.0
    assert station.command(HOME, 0, 0, 0, 0, 36.001, 121.0, 0) == ACCEPTED
    local = station.receive("LOCAL_POSITION_NED", lambda message: message.x < -50.0)
    assert local.x == pytest.approx((position.lat * 1e-7 - 36.001) * 111_195.1, abs=10.0)
    frame, reposition = mavlink.MAV_FRAME_GLOBAL_INT, mavlink.MAV_CMD_DO_REPOSITION
    station.mav.command_int_send(1, 1, frame, reposition, 0, 0, -1, 1, 0, math.nan, 360_500_000, 1_210_500_000, 0)
    target = station.receive("POSITION_TARGET_GLOBAL_INT")
    assert (target.lat_int, target.lon_int) == pytest.approx((360_500_000, 1_210_500_000), abs=100)
    for number, name in ((148, "AUTOPILOT_VERSION"), (235, "HIGH_LATENCY2"), (230, "ESTIMATOR_STATUS")):
        assert station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number) == ACCEPTED
        station.receive(name)
    station.mav.ping_send(77, 5, 0, 0)
    assert station.receive("PING", lambda pong: pong.target_system == 200).seq == 5
    station.mav.timesync_send(0, 123_456)
    assert station.receive("TIMESYNC", lambda answer: answer.tc1 > 0).ts1 == 123_456
    assert station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 31, 200_000) == ACCEPTED
    turn = station.receive("ATTITUDE_QUATERNION")
    yaw_rad = station.receive("ATTITUDE").yaw
    assert 2.0 * math.atan2(turn.q4, turn.q1) == pytest.approx(yaw_rad, abs=0.1)
    hil.end()


def wait_for_rudder(station, rudder_deg):
    """Wait until the measured rudder angle is near an angle."""

    def is_reached(value):
        return value.name == "RUDDER" and abs(value.value - rudder_deg) < 0.5

    station.receive("NAMED_VALUE_FLOAT", is_reached)


def test_bench_rudder_centre_reset_and_restart_need_a_disarmed_boat(start_hil, connect):
    hil = start_hil("udpout")
    station = connect(f"udpin:127.0.0.1:{hil.ports[0]}")
    for command in ((SERVO, 1, 1800), (CALIBRATE, 0, 0, 0, 2), (STORAGE, 2), (REBOOT, 1)):
        assert station.command(*command) == REJECTED  # the boat is armed
    assert station.command(ARM, 0) == ACCEPTED
    station.receive("HEARTBEAT", lambda heartbeat: not heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    assert station.command(SERVO, 1, 1700) == ACCEPTED
    wait_for_rudder(station, 12.0)
    assert station.command(CALIBRATE, 0, 0, 0, 2) == ACCEPTED
    assert station.parameter("RUD_CENTRE_DEG") == pytest.approx(12.0, abs=0.5)
    wait_for_rudder(station, 0.0)
    assert station.command(STORAGE, 2) == ACCEPTED
    assert station.parameter("RUD_CENTRE_DEG") == pytest.approx(12.0, abs=0.5)
    before_ms = station.receive("ATTITUDE").time_boot_ms
    assert station.command(REBOOT, 1) == ACCEPTED
    station.receive("ATTITUDE", lambda attitude: attitude.time_boot_ms < before_ms)
    assert station.parameter("RUD_CENTRE_DEG") == 0.0
    assert station.receive("HEARTBEAT").custom_mode == HOLD  # BOOT_MODE
    hil.end()


@pytest.mark.proof
def test_forced_restart_in_lockstep_loses_no_time_and_uses_the_boot_parameters(tmp_path, start_hil, connect):
    hil = start_hil("udpout", scenario="tank", speed="15", seconds=9000, nimble=False)
    station = connect(f"udpin:127.0.0.1:{hil.ports[0]}")
    integer = mavlink.MAV_PARAM_TYPE_INT32
    assert station.set_parameter("BOOT_ARM", 1, integer) == 1
    assert station.set_parameter("BOOT_MODE", GUIDED, integer) == GUIDED
    assert station.command(REBOOT, 1) == REJECTED
    before_ms = station.receive("ATTITUDE").time_boot_ms
    assert station.command(REBOOT, 1, 0, 0, 0, 0, FORCE) == ACCEPTED
    station.receive("STATUSTEXT", lambda message: message.text.startswith("Mode GUIDED"))
    after = station.receive("ATTITUDE")
    assert before_ms < after.time_boot_ms  # in lockstep the clock is that of the HIL
    heartbeat = station.receive("HEARTBEAT", lambda heartbeat: heartbeat.custom_mode == GUIDED)
    assert heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    hil.end()
    names = {path.name for path in (hil.out / "state" / "logs").iterdir()}
    logs = {name for name in names if ".BIN" in name and not name.startswith(".")}  # one may be in compression
    assert len(logs) == 2
    assert is_replay_identical(hil.out)


def test_shutdown_ends_the_process_with_its_own_exit_code(boot, free_ports, connect):
    (port,) = free_ports(["tcpin"])
    program = boot("boat", f"tcpin:127.0.0.1:{port}")
    station = connect(f"tcp:127.0.0.1:{port}")
    assert station.command(REBOOT, 2) == ACCEPTED
    assert program.exit_code() == EXIT_SHUT_DOWN
