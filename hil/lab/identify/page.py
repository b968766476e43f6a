"""The report of an identification as one self-contained HTML page."""

from __future__ import annotations

from hil.lab.identify.identify import Identification
from hil.lab.identify.report import figures
from hil.lab.identify.verdict import IDENTIFIABLE, Estimate
from hil.report import page
from hil.report.page import Cell

COLUMNS = ("", "value", "95 % interval", Cell("verdict"))


def page_of(result: Identification, text: str, picture: bytes, title: str, *, angular: bool) -> str:
    """Return the page: table, picture, and the report of the terminal; angular: the rudder column is an angle."""
    rows = [_row(name, estimate, angular=angular) for name, estimate in result.judgement.estimates.items()]
    return page.page(
        title,
        [
            page.table([COLUMNS, *rows]),
            page.heading("Measured and predicted"),
            page.image(picture, "heading, error, yaw rate and rudder"),
            page.heading("Report"),
            page.verbatim(text),
        ],
    )


def _row(name: str, estimate: Estimate, *, angular: bool) -> tuple[str | Cell, ...]:
    value, interval, unit = figures(name, estimate, angular=angular)
    kind = "words good" if estimate.verdict == IDENTIFIABLE else "words bad"
    shown = f"{value} {unit.replace('^2', '²')}".rstrip()
    return (name, shown, interval, Cell(estimate.verdict, kind, estimate.why))
