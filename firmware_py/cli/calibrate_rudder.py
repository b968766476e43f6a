"""`rambler calibrate rudder`: propose centre, limits and direction, on the bench or from logs."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import Any, Final

import msgspec

from firmware_py.cli.bench_session import BenchDevice, open_devices
from firmware_py.cli.errors import print_error
from firmware_py.cli.logged_ticks import track_parameters
from firmware_py.cli.preflight import parameters_in_force
from firmware_py.cli.state_owner import state_directory_of
from firmware_py.common.angles import degrees, radians, wrap_pi
from firmware_py.common.interfaces import Rudder
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DeviceState, RudderCommand
from firmware_py.control.rudder_limit import Linkage
from firmware_py.estimate.rudder_centre import MIN_SECTORS, MIN_STRETCHES, SECTORS, RudderCentreEstimator
from firmware_py.log.reader import LoggedTick
from firmware_py.system.clock import RealClock
from firmware_py.vehicle import VehicleError, load

INSUFFICIENT_DATA = 1
STEP_RAD: Final = radians(2.0)
STOP_ERROR_RAD: Final = radians(3.0)  # a larger error after settling means a mechanical stop
STOP_MARGIN_RAD: Final = radians(2.0)  # between RUD_LIMIT_DEG and a stop
MIN_LIMIT_RAD: Final = radians(5.0)
DEMONSTRATION_RAD: Final = radians(10.0)  # deflection whose direction the operator reports, at most the limit
MAX_SCALE_ERROR: Final = 0.1  # of measured over commanded angle
MAX_SETTLED_ERROR_RAD = radians(0.5)
MAX_SETTLING_S = 1.5  # per step
MAX_SILENCE_S = 3.0
POLL_INTERVAL_S, COMMAND_INTERVAL_S = 0.05, 0.1
_QUESTION = "seen from astern, did the trailing edge move to starboard? [y/n] "

_NO_ANGLE = (
    "this servo reports no angle while released: move the rudder amidships (DO_SET_SERVO), set that as centre "
    "(PREFLIGHT_CALIBRATION, param4 = 2), and run this without --amidships"
)

_NOT_MEASURED = "this servo measures no angle; set its pulses by hand: docs/how-to/hobby-servo.md"

Proposal = Mapping[str, float]


def estimate_centre(ticks: Iterable[LoggedTick]) -> tuple[RudderCentreEstimator, ParameterSet]:
    """Estimate the rudder centre from straight courses; return the estimator and the last parameters in force."""
    estimator, parameters = RudderCentreEstimator(), ParameterSet()
    for tick, parameters, armed in track_parameters(ticks):
        estimator.take(tick.inputs, Linkage.of(parameters).to_rudder, steers=armed and tick.command.torque_on)
    return estimator, parameters


def propose_from_logs(ticks: Iterable[LoggedTick]) -> tuple[Proposal, dict[str, Any], list[str]]:
    """Return the proposal, the values for JSON, and the lines to print."""
    estimator, parameters = estimate_centre(ticks)
    estimate, linkage = estimator.result(), Linkage.of(parameters)
    if estimate is None:
        return {}, {"ready": False, "stretches": 0, "unsteady": estimator.unsteady}, list(_insufficient_data(estimator))
    centre_deg = degrees(wrap_pi(linkage.centre_rad + linkage.sign * estimate.mean_rad))
    values = {
        "ready": estimate.ready,
        "stretches": estimate.stretches,
        "sectors": estimate.sectors,
        "unsteady": estimator.unsteady,
        "mean_deg": round(degrees(estimate.mean_rad), 3),
        "sd_deg": round(degrees(estimate.sd_rad), 3),
        "in_force_deg": {"RUD_CENTRE_DEG": parameters["RUD_CENTRE_DEG"]},
        "proposed_deg": {"RUD_CENTRE_DEG": round(centre_deg, 2)},
    }
    lines = [
        f"{estimate.stretches} straight stretches in {estimate.sectors} of {SECTORS} sectors",
        f"{estimator.unsteady} more rejected: waves or turns",
        f"mean rudder angle {degrees(estimate.mean_rad):.2f} deg, sd {degrees(estimate.sd_rad):.2f}",
        f"RUD_CENTRE_DEG  in force {parameters['RUD_CENTRE_DEG']:.2f}  proposed {centre_deg:.2f}",
    ]
    if not estimate.ready:
        return {}, values, [*lines, *_insufficient_data(estimator)]
    return {"RUD_CENTRE_DEG": round(centre_deg, 2)}, values, lines


def _insufficient_data(estimator: RudderCentreEstimator) -> Iterator[str]:
    yield (
        f"not enough data: {MIN_STRETCHES} stretches of 10 min in {MIN_SECTORS} of {SECTORS} sectors are needed, "
        f"armed and in calm water ({estimator.unsteady} rejected)"
    )


# ------------------------------------------------------------------ on the bench


class BenchError(RuntimeError):
    """The servo cannot be measured; the text names the remedy."""


class ServoFeedback(msgspec.Struct, frozen=True):
    """Angle and motor current after the shaft has settled."""

    shaft_rad: float
    current_a: float | None = None


# Move the shaft to an angle and wait; None: release it. Raises BenchError for a silent servo.
Move = Callable[[float | None], ServoFeedback]


@dataclass(slots=True)
class Sweep:
    """Sweep to one side: largest angle from the centre, whether a stop ended it, commanded and measured angles."""

    reached_rad: float = 0.0
    has_stop: bool = False
    pairs: list[tuple[float, float]] = field(default_factory=list)  # rad


def sweep(move: Move, centre_rad: float, side: float, max_rad: float, max_a: float) -> Sweep:
    """Step to one side (+1 or -1 of the shaft) up to a stop or max_rad, and return to the centre.

    A motor current above `max_a` counts as a stop; 0: no limit.
    """
    result = Sweep()
    for number in count(1):
        deflection_rad = number * STEP_RAD
        if deflection_rad > max_rad:
            break
        target_rad = centre_rad + side * deflection_rad
        measured = move(target_rad)
        overloaded = max_a > 0.0 and measured.current_a is not None and abs(measured.current_a) > max_a
        if overloaded or abs(measured.shaft_rad - target_rad) > STOP_ERROR_RAD:
            result.has_stop = True
            break
        result.pairs.append((target_rad, measured.shaft_rad))
        result.reached_rad = side * (measured.shaft_rad - centre_rad)
    move(centre_rad)
    return result


def fit_scale(pairs: list[tuple[float, float]]) -> float:
    """Return the slope of measured over commanded angle; raise BenchError for fewer than three pairs."""
    if len(pairs) < 3:
        raise BenchError("the shaft does not follow small steps; check that it is free, and the servo's supply")
    mean_x = sum(x for x, _ in pairs) / len(pairs)
    mean_y = sum(y for _, y in pairs) / len(pairs)
    return sum((x - mean_x) * (y - mean_y) for x, y in pairs) / sum((x - mean_x) ** 2 for x, _ in pairs)


def choose_limit_rad(sides: list[Sweep], present_limit_rad: float) -> float:
    """Return the nearer stop less a margin, at most the present limit.

    Raise BenchError for a stop near the centre.
    """
    stops = [side.reached_rad - STOP_MARGIN_RAD for side in sides if side.has_stop]
    if stops and min(stops) < MIN_LIMIT_RAD:
        raise BenchError(
            f"the shaft stops at {degrees(min(stops) + STOP_MARGIN_RAD):.1f} deg on one side: it sticks, or the centre "
            "is not amidships; free it, or turn the rudder amidships by hand and use --amidships"
        )
    return min([present_limit_rad, *stops])


class Bench:
    """The rudder servo without the control loop, in real time."""

    def __init__(self, device: BenchDevice, rudder: Rudder) -> None:
        """Store an open device and its driver."""
        self._device, self._rudder, self._clock = device, rudder, RealClock()
        self._last: ServoFeedback | None = None

    def release(self) -> ServoFeedback | None:
        """Release the shaft; return None if the servo runs but reports no angle while released."""
        try:
            return self.move(None)
        except BenchError:
            if self._rudder.health(self._clock.now_s()).state is DeviceState.RUNNING:
                return None
            raise

    def move(self, shaft_rad: float | None) -> ServoFeedback:
        """Move the shaft, or release it for None; wait until it settles or MAX_SETTLING_S per step ends.

        Raise BenchError for a silent servo.
        """
        start_s = feedback_s = self._clock.now_s()
        start_rad = None if self._last is None else self._last.shaft_rad
        next_command_s, steps = start_s, 1.0
        if shaft_rad is not None and start_rad is not None:
            steps += abs(shaft_rad - start_rad) / radians(2.0)
        has_feedback = False
        while True:
            now_s = self._clock.now_s()
            if now_s >= next_command_s:  # more frequent commands would delay the angle
                self._rudder.command(RudderCommand(shaft_rad or 0.0, torque_on=shaft_rad is not None), now_s)
                next_command_s = now_s + COMMAND_INTERVAL_S
            descriptor = self._rudder.fileno()
            self._clock.wait(now_s + POLL_INTERVAL_S, [descriptor] if descriptor >= 0 else [])
            now_s = self._clock.now_s()
            self._rudder.receive(now_s)
            for feedback in self._rudder.poll():
                has_feedback = True
                if feedback.shaft_rad is not None:
                    feedback_s, self._last = now_s, ServoFeedback(feedback.shaft_rad, feedback.current_a)
            if now_s - feedback_s > MAX_SILENCE_S:
                if has_feedback and shaft_rad is not None:
                    raise BenchError(f"{self._device.port}: {_NOT_MEASURED}")
                text = self._rudder.health(now_s).text
                raise BenchError(f"{self._device.port}: {text or 'no angle from the servo'}; check power and wiring")
            last, waited_s = self._last, now_s - start_s
            if last is None:
                continue
            is_settled = shaft_rad is None or abs(last.shaft_rad - shaft_rad) < MAX_SETTLED_ERROR_RAD
            is_new = waited_s > COMMAND_INTERVAL_S and feedback_s > start_s
            if (is_settled and is_new) or waited_s > MAX_SETTLING_S * steps:
                return last


def propose_on_bench(arguments: argparse.Namespace) -> tuple[Proposal, dict[str, Any], list[str]]:
    """Measure the rudder of a vehicle file; raise VehicleError or BenchError."""
    vehicle = load(arguments.file[0])
    directory = arguments.state or state_directory_of(arguments.file[0], vehicle)
    parameters = parameters_in_force(vehicle, directory, lambda _problem: None)
    (device,) = open_devices([("rudder", vehicle.rudder)])
    if device.line is None:
        raise BenchError(device.error)
    bench = Bench(device, device.driver)  # type: ignore[arg-type]
    try:
        return measure_rudder(bench, parameters, amidships=arguments.amidships, can_ask=sys.stdin.isatty())
    finally:
        with contextlib.suppress(BenchError):  # already reported
            bench.release()
        device.line.close()


def measure_rudder(
    bench: Bench, parameters: ParameterSet, *, amidships: bool, can_ask: bool
) -> tuple[Proposal, dict[str, Any], list[str]]:
    """Move the rudder in small steps; return the proposal, the values for JSON, and the lines to print.

    `amidships`: the rudder is amidships now; propose its angle as centre. `can_ask`: an operator is there to report
    the direction.
    """
    linkage = Linkage.of(parameters)
    initial = bench.release()
    if initial is None and amidships:
        raise BenchError(_NO_ANGLE)
    centre_rad = initial.shaft_rad if initial is not None and amidships else linkage.centre_rad
    print("the rudder moves now, in small steps", file=sys.stderr)
    present_limit_rad = radians(parameters["RUD_LIMIT_DEG"])
    max_rad = min(radians(TABLE[INDEX["RUD_LIMIT_DEG"]].maximum), present_limit_rad + radians(6.0))
    bench.move(centre_rad)
    sides = [sweep(bench.move, centre_rad, side, max_rad, parameters["RUD_AMP_MAX"]) for side in (1.0, -1.0)]
    scale = fit_scale([pair for side in sides for pair in side.pairs])
    if abs(scale - 1.0) > MAX_SCALE_ERROR:
        raise BenchError(f"the encoder moves {scale:.2f} of the command; check gear, mode and unit of the servo")
    proposed_rad = choose_limit_rad(sides, present_limit_rad)
    deflected_rad = centre_rad + min(DEMONSTRATION_RAD, proposed_rad)
    is_reversed = _ask_reversed(bench, deflected_rad, centre_rad) if can_ask else None
    proposed = {"RUD_LIMIT_DEG": round(degrees(proposed_rad), 1)}
    if amidships:
        proposed["RUD_CENTRE_DEG"] = round(degrees(wrap_pi(centre_rad)), 2)
    if is_reversed is not None:
        proposed["RUD_REVERSE"] = float(is_reversed)
    present = {name: parameters[name] for name in ("RUD_CENTRE_DEG", "RUD_LIMIT_DEG", "RUD_REVERSE")}
    values = {
        "ready": True,
        "scale": round(scale, 3),
        "reached_deg": [round(degrees(side.reached_rad), 1) for side in sides],
        "stopped": [side.has_stop for side in sides],
        "in_force_deg": present,
        "proposed_deg": proposed,
    }
    return proposed, values, list(_bench_lines(values))


def _ask_reversed(bench: Bench, deflected_rad: float, centre_rad: float) -> bool | None:
    """Deflect the rudder and ask whether it is reversed; return None without an answer."""
    bench.move(deflected_rad)
    answer = input(_QUESTION).strip().lower()[:1]
    bench.move(centre_rad)
    return None if answer not in ("y", "n") else answer == "n"


def _bench_lines(values: Mapping[str, Any]) -> Iterator[str]:
    for side, reached, has_stop in zip("+-", values["reached_deg"], values["stopped"], strict=True):
        yield f"shaft {side}: follows to {reached:.1f} deg{', mechanical stop' if has_stop else ''}"
    yield f"encoder moves {values['scale']:.2f} of the command"
    for name, value in values["in_force_deg"].items():
        proposed = values["proposed_deg"].get(name)
        yield f"{name:<15} in force {value:8.2f}  proposed {'       -' if proposed is None else f'{proposed:8.2f}'}"
    yield "for a centre, turn the rudder amidships by hand and use --amidships; for the direction, use a terminal"


def report(arguments: argparse.Namespace, ticks: Iterable[LoggedTick]) -> tuple[int, Proposal]:
    """Print the result; return the exit code and the proposal."""
    try:
        result = propose_on_bench(arguments) if arguments.file[0].suffix == ".toml" else propose_from_logs(ticks)
    except (VehicleError, BenchError) as error:
        return print_error("calibrate", str(error)), {}
    proposal, values, lines = result
    print(json.dumps(values) if arguments.json else "\n".join(lines))
    return (0 if proposal else INSUFFICIENT_DATA), proposal
