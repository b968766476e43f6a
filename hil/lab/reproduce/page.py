"""Write reproduce.png, reproduce.html and reproduce.json: plots, page and results."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.reproduce.chain import Chain, Voyage
from hil.lab.reproduce.heading_test import GOAL_S, HeadingTest
from hil.lab.reproduce.results import EQUATIONS_TITLE, TABLE_2_TITLE, Results, table_2_cells, table_2_json
from hil.lab.reproduce.rows import MAX_ERROR_DEG, Row, Verdict, all_match
from hil.report import page
from hil.report.page import Cell
from hil.report.style import (
    BAND,
    COMMAND,
    COMPASS,
    GOAL,
    HULL,
    INK,
    add_headroom,
    add_legend,
    finish,
    name_panel,
    new_figure,
)

TITLE = "The paper's heading control test, identification and trials, on synthetic data"
SIZE_INCHES, PANEL_INCHES = (13.0, 14.0), (6.4, 3.0)
COLOURS = {"paper": GOAL, "tuned": HULL}
PLOTTED_STEP_S = 4.0  # time after a step of the goal

Panel = Callable[[Any], None]


def draw(chain: Chain, path: Path) -> None:
    """Write all panels as one PNG file."""
    figure = new_figure(TITLE, *SIZE_INCHES)
    panel_functions = list(_panels(chain).values())
    grid = figure.subplots(len(panel_functions) // 2, 2)
    for axes, panel in zip(grid.ravel(), panel_functions, strict=True):
        panel(axes)
        finish(axes)
    figure.savefig(path)


def panel_images(chain: Chain) -> list[tuple[bytes, str]]:
    """Return each panel as a separate PNG, for narrow screens, with its description."""
    images = []
    for description, panel in _panels(chain).items():
        figure = new_figure("", *PANEL_INCHES)
        axes = figure.subplots()
        panel(axes)
        finish(axes)
        png = io.BytesIO()
        figure.savefig(png, format="png")
        images.append((png.getvalue(), description))
    return images


def _panels(chain: Chain) -> dict[str, Panel]:
    """Return the functions that draw the panels, by description."""
    test = chain.test
    panel_functions: dict[str, Panel] = {
        "heading control test: heading measured and predicted": partial(_draw_prediction, test),
        "yaw rate measured and predicted, as in figure 6": partial(_draw_yaw_rate, test),
        "prediction error of the heading": partial(_draw_prediction_error, test),
        "distribution of the prediction error": partial(_draw_distribution, test),
        "rudder commanded and actual, as in figure 7": partial(_draw_two_goals, test),
        "rudder commanded and actual after a step of the goal": partial(_draw_rudder_step, test),
    }
    for sea in MAX_ERROR_DEG:
        voyages = [voyage for voyage in chain.voyages if voyage.scenario == sea]
        panel_functions[f"{sea}: heading"] = partial(_draw_headings, voyages)
        panel_functions[f"{sea}: error"] = partial(_draw_errors, voyages)
    return panel_functions


def _draw_prediction(test: HeadingTest, axes: Any) -> None:
    truth = test.validation_truth
    axes.plot(truth.time_s, truth.goal_rad * DEGREES_PER_RADIAN, color=INK, lw=1.0, ls="--", label="goal")
    axes.plot(test.time_s, test.measured_deg, color=COMPASS, lw=1.6, label="compass")
    axes.plot(test.time_s, test.predicted_deg, color=HULL, lw=1.0, label="predicted")
    name_panel(axes, "heading control test, part not used for the model", x="time, s", y="deg")
    add_headroom(axes)
    add_legend(axes, 3)


def _draw_yaw_rate(test: HeadingTest, axes: Any) -> None:
    axes.plot(test.time_s, test.measured_rate_deg_s, color=COMPASS, lw=1.6, label="measured")
    axes.plot(test.time_s, test.predicted_rate_deg_s, color=HULL, lw=1.0, label="predicted")
    name_panel(axes, "as figure 6: yaw rate measured and predicted", x="time, s", y="deg/s")
    add_headroom(axes)
    add_legend(axes, 2)


def _draw_prediction_error(test: HeadingTest, axes: Any) -> None:
    axes.axhspan(-10.0, 10.0, color=BAND, lw=0, label="the paper's ±10°")
    axes.plot(test.time_s, test.heading_error_deg, color=HULL, lw=0.7)
    axes.set_ylim(-15.0, 15.0)
    name_panel(axes, "predicted minus measured heading", x="time, s", y="deg")
    add_legend(axes)


def _draw_distribution(test: HeadingTest, axes: Any) -> None:
    error = test.heading_error_deg
    axes.hist(error, bins=np.linspace(-10.0, 10.0, 81), color=COMPASS)
    mean = float(np.mean(error))
    axes.axvline(mean, color=HULL, lw=1.4, label=f"mean {mean:+.2f}°")
    axes.axvline(-0.6, color=GOAL, lw=1.2, ls="--", label="the paper's mean -0.6°")
    name_panel(axes, "predicted minus measured heading: distribution", x="deg", y="samples")
    add_legend(axes)


def _draw_two_goals(test: HeadingTest, axes: Any) -> None:
    _draw_rudder(test, axes, 2.0 * GOAL_S)
    name_panel(axes, "as figure 7: rudder commanded and actual", x="time, s", y="deg")


def _draw_rudder_step(test: HeadingTest, axes: Any) -> None:
    _draw_rudder(test, axes, PLOTTED_STEP_S)
    name_panel(axes, f"as figure 7: the first {PLOTTED_STEP_S:g} s", x="time, s", y="deg")


def _draw_rudder(test: HeadingTest, axes: Any, seconds: float) -> None:
    truth = test.validation_truth
    rows = truth.time_s <= truth.time_s[0] + seconds
    for name, values, colour, width in (
        ("commanded", truth.rudder_command_rad, COMMAND, 3.0), ("actual", truth.rudder_rad, HULL, 1.0)
    ):  # fmt: skip
        axes.plot(truth.time_s[rows], values[rows] * DEGREES_PER_RADIAN, color=colour, lw=width, label=name)
    add_headroom(axes)
    add_legend(axes, 2)


def _draw_headings(voyages: list[Voyage], axes: Any) -> None:
    truth = voyages[0].truth
    axes.plot(truth.time_s, truth.goal_rad * DEGREES_PER_RADIAN, color=INK, lw=1.0, ls="--", label="goal")
    for voyage in voyages:
        heading_deg = voyage.truth.heading_low_rad * DEGREES_PER_RADIAN
        axes.plot(voyage.truth.time_s, heading_deg, color=COLOURS[voyage.gains], lw=1.2, label=f"{voyage.gains} gains")
    name_panel(axes, f"{voyages[0].scenario}: heading", x="time, s", y="deg")
    add_headroom(axes)
    add_legend(axes, 3)


def _draw_errors(voyages: list[Voyage], axes: Any) -> None:
    limit_deg = MAX_ERROR_DEG[voyages[0].scenario]
    axes.axhspan(-limit_deg, limit_deg, color=BAND, lw=0, label=f"the paper's ±{limit_deg:g}°")
    for voyage in voyages:
        truth = voyage.truth
        error_deg = (truth.heading_low_rad - truth.goal_rad) * DEGREES_PER_RADIAN
        error_deg[np.abs(error_deg) > 1.6 * limit_deg] = np.nan  # turns would overlap the legend
        axes.plot(truth.time_s, error_deg, color=COLOURS[voyage.gains], lw=0.9, label=f"{voyage.gains} gains")
    axes.set_ylim(-1.6 * limit_deg, 2.2 * limit_deg)
    name_panel(axes, f"{voyages[0].scenario}: heading minus goal", x="time, s", y="deg")
    add_legend(axes, 3)


COLUMNS = (Cell("quantity"), Cell("paper"), Cell("ours"), "")
CLASSES = {Verdict.MATCHES: "good", Verdict.MISSES: "bad"}
NO_WRAP = "words whole"  # class of cells without line breaks
SOURCE = "Wang et al., J. Cent. South Univ. 25(9):2131-2142 (2018), on synthetic tank data"


def write(chain: Chain, results: Results, out: Path) -> Path:
    """Write the files to `out`; return the path of the page."""
    html = out / "reproduce.html"
    draw(chain, out / "reproduce.png")
    html.write_text(_page(chain, results), encoding="utf-8")
    content = {
        "all_match": all_match(results.rows),
        "rows": [{**asdict(row), "verdict": row.verdict.value} for row in results.rows],
        "table_2": table_2_json(results.table_2),
        "equations": [asdict(equation) for equation in results.equations],
    }
    (out / "reproduce.json").write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return html


def _page(chain: Chain, results: Results) -> str:
    equations = []
    for equation in results.equations:
        equations += [page.heading(equation.title, 3), page.verbatim("\n".join(equation.lines))]
    return page.page(
        "The paper against ours",
        [
            page.paragraph(SOURCE, "lead"),
            page.table([COLUMNS, *map(_cells, results.rows)]),
            page.heading("Figures"),
            page.images(panel_images(chain)),
            page.heading(TABLE_2_TITLE),
            page.table(table_2_cells(results.table_2)),
            page.paragraph(results.table_2_note, "note"),
            page.heading(EQUATIONS_TITLE),
            *equations,
            page.bullets(results.equations_notes),
        ],
    )


def _cells(row: Row) -> tuple[Cell, ...]:
    verdict = Cell(row.verdict.value, CLASSES.get(row.verdict, "note"))
    return Cell(row.quantity, note=row.note), Cell(row.paper, NO_WRAP), Cell(row.ours, NO_WRAP), verdict
