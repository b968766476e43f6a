"""The one table of parameters: store, MAVLink, reference page and loop all read it.

Names are at most 16 characters (MAVLink). REAL values are kept rounded to single
precision, so that what a ground station reads back is exactly what the loop uses and
what the store keeps.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum


class ParameterError(ValueError):
    """A parameter name or value is refused; the text says why and what is allowed."""


class Kind(IntEnum):
    """How a value travels, numbered as MAVLink's MAV_PARAM_TYPE (INT32, REAL32)."""

    INTEGER = 6
    REAL = 9


@dataclass(frozen=True, slots=True)
class Parameter:
    """One row of the table; `choices` names the values of an enumeration."""

    name: str
    default: float
    minimum: float
    maximum: float
    unit: str
    kind: Kind
    text: str
    choices: Mapping[int, str] | None = None
    reboot: bool = False  # takes effect at the next start
    read_only: bool = False  # counted or measured here; nobody else may set it

    def checked(self, value: float) -> float:
        """Return the value as it is kept, or raise ParameterError."""
        allowed = self.allowed()
        if not math.isfinite(value):
            raise ParameterError(f"{self.name}: {value} is not a number; allowed: {allowed}")
        kept = value
        if self.kind is Kind.INTEGER:
            if value != math.floor(value):
                raise ParameterError(f"{self.name}: {value:g} is not a whole number; allowed: {allowed}")
        elif abs(value) <= SINGLE_MAX:
            kept = to_single(value)
        low, high = (self.minimum, self.maximum)
        if self.kind is Kind.REAL:
            low, high = to_single(low), to_single(high)
        if not low <= kept <= high:
            raise ParameterError(f"{self.name}: {value:g} is out of range; allowed: {allowed}")
        if self.choices is not None and int(kept) not in self.choices:
            raise ParameterError(f"{self.name}: {value:g} is not one of its values; allowed: {allowed}")
        return kept

    def allowed(self) -> str:
        """Say what is allowed, for messages."""
        if self.choices is not None:
            return ", ".join(f"{number} ({text})" for number, text in self.choices.items())
        return f"{self.minimum:g} to {self.maximum:g} {self.unit}".rstrip()


SINGLE_MAX = 3.4028234663852886e38


def to_single(value: float) -> float:
    """Round to single precision, the precision of a MAVLink parameter."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def _real(
    name: str, default: float, low: float, high: float, unit: str, text: str, *, reboot: bool = False
) -> Parameter:
    return Parameter(name, to_single(default), low, high, unit, Kind.REAL, text, None, reboot)


def _whole(name: str, default: int, low: int, high: int, unit: str, text: str, *, reboot: bool = False) -> Parameter:
    return Parameter(name, default, low, high, unit, Kind.INTEGER, text, None, reboot)


def _choice(name: str, default: int, choices: Mapping[int, str], text: str, *, reboot: bool = False) -> Parameter:
    return Parameter(name, default, min(choices), max(choices), "", Kind.INTEGER, text, choices, reboot)


def _count(name: str, text: str) -> Parameter:
    # Far within what a single counts exactly.
    return Parameter(name, 0.0, 0, 1_000_000, "", Kind.INTEGER, text, None, reboot=False, read_only=True)


_OFF_ON = {0: "off", 1: "on"}


def _deviations(prefix: str, compass: str) -> tuple[Parameter, ...]:
    terms = (("A", "constant"), ("B", "sin h"), ("C", "cos h"), ("D", "sin 2h"), ("E", "cos 2h"))
    return tuple(
        _real(f"{prefix}_DEV_{letter}", 0.0, -45.0, 45.0, "deg", f"Deviation of {compass}: coefficient of {term}.")
        for letter, term in terms
    )


_FAILSAFE = {
    0: "alert only",
    1: "HOLD: rudder amidships",
    2: "STEERING: keep the heading",
    3: "LOITER",
    4: "RTL",
}

TABLE: tuple[Parameter, ...] = (
    _real("BAT_LOW_VOLT", 0.0, 0.0, 100.0, "V", "Supply voltage below which it is low; 0: never."),
    _whole("BOOT_ARM", 0, 0, 1, "", "Arm by itself at start: 1 for a boat that must go on after a power cut."),
    _choice(
        "BOOT_MODE",
        4,
        {0: "manual", 3: "steering", 4: "hold", 5: "loiter", 10: "auto", 11: "rtl", 15: "guided"},
        "Mode at start.",
    ),
    _choice(
        "BOOT_RESUME",
        0,
        {0: "no", 1: "mode, goal and mission", 2: "mode, goal, mission and arming"},
        "Go on at start with what she was doing when the autopilot ended; the rest is as BOOT_MODE and BOOT_ARM say.",
    ),
    _real(
        "BOOT_RESUME_H",
        24.0,
        0.0,
        10000.0,
        "h",
        "What she did longer ago than this is not gone on with; without a right clock the age is not known nor asked.",
    ),
    _choice(
        "CLK_SET",
        1,
        {0: "never", 1: "when it is plainly wrong", 2: "when nothing keeps it"},
        "The computer's clock is set from GPS. Plainly wrong: before 2026, and then a ground station's time is taken, "
        "too, where there is no GPS. Nothing keeps it: the kernel knows of no NTP, and it is more than 2 s off.",
    ),
    *_deviations("CMPB", "compass B"),
    _real("CMPB_OFFSET_DEG", 0.0, -180.0, 180.0, "deg", "Mounting angle of compass B, added to its reading."),
    _choice(
        "CMP_DECL_AUTO",
        0,
        {0: "CMP_DECL_DEG", 1: "world magnetic model"},
        "Where the declination comes from; the model's needs a position, until then CMP_DECL_DEG counts.",
    ),
    _real(
        "CMP_DECL_DEG",
        0.0,
        -180.0,
        180.0,
        "deg",
        "Magnetic declination, east positive; used when the compass is magnetic and does not state its own.",
    ),
    *_deviations("CMP", "the compass"),
    _real(
        "CMP_FROZEN_S",
        30.0,
        0.0,
        3600.0,
        "s",
        "A compass that shows the same number for so long has stopped measuring; 0: never, for a boat ashore.",
    ),
    _real("CMP_OFFSET_DEG", 0.0, -180.0, 180.0, "deg", "Mounting angle of the compass, added to its reading."),
    _real("CMP_TIMEOUT_S", 1.0, 0.2, 60.0, "s", "A heading older than this is not steered by."),
    _real(
        "COG_SPEED_MIN",
        0.3,
        0.05,
        5.0,
        "m/s",
        "Without a compass she is steered by her course over ground when she makes at least this speed.",
    ),
    _real(
        "CRUISE_SPEED",
        0.5,
        0.05,
        5.0,
        "m/s",
        "Speed through the water that is expected before any is estimated.",
        reboot=True,
    ),
    _real(
        "CTL_HOLD_S",
        10.0,
        0.0,
        600.0,
        "s",
        "Without a valid heading the last rudder is held this long, then she goes amidships.",
    ),
    _real("CTL_K1", 40.0, 0.0, 200.0, "", "S-surface gain on the heading error (error / 180 deg), with CTL_MODE 0."),
    _real(
        "CTL_K2",
        0.3,
        0.0,
        50.0,
        "",
        "S-surface gain on the yaw rate (yaw rate / steady yaw rate at full rudder), with CTL_MODE 0.",
    ),
    _choice(
        "CTL_MODE",
        1,
        {0: "fixed gains", 1: "scheduled"},
        "The S-surface with CTL_K1 and CTL_K2, or with gains, trim and turns after the estimate (needs EST_MODE 1).",
    ),
    _real(
        "CTL_PRICE",
        1.0,
        0.1,
        10.0,
        "",
        "Price of rudder travel with CTL_MODE 1: more steers softer and quieter, less closer to the goal.",
    ),
    _real("CTL_TRIM_DEG", 0.0, -20.0, 20.0, "deg", "Rudder angle added to the controller's demand."),
    _real(
        "CTL_WAY_MIN",
        0.1,
        0.0,
        1.0,
        "m/s",
        "Slower than this through the water she has no steerage way: the rudder stays as it is (CTL_MODE 1).",
    ),
    _choice(
        "EST_MODE",
        1,
        {0: "plain", 1: "wave filter"},
        "How the heading is estimated: a plain observer, or a filter that sees through waves, learns speed and trim.",
    ),
    _real("EST_TAU_S", 1.5, 0.1, 30.0, "s", "Time constant of the plain observer (EST_MODE 0)."),
    _choice("FENCE_ENABLE", 0, _OFF_ON, "Heed the fence."),
    _choice("FS_FENCE_ACT", 4, _FAILSAFE, "What is done when she is outside the fence."),
    _choice("FS_GCS_ACT", 0, _FAILSAFE, "What is done when no ground station is heard any more."),
    _real("FS_GCS_S", 600.0, 5.0, 1e7, "s", "A ground station that has said nothing for this long is silent."),
    _choice("FS_POS_ACT", 0, _FAILSAFE, "What is done without a position; with 0 she goes on as last steered."),
    _choice("FS_RESUME", 0, _OFF_ON, "When a fault goes whose failsafe changed the mode: go on with what she did."),
    _choice("FS_RUD_ACT", 0, _FAILSAFE, "What is done when the rudder or its servo fails, beside what helps it."),
    _choice("FS_STEER_ACT", 0, _FAILSAFE, "What is done when she does not answer the rudder."),
    _choice("FS_VOLT_ACT", 0, _FAILSAFE, "What is done when the supply voltage is low."),
    _choice(
        "LNK_IDENTITY",
        3,
        {0: "generic", 3: "ArduPilot"},
        "Autopilot type in the heartbeat; ArduPilot gives QGroundControl and MAVSDK modes and go-to.",
        reboot=True,
    ),
    _choice("LNK_MAVLINK1", 1, {0: "refused", 1: "heard"}, "MAVLink 1 frames, which cannot be signed."),
    _real(
        "LNK_SAT_S", 120.0, 10.0, 3600.0, "s", "Interval of HIGH_LATENCY2 on a satellite link that was asked for it."
    ),
    _whole("LNK_SYSID", 1, 1, 250, "", "MAVLink system id of the boat.", reboot=True),
    _choice("LOG_ENABLE", 1, _OFF_ON, "Write the onboard log.", reboot=True),
    _real(
        "LOG_FILE_MB",
        64.0,
        1.0,
        1024.0,
        "MB",
        "A log file that reaches this size is closed and the next one begun.",
        reboot=True,
    ),
    _real("LOG_FREE_MB", 50.0, 0.0, 1e6, "MB", "Storage with less room than this is full; no more logs are begun."),
    _real(
        "LOG_KEEP_MB",
        2048.0,
        2.0,
        1000000.0,
        "MB",
        "The oldest logs are removed when all together are larger than this.",
        reboot=True,
    ),
    _real(
        "LOIT_RADIUS",
        100.0,
        10.0,
        10000.0,
        "m",
        "Radius of the watch circle in which she keeps station, and of circles that a mission gives none.",
    ),
    _choice(
        "LOOP_LOCK",
        1,
        _OFF_ON,
        "Let the ticks drift to just after the arrival of the compass samples; the rate does not change.",
    ),
    _whole("LOOP_RATE_HZ", 10, 1, 50, "Hz", "Rate of the control loop."),
    _real("MAN_TIMEOUT_S", 3.0, 0.5, 60.0, "s", "A stick that says nothing for this long is released."),
    _real("MDL_ALPHA_S2", 17.0, 0.0, 1e6, "s^2", "Norrbin coefficient of the K-T model at MDL_SPEED."),
    _real("MDL_K", 0.049, 1e-4, 20.0, "1/s", "Turning ability of the K-T model at MDL_SPEED."),
    _real("MDL_SPEED", 0.4, 0.05, 10.0, "m/s", "Speed through the water that the K-T model was identified at."),
    _real("MDL_T_S", 4.0, 0.05, 5000.0, "s", "Turning lag of the K-T model at MDL_SPEED."),
    _real(
        "NAV_LOOK_S",
        60.0,
        10.0,
        600.0,
        "s",
        "On a line she steers for the point that lies this much sailing ahead, two turning radii at least.",
    ),
    _real(
        "POS_JUMP_S",
        120.0,
        1.0,
        3600.0,
        "s",
        "A position that has jumped further than she can sail is believed once it stays for this long.",
    ),
    _real("POS_TIMEOUT_S", 5.0, 0.5, 600.0, "s", "A position older than this is not steered by."),
    _choice("RALLY_INCL_HOME", 1, _OFF_ON, "RTL considers home beside the rally points, not only when there are none."),
    _real("RUD_AMP_MAX", 3.0, 0.0, 50.0, "A", "Current above which the rudder servo is eased; 0: none."),
    _real("RUD_CENTRE_DEG", 0.0, -90.0, 90.0, "deg", "Angle of the servo shaft at which the rudder is amidships."),
    _real(
        "RUD_DBAND_DEG",
        0.0,
        0.0,
        10.0,
        "deg",
        "A demand that differs from the present command by less than this is not sent.",
    ),
    _choice("RUD_DISARMED", 0, {0: "held amidships", 1: "released"}, "The rudder while disarmed."),
    _real("RUD_LIMIT_DEG", 30.0, 1.0, 60.0, "deg", "Largest rudder angle to either side."),
    _real(
        "RUD_REST_S",
        0.0,
        0.0,
        3600.0,
        "s",
        "Torque is released when the command has stood this long and nothing pulls, if the servo can; 0: never.",
    ),
    _choice("RUD_REVERSE", 0, {0: "no", 1: "yes"}, "The servo shaft turns against the rudder."),
    _real("RUD_SLEW_DEG_S", 30.0, 0.5, 360.0, "deg/s", "Fastest change of the rudder command."),
    _real("RUD_TEMP_MAX", 70.0, 0.0, 150.0, "degC", "Temperature above which the rudder servo is hot."),
    _real("RUD_TIMEOUT_S", 1.0, 0.2, 60.0, "s", "A servo that has not answered for this long is silent."),
    _count("STAT_BOOTCNT", "Starts of the autopilot that this state directory has seen."),
    _real("STK_RATE_DEG_S", 2.0, 0.1, 30.0, "deg/s", "In STEERING, how fast a full stick turns the goal."),
    _real(
        "WP_RADIUS",
        20.0,
        2.0,
        1000.0,
        "m",
        "A waypoint without a radius of its own is reached at this distance, or when she passes it.",
    ),
)

INDEX: Mapping[str, int] = {row.name: index for index, row in enumerate(TABLE)}


class ParameterSet:
    """An immutable value for every row of TABLE, hashable and compared by value."""

    __slots__ = ("_hash", "_values")

    def __init__(self, values: Iterable[float] | None = None) -> None:
        """Take one checked value a row, in the table's order; the defaults without any."""
        self._values = tuple(row.default for row in TABLE) if values is None else tuple(values)
        if len(self._values) != len(TABLE):
            raise ParameterError(f"{len(self._values)} values for {len(TABLE)} parameters")
        self._hash = hash(self._values)

    def __getitem__(self, name: str) -> float:
        """Return the value of a row; ParameterError for an unknown name."""
        return self._values[index_of(name)]

    def __eq__(self, other: object) -> bool:
        """Compare by value."""
        return isinstance(other, ParameterSet) and self._values == other._values

    def __hash__(self) -> int:
        """Hash by value."""
        return self._hash

    def items(self) -> Iterator[tuple[str, float]]:
        """Yield name and value in the table's order."""
        for row, value in zip(TABLE, self._values, strict=True):
            yield row.name, value

    def values(self) -> tuple[float, ...]:
        """Return the values in the table's order."""
        return self._values

    def replaced(self, name: str, value: float) -> ParameterSet:
        """Return a set with one value changed, or raise ParameterError."""
        index = index_of(name)
        kept = TABLE[index].checked(value)
        if kept == self._values[index]:
            return self
        return ParameterSet((*self._values[:index], kept, *self._values[index + 1 :]))


def index_of(name: str) -> int:
    """Return the row number of a name, or raise ParameterError with near names."""
    index = INDEX.get(name)
    if index is None:
        near = sorted(INDEX, key=lambda known: (-_common_prefix(known, name), known))[:3]
        raise ParameterError(f"unknown parameter {name!r}; near it: {', '.join(near)}")
    return index


def _common_prefix(first: str, second: str) -> int:
    count = 0
    for one, other in zip(first, second.upper(), strict=False):
        if one != other:
            break
        count += 1
    return count


def parse_file(text: str, source: str) -> dict[str, float]:
    """Read a ground station's parameter file into {name: checked value}.

    Accepts MAVProxy's and Mission Planner's `NAME VALUE` or `NAME,VALUE` and
    QGroundControl's `SYSTEM COMPONENT NAME VALUE TYPE`; `#` starts a comment. Raises
    ParameterError naming source and line.
    """
    found: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split("#", 1)[0].replace(",", " ").split()
        if not fields:
            continue
        name, value_text = (fields[2], fields[3]) if len(fields) == 5 else [*fields, "", ""][:2]
        if len(fields) not in (2, 5):
            raise ParameterError(f"{source}:{number}: expected NAME VALUE, found {line.strip()[:60]!r}")
        try:
            value = float(value_text)
        except ValueError:
            raise ParameterError(f"{source}:{number}: {value_text[:30]!r} is not a number") from None
        try:
            found[name] = TABLE[index_of(name)].checked(value)
        except ParameterError as error:
            raise ParameterError(f"{source}:{number}: {error}") from None
    return found


def format_value(value: float) -> str:
    """Write a value with the fewest digits that read back as the same single."""
    if value == math.floor(value) and abs(value) < 1e9:
        return str(int(value))
    for digits in range(1, 10):
        text = f"{value:.{digits}g}"
        # Few digits of the largest singles round up beyond them.
        if abs(float(text)) <= SINGLE_MAX and to_single(float(text)) == value:
            return text
    return repr(value)


def format_file(values: Mapping[str, float]) -> str:
    """Write a `NAME VALUE` file that parse_file and the ground stations read."""
    return "".join(f"{name} {format_value(value)}\n" for name, value in values.items())


def markdown() -> str:
    """The reference page, params/REFERENCE.md."""
    lines = [
        "# Parameters",
        "",
        "Generated by `rambler params --markdown`; do not edit.",
        "",
        "| name | default | range | unit | meaning |",
        "| --- | --- | --- | --- | --- |",
    ]
    for row in TABLE:
        limits = row.allowed() if row.choices else f"{row.minimum:g} to {row.maximum:g}"
        text = row.text + (" Takes effect at the next start." if row.reboot else "")
        text += " Read-only." if row.read_only else ""
        lines.append(f"| `{row.name}` | {format_value(row.default)} | {limits} | {row.unit} | {text} |")
    return "\n".join(lines) + "\n"
