"""`rambler-hil identify`: identify K, T, alpha and delta0 from manoeuvres and onboard logs."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Self

from firmware_py.log.open_file import open_buffer
from hil.cli import outputs
from hil.errors import UsageError
from hil.lab.compiled import being_compiled
from hil.lab.identify import ardupilot_log, manoeuvre_file, nmea_capture, onboard_log, report
from hil.lab.identify.identify import MODELS, SPEEDS, Identification, identify
from hil.lab.identify.manoeuvre_file import RUDDER_UNITS
from hil.lab.identify.recording import Recording, Source

MAX_SEED = 2**63 - 1
PROGRESS_INTERVAL_S = 0.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    files = (
        "manoeuvre table, NMEA 0183 capture or .BIN log of Rambler or ArduPilot; FILE:from:to selects the part between "
        "two times in seconds"
    )
    parser.add_argument("train", metavar="FILE[:from:to]", nargs="+", help=files)
    parser.add_argument(
        "--validate",
        metavar="FILE[:from:to]",
        nargs="+",
        action="extend",
        default=[],
        help="recordings that are only predicted, not fitted",
    )
    parser.add_argument(
        "--model", choices=MODELS, default="auto", help="linear: without Norrbin's cubic term; auto: same as cubic"
    )
    parser.add_argument(
        "--speed-scaling",
        choices=SPEEDS,
        default="auto",
        help="scaled: the model follows the measured speed by similarity; auto: with an estimated exponent",
    )
    parser.add_argument(
        "--rudder-unit",
        choices=RUDDER_UNITS,
        default="rad",
        help="unit of the rudder column of a table; any: a signed command that is not an angle",
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="accepted for scripts; the fit uses no random numbers"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result as JSON (-: standard output)")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write a plot (.png) or a page (.html)")
    parser.add_argument(
        "--out-params", type=Path, metavar="FILE", help="write the model as parameters of the autopilot"
    )


def run(arguments: argparse.Namespace) -> int:
    """Identify, print the report and write the files; return 1 if the rudder has no effect in the logs."""
    if not 0 <= arguments.seed <= MAX_SEED:
        raise UsageError(f"--seed {arguments.seed}: give a whole number from 0 up")
    if arguments.plot is not None and arguments.plot.suffix.lower() not in (".png", ".html"):
        raise UsageError(f"--plot {arguments.plot}: give a name that ends in .png or .html")
    to_stdout = arguments.json is not None and str(arguments.json) == "-"
    outputs.check("--json", None if to_stdout else arguments.json)
    outputs.check("--plot", arguments.plot)
    outputs.check("--out-params", arguments.out_params)
    sources = [Source.parse(text) for text in (*arguments.train, *arguments.validate)]
    is_angle = arguments.rudder_unit != "any"
    start_s = time.monotonic()
    recordings = _read(sources, arguments.rudder_unit)
    train, validate = recordings[: len(arguments.train)], recordings[len(arguments.train) :]
    with _Progress() as progress:
        result = identify(
            train,
            validate,
            model=arguments.model,
            speed=arguments.speed_scaling,
            is_angle=is_angle,
            report=progress.report,
        )
    seconds = time.monotonic() - start_s
    text = report.as_text(result, is_angle=is_angle)
    if arguments.json is not None:
        data = report.as_json(result, seconds)
        sys.stdout.write(data) if to_stdout else outputs.write("--json", arguments.json, data)
    if not to_stdout:
        print(text)
        print(f"identified in {seconds:.2f} s")
    if arguments.plot is not None:
        outputs.write("--plot", arguments.plot, _draw_plot(result, text, arguments, is_angle=is_angle))
    if not result.judgement.is_usable:
        print("rambler-hil: no model: the logs show no effect of the rudder; see the verdicts", file=sys.stderr)
        return 1
    if arguments.out_params is not None:
        outputs.write("--out-params", arguments.out_params, report.as_parameters(result, arguments.rudder_unit))
    return 0


def _read(sources: Sequence[Source], unit: str) -> list[Recording]:
    """Read each file once, even if several parts of it are used."""
    recordings: dict[Path, Recording] = {}
    for source in sources:
        if source.path not in recordings:
            recordings[source.path] = _read_file(source.path, unit)
    return [recordings[source.path].part(source) for source in sources]


def _read_file(path: Path, unit: str) -> Recording:
    """Read a file according to its type."""
    name = path.name.lower()
    if name.removesuffix(".gz").endswith(".bin"):
        return _read_log(path)
    if name.endswith((".tlog", ".rlog")):
        raise UsageError(
            f"{path}: MAVLink telemetry log; give the onboard .BIN log, or convert it to a table: "
            "mavlogdump.py --format csv --types ATTITUDE,SERVO_OUTPUT_RAW,VFR_HUD"
        )
    if nmea_capture.is_capture(path):
        return nmea_capture.read(path)
    return manoeuvre_file.read(path, unit)


def _read_log(path: Path) -> Recording:
    """Read a log of Rambler or of ArduPilot."""
    try:
        with open_buffer(path) as data:
            if ardupilot_log.is_ardupilot_log(data):
                return ardupilot_log.read(path, data)
    except OSError:  # the other reader reports the error
        pass
    return onboard_log.read(path)


def _is_html(path: Path) -> bool:
    return path.suffix.lower() == ".html"


def _draw_plot(result: Identification, text: str, arguments: argparse.Namespace, *, is_angle: bool) -> bytes:
    from hil.lab.identify.page import draw, page_of  # noqa: PLC0415 - matplotlib is slow to import

    train = replace(result.train, file=", ".join(Path(name).name for name in arguments.train)[:60])
    model = result.model()
    gain = f"K {model.turning_ability_1_s:.4g}" + " 1/s" * is_angle
    other_parameters = f"T {model.turning_lag_s:.4g} s, alpha {model.norrbin_s2:.3g} s² ({result.name})"
    title = f"{gain}, {other_parameters}"
    image = draw((train, *result.validate), title, is_angle=is_angle)
    page_title = "Identification: " + title
    return page_of(result, text, image, page_title, is_angle=is_angle).encode() if _is_html(arguments.plot) else image


class _Progress:
    """A progress line on a terminal; nothing in a pipe."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._start_s = self._last_s = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

    def report(self) -> None:
        """Show the time so far."""
        now_s = time.monotonic()
        if self._is_terminal and not being_compiled() and now_s - self._last_s >= PROGRESS_INTERVAL_S:
            self._last_s = now_s
            sys.stderr.write(f"\r\x1b[Kidentifying ... {now_s - self._start_s:.1f} s")
            sys.stderr.flush()
