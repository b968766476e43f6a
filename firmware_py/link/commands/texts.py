"""Meaning and remedy of the STATUSTEXTs of commands and refusals, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_CORRECT_VALUE = "correct the named value and send the command again"
_INVALID_POSITION = "latitude or longitude is out of range or not a number"
_INVALID_PARAMETER = "the value is not allowed for the command that the text names first"
_DISARM = "disarm the boat first"
_NOT_STORED = "the change is active but not on disk: a restart may lose it"
_REPAIR_DISK = "see STORAGE_FAILING; send the command again when the disk works"

TEXTS: Mapping[str, tuple[str, str]] = {
    "<command> refused": (
        "the command was refused without a reason",
        "check the mode and whether the boat is armed, then send the command again",
    ),
    "<parameter>: refused": ("the value is not accepted", "see the reference of parameters"),
    "Too many requests: try again": ("more requests arrived in one tick than are processed", "send the request again"),
    "Too many commands in progress": ("eight long commands are in progress", "wait for their acknowledgements"),
    "<command> is already in progress": ("the same command is in progress", "wait, or cancel it with COMMAND_CANCEL"),
    "not done in time": ("a long command has exceeded its timeout", "see the texts before it; try again"),
    "done but not yet stored": (_NOT_STORED, _REPAIR_DISK),
    "<command>: done but not stored": (_NOT_STORED, _REPAIR_DISK),
    "guided waypoint active but not stored": (_NOT_STORED, _REPAIR_DISK),
    "Mission item <number> active but not stored": (_NOT_STORED, _REPAIR_DISK),
    "<request> is not supported yet": (
        "this version does not support the request",
        "update the autopilot, or use another command",
    ),
    "PreArm: all good": ("arming would be accepted", "nothing"),
    "PreArm: starting": ("the autopilot is starting", "try again in a second"),
    "PreArm: already armed": ("checks run only before arming", "nothing"),
    "Arming refused: <why>": (
        "a check before arming has failed; PreArm reports the same",
        "remove the named cause (see the faults below); param2 = 21196 forces arming",
    ),
    "Mode <number> is not known; there are <modes>": ("the mode is not supported", "choose one of the named modes"),
    "only custom modes can be set": ("DO_SET_MODE without the flag for custom modes", _CORRECT_VALUE),
    "the mode is not a whole number": ("the mode number is not an integer", _CORRECT_VALUE),
    "<command>: standard mode not supported; use 5 (RTL) or 6 (AUTO)": (
        "of the standard modes, mission and return are supported",
        _CORRECT_VALUE,
    ),
    "<mode> refused: <why>": (
        "a requirement of the mode is missing",
        "provide what is named: position, home, mission or heading",
    ),
    "Heading goal is out of range": ("the heading is not a number", _CORRECT_VALUE),
    "Heading goal refused in <mode>: enter <mode> first": (
        "this mode follows another goal",
        "enter the named mode, or use DO_REPOSITION with flag 1, which changes the mode",
    ),
    "Heading goal refused: no valid heading": (
        "a relative heading needs a valid heading",
        "see the faults of the compass",
    ),
    "Position goal is out of range": (_INVALID_POSITION, _CORRECT_VALUE),
    "Position goal refused in <mode>: enter <mode> first": ("this mode follows another goal", _CORRECT_VALUE),
    "Position goal refused: no position": ("the position is unknown", "see POSITION_LOST"),
    "no valid heading for a relative goal": (
        "the goal is relative, and no heading is valid",
        "see the faults of the compass",
    ),
    "no home for a relative goal": (
        "the goal is relative to home, which is not set",
        "set home (DO_SET_HOME), or wait for a fix",
    ),
    "no valid position for a relative goal": (
        "the goal is relative to the boat, and there is no fix",
        "see POSITION_LOST",
    ),
    "the quaternion is not normalized": ("invalid attitude in SET_ATTITUDE_TARGET", _CORRECT_VALUE),
    "attitude points up or down: no heading": ("the attitude contains no heading", _CORRECT_VALUE),
    "the velocity has no direction": ("the velocity is nearly zero or not a number", _CORRECT_VALUE),
    "the yaw is not within one turn": ("the yaw is too large or not a number", _CORRECT_VALUE),
    "position, velocity and yaw are all masked out": (
        "all fields of the position target are masked out",
        _CORRECT_VALUE,
    ),
    "the attitude is masked out": ("the attitude of SET_ATTITUDE_TARGET is masked out", _CORRECT_VALUE),
    "the stick is not within -1000 to 1000": (
        "field y or r of MANUAL_CONTROL is out of range",
        "calibrate the joystick",
    ),
    "RC override ignored: disarmed": ("the rudder follows a stick only while armed", "arm, or release the override"),
    "RC override ignored: channel 1 is the rudder in MANUAL, the heading in STEERING": (
        "only other channels are overridden",
        "use channel 1, or release the override",
    ),
    "RC override ignored in <mode>: channel 1 is the rudder in MANUAL, the heading in STEERING": (
        "in this mode the stick is ignored",
        "choose MANUAL or STEERING, or release the override",
    ),
    "param<number> is <value>; allowed: <values>": (_INVALID_PARAMETER, _CORRECT_VALUE),
    "Speed command ignored: a wave glider cannot set its speed": (
        "DO_CHANGE_SPEED is accepted for compatibility only",
        "nothing",
    ),
    "Rambler <version>": ("the program and its commit (DO_SEND_BANNER)", "nothing"),
    "channel 1 is not within 1000 to 2000": (
        "channel 1 of RC_CHANNELS_OVERRIDE (in us) is out of range",
        "calibrate the joystick",
    ),
    "frame <number> is not a local one": ("the frame of the position target is not supported", _CORRECT_VALUE),
    "the position is not within <number> km": ("a local position must be near home or the boat", _CORRECT_VALUE),
    "local position beyond a pole": ("north and east are undefined", "send latitude and longitude"),
    "latitude or longitude out of range": (_INVALID_POSITION, _CORRECT_VALUE),
    "frame <number> is not a global one": ("the command needs latitude and longitude", _CORRECT_VALUE),
    "param<number> is neither 0 (absolute) nor 1 (relative)": (_INVALID_PARAMETER, _CORRECT_VALUE),
    "the direction is not -1, 0 or 1": ("param3 of CONDITION_YAW is not allowed", _CORRECT_VALUE),
    "the angle is not within <limits> deg": (_INVALID_PARAMETER, _CORRECT_VALUE),
    "the type is neither course over ground (0) nor heading (1)": (
        "param1 of GUIDED_CHANGE_HEADING is not allowed",
        _CORRECT_VALUE,
    ),
    "flags (param2) <number> are not within 0 to 65535": ("param2 of DO_REPOSITION is out of range", _CORRECT_VALUE),
    "param1 is neither 0 nor 1": (_INVALID_PARAMETER, _CORRECT_VALUE),
    "param2 <number> is neither 0 nor 1": (_INVALID_PARAMETER, _CORRECT_VALUE),
    "Stick is out of range": ("invalid value in MANUAL_CONTROL or RC_CHANNELS_OVERRIDE", "calibrate the joystick"),
    "Home refused: position out of range": (_INVALID_POSITION, _CORRECT_VALUE),
    "Home refused: no position": ("home at the present position needs a fix", "wait for a fix, or send a position"),
    "position 0, 0 is not accepted": ("stations send this when they have no position", "send a position"),
    "home at 0, 0 is not accepted": ("stations send this when they have no position", "send a position"),
    "the altitude is out of range": ("the altitude of home is too large or not a number", _CORRECT_VALUE),
    "position not supported; use DO_REPOSITION": (
        "NAV_LOITER_UNLIM was sent with a position",
        "use DO_REPOSITION, or send no position",
    ),
    "there is no mission": ("MISSION_START needs a mission", "upload a mission"),
    "There is no mission": ("the request needs a mission", "upload a mission"),
    "Item <number> refused: mission has items <number> to <number>": ("there is no such item", _CORRECT_VALUE),
    "<command>: the mission has no such item": ("there is no such item", _CORRECT_VALUE),
    "first item <number> or last item <number> is not valid": (
        "param1 or param2 of MISSION_START is not allowed",
        _CORRECT_VALUE,
    ),
    "Pause refused in <mode>: only AUTO has a mission": ("only AUTO can be paused", "enter AUTO first"),
    "There is no fence": ("without a fence it cannot be enabled", "upload a fence"),
    "<command>: fence kinds cannot be chosen; use param2 = 0": (
        "the fence is enabled or disabled as a whole",
        _CORRECT_VALUE,
    ),
    "the kinds of fence are not a number": ("param2 of DO_FENCE_ENABLE is not allowed", _CORRECT_VALUE),
    "Battery report refused: value out of range": (
        "another component sent an impossible battery value",
        "check that component",
    ),
    "Bench rudder is out of range": ("the pulse is not a number", _CORRECT_VALUE),
    "Bench rudder refused: armed": ("direct rudder commands are for the bench only", _DISARM),
    "Bench rudder refused: rudder servo not responding": ("the servo does not reply", "see RUDDER_SILENT"),
    "only servo 1, the rudder, is supported": ("param1 of DO_SET_SERVO is not 1", _CORRECT_VALUE),
    "the pulse is not within 1000 to 2000 us": ("param2 of DO_SET_SERVO is out of range", _CORRECT_VALUE),
    "Restart refused: armed": (
        "during a restart the rudder is not controlled for a second",
        "disarm, or force the restart (param6 = 20190226)",
    ),
    "param1 is neither 0, 1 (restart) nor 2 (shut down)": (
        "param1 of PREFLIGHT_REBOOT_SHUTDOWN is not allowed",
        _CORRECT_VALUE,
    ),
    "<command>: only the autopilot itself can be restarted": ("other components cannot be restarted", _CORRECT_VALUE),
    "Reset of parameters refused: armed": ("the reset changes the steering", _DISARM),
    "param1 is neither 0 (read), 1 (write) nor 2 (reset)": (
        "param1 of PREFLIGHT_STORAGE is not allowed",
        _CORRECT_VALUE,
    ),
    "<command>: plans are cleared by MISSION_CLEAR_ALL": (
        "PREFLIGHT_STORAGE is for parameters only",
        "use MISSION_CLEAR_ALL",
    ),
    "Parameters reset to the vehicle file at the next start": (
        "values set by stations are deleted",
        "restart the autopilot",
    ),
    "not stored, parameters unchanged": ("the parameters were not reset", _REPAIR_DISK),
    "All settings stored": ("all parameters are on disk", "nothing"),
    "not all stored; retrying": ("some parameters are not on disk yet", _REPAIR_DISK),
    "<parameter> is now <value>": ("a calibration has set and stored a parameter", "nothing"),
    "<parameter> active but not stored": (_NOT_STORED, _REPAIR_DISK),
    "<parameter>: takes effect at the next start": (
        "the new value is stored",
        "restart the autopilot (PREFLIGHT_REBOOT_SHUTDOWN)",
    ),
    "<parameter> is read-only": ("the autopilot maintains the value itself", "nothing"),
    "<parameter>: <value> is not a number; allowed: <values>": ("the value is not accepted", _CORRECT_VALUE),
    "<parameter>: <value> is not a whole number; allowed: <values>": ("the value is not accepted", _CORRECT_VALUE),
    "<parameter>: <value> is out of range; allowed: <values>": ("the value is not accepted", _CORRECT_VALUE),
    "<parameter>: <value> is not one of its values; allowed: <values>": ("the value is not accepted", _CORRECT_VALUE),
    "unknown parameter <name>; near it: <names>": (
        "the name is mistyped or belongs to another version",
        "use one of the similar names",
    ),
    "Calibration refused: armed": ("a calibration changes the steering", _DISARM),
    "Calibration refused: no valid heading": ("there is no heading to align", "see the faults of the compass"),
    "Calibration refused: compass missing or busy": (
        "the compass does not reply, or a calibration is running",
        "check power and cable of the compass; COMMAND_CANCEL ends a running calibration",
    ),
    "Calibration refused: no rudder angle from the servo": ("no reading from the encoder", "see RUDDER_SILENT"),
    "<command>: supported are the rudder centre <and other calibrations>": (
        "the calibration is not supported",
        "use one of the named calibrations; see the page on calibration",
    ),
    "the yaw is not within -360 to 360 deg": ("param1 of FIXED_MAG_CAL_YAW is out of range", _CORRECT_VALUE),
    "compass mask (<parameter>) <number> is neither 0 nor 1": (
        "the boat calibrates one compass; the text names the command first",
        _CORRECT_VALUE,
    ),
    "Compass swing refused: <why>": (
        "a swing needs the boat armed and under way, with compass and GPS",
        "provide what is named; DO_CANCEL_MAG_CAL ends a running swing",
    ),
    "Compass swing: nothing to accept, <number> % done": (
        "there is no proposal yet",
        "sail the missing headings (`rambler status` shows them)",
    ),
    "Compass swing: sail all headings, 15 min each, then accept": (
        "a swing has begun; it observes and does not steer",
        "use a loiter circle of 150 m radius, or a mission with legs in all directions",
    ),
    "Compass swing: <proposal>; accept with DO_ACCEPT_MAG_CAL": (
        "the proposal is `CMP_DEV_A` to `CMP_DEV_E`, with standard deviation, error of the present values and residual",
        "accept when the error is clearly larger than the standard deviation; until then the proposal improves",
    ),
    "Compass swing: <coefficients> deg set": ("the proposal was accepted", "DO_CANCEL_MAG_CAL restores the old values"),
    "Compass swing: <coefficients> deg restored": ("the old values are active again", "nothing"),
    "Compass swing: cancelled, nothing was set": ("the observations are deleted", "nothing"),
    "deviation active but not stored": (_NOT_STORED, _REPAIR_DISK),
    "interval must be 20 ms (satellite: 10 s) to 1 h, 0 or -1; HEARTBEAT is fixed": (
        "allowed intervals of SET_MESSAGE_INTERVAL",
        _CORRECT_VALUE,
    ),
}
