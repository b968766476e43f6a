"""The report of an identification as one self-contained HTML page."""

from __future__ import annotations

import base64
from html import escape

from hil.lab.identify.identify import Identification
from hil.lab.identify.verdict import IDENTIFIABLE

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #333b44; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2rem; } img { width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .3rem .9rem; border-bottom: 1px solid #dde3e8; }
th { color: #66717d; font-weight: 600; } td:first-child, td:last-child, th:last-child { text-align: left; }
.good { color: #1d7a46; } .bad { color: #b3402f; } pre { white-space: pre-wrap; font-size: .85rem; }
"""
UNITS = {"K": "1/s", "T": "s", "alpha": "s²", "delta0": "rad"}


def page(result: Identification, text: str, picture: bytes, title: str) -> str:
    """Return the page: the table, the picture, and the report as on the terminal."""
    image = base64.b64encode(picture).decode("ascii")
    rows = [
        f"<tr><td>{name}</td><td>{one.value:.5g}</td><td>± {one.se:.2g}</td><td>{UNITS[name]}</td>"
        f'<td class="{"good" if one.verdict == IDENTIFIABLE else "bad"}">{escape(one.verdict)}</td>'
        f"<td>{escape(one.why)}</td></tr>"
        for name, one in result.judgement.estimates.items()
    ]
    return "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            f"<title>{escape(title)}</title><style>{STYLE}</style></head><body><h1>{escape(title)}</h1>",
            "<table><tr><th></th><th>value</th><th>standard error</th><th></th><th>verdict</th><th>why</th></tr>",
            *rows,
            "</table>",
            "<h2>Measured and predicted</h2>",
            f'<img alt="heading, error, yaw rate and rudder" src="data:image/png;base64,{image}">',
            f"<h2>Report</h2><pre>{escape(text)}</pre></body></html>\n",
        ]
    )
