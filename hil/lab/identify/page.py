"""The report of an identification as one self-contained HTML page."""

from __future__ import annotations

from hil.lab.identify.identify import Identification
from hil.lab.identify.verdict import IDENTIFIABLE, Estimate
from hil.report import page
from hil.report.page import Cell

UNITS = {"K": "1/s", "T": "s", "alpha": "s²", "delta0": "rad"}
COLUMNS = ("", "value", "standard error", "", Cell("verdict"), Cell("why"))


def page_of(result: Identification, text: str, picture: bytes, title: str) -> str:
    """Return the page: the table, the picture, and the report as on the terminal."""
    rows = [_row(name, estimate) for name, estimate in result.judgement.estimates.items()]
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


def _row(name: str, estimate: Estimate) -> tuple[str | Cell, ...]:
    verdict = Cell(estimate.verdict, "words good" if estimate.verdict == IDENTIFIABLE else "words bad")
    return (name, f"{estimate.value:.5g}", f"± {estimate.se:.2g}", UNITS[name], verdict, Cell(estimate.why))
