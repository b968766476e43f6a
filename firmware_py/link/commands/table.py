"""The one table of commands; the reference page (params/MESSAGES.md) is made from it."""

from __future__ import annotations

from firmware_py.link.commands import compass_swing, goals, plan, requests, state, upkeep
from firmware_py.link.commands.server import CommandRow

TABLE: tuple[CommandRow, ...] = (
    CommandRow(17, "NAV_LOITER_UNLIM", state.loiter, "enter LOITER where she is; with a place: refused"),
    CommandRow(20, "NAV_RETURN_TO_LAUNCH", state.return_to_launch, "enter RTL"),
    CommandRow(
        115,
        "CONDITION_YAW",
        goals.condition_yaw,
        "heading param1 (deg), absolute or (param4 = 1) relative to her heading, by starboard or port (param3)",
        relative=True,
    ),
    CommandRow(176, "DO_SET_MODE", state.set_mode, "enter the custom mode param2"),
    CommandRow(178, "DO_CHANGE_SPEED", plan.change_speed, "nothing, and says so: her speed is the sea's"),
    CommandRow(179, "DO_SET_HOME", plan.set_home, "home is where she is (param1 = 1), or param5 to param7 (0)"),
    CommandRow(
        183,
        "DO_SET_SERVO",
        upkeep.set_servo,
        "disarmed, on the bench: rudder (servo 1) to param2 (us) for 10 s",
    ),
    CommandRow(
        192,
        "DO_REPOSITION",
        goals.reposition,
        "go to param5, param6; flag 1 in param2 enters GUIDED; speed, radius and yaw are ignored",
    ),
    CommandRow(193, "DO_PAUSE_CONTINUE", plan.pause_or_continue, "halt the mission (param1 = 0), go on with it (1)"),
    CommandRow(207, "DO_FENCE_ENABLE", plan.enable_fence, "heed the fence (param1 = 1) or not (0), the whole of it"),
    CommandRow(
        213,
        "NAV_SET_YAW_SPEED",
        goals.set_yaw_speed,
        "heading param1 (deg), absolute or (param3 = 1) relative to her heading; speed is ignored",
        relative=True,
    ),
    CommandRow(
        224,
        "DO_SET_MISSION_CURRENT",
        plan.set_mission_item,
        "go on with item param1 (-1: the current one); param2 = 1 begins the mission anew",
    ),
    CommandRow(
        241,
        "PREFLIGHT_CALIBRATION",
        upkeep.calibrate,
        "disarmed: param4 = 2 takes the rudder as it stands for amidships (`RUD_CENTRE_DEG`); param2 = 1 has a PNI "
        "compass calibrate itself while she is turned through a circle (IN_PROGRESS, COMMAND_CANCEL); with any other "
        "it is DO_START_MAG_CAL",
    ),
    CommandRow(
        245,
        "PREFLIGHT_STORAGE",
        upkeep.storage,
        "param1 = 2, disarmed: from the next start on the vehicle file's parameters; 0 and 1: they are always stored",
    ),
    CommandRow(
        246,
        "PREFLIGHT_REBOOT_SHUTDOWN",
        state.restart,
        "disarmed, or forced by param6 = 20190226: start the autopilot anew (param1 = 1), end it (2)",
    ),
    CommandRow(262, "DO_SET_STANDARD_MODE", state.set_standard_mode, "enter AUTO (param1 = 6) or RTL (5)"),
    CommandRow(
        300,
        "MISSION_START",
        plan.start_mission,
        "enter AUTO and go on, at item param1 unless it is 0; a complete mission begins anew",
    ),
    CommandRow(400, "COMPONENT_ARM_DISARM", state.arm_disarm, "arm (param1 = 1) or disarm (0); param2 = 21196 forces"),
    CommandRow(401, "RUN_PREARM_CHECKS", state.run_prearm_checks, "say what forbids arming", repeatable=True),
    CommandRow(410, "GET_HOME_POSITION", requests.home_position, "send HOME_POSITION", repeatable=True),
    CommandRow(510, "GET_MESSAGE_INTERVAL", requests.get_message_interval, "send MESSAGE_INTERVAL", repeatable=True),
    CommandRow(
        511,
        "SET_MESSAGE_INTERVAL",
        requests.set_message_interval,
        "send message param1 each param2 us on this link; -1 off, 0 default",
        repeatable=True,
    ),
    CommandRow(
        512,
        "REQUEST_MESSAGE",
        requests.request_message,
        "send message param1 once; param2: the index of AVAILABLE_MODES, the message that MESSAGE_INTERVAL tells of",
        repeatable=True,
    ),
    CommandRow(519, "REQUEST_PROTOCOL_VERSION", requests.protocol_version, "send PROTOCOL_VERSION", repeatable=True),
    CommandRow(
        520,
        "REQUEST_AUTOPILOT_CAPABILITIES",
        requests.capabilities,
        "send AUTOPILOT_VERSION",
        repeatable=True,
    ),
    CommandRow(
        2600,
        "CONTROL_HIGH_LATENCY",
        requests.control_high_latency,
        "HIGH_LATENCY2 on the satellite links (param1 = 1) or silence (0)",
    ),
    CommandRow(
        42006,
        "FIXED_MAG_CAL_YAW",
        upkeep.align_compass,
        "disarmed: she heads param1 (deg true) now; sets `CMP_OFFSET_DEG`",
    ),
    CommandRow(42428, "DO_SEND_BANNER", state.send_banner, "say the version", repeatable=True),
    CommandRow(
        42424,
        "DO_START_MAG_CAL",
        compass_swing.start,
        "armed, under way: look on for the deviation of compass A; MAG_CAL_PROGRESS, MAG_CAL_REPORT and a text tell "
        "how far it is; nothing is saved by itself (param3), retry and delays are ignored",
    ),
    CommandRow(
        42425,
        "DO_ACCEPT_MAG_CAL",
        compass_swing.accept,
        "take what a swing of the compass proposes (`CMP_DEV_A` to `CMP_DEV_E`)",
    ),
    CommandRow(
        42426,
        "DO_CANCEL_MAG_CAL",
        compass_swing.cancel,
        "end a swing and drop its proposal; after it was accepted: put back what it replaced",
    ),
    CommandRow(
        43002,
        "GUIDED_CHANGE_HEADING",
        goals.change_heading,
        "heading (param1 = 1) or course over ground (0) param2 (deg)",
    ),
)
