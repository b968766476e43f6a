"""The mode state machine: pure functions that decide on modes, arming and goals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import TWO_PI, wrap_two_pi
from firmware_py.common.intents import (
    Answer,
    Arm,
    BenchRudder,
    ForgetParameters,
    Intent,
    ManualRudder,
    Restart,
    SetMode,
    SteerHeading,
    SteerPosition,
    Verdict,
)
from firmware_py.common.mode_table import MODES, Mode, Need
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.reports import Water
from firmware_py.model.crab import heading_for_course

_HEADING_MODES = " or ".join(sorted(mode.name for mode, row in MODES.items() if row.heading_goals))
_POSITION_MODES = " or ".join(sorted(mode.name for mode, row in MODES.items() if row.position_goals))
ACCEPTED = Answer(Verdict.ACCEPTED)
# A goal within this angle on the other side is reached without a turn the long way.
ALREADY_THERE_RAD = 0.1
MAX_BENCH_S = 60.0


class HeadingGoal(msgspec.Struct, frozen=True, tag=True):
    """A heading or, over ground, a course, from true north.

    `turn` is 1 (to starboard) or -1 (to port) during a turn the long way.
    """

    heading_rad: float
    over_ground: bool = False
    turn: int = 0


class PositionGoal(msgspec.Struct, frozen=True, tag=True):
    """A position to go to."""

    latitude_rad: float
    longitude_rad: float


class ModeState(msgspec.Struct, frozen=True):
    """Mode, arming, goal, stick with the time of its last command, and bench rudder deflection with its end.

    `stick` and `bench` are -1 (full port) to 1 (full starboard), None without a command.
    `by_failsafe`: a failsafe has chosen the mode, and there was no command since.
    """

    mode: Mode = Mode.HOLD
    armed: bool = False
    goal: HeadingGoal | PositionGoal | None = None
    stick: float | None = None
    stick_t_s: float = 0.0
    bench: float | None = None
    bench_until_s: float = 0.0
    by_failsafe: bool = False

    @classmethod
    def at_start(cls, parameters: ParameterSet) -> ModeState:
        """Return the state at start, set by BOOT_MODE and BOOT_ARM."""
        return cls(Mode(int(parameters["BOOT_MODE"])), armed=bool(parameters["BOOT_ARM"]))


class Situation(msgspec.Struct, frozen=True):
    """Inputs of decisions besides the mode state."""

    heading_rad: float | None  # None without a valid heading
    water: Water | None
    position_ok: bool
    rudder_ok: bool
    mission_ok: bool = False  # a mission is loaded
    home_ok: bool = False  # home is set, or a rally point loaded
    dead_reckoning_sd_m: float | None = None  # of the position, while dead reckoning is used
    fence_breached: bool = False
    fault: str = ""  # text of an active fault that prevents arming

    @property
    def is_position_known(self) -> bool:
        """Whether a position is known, by a fix or by dead reckoning."""
        return self.position_ok or self.dead_reckoning_sd_m is not None


# Texts of missing requirements.
_MISSING_TEXTS: Mapping[Need, str] = {
    Need.HEADING: "no valid heading",
    Need.POSITION: "no position",
    Need.MISSION: "no mission",
    Need.HOME: "no home and no rally point",
}
_CONDITIONS: Mapping[Need, Callable[[Situation], bool]] = {
    Need.HEADING: lambda situation: situation.heading_rad is not None,
    Need.POSITION: lambda situation: situation.is_position_known,
    Need.MISSION: lambda situation: situation.mission_ok,
    Need.HOME: lambda situation: situation.home_ok,
}


def mode_refusal(mode: Mode, situation: Situation) -> str:
    """Return the reason why a mode cannot be entered, empty if it can."""
    return next((_MISSING_TEXTS[need] for need in MODES[mode].needs if not _CONDITIONS[need](situation)), "")


def enter(state: ModeState, mode: Mode, situation: Situation) -> tuple[ModeState, Answer]:
    """Enter a mode, or refuse it and keep the present one."""
    if mode is state.mode:
        return state, ACCEPTED
    if refusal := mode_refusal(mode, situation):
        return state, Answer(Verdict.TEMPORARILY_REJECTED, f"{mode.name} refused: {refusal}")
    if MODES[mode].heading_goals and situation.heading_rad is not None:
        # Keep the present heading: an old goal must not turn the boat unexpectedly.
        return replace(state, mode=mode, goal=HeadingGoal(situation.heading_rad)), ACCEPTED
    return replace(state, mode=mode, goal=None), ACCEPTED


def _set_mode(state: ModeState, intent: SetMode, situation: Situation, _t_s: float) -> tuple[ModeState, Answer]:
    try:
        mode = Mode(intent.mode)
    except ValueError:
        modes = ", ".join(f"{mode.name} {mode.value}" for mode in Mode)
        return state, Answer(Verdict.DENIED, f"Mode {intent.mode} is not known; there are {modes}")
    return enter(state, mode, situation)


def arming_refusal(situation: Situation) -> str:
    """Return the reason why arming is refused, empty if it is possible."""
    if situation.heading_rad is None:
        return "no valid heading"
    if not situation.rudder_ok:
        return "rudder servo not responding"
    if situation.fence_breached:
        return "outside the fence"
    return situation.fault


def _set_armed(state: ModeState, intent: Arm, situation: Situation, _t_s: float) -> tuple[ModeState, Answer]:
    refusal = arming_refusal(situation)
    if intent.armed and not intent.force and not state.armed and refusal:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, f"Arming refused: {refusal}")
    return replace(state, armed=intent.armed, bench=None if intent.armed else state.bench), ACCEPTED


def _enter_guided(state: ModeState, situation: Situation, *, change_mode: bool) -> tuple[ModeState, Answer]:
    if change_mode and state.mode is not Mode.GUIDED:
        return enter(state, Mode.GUIDED, situation)
    return state, ACCEPTED


def _steer_heading(
    state: ModeState, intent: SteerHeading, situation: Situation, _t_s: float
) -> tuple[ModeState, Answer]:
    if not math.isfinite(intent.heading_rad) or abs(intent.heading_rad) > 2.0 * TWO_PI:
        return state, Answer(Verdict.DENIED, "Heading goal is out of range")
    entered, answer = _enter_guided(state, situation, change_mode=intent.change_mode)
    if answer.verdict is not Verdict.ACCEPTED:
        return state, answer
    if not MODES[entered.mode].heading_goals:
        text = f"Heading goal refused in {state.mode.name}: enter {_HEADING_MODES} first"
        return state, Answer(Verdict.TEMPORARILY_REJECTED, text)
    if situation.heading_rad is None:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, "Heading goal refused: no valid heading")
    base_rad = situation.heading_rad if intent.relative else 0.0
    goal = HeadingGoal(wrap_two_pi(base_rad + intent.heading_rad), intent.over_ground and not intent.relative)
    return replace(entered, goal=replace(goal, turn=_forced_turn(goal, intent.turn, situation))), ACCEPTED


def _forced_turn(goal: HeadingGoal, turn: int, situation: Situation) -> int:
    """Return the direction to force, 0 if the shorter way is in this direction."""
    if turn == 0 or situation.heading_rad is None:
        return 0
    sign = 1 if turn > 0 else -1
    remaining_rad = wrap_two_pi(sign * (heading_to_steer(goal, situation.water) - situation.heading_rad))
    return sign if math.pi < remaining_rad < TWO_PI - ALREADY_THERE_RAD else 0


def heading_to_steer(goal: HeadingGoal, water: Water | None) -> float:
    """Return the heading for a goal; a course is steered as a heading while no current is known."""
    if not goal.over_ground or water is None:
        return goal.heading_rad
    return heading_in_water(goal.heading_rad, water)


def heading_in_water(course_rad: float, water: Water) -> float:
    """Return the heading for a course over ground in the estimated current."""
    return heading_for_course(
        course_rad, water.speed_m_s, water.current_north_m_s, water.current_east_m_s, water.leeway_rad
    )


def _steer_position(
    state: ModeState, intent: SteerPosition, situation: Situation, _t_s: float
) -> tuple[ModeState, Answer]:
    # Written so that NaN fails the comparison.
    if not (abs(intent.latitude_rad) <= 0.5 * math.pi and abs(intent.longitude_rad) <= math.pi):
        return state, Answer(Verdict.DENIED, "Position goal is out of range")
    entered, answer = _enter_guided(state, situation, change_mode=intent.change_mode)
    if answer.verdict is not Verdict.ACCEPTED:
        return state, answer
    if not MODES[entered.mode].position_goals:
        text = f"Position goal refused in {state.mode.name}: enter {_POSITION_MODES} first"
        return state, Answer(Verdict.TEMPORARILY_REJECTED, text)
    if not situation.is_position_known:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, "Position goal refused: no position")
    return replace(entered, goal=PositionGoal(intent.latitude_rad, intent.longitude_rad)), ACCEPTED


def _set_stick(state: ModeState, intent: ManualRudder, _situation: Situation, t_s: float) -> tuple[ModeState, Answer]:
    if intent.deflection is not None and not abs(intent.deflection) <= 1.0:
        return state, Answer(Verdict.DENIED, "Stick is out of range")
    return replace(state, stick=intent.deflection, stick_t_s=t_s), ACCEPTED


def _set_bench(state: ModeState, intent: BenchRudder, situation: Situation, t_s: float) -> tuple[ModeState, Answer]:
    # Written so that NaN fails the comparison.
    if not (abs(intent.deflection) <= 1.0 and 0.0 <= intent.seconds <= MAX_BENCH_S):
        return state, Answer(Verdict.DENIED, "Bench rudder is out of range")
    if state.armed:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, "Bench rudder refused: armed")
    if not situation.rudder_ok:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, "Bench rudder refused: rudder servo not responding")
    return replace(state, bench=intent.deflection, bench_until_s=t_s + intent.seconds), ACCEPTED


def _restart(state: ModeState, intent: Restart, _situation: Situation, _t_s: float) -> tuple[ModeState, Answer]:
    if state.armed and not intent.force:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, "Restart refused: armed")
    return state, ACCEPTED


def _forget_parameters(
    state: ModeState, _intent: ForgetParameters, _situation: Situation, _t_s: float
) -> tuple[ModeState, Answer]:
    if state.armed:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, "Reset of parameters refused: armed")
    return state, ACCEPTED


_HANDLERS: Mapping[type[Intent], Callable[..., tuple[ModeState, Answer]]] = {
    SetMode: _set_mode,
    Arm: _set_armed,
    SteerHeading: _steer_heading,
    SteerPosition: _steer_position,
    ManualRudder: _set_stick,
    BenchRudder: _set_bench,
    Restart: _restart,
    ForgetParameters: _forget_parameters,
}


def decide(state: ModeState, intent: Intent, situation: Situation, t_s: float) -> tuple[ModeState, Answer]:
    """Apply an intent that arrived at t_s; a refusal leaves the state unchanged."""
    handler = _HANDLERS.get(type(intent))
    if handler is None:
        return state, Answer(Verdict.UNSUPPORTED, f"{type(intent).__name__} is not supported yet")
    return handler(state, intent, situation, t_s)


def bench_deflection(state: ModeState, now_s: float) -> float | None:
    """Return the rudder deflection commanded on the bench, None without a valid command."""
    # The upper limit excludes a state restored from another process, whose clock differs.
    is_active = now_s < state.bench_until_s <= now_s + MAX_BENCH_S
    return state.bench if is_active and not state.armed else None


def stick_deflection(state: ModeState, now_s: float, timeout_s: float) -> float | None:
    """Return the deflection of the stick, None if it is released or too old."""
    if state.stick is None or now_s - state.stick_t_s > timeout_s:
        return None
    return state.stick
