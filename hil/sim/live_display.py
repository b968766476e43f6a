"""The live display of a run on a terminal, drawn with rich."""

from __future__ import annotations

import math
import time
from types import TracebackType
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from firmware_py.common.angles import compass_degrees, degrees, wrap_pi
from hil.sim.display import Banner
from hil.sim.ground_station import GroundStation
from hil.sim.world import World

REFRESH_S = 0.2
ROSE_WIDTH = 61
ROSE_SPAN_DEG = 180.0
MAX_TEXTS = 4
MIN_SLACK_S = 0.02  # time for drawing
POINTS = {0: "N", 45: "NE", 90: "E", 135: "SE", 180: "S", 225: "SW", 270: "W", 315: "NW"}
HIGHLIGHT_SEVERITY = 4  # MAV_SEVERITY_WARNING and more severe texts


class LiveDisplay:
    """Draw the run at most five times a second, in the caller's thread."""

    def __init__(self, banner: Banner, world: World, station: GroundStation, console: Console) -> None:
        """Set the sources of the values; `update` draws on the console."""
        self._banner = banner
        self._world = world
        self._station = station
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._next_s = 0.0
        self._last_times_s: tuple[float, float] | None = None
        self._speed = math.nan

    def __enter__(self) -> Self:
        """Start drawing."""
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Remove the drawing."""
        self._live.stop()

    def update(self, slack_s: float = math.inf) -> None:
        """Draw the present state if an update is due and slack_s is enough for drawing."""
        now_s = time.monotonic()
        if now_s < self._next_s or slack_s < MIN_SLACK_S:
            return
        self._next_s = now_s + REFRESH_S
        self._measure_speed(now_s)
        self._live.update(self.make_panel(), refresh=True)

    def make_panel(self) -> RenderableType:
        """Return a panel with the present state."""
        world = self._world
        banner = self._banner
        body = Table.grid(padding=(0, 2))
        body.add_column(style="bold", min_width=8)
        body.add_column()
        heading_rad, goal_rad = world.heading_low_rad(), world.goal_rad()
        body.add_row("time", self._progress())
        body.add_row("", rose(degrees(heading_rad), None if goal_rad is None else degrees(goal_rad)))
        body.add_row("heading", _steering(heading_rad, goal_rad))
        body.add_row("rudder", self._rudder())
        body.add_row("mode", self._station.mode())
        body.add_row("loop", self._loop())
        body.add_row("links", Text(", ".join(banner.links) or "only the run's own"))
        for t_s, severity, text in list(self._station.texts)[-MAX_TEXTS:]:
            body.add_row("", Text(f"{t_s:7.1f} s  {text}", style="yellow" if severity <= HIGHLIGHT_SEVERITY else "dim"))
        return Panel(Group(body), title=banner.title, title_align="left", border_style="cyan", width=84)

    def _progress(self) -> RenderableType:
        now_s, end_s = self._world.now_s, self._banner.end_s
        row = Table.grid(padding=(0, 1))
        speed = "" if math.isnan(self._speed) else f"  {self._speed:.0f} x real time"
        row.add_row(ProgressBar(end_s, min(now_s, end_s), width=30), f"{now_s:.0f} of {end_s:.0f} s{speed}")
        return row

    def _rudder(self) -> str:
        command, measured = self._station.named_value("RUD_CMD"), self._station.named_value("RUDDER")
        return f"commanded {_signed(command)}   measured {_signed(measured)}"

    def _loop(self) -> str:
        skipped, late_ms = self._station.named_value("SKIPPED"), self._station.named_value("LATE_MS")
        texts = ["ticks skipped " + ("-" if skipped is None else f"{skipped:.0f}")]
        if self._banner.lockstep:
            texts.append("lockstep: no lateness")
        elif late_ms is not None:
            texts.append(f"last tick {late_ms:.2f} ms late")
        return "   ".join(texts)

    def _measure_speed(self, now_s: float) -> None:
        simulated_s = self._world.now_s
        if self._last_times_s is not None and now_s > self._last_times_s[0]:
            self._speed = (simulated_s - self._last_times_s[1]) / (now_s - self._last_times_s[0])
        self._last_times_s = (now_s, simulated_s)


def rose(heading_deg: float, goal_deg: float | None) -> Text:
    """Draw the compass rose around the heading, with the heading in the middle and a mark at the goal."""
    cells = []
    middle = ROSE_WIDTH // 2
    step_deg = ROSE_SPAN_DEG / (ROSE_WIDTH - 1)
    for column in range(ROSE_WIDTH):
        angle_deg = heading_deg + (column - middle) * step_deg
        mark = 45 * round(angle_deg / 45.0)
        cells.append(POINTS[mark % 360][0] if abs(angle_deg - mark) <= step_deg / 2.0 else "·")
        if cells[-1] != "·" and len(POINTS[mark % 360]) > 1:
            cells[-1] = "+"
    text = Text("".join(cells), style="dim")
    if goal_deg is not None:
        error_deg = degrees(wrap_pi(math.radians(goal_deg - heading_deg)))
        column = middle + round(max(-ROSE_SPAN_DEG / 2.0, min(ROSE_SPAN_DEG / 2.0, error_deg)) / step_deg)
        text = _replace_cell(text, column, "◆", "bold green")
    return _replace_cell(text, middle, "▲", "bold cyan")


def _replace_cell(text: Text, column: int, mark: str, style: str) -> Text:
    return text[:column] + Text(mark, style=style) + text[column + 1 :]


def _steering(heading_rad: float, goal_rad: float | None) -> str:
    texts = [f"{compass_degrees(heading_rad):5.1f}°"]
    if goal_rad is None:
        texts.append("no goal yet")
    else:
        error_deg = degrees(wrap_pi(heading_rad - goal_rad))
        texts += [f"goal {compass_degrees(goal_rad):5.1f}°", f"error {error_deg:+6.1f}°"]
    return "   ".join(texts)


def _signed(angle_deg: float | None) -> str:
    return "  -   " if angle_deg is None else f"{angle_deg:+6.1f}°"
