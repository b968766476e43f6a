"""The parameter table, used by the store, MAVLink, the reference page and the loop."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.mode_table import FAILSAFE_MODES, MODES, Mode
from firmware_py.common.parameter_row import Parameter, choice, constant, count, integer, real

_OFF_ON = {0: "off", 1: "on"}


def _deviations(prefix: str, compass: str) -> tuple[Parameter, ...]:
    terms = {"A": "constant term", "B": "sin h term", "C": "cos h term", "D": "sin 2h term", "E": "cos 2h term"}
    return tuple(
        real(f"{prefix}_DEV_{letter}", 0.0, -45.0, 45.0, "deg", f"Deviation of {compass}: coefficient of the {term}.")
        for letter, term in terms.items()
    )


_FAILSAFE = {0: "alert only"} | {
    value: f"{mode.name}: {effect}" if (effect := MODES[mode].failsafe_effect) else mode.name
    for value, mode in FAILSAFE_MODES.items()
}

# fmt: off
TABLE: tuple[Parameter, ...] = (
    choice("AIS_ACT", 0, {0: "report only", 1: "step aside"},
        "Action for a vessel on a close approach. Step aside: in AUTO, GUIDED, RTL and LOITER the boat steers the "
        "heading within AIS_SECTOR_DEG that opens the distance most, inside the fence, until the vessel has "
        "passed. The boat is slow: it can only leave a line early, and does not apply the collision regulations."),
    real("AIS_NEAR_M", 500.0, 10.0, 20000.0, "m",
        "Closest approach to a moving vessel that counts as near, if both keep course and speed. Larger: earlier "
        "and more warnings."),
    real("AIS_NEAR_S", 1500.0, 60.0, 7200.0, "s",
        "Time ahead within which a close approach is reported. Larger: earlier warnings."),
    real("AIS_SECTOR_DEG", 60.0, 5.0, 80.0, "deg",
        "Maximum angle off the planned course when stepping aside. Larger: opens the distance faster; smaller: "
        "more progress along the course."),
    real("AIS_STILL_M", 100.0, 10.0, 20000.0, "m",
        "Closest approach to a stationary vessel, a mark or a base station that counts as near. Larger: earlier "
        "and more warnings."),
    real("AIS_STILL_M_S", 0.5, 0.0, 10.0, "m/s", "Speed over ground below which a vessel counts as stationary."),
    constant("ARMING_CHECK", 1, "all", "Checks before arming, for ground stations that report disabled checks."),
    constant("ARMING_SKIPCHK", 0, "none", "Checks left out before arming (the name since ArduPilot 4.7)."),
    real("BAT_LOW_VOLT", 0.0, 0.0, 100.0, "V", "Supply voltage below which SUPPLY_LOW is set. 0: never."),
    integer("BOOT_ARM", 0, 0, 1, "",
        "Arming at start. 1: armed without a command, for a boat that must continue after a power cut."),
    choice("BOOT_MODE", 4, {mode.value: mode.name.lower() for mode in Mode}, "Mode at start."),
    choice("BOOT_RESUME", 0, {0: "nothing", 1: "mode, goal and mission", 2: "mode, goal, mission and arming"},
        "State restored at start from the time before the restart; BOOT_MODE and BOOT_ARM determine the rest."),
    real("BOOT_RESUME_H", 24.0, 0.0, 10000.0, "h",
        "Maximum age of a task that is resumed. Without a valid clock the age is not checked."),
    choice("CLK_SET", 1, {0: "never", 1: "when plainly wrong", 2: "when not synchronized"},
        "Setting of the computer's clock from GPS. Plainly wrong: before 2026 or after 2099 (then also from a "
        "ground station, if there is no GPS), or a day off without synchronization. Not synchronized: the kernel "
        "knows of no NTP, and the clock is more than 2 s off."),
    *_deviations("CMPB", "compass B"),
    real("CMPB_OFFSET_DEG", 0.0, -180.0, 180.0, "deg", "Mounting angle of compass B, added to its reading."),
    choice("CMP_DECL_AUTO", 0, {0: "CMP_DECL_DEG", 1: "world magnetic model"},
        "Source of the magnetic declination. The model needs a position; until the first fix CMP_DECL_DEG is used."),
    real("CMP_DECL_DEG", 0.0, -180.0, 180.0, "deg",
        "Magnetic declination, east positive, for a magnetic compass that does not state its own. If not 0, it "
        "also replaces a stated variation that is 0 or differs by more than 3 deg."),
    *_deviations("CMP", "the compass"),
    real("CMP_FROZEN_S", 30.0, 0.0, 3600.0, "s",
        "Time of an unchanged reading after which a compass counts as frozen, if it moved with the waves before, "
        "or if the other compass or the track turns. Rudder and large waves reveal it earlier. Smaller: earlier "
        "detection. 0: never."),
    real("CMP_OFFSET_DEG", 0.0, -180.0, 180.0, "deg", "Mounting angle of the compass, added to its reading."),
    real("CMP_TIMEOUT_S", 1.0, 0.2, 60.0, "s",
        "Maximum age of a valid heading; for a slow compass at least 2.5 of its sample intervals. Smaller: earlier "
        "fallback."),
    real("COG_SPEED_MIN", 0.3, 0.05, 5.0, "m/s",
        "Speed over ground above which the course replaces a missing compass heading. Smaller: steering at lower "
        "speed, with a noisier course."),
    real("CRUISE_SPEED", 0.5, 0.05, 5.0, "m/s",
        "Speed through the water assumed before the first estimate.", reboot=True),
    real("CTL_HOLD_S", 10.0, 0.0, 600.0, "s",
        "Maximum time the last rudder angle is held after the heading becomes invalid; then the rudder is centred. "
        "0: centre at once."),
    real("CTL_K1", 40.0, 0.0, 200.0, "",
        "S-surface gain on the heading error (error / 180 deg) with CTL_MODE 0. Larger: faster turns, more "
        "overshoot and rudder travel."),
    real("CTL_K2", 0.3, 0.0, 50.0, "",
        "S-surface gain on the yaw rate (yaw rate / steady yaw rate at full rudder) with CTL_MODE 0. Larger: more "
        "damping and rudder travel."),
    choice("CTL_MODE", 1, {0: "fixed gains", 1: "scheduled"},
        "Heading controller: S-surface with the fixed gains CTL_K1 and CTL_K2, or with gains, trim and turns "
        "scheduled by the estimate (needs EST_MODE 1)."),
    real("CTL_PRICE", 1.0, 0.1, 10.0, "",
        "Weight of rudder travel with CTL_MODE 1. Larger: less rudder travel, larger heading errors."),
    real("CTL_TRIM_DEG", 0.0, -20.0, 20.0, "deg", "Rudder angle added to the output of the heading controller."),
    real("CTL_WAY_MIN", 0.1, 0.0, 1.0, "m/s",
        "Minimum speed through the water for steering with CTL_MODE 1. Below it, on the goal heading, the rudder "
        "is not moved."),
    real("DEPTH_MIN", 0.0, 0.0, 1000.0, "m",
        "Water depth below the surface under which WATER_SHALLOW is set. Larger: earlier warning. 0: never."),
    choice("EST_MODE", 1, {0: "plain", 1: "wave filter"},
        "Heading estimator: a plain observer, or a filter that removes wave motion and learns speed and trim."),
    real("EST_TAU_S", 1.5, 0.1, 30.0, "s",
        "Time constant of the plain observer (EST_MODE 0). Larger: smoother, with more delay."),
    choice("FENCE_ENABLE", 0, _OFF_ON, "Fence monitoring."),
    choice("FS_BATT_ACT", 2, _FAILSAFE, "Action on a nearly empty battery (PWR_KEEP_PCT, PWR_KEEP_VOLT)."),
    choice("FS_DEPTH_ACT", 0, _FAILSAFE, "Action in shallow water (DEPTH_MIN)."),
    choice("FS_FENCE_ACT", 4, _FAILSAFE, "Action outside the fence."),
    choice("FS_GCS_ACT", 0, _FAILSAFE,
        "Action when no ground station has been received for FS_GCS_S. Also taken in MANUAL, not in HOLD."),
    real("FS_GCS_S", 600.0, 5.0, 10000000.0, "s",
        "Time without a message after which a ground station counts as silent."),
    choice("FS_POS_ACT", 0, _FAILSAFE, "Action without a position fix. 0: dead reckoning (POS_RECKON_M)."),
    choice("FS_RESUME", 0, _OFF_ON,
        "Resumption of the interrupted task when the fault that changed the mode is cleared."),
    choice("FS_RUD_ACT", 0, _FAILSAFE,
        "Action on a fault of the rudder or its servo, in addition to the automatic remedy."),
    choice("FS_STEER_ACT", 0, _FAILSAFE, "Action when the boat does not respond to the rudder."),
    choice("FS_VOLT_ACT", 0, _FAILSAFE, "Action on low supply voltage."),
    choice("FS_WIND_ACT", 0, _FAILSAFE, "Action in strong wind (WIND_MAX)."),
    choice("LNK_IDENTITY", 3, {0: "generic", 3: "ArduPilot"},
        "Autopilot type in the heartbeat. ArduPilot: modes and go-to work in QGroundControl and MAVSDK.", reboot=True),
    choice("LNK_MAVLINK1", 1, {0: "refused", 1: "accepted"}, "MAVLink 1 frames, which cannot be signed."),
    real("LNK_SAT_S", 120.0, 10.0, 3600.0, "s", "Interval of HIGH_LATENCY2 on a satellite link that has requested it."),
    integer("LNK_SYSID", 1, 1, 250, "", "MAVLink system id of the boat.", reboot=True),
    choice("LOG_ENABLE", 1, _OFF_ON, "Onboard log.", reboot=True),
    real("LOG_FILE_MB", 64.0, 1.0, 1024.0, "MB",
        "Size at which a log file is closed and the next one begun.", reboot=True),
    real("LOG_FREE_MB", 50.0, 0.0, 1000000.0, "MB",
        "Minimum free disk space. The oldest full logs are deleted to keep it; below it no log is begun."),
    real("LOG_KEEP_DAYS", 0.0, 0.0, 10000.0, "d",
        "Age after which full logs are deleted. 0: kept while there is space.", reboot=True),
    real("LOG_KEEP_MB", 2048.0, 2.0, 1000000.0, "MB",
        "Total size above which the oldest full logs are deleted; the last minutes before restarts and severe "
        "faults are deleted last.", reboot=True),
    real("LOIT_RADIUS", 100.0, 10.0, 10000.0, "m",
        "Radius of the loiter circle, and of mission circles without a radius. Below 5 turning radii (78 m by "
        "default) the boat may drift out by about 3.5 turning radii in a current; the autopilot reports it. Near a "
        "fence the circle is moved. A mission item keeps the radius with which it began."),
    choice("LOOP_LOCK", 1, _OFF_ON,
        "Alignment of the ticks to the compass: they drift to just after the arrival of its samples. The rate does "
        "not change."),
    integer("LOOP_RATE_HZ", 10, 1, 50, "Hz", "Rate of the control loop."),
    real("MAN_TIMEOUT_S", 3.0, 0.5, 60.0, "s", "Time without a message after which a joystick is released."),
    real("MDL_ALPHA_S2", 17.0, 0.0, 1000000.0, "s^2",
        "Norrbin coefficient of the K-T model at MDL_SPEED. 0: linear model."),
    real("MDL_K", 0.049, 0.0001, 20.0, "1/s",
        "Turning ability of the K-T model at MDL_SPEED: steady yaw rate per rudder angle."),
    real("MDL_SPEED", 0.4, 0.05, 10.0, "m/s", "Speed through the water at which the K-T model was identified."),
    real("MDL_T_S", 4.0, 0.05, 5000.0, "s", "Turning time constant of the K-T model at MDL_SPEED."),
    real("NAV_LOOK_S", 60.0, 10.0, 600.0, "s",
        "Look-ahead time on a line: the boat steers for the point at this sailing time ahead, at least two turning "
        "radii. Larger: smoother, slower return to the line."),
    real("POS_JUMP_S", 120.0, 1.0, 3600.0, "s",
        "Time after which a position that jumped farther than the boat can sail is accepted, if it stays. Larger: "
        "safer against spoofing, slower after a real jump."),
    real("POS_RECKON_M", 500.0, 0.0, 100000.0, "m",
        "Maximum standard deviation of dead reckoning without fixes; above it the boat keeps station. "
        "0: no dead reckoning."),
    real("POS_TIMEOUT_S", 5.0, 0.5, 600.0, "s",
        "Maximum age of a valid position; for a slow receiver at least 2.5 of its sample intervals. Smaller: "
        "earlier dead reckoning."),
    integer("PWR_COMPANION", 0, 0, 255, "",
        "MAVLink component id on the boat whose BATTERY_STATUS is used if the autopilot measures no battery "
        "itself. 0: none."),
    real("PWR_KEEP_PCT", 0.0, 0.0, 95.0, "%", "Battery charge below which FS_BATT_ACT is taken. 0: never."),
    real("PWR_KEEP_VOLT", 0.0, 0.0, 100.0, "V", "Battery voltage below which FS_BATT_ACT is taken. 0: never."),
    real("PWR_LNK_FACTOR", 5.0, 1.0, 100.0, "",
        "Factor on the telemetry intervals while saving power. Larger: less telemetry."),
    integer("PWR_LOOP_HZ", 5, 2, 50, "Hz", "Maximum rate of the control loop while saving power."),
    real("PWR_PRICE", 3.0, 1.0, 10.0, "", "Factor on CTL_PRICE while saving power. Larger: less rudder travel."),
    real("PWR_SAVE_PCT", 0.0, 0.0, 95.0, "%", "Battery charge below which the autopilot saves power. 0: never."),
    real("PWR_SAVE_VOLT", 0.0, 0.0, 100.0, "V", "Battery voltage below which the autopilot saves power. 0: never."),
    choice("RALLY_INCL_HOME", 1, _OFF_ON,
        "Home as a return point of RTL beside the rally points. Off: home only without rally points."),
    real("RUD_AMP_MAX", 3.0, 0.0, 50.0, "A", "Current above which the rudder servo is eased. 0: no limit."),
    real("RUD_CENTRE_DEG", 0.0, -90.0, 90.0, "deg", "Angle of the servo shaft with the rudder amidships."),
    real("RUD_DBAND_DEG", 0.0, 0.0, 10.0, "deg",
        "Deadband: a rudder demand that differs less from the present command is not sent. Larger: less servo "
        "wear, less accurate steering."),
    choice("RUD_DISARMED", 0, {0: "held amidships", 1: "released"}, "Rudder while disarmed."),
    real("RUD_EST_DEG_S", 60.0, 1.0, 1000.0, "deg/s",
        "Rate of the servo under load, for the estimate of a rudder angle that is not measured. Larger: the estimate "
        "follows the command earlier."),
    real("RUD_EST_LAG_S", 0.1, 0.0, 1.0, "s",
        "Dead time from the command to the start of the rudder motion, for the estimate of a rudder angle that is not "
        "measured. Larger: the estimate starts to move later."),
    real("RUD_LIMIT_DEG", 30.0, 1.0, 60.0, "deg", "Maximum rudder angle to either side."),
    real("RUD_REST_S", 0.0, 0.0, 3600.0, "s",
        "Time of a constant, unloaded command after which the servo torque is released, if the servo supports it. "
        "0: never."),
    choice("RUD_REVERSE", 0, {0: "no", 1: "yes"}, "Reversed servo: its shaft turns against the rudder."),
    real("RUD_SLEW_DEG_S", 30.0, 0.5, 360.0, "deg/s", "Maximum rate of the rudder command."),
    real("RUD_TEMP_MAX", 70.0, 0.0, 150.0, "degC", "Servo temperature above which RUDDER_HOT is set."),
    real("RUD_TIMEOUT_S", 1.0, 0.2, 60.0, "s",
        "Time without a reply after which the servo counts as silent; if polled slowly, at least 2.5 polling "
        "intervals. Likewise for the samples of a rudder angle sensor."),
    real("SBD_CHECK_H", 12.0, 0.0, 720.0, "h",
        "Time without a satellite session after which the autopilot checks for messages. 0: never."),
    integer("SBD_CREDIT_B", 50, 1, 340, "", "Bytes per credit of the satellite provider."),
    integer("SBD_CSQ_MIN", 2, 0, 5, "", "Minimum satellite signal, 0 to 5, to begin a session."),
    integer("SBD_DAY_CRED", 50, 0, 100000, "", "Maximum satellite credits per UTC day. 0: no limit."),
    integer("SBD_MONTH_CRED", 1500, 0, 1000000, "", "Maximum satellite credits per UTC month. 0: no limit."),
    real("SBD_MT_DAYS", 7.0, 0.1, 365.0, "d",
        "Maximum age of a keyed satellite message to the boat; older ones are refused."),
    real("SBD_REPORT_MIN", 60.0, 0.0, 10080.0, "min", "Interval of satellite reports. 0: only when the mode changes."),
    count("STAT_BOOTCNT", "Number of starts with this state directory."),
    real("STK_RATE_DEG_S", 2.0, 0.1, 30.0, "deg/s", "Turn rate of the goal heading at full stick in STEERING."),
    real("WIND_MAX", 0.0, 0.0, 100.0, "m/s",
        "Wind speed averaged over 2 min above which WIND_STRONG is set. Smaller: earlier warning. 0: never."),
    real("WP_RADIUS", 20.0, 2.0, 1000.0, "m",
        "Distance at which a waypoint without its own radius is reached; passing it also counts."),
)
# fmt: on

INDEX: Mapping[str, int] = {row.name: index for index, row in enumerate(TABLE)}

# Group of the parameters with a prefix, on the reference page and in the component metadata.
GROUPS: Mapping[str, str] = {
    "AIS": "Navigation",
    "ARMING": "Start",
    "BAT": "Energy",
    "BOOT": "Start",
    "CLK": "Clock",
    "CMP": "Compass",
    "CMPB": "Compass",
    "COG": "Compass",
    "CRUISE": "Navigation",
    "CTL": "Controller",
    "DEPTH": "Instruments",
    "EST": "Estimator",
    "FENCE": "Fence",
    "FS": "Failsafe",
    "LNK": "Link",
    "LOG": "Log",
    "LOIT": "Navigation",
    "LOOP": "Loop",
    "MAN": "Manual",
    "MDL": "Model",
    "NAV": "Navigation",
    "POS": "Position",
    "PWR": "Energy",
    "RALLY": "Navigation",
    "RUD": "Rudder",
    "SBD": "Link",
    "STAT": "Statistics",
    "STK": "Manual",
    "WIND": "Instruments",
    "WP": "Navigation",
}
