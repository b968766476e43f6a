"""The STATUSTEXTs of modes, navigation and sensors: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_NOTHING = "nothing"

TEXTS: Mapping[str, tuple[str, str]] = {
    "<Device>: driver of package <name> <version>: <exception> (<file>:<line>)": (
        "the driver package of a device has a defect; the device is lost, and its driver starts again after 10 s",
        "report it to the author of the package with the log; use another device or version until then",
    ),
    "Power monitor: <problem>": (
        "a charger reports an error; reported once in ten minutes",
        "look up the number in its manual; `rambler status` names the device",
    ),
    "<sensor>: no data": (
        "a sensor sends nothing any more or since the start, its port is missing, or its driver package has failed",
        "steering is not affected; at the boat: check power and cable; `rambler status` names the port",
    ),
    "<sensor>: data recovered": ("messages of the wind or depth sensor arrive again", _NOTHING),
    "Armed": ("the rudder follows the mode", _NOTHING),
    "Disarmed": ("the rudder is not steered", "arm the boat to sail"),
    "Rudder angle: estimated": (
        "nothing measures the rudder angle; it is computed from the commands. A jammed rudder shows only in turns",
        "nothing with a servo that measures no angle; otherwise check cable and power of the rudder angle sensor",
    ),
    "Rudder angle: measured by the servo": (
        "the servo measures the angle again, or the rudder angle sensor has failed",
        "with a sensor, check its cable and power; the boat steers on by the angle of the servo",
    ),
    "Rudder angle: measured by the sensor": ("the rudder angle sensor is used from now on", _NOTHING),
    "Mode <mode>": ("the mode was changed by a command or a failsafe", _NOTHING),
    "Failsafe: <mode>": (
        "an active fault has changed the mode, by its parameter `FS_...`",
        "see the fault reported before; any command overrules the failsafe until the fault occurs again",
    ),
    "Failsafe: <mode>, <mode> not possible": (
        "a failsafe could not enter its mode and has entered the next one in order",
        "see the fault reported before, and the requirements of the mode (position, home, heading)",
    ),
    "Failsafe ended: <mode> resumed": ("the fault has ended, and the previous mode continues (`FS_RESUME`)", _NOTHING),
    "Failsafe ended: <mode> stays until a mode is set": (
        "the fault has ended, and the boat stays in this mode; a task that the failsafe interrupted does not continue",
        "choose a mode; `FS_RESUME` 1 continues the earlier task by itself",
    ),
    "Failsafe ended: <mode> kept, <why>": (
        "the fault has ended, and the previous mode is not possible now",
        "correct the named cause, or choose a mode",
    ),
    "Compass <A or B> states variation <angle>: <angle> is used": (
        "the variation stated by the compass differs by more than 3 deg from the configured declination",
        "correct position or variation in the instrument, or `CMP_DECL_DEG` or `CMP_DECL_AUTO`",
    ),
    "Compass <A or B> states deviation <angle>: <use>": (
        "the deviation field of the sentence holds the variation, as sent by early versions of Signal K",
        "correct the sender of the sentence; check the heading",
    ),
    "Compass <A or B>: stated variation agrees": (
        "the stated variation no longer differs from the configured declination",
        _NOTHING,
    ),
    "Gyro agrees with compass: yaw rate used": (
        "a gyroscope without north agrees with the compass in a turn; its yaw rate supports the heading estimate",
        _NOTHING,
    ),
    "Gyro differs from compass: yaw rate not used": (
        "they turn differently: one of them is faulty, the gyroscope drifts, or its option `clockwise` is wrong",
        "turn the boat and compare both with `rambler listen`; the heading needs only the compass",
    ),
    "First GPS position wrong by <distance> km: home and tasks moved": (
        "home and a goal near the wrong position move along; loiter point and water are reset",
        "check home and task on the map",
    ),
    "GPS jump accepted: position moved by <distance> m": (
        "positions that were rejected before are consistent, or can have been reached meanwhile",
        "check the position: a spoofed receiver looks the same; HOLD and STEERING need no position",
    ),
    "Dead reckoning started: position error grows": (
        "guidance continues after the fault `GPS position lost`, by heading, speed and current as last known",
        "see POSITION_LOST; `rambler status` shows the position and its standard deviation",
    ),
    "Probably at the waypoint (no GPS); waiting for a fix": (
        "the position error exceeds the acceptance radius: the item is not reached, the boat keeps station",
        "see POSITION_LOST; set another item or a heading if you know better",
    ),
    "Position too uncertain; holding here until GPS returns": (
        "the position error exceeds `POS_RECKON_M`: the boat keeps station at the estimated position",
        "see POSITION_LOST; in free water, set a heading or a larger `POS_RECKON_M`",
    ),
    "Rudder at limit 5 min: heading not converging": (
        "the heading error stays above 15 deg: calm, weed on the rudder, or too much wind",
        "wait for wind or waves; choose a heading that needs less rudder; check for weed and lines",
    ),
    "GPS recovered after <number> min: position error <distance> m": (
        "difference between the first fix and the position by dead reckoning",
        _NOTHING,
    ),
    "GPS position/velocity differ by <speed> m/s: spoofing?": (
        "for four minutes the positions have disagreed with the velocities of the receiver; the positions are used",
        "check the position; HOLD and STEERING need no position",
    ),
    "GPS position unchanged for <number> min: static hold?": (
        "while armed, the receiver repeats the same position: static hold at low speed, or a hung receiver",
        "switch off static hold (static navigation) in the receiver; STEERING needs no position",
    ),
    "Mission: item <number>": ("this item has begun; home is item 0, as in ground stations", _NOTHING),
    "Fence enabled": ("by a command or an item of the mission", _NOTHING),
    "Fence disabled": ("by a command or an item of the mission", "DO_FENCE_ENABLE enables it"),
    "Fence enabled, but none is loaded: send one": (
        "a DO_FENCE_ENABLE of the mission enables the fence, and there is none",
        "send a fence; it is enabled as soon as it is loaded",
    ),
    "Loiter radius <radius> m: below <radius> m the boat may drift out": (
        "the boat cannot stop: in a current it leaves a small circle by up to 3.5 turning radii",
        "if that matters, set `LOIT_RADIUS`, or the radius of the item, to the second number or more",
    ),
    "Circle radius <radius> m too small: circling at <radius> m": (
        "the turning circle at full rudder is larger; the smallest possible circle is used",
        "set a larger radius of the item if the circle matters",
    ),
    "Fence near: loiter radius <radius> m, moved <distance> m inward": (
        "the boat overshoots a loiter circle by up to 3.5 turning radii: it is moved, and reduced if necessary",
        "choose a place farther from the fence if the place matters",
    ),
    "Fence too close to the loiter circle: breach possible": (
        "no place nearby has the room for station keeping; `FENCE_BREACHED` may follow",
        "choose a place with more room, or enlarge the fence",
    ),
    "Mission complete: keeping station": ("the last item is done; the boat stays near it", "send a mission or a mode"),
    "Mission paused: keeping station": ("by command", "DO_PAUSE_CONTINUE (1) or AUTO resumes it"),
    "Mission paused after item <number>: no autocontinue": (
        "the item has no autocontinue",
        "DO_PAUSE_CONTINUE (1), or set the next item",
    ),
    "Mission resumed": ("the pause has ended", _NOTHING),
    "Heading source: <source>": ("a source of the heading is available", _NOTHING),
    "Heading source: <source> (was <source>)": (
        "the source of the heading has changed: the better one has failed or recovered",
        "for a worse source, see the fault of the compass; steering by course over ground is less accurate",
    ),
    "Heading lost: <source> failed": (
        "no source of the heading is left; the rudder is held, then centred (fault COMPASS_LOST)",
        "check power and cable of the compass; ashore, use `rambler listen`",
    ),
    "Heading estimate restarted": (
        "a wave has turned the boat, or the compass has differed from the estimate for so long that it is used",
        "once: nothing; repeatedly: look for a compass that jumps, or for magnetic objects near it",
    ),
    "Clock set from <source>: it was <seconds> s off": ("the clock of the computer was set", _NOTHING),
    "Clock is <seconds> s off and may not be set (needs CAP_SYS_TIME)": (
        "log names and time stamps are wrong by this; steering is not affected",
        "install the service (`rambler service install`), which may set the clock",
    ),
    "GPS date <date> invalid: time not used": (
        "the date of the receiver is before the build of this program, or far in the future",
        "if it persists, replace the receiver: an old one may have a week number rollover",
    ),
    "<how long> ago: <text>": ("an earlier warning, or an active fault, for a new ground station", "see the text"),
    "GPS date recovered": ("the time of the receiver is used again", _NOTHING),
    "GPS week rollover: <date> corrected to <date>": (
        "the week number of an old receiver restarts after 1024 weeks; the date is corrected",
        "nothing; a firmware update of the receiver solves it",
    ),
    "<signal>: autopilot ends, rudder centred": (
        "a user or the service manager ends the program; without this text, the log was cut off",
        "to start again: `systemctl start rambler`; the task is resumed",
    ),
    "<signal>: <why>; autopilot continues": (
        "a user has sent a signal that does not end the program",
        "to end it: `systemctl stop rambler`, or SIGTERM",
    ),
    "Link error <error>; autopilot unaffected": (
        "a program error in the telemetry part; it is restarted, steering is not affected",
        "keep the log and report it; if it repeats, use another link or ground station",
    ),
    "Status file not written: <why>": (
        "the file for `rambler status` cannot be written",
        "check space and permissions of the runtime directory (`/run/rambler`)",
    ),
    "Compass calibration: turn a full circle by hand, ashore": (
        "the compass samples the magnetic field",
        "turn the boat slowly within a quarter of an hour, with some pitch and roll; COMMAND_CANCEL cancels",
    ),
    "Compass calibrated and saved: score <score>": ("the compass has stored its calibration", _NOTHING),
    "Compass calibration aborted": ("by COMMAND_CANCEL, or because the compass stopped", "try again"),
    "Compass calibration failed: <problem>": (
        "the calibration has failed; the old one stays active",
        "check power and cable of the compass; try again, turning more slowly",
    ),
    "Compass calibration not saved: score <score>, at most <score>; switch the compass off and on": (
        "the score is too bad to be stored; the old calibration returns after a power cycle of the compass",
        "switch it off and on; try again away from iron, through a full circle, with more pitch and roll",
    ),
}
