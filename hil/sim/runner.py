"""One run: the autopilot as a child process, connected to the simulated sea."""

from __future__ import annotations

import contextlib
import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hil.devices.emulator import Emulator
from hil.devices.pty_line import PtyLine
from hil.devices.vedirect import VeDirectEmulator
from hil.errors import HilError
from hil.ship import disturbance_options
from hil.ship.noise import Stream, generator
from hil.ship.power_plant import PowerPlant, energy_figures
from hil.ship.traffic import ClosestApproaches
from hil.sim import directory_modem
from hil.sim.board import Board
from hil.sim.device_factory import make_emulators
from hil.sim.display import Banner, Display, NoDisplay, make_display
from hil.sim.ground_station import GroundStation
from hil.sim.lockstep import LockstepError, LockstepServer
from hil.sim.logbook import Logbook, RunOptions, recorded_run
from hil.sim.pace import Pacer
from hil.sim.process import SHUT_DOWN_CODE, AutopilotProcess
from hil.sim.realtime import RealTimeServer
from hil.sim.reserved_cores import reserved_cores
from hil.sim.run_directory import FIRMWARE_LOG, STATE, VEHICLE_NAME
from hil.sim.run_file import OrderRecord
from hil.sim.signals import interruptible, stop_signal_handler
from hil.sim.truth import TruthFile
from hil.sim.vehicle_file import file_text
from hil.sim.view_page import ViewPage
from hil.sim.world import START_UTC_S

END_TIMEOUT_S = 15.0  # the autopilot centres the rudder and closes its log
POLL_S = 0.03  # after such a pause the tick is complete and there is time to draw
CHECK_S = 1.0


@dataclass(frozen=True, slots=True)
class Run:
    """A completed run: its directory, the truth, and the latest texts: time, severity, text."""

    out: Path
    truth: TruthFile
    texts: tuple[tuple[float, int, str], ...]


def run(options: RunOptions) -> Run:
    """Make a run in its directory, which the caller has locked; raise HilError if it fails.

    truth.csv is written during the run, run.json at its start and at its end, also after a failure.
    """
    # In real time a receiver with another date than the computer would be a fault.
    with recorded_run(options, START_UTC_S if options.lockstep else time.time()) as book:
        station = GroundStation(options.goals, options.mode, shared=options.play or bool(options.links))
        station.is_silent = options.play and not station.orders  # the operator steers
        devices: dict[str, Emulator] = {**make_emulators(book.world, options.vehicle, options.seed), "link": station}
        if (modem := directory_modem.make_modem(options.links, generator(options.seed, Stream.SATELLITE))) is not None:
            devices[directory_modem.PORT] = modem
        try:
            _simulate(options, book, station, devices)
        finally:
            book.truth.close()  # before it is read
            power = devices.get("power") or devices.get("power_b")
            plant = power.plant if isinstance(power, VeDirectEmulator) else None
            book.vessels = _closest_approaches(book)
            book.supply = energy_figures(plant) if isinstance(plant, PowerPlant) else None
            book.orders, book.arrivals = tuple(map(OrderRecord.of, station.orders)), tuple(station.reached)
    return Run(options.out, book.truth, tuple(station.texts))


def _closest_approaches(book: Logbook) -> list[dict[str, float | str]] | None:
    """Return the closest approach of each ship, or None without other ships."""
    if not book.world.ships:
        return None
    closest = ClosestApproaches(book.world.ships)
    for piece in book.truth:  # one row a second
        closest.add(piece.time_s[::10], piece.north_m[::10], piece.east_m[::10])
    return closest.figures()


def _simulate(options: RunOptions, book: Logbook, station: GroundStation, devices: dict[str, Emulator]) -> None:
    send = PtyLine.post if options.lockstep else PtyLine.write
    with (
        interruptible(),
        tempfile.TemporaryDirectory(prefix="rambler-") as directory,
        Board(book.world, devices, Path(directory), send) as board,
    ):
        book.wall_s = _Run(options, board, station, Path(directory), book.begin).make()
    if station.skip_text:
        print(f"rambler-hil: {station.skip_text}", file=sys.stderr)
    if not options.play:
        _check_orders(station, options.out)


def _check_orders(station: GroundStation, out: Path) -> None:
    if failure := station.final_failure():
        raise HilError(f"{failure}; see {out / FIRMWARE_LOG}")


class _Run:
    """A run in progress."""

    def __init__(
        self, options: RunOptions, board: Board, station: GroundStation, directory: Path, begin: Callable[[], None]
    ) -> None:
        self._options = options
        self._begin = begin
        self._board = board
        self._station = station
        self._socket_path = directory / "clock"
        self._next_check_s = 0.0
        self._is_stopped: Callable[[], bool] = lambda: False

    def make(self) -> float:
        """Run to the end; return the duration in seconds without the start of the autopilot."""
        options = self._options
        vehicle_path = options.out / VEHICLE_NAME
        text = file_text(options.vehicle, self._board.paths(), options.settings)
        vehicle_path.write_text(text, encoding="utf-8")
        arguments = ["run", str(vehicle_path), "--state", str(options.out / STATE)]
        for url in options.links:
            arguments += [
                "--link",
                directory_modem.link_to_port(url, str(self._board.paths().get(directory_modem.PORT))),
            ]
        display: Display = NoDisplay()
        if options.live_display:
            display = make_display(self._banner(), self._board.world, self._station)
        with contextlib.ExitStack() as stack:
            if options.view is not None:
                page = ViewPage(options.view, options.out / STATE, self._banner(), self._board.world, display)
                stack.callback(page.close)
                display = page
                arguments.append("--status")
            if options.play:
                self._is_stopped = stack.enter_context(stop_signal_handler())
            if options.lockstep:
                return self._in_lockstep([*arguments, "--lockstep", str(self._socket_path)], display)
            return self._in_real_time(arguments, display)

    def _banner(self) -> Banner:
        options = self._options
        compass, servo = options.vehicle.compass.driver, options.vehicle.rudder.driver
        if (second := options.vehicle.compass_b) is not None:
            compass = f"{compass} with {second.driver}"
        options_text = disturbance_options.text_of(options.scenario.disturbances)
        sea = f"{options.scenario.name} with {options_text}" if options_text else options.scenario.name
        title = f"rambler-hil run {sea}: compass {compass}, servo {servo}, seed {options.seed}"
        return Banner(title, options.seconds, options.links, options.lockstep)

    def _in_lockstep(self, arguments: list[str], display: Display) -> float:
        speed = self._options.speed
        pacer = Pacer(math.inf if speed is None else speed)
        log_path = self._options.out / FIRMWARE_LOG
        with (
            reserved_cores(self._options.cores) as cores,
            LockstepServer(self._socket_path, self._board, pacer, cores=cores) as server,
            AutopilotProcess(arguments, log_path) as autopilot,
        ):
            try:
                server.accept(autopilot.running, START_UTC_S)
                self._begin()
                start_s = time.monotonic()
                with display:
                    while self._is_under_way():
                        if not server.serve(self._options.seconds) and not self._accept_restart(server, autopilot):
                            break
                        display.update()
                wall_s = time.monotonic() - start_s
                autopilot.terminate()
                deadline_s = time.monotonic() + END_TIMEOUT_S
                while time.monotonic() < deadline_s and server.serve(paced=False):
                    pass
            except LockstepError as error:
                raise HilError(_with_last_output(str(error), autopilot)) from None
            finally:
                # Closing the clock ends an autopilot that waits for it.
                server.close()
            self._check_end(autopilot)
        return wall_s

    def _accept_restart(self, server: LockstepServer, autopilot: AutopilotProcess) -> bool:
        """Accept an autopilot that restarts in the same process; return False if it has ended."""
        try:
            server.accept(autopilot.running, self._board.world.utc_s())
        except LockstepError:
            if autopilot.running():
                raise
            self._check_early_end(autopilot)
            return False
        return True

    def _in_real_time(self, arguments: list[str], display: Display) -> float:
        has_begun = False
        with (
            AutopilotProcess(arguments, self._options.out / FIRMWARE_LOG) as autopilot,
            contextlib.ExitStack() as display_stack,
        ):
            server = RealTimeServer(self._board)
            while self._is_under_way():
                slack_s = server.serve(min(self._options.seconds, server.now_s() + POLL_S))
                if not has_begun and self._station.heartbeat is not None:
                    has_begun = True
                    self._begin()
                    display_stack.enter_context(display)
                if not autopilot.running():
                    self._check_early_end(autopilot)
                    break
                if has_begun:
                    display.update(slack_s)
            wall_s = server.now_s()
            autopilot.terminate()
            while autopilot.running() and server.now_s() < wall_s + END_TIMEOUT_S:
                server.serve(server.now_s() + POLL_S)
            self._check_end(autopilot)
        return wall_s

    def _is_under_way(self) -> bool:
        now_s = self._board.world.now_s
        if self._options.play:
            return now_s < self._options.seconds and not self._is_stopped()
        if now_s >= self._next_check_s:
            self._next_check_s = now_s + CHECK_S
            if failure := self._station.failure(now_s):
                raise HilError(f"{failure}; see {self._options.out / FIRMWARE_LOG}")
        return now_s < self._options.seconds

    def _check_early_end(self, autopilot: AutopilotProcess) -> None:
        """Raise HilError because the autopilot has ended early, unless the operator has shut it down with --play."""
        autopilot.wait(END_TIMEOUT_S)
        code = autopilot.exit_code()
        if not (self._options.play and code == SHUT_DOWN_CODE):
            reason = ": a ground station has shut it down" if code == SHUT_DOWN_CODE else ""
            raise HilError(_with_last_output(f"the autopilot ended early, exit code {code}{reason}", autopilot))
        print("rambler-hil: a ground station has shut down the autopilot; end of the run", file=sys.stderr)

    def _check_end(self, autopilot: AutopilotProcess) -> None:
        if not autopilot.wait(END_TIMEOUT_S):
            raise HilError(
                _with_last_output(f"the autopilot did not end within {END_TIMEOUT_S:g} s of SIGTERM", autopilot)
            )
        code = autopilot.exit_code()
        if code != 0 and not (self._options.play and code == SHUT_DOWN_CODE):
            raise HilError(_with_last_output(f"the autopilot ended with exit code {code}", autopilot))


def _with_last_output(text: str, autopilot: AutopilotProcess) -> str:
    output = autopilot.last_output()
    return f"{text}; its last output: {output}" if output else text
