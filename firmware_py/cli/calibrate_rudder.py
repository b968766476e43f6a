"""`rambler calibrate rudder`: centre, limits and direction, on the bench or from logs; proposed, never set."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from firmware_py.cli.bench_session import BenchDevice, open_devices
from firmware_py.cli.logged import in_force
from firmware_py.cli.preflight import parameters_in_force
from firmware_py.cli.refusal import refused
from firmware_py.cli.rudder_bench import SCALE, SHOWN_RAD, BenchError, Measured, limit_rad, scale_of, sweep
from firmware_py.cli.state_owner import state_directory_of
from firmware_py.common.angles import degrees, radians, wrap_pi
from firmware_py.common.interfaces import Rudder
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DeviceState, RudderCommand
from firmware_py.control.rudder_limit import Linkage
from firmware_py.estimate.rudder_centre import ENOUGH_SECTORS, ENOUGH_STRETCHES, SECTORS, CentreWatch
from firmware_py.log.reader import LoggedTick
from firmware_py.system.clock import RealClock
from firmware_py.vehicle import VehicleError, load

NOT_ENOUGH = 1
SETTLED_RAD = radians(0.5)
SETTLING_S = 1.5  # for a step; the way back has as much for each step that it takes
SILENT_S = 3.0
POLL_S, COMMAND_S = 0.05, 0.1
_QUESTION = "seen from astern, has its trailing edge gone to starboard? [y/n] "

_NO_ANGLE = (
    "this servo tells no angle while it is let go: steer the rudder amidships (DO_SET_SERVO) and take that for its "
    "centre (PREFLIGHT_CALIBRATION, param4 = 2), without --amidships here"
)

Proposal = Mapping[str, float]


def centre_of(ticks: Iterable[LoggedTick]) -> tuple[CentreWatch, ParameterSet]:
    """Return what the rudder did on straight courses, and the parameters that were in force last."""
    watch, parameters = CentreWatch(), ParameterSet()
    for tick, parameters, armed in in_force(ticks):
        watch.take(tick.inputs, Linkage.of(parameters).to_rudder, steers=armed and tick.command.torque_on)
    return watch, parameters


def from_logs(ticks: Iterable[LoggedTick]) -> tuple[Proposal, dict[str, Any], list[str]]:
    """Return what is proposed, what is known, and lines for people."""
    watch, parameters = centre_of(ticks)
    found, linkage = watch.result(), Linkage.of(parameters)
    if found is None:
        return {}, {"ready": False, "stretches": 0, "unsteady": watch.unsteady}, list(_too_little(watch))
    centre_deg = degrees(wrap_pi(linkage.centre_rad + linkage.sign * found.mean_rad))
    values = {
        "ready": found.ready,
        "stretches": found.stretches,
        "sectors": found.sectors,
        "unsteady": watch.unsteady,
        "mean_deg": round(degrees(found.mean_rad), 3),
        "sd_deg": round(degrees(found.sd_rad), 3),
        "in_force_deg": {"RUD_CENTRE_DEG": parameters["RUD_CENTRE_DEG"]},
        "proposed_deg": {"RUD_CENTRE_DEG": round(centre_deg, 2)},
    }
    lines = [
        f"{found.stretches} straight stretches in {found.sectors} of {SECTORS} parts of the circle",
        f"{watch.unsteady} more were in waves, or turns",
        f"rudder on the mean {degrees(found.mean_rad):.2f} deg, sd {degrees(found.sd_rad):.2f}",
        f"RUD_CENTRE_DEG  in force {parameters['RUD_CENTRE_DEG']:.2f}  proposed {centre_deg:.2f}",
    ]
    if not found.ready:
        return {}, values, [*lines, *_too_little(watch)]
    return {"RUD_CENTRE_DEG": round(centre_deg, 2)}, values, lines


def _too_little(watch: CentreWatch) -> Iterator[str]:
    yield (
        f"not enough for a proposal: {ENOUGH_STRETCHES} stretches of ten minutes in {ENOUGH_SECTORS} of {SECTORS} "
        f"parts of the circle, in calm water, armed ({watch.unsteady} were too unsteady)"
    )


# ------------------------------------------------------------------ on the bench


class Bench:
    """The rudder's servo alone, in real time."""

    def __init__(self, device: BenchDevice, rudder: Rudder) -> None:
        """Take the opened device and its driver."""
        self._device, self._rudder, self._clock = device, rudder, RealClock()
        self._last: Measured | None = None

    def let_go(self) -> Measured | None:
        """Let the shaft go; None for a servo that answers, and tells no angle while it is not steered."""
        try:
            return self.move(None)
        except BenchError:
            if self._rudder.health(self._clock.now_s()).state is DeviceState.RUNNING:
                return None
            raise

    def move(self, shaft_rad: float | None) -> Measured:
        """Bring the shaft to an angle, or let it go, until it stands or has had its time; BenchError in silence."""
        begun_s = heard_s = self._clock.now_s()
        start_rad = None if self._last is None else self._last.shaft_rad
        due_s, steps = begun_s, 1.0
        if shaft_rad is not None and start_rad is not None:
            steps += abs(shaft_rad - start_rad) / radians(2.0)
        while True:
            now_s = self._clock.now_s()
            if now_s >= due_s:  # not more often: a goal goes before the question where the shaft stands
                self._rudder.command(RudderCommand(shaft_rad or 0.0, torque_on=shaft_rad is not None), now_s)
                due_s = now_s + COMMAND_S
            descriptor = self._rudder.fileno()
            self._clock.wait(now_s + POLL_S, [descriptor] if descriptor >= 0 else [])
            now_s = self._clock.now_s()
            self._rudder.receive(now_s)
            for feedback in self._rudder.poll():
                if feedback.shaft_rad is not None:
                    heard_s, self._last = now_s, Measured(feedback.shaft_rad, feedback.current_a)
            if now_s - heard_s > SILENT_S:
                text = self._rudder.health(now_s).text
                raise BenchError(f"{self._device.port}: {text or 'the servo gives no angle'}; check power and wiring")
            last, waited_s = self._last, now_s - begun_s
            if last is None:
                continue
            stands = shaft_rad is None or abs(last.shaft_rad - shaft_rad) < SETTLED_RAD
            if (stands and waited_s > COMMAND_S and heard_s > begun_s) or waited_s > SETTLING_S * steps:
                return last


def on_bench(arguments: argparse.Namespace) -> tuple[Proposal, dict[str, Any], list[str]]:
    """Move the rudder by small steps to either side; VehicleError, BenchError."""
    vehicle = load(arguments.file[0])
    directory = arguments.state or state_directory_of(arguments.file[0], vehicle)
    parameters = parameters_in_force(vehicle, directory, lambda _problem: None)
    (device,) = open_devices([("rudder", vehicle.rudder)])
    if device.driver is None or device.line is None:
        raise BenchError(device.error)
    bench = Bench(device, device.driver)  # type: ignore[arg-type]
    try:
        return examine(bench, parameters, amidships=arguments.amidships, asks=sys.stdin.isatty())
    finally:
        with contextlib.suppress(BenchError):  # which is told already
            bench.let_go()
        device.line.close()


def examine(
    bench: Bench, parameters: ParameterSet, *, amidships: bool, asks: bool
) -> tuple[Proposal, dict[str, Any], list[str]]:
    """Return what is proposed, what was seen, and lines for people; `amidships`: it has been laid so by hand."""
    linkage = Linkage.of(parameters)
    at_first = bench.let_go()
    if at_first is None and amidships:
        raise BenchError(_NO_ANGLE)
    centre_rad = at_first.shaft_rad if at_first is not None and amidships else linkage.centre_rad
    print("the rudder moves now, by small steps", file=sys.stderr)
    largest_rad = radians(parameters["RUD_LIMIT_DEG"])
    farthest_rad = min(radians(TABLE[INDEX["RUD_LIMIT_DEG"]].maximum), largest_rad + radians(6.0))
    bench.move(centre_rad)
    sides = [sweep(bench.move, centre_rad, side, farthest_rad, parameters["RUD_AMP_MAX"]) for side in (1.0, -1.0)]
    scale = scale_of([pair for side in sides for pair in side.pairs])
    if abs(scale - 1.0) > SCALE:
        raise BenchError(
            f"the encoder moves {scale:.2f} of what is commanded: gear, mode or unit of the servo is wrong"
        )
    most_rad = limit_rad(sides, largest_rad)
    reverse = _reverse(bench, centre_rad + min(SHOWN_RAD, most_rad), centre_rad) if asks else None
    proposed = {"RUD_LIMIT_DEG": round(degrees(most_rad), 1)}
    if amidships:
        proposed["RUD_CENTRE_DEG"] = round(degrees(wrap_pi(centre_rad)), 2)
    if reverse is not None:
        proposed["RUD_REVERSE"] = float(reverse)
    in_force = {name: parameters[name] for name in ("RUD_CENTRE_DEG", "RUD_LIMIT_DEG", "RUD_REVERSE")}
    values = {
        "ready": True,
        "scale": round(scale, 3),
        "reached_deg": [round(degrees(side.reached_rad), 1) for side in sides],
        "stopped": [side.stopped for side in sides],
        "in_force_deg": in_force,
        "proposed_deg": proposed,
    }
    return proposed, values, list(_bench_lines(values))


def _reverse(bench: Bench, shown_rad: float, centre_rad: float) -> bool | None:
    """Show a deflection of the shaft and ask which way the rudder went; None when that is not answered."""
    bench.move(shown_rad)
    answer = input(_QUESTION).strip().lower()[:1]
    bench.move(centre_rad)
    return None if answer not in ("y", "n") else answer == "n"


def _bench_lines(values: Mapping[str, Any]) -> Iterator[str]:
    for side, reached, stopped in zip("+-", values["reached_deg"], values["stopped"], strict=True):
        yield f"shaft {side}: follows to {reached:.1f} deg{', a stop ends it there' if stopped else ''}"
    yield f"the encoder moves {values['scale']:.2f} of what is commanded"
    for name, value in values["in_force_deg"].items():
        proposed = values["proposed_deg"].get(name)
        yield f"{name:<15} in force {value:8.2f}  proposed {'       -' if proposed is None else f'{proposed:8.2f}'}"
    yield "a centre is proposed with --amidships, the rudder laid so by hand; a direction at a terminal, by your eyes"


def report(arguments: argparse.Namespace, ticks: Iterable[LoggedTick]) -> tuple[int, Proposal]:
    """Print what is found; return the exit code and the proposal."""
    try:
        found = on_bench(arguments) if arguments.file[0].suffix == ".toml" else from_logs(ticks)
    except (VehicleError, BenchError) as error:
        return refused("calibrate", str(error)), {}
    proposal, values, lines = found
    print(json.dumps(values) if arguments.json else "\n".join(lines))
    return (0 if proposal else NOT_ENOUGH), proposal
