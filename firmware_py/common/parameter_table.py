"""The one table of parameters: store, MAVLink, reference page and loop all read it."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.ais_parameters import AIS
from firmware_py.common.mode_table import FAILSAFE_MODES, MODES, Mode
from firmware_py.common.parameter_row import Parameter, choice, constant, count, real, whole
from firmware_py.common.satellite_parameters import SATELLITE

_OFF_ON = {0: "off", 1: "on"}
# Of the time-outs that common/silence.py lengthens.
_SELDOM = "what comes seldom has 2.5 of its intervals."


def _deviations(prefix: str, compass: str) -> tuple[Parameter, ...]:
    terms = (("A", "constant"), ("B", "sin h"), ("C", "cos h"), ("D", "sin 2h"), ("E", "cos 2h"))
    return tuple(
        real(f"{prefix}_DEV_{letter}", 0.0, -45.0, 45.0, "deg", f"Deviation of {compass}: coefficient of {term}.")
        for letter, term in terms
    )


_FAILSAFE = {0: "alert only"} | {
    value: f"{mode.name}: {effect}" if (effect := MODES[mode].failsafe_effect) else mode.name
    for value, mode in FAILSAFE_MODES.items()
}

TABLE: tuple[Parameter, ...] = (
    *AIS,
    constant("ARMING_CHECK", 1, "all", "Checks before arming; for ground stations that report disabled checks."),
    constant("ARMING_SKIPCHK", 0, "none", "Checks left out before arming; the name of ArduPilot 4.7."),
    real("BAT_LOW_VOLT", 0.0, 0.0, 100.0, "V", "Supply voltage below which it is low; 0: never."),
    whole("BOOT_ARM", 0, 0, 1, "", "Arm by itself at start: 1 for a boat that must go on after a power cut."),
    choice("BOOT_MODE", 4, {mode.value: mode.name.lower() for mode in Mode}, "Mode at start."),
    choice(
        "BOOT_RESUME",
        0,
        {0: "no", 1: "mode, goal and mission", 2: "mode, goal, mission and arming"},
        "Go on at start with what she was doing when the autopilot ended; the rest is as BOOT_MODE and BOOT_ARM say.",
    ),
    real(
        "BOOT_RESUME_H",
        24.0,
        0.0,
        10000.0,
        "h",
        "What she did longer ago than this is not gone on with; without a right clock the age is not known nor asked.",
    ),
    choice(
        "CLK_SET",
        1,
        {0: "never", 1: "when it is plainly wrong", 2: "when nothing keeps it"},
        "The computer's clock is set from GPS. Plainly wrong: before 2026 or after 2099, and then a ground station's "
        "time is taken, too, where there is no GPS; or a day off where nothing keeps it. Nothing keeps it: the kernel "
        "knows of no NTP, and it is more than 2 s off.",
    ),
    *_deviations("CMPB", "compass B"),
    real("CMPB_OFFSET_DEG", 0.0, -180.0, 180.0, "deg", "Mounting angle of compass B, added to its reading."),
    choice(
        "CMP_DECL_AUTO",
        0,
        {0: "CMP_DECL_DEG", 1: "world magnetic model"},
        "Where the declination comes from; the model's needs a position, until then CMP_DECL_DEG counts.",
    ),
    real(
        "CMP_DECL_DEG",
        0.0,
        -180.0,
        180.0,
        "deg",
        "Magnetic declination, east positive; used when the compass is magnetic and does not state its own. Unless "
        "it is 0, it also replaces a stated variation that is 0 or differs from it by more than 3 deg.",
    ),
    *_deviations("CMP", "the compass"),
    real(
        "CMP_FROZEN_S",
        30.0,
        0.0,
        3600.0,
        "s",
        "Time with one number after which a compass has stopped measuring, if until then it swung with the waves or "
        "if the other compass or the track turns meanwhile. Rudder and large waves show it earlier. 0: never judged.",
    ),
    real("CMP_OFFSET_DEG", 0.0, -180.0, 180.0, "deg", "Mounting angle of the compass, added to its reading."),
    real("CMP_TIMEOUT_S", 1.0, 0.2, 60.0, "s", f"A heading older than this is not steered by; {_SELDOM}"),
    real(
        "COG_SPEED_MIN",
        0.3,
        0.05,
        5.0,
        "m/s",
        "Without a compass she is steered by her course over ground when she makes at least this speed.",
    ),
    real(
        "CRUISE_SPEED",
        0.5,
        0.05,
        5.0,
        "m/s",
        "Speed through the water that is expected before any is estimated.",
        reboot=True,
    ),
    real(
        "CTL_HOLD_S",
        10.0,
        0.0,
        600.0,
        "s",
        "Without a valid heading the last rudder is held this long, then she goes amidships.",
    ),
    real("CTL_K1", 40.0, 0.0, 200.0, "", "S-surface gain on the heading error (error / 180 deg), with CTL_MODE 0."),
    real(
        "CTL_K2",
        0.3,
        0.0,
        50.0,
        "",
        "S-surface gain on the yaw rate (yaw rate / steady yaw rate at full rudder), with CTL_MODE 0.",
    ),
    choice(
        "CTL_MODE",
        1,
        {0: "fixed gains", 1: "scheduled"},
        "The S-surface with CTL_K1 and CTL_K2, or with gains, trim and turns after the estimate (needs EST_MODE 1).",
    ),
    real(
        "CTL_PRICE",
        1.0,
        0.1,
        10.0,
        "",
        "Price of rudder travel with CTL_MODE 1: more steers softer and quieter, less closer to the goal.",
    ),
    real("CTL_TRIM_DEG", 0.0, -20.0, 20.0, "deg", "Rudder angle added to the controller's demand."),
    real(
        "CTL_WAY_MIN",
        0.1,
        0.0,
        1.0,
        "m/s",
        "Slower than this through the water she has no steerage way: on her goal the rudder is let be (CTL_MODE 1).",
    ),
    choice(
        "EST_MODE",
        1,
        {0: "plain", 1: "wave filter"},
        "How the heading is estimated: a plain observer, or a filter that sees through waves, learns speed and trim.",
    ),
    real("EST_TAU_S", 1.5, 0.1, 30.0, "s", "Time constant of the plain observer (EST_MODE 0)."),
    choice("FENCE_ENABLE", 0, _OFF_ON, "Heed the fence."),
    choice("FS_BATT_ACT", 2, _FAILSAFE, "What is done when the battery is nearly empty (PWR_KEEP_PCT, PWR_KEEP_VOLT)."),
    choice("FS_FENCE_ACT", 4, _FAILSAFE, "What is done when she is outside the fence."),
    choice(
        "FS_GCS_ACT",
        0,
        _FAILSAFE,
        "What is done when no ground station is heard any more, in MANUAL too; not in HOLD.",
    ),
    real("FS_GCS_S", 600.0, 5.0, 1e7, "s", "A ground station that has said nothing for this long is silent."),
    choice("FS_POS_ACT", 0, _FAILSAFE, "What is done without a fix; with 0 she goes on by reckoning (POS_RECKON_M)."),
    choice("FS_RESUME", 0, _OFF_ON, "When a fault goes whose failsafe changed the mode: go on with what she did."),
    choice("FS_RUD_ACT", 0, _FAILSAFE, "What is done when the rudder or its servo fails, beside what helps it."),
    choice("FS_STEER_ACT", 0, _FAILSAFE, "What is done when she does not answer the rudder."),
    choice("FS_VOLT_ACT", 0, _FAILSAFE, "What is done when the supply voltage is low."),
    choice(
        "LNK_IDENTITY",
        3,
        {0: "generic", 3: "ArduPilot"},
        "Autopilot type in the heartbeat; ArduPilot gives QGroundControl and MAVSDK modes and go-to.",
        reboot=True,
    ),
    choice("LNK_MAVLINK1", 1, {0: "refused", 1: "heard"}, "MAVLink 1 frames, which cannot be signed."),
    real("LNK_SAT_S", 120.0, 10.0, 3600.0, "s", "Interval of HIGH_LATENCY2 on a satellite link that was asked for it."),
    whole("LNK_SYSID", 1, 1, 250, "", "MAVLink system id of the boat.", reboot=True),
    choice("LOG_ENABLE", 1, _OFF_ON, "Write the onboard log.", reboot=True),
    real(
        "LOG_FILE_MB",
        64.0,
        1.0,
        1024.0,
        "MB",
        "A log file that reaches this size is closed and the next one begun.",
        reboot=True,
    ),
    real("LOG_FREE_MB", 50.0, 0.0, 1e6, "MB", "The oldest full logs go to keep this room; below it none is begun."),
    real(
        "LOG_KEEP_DAYS",
        0.0,
        0.0,
        10000.0,
        "d",
        "Full logs older than this are removed; 0: they stay as long as there is room.",
        reboot=True,
    ),
    real(
        "LOG_KEEP_MB",
        2048.0,
        2.0,
        1000000.0,
        "MB",
        "The oldest full logs are removed when all together are larger than this, the last minutes before restarts and "
        "severe faults at last.",
        reboot=True,
    ),
    real(
        "LOIT_RADIUS",
        100.0,
        10.0,
        10000.0,
        "m",
        "Radius of the watch circle in which she keeps station, and of circles that a mission gives none; an item of a "
        "mission keeps that with which it began. In a current she leaves one smaller than 5 "
        "turning radii (78 m as delivered) by some 3.5 of them; that is told. A fence nearer than those has it moved.",
    ),
    choice(
        "LOOP_LOCK",
        1,
        _OFF_ON,
        "Let the ticks drift to just after the arrival of the compass samples; the rate does not change.",
    ),
    whole("LOOP_RATE_HZ", 10, 1, 50, "Hz", "Rate of the control loop."),
    real("MAN_TIMEOUT_S", 3.0, 0.5, 60.0, "s", "A stick that says nothing for this long is released."),
    real("MDL_ALPHA_S2", 17.0, 0.0, 1e6, "s^2", "Norrbin coefficient of the K-T model at MDL_SPEED."),
    real("MDL_K", 0.049, 1e-4, 20.0, "1/s", "Turning ability of the K-T model at MDL_SPEED."),
    real("MDL_SPEED", 0.4, 0.05, 10.0, "m/s", "Speed through the water that the K-T model was identified at."),
    real("MDL_T_S", 4.0, 0.05, 5000.0, "s", "Turning lag of the K-T model at MDL_SPEED."),
    real(
        "NAV_LOOK_S",
        60.0,
        10.0,
        600.0,
        "s",
        "On a line she steers for the point that lies this much sailing ahead, two turning radii at least.",
    ),
    real(
        "POS_JUMP_S",
        120.0,
        1.0,
        3600.0,
        "s",
        "A position that has jumped further than she can sail is believed once it stays for this long.",
    ),
    real(
        "POS_RECKON_M", 500.0, 0.0, 1e5, "m", "Without fixes she goes on by a reckoned place no less certain; 0: never."
    ),
    real("POS_TIMEOUT_S", 5.0, 0.5, 600.0, "s", f"A position older than this is not steered by; {_SELDOM}"),
    whole(
        "PWR_COMPANION",
        0,
        0,
        255,
        "",
        "MAVLink component of the boat whose BATTERY_STATUS is believed where she measures nothing herself; 0: none.",
    ),
    real("PWR_KEEP_PCT", 0.0, 0.0, 95.0, "%", "Charge of the battery below which FS_BATT_ACT is done; 0: never."),
    real("PWR_KEEP_VOLT", 0.0, 0.0, 100.0, "V", "Voltage of the battery below which FS_BATT_ACT is done; 0: never."),
    real("PWR_LNK_FACTOR", 5.0, 1.0, 100.0, "", "While she saves power, telemetry comes so many times less often."),
    whole("PWR_LOOP_HZ", 5, 2, 50, "Hz", "While she saves power, the control loop turns no faster than this."),
    real("PWR_PRICE", 3.0, 1.0, 10.0, "", "While she saves power, rudder travel costs so many times CTL_PRICE."),
    real("PWR_SAVE_PCT", 0.0, 0.0, 95.0, "%", "Charge of the battery below which she saves power; 0: never."),
    real("PWR_SAVE_VOLT", 0.0, 0.0, 100.0, "V", "Voltage of the battery below which she saves power; 0: never."),
    choice("RALLY_INCL_HOME", 1, _OFF_ON, "RTL considers home beside the rally points, not only when there are none."),
    real("RUD_AMP_MAX", 3.0, 0.0, 50.0, "A", "Current above which the rudder servo is eased; 0: none."),
    real("RUD_CENTRE_DEG", 0.0, -90.0, 90.0, "deg", "Angle of the servo shaft at which the rudder is amidships."),
    real(
        "RUD_DBAND_DEG",
        0.0,
        0.0,
        10.0,
        "deg",
        "A demand that differs from the present command by less than this is not sent.",
    ),
    choice("RUD_DISARMED", 0, {0: "held amidships", 1: "released"}, "The rudder while disarmed."),
    real("RUD_LIMIT_DEG", 30.0, 1.0, 60.0, "deg", "Largest rudder angle to either side."),
    real(
        "RUD_REST_S",
        0.0,
        0.0,
        3600.0,
        "s",
        "Torque is released when the command has stood this long and nothing pulls, if the servo can; 0: never.",
    ),
    choice("RUD_REVERSE", 0, {0: "no", 1: "yes"}, "The servo shaft turns against the rudder."),
    real("RUD_SLEW_DEG_S", 30.0, 0.5, 360.0, "deg/s", "Fastest change of the rudder command."),
    real("RUD_TEMP_MAX", 70.0, 0.0, 150.0, "degC", "Temperature above which the rudder servo is hot."),
    real("RUD_TIMEOUT_S", 1.0, 0.2, 60.0, "s", f"A servo that has not answered for this long is silent; {_SELDOM}"),
    *SATELLITE,
    count("STAT_BOOTCNT", "Starts of the autopilot that this state directory has seen."),
    real("STK_RATE_DEG_S", 2.0, 0.1, 30.0, "deg/s", "In STEERING, how fast a full stick turns the goal."),
    real(
        "WP_RADIUS",
        20.0,
        2.0,
        1000.0,
        "m",
        "A waypoint without a radius of its own is reached at this distance, or when she passes it.",
    ),
)

INDEX: Mapping[str, int] = {row.name: index for index, row in enumerate(TABLE)}
