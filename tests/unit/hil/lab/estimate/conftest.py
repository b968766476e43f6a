"""A recorded sea, and the command `rambler-hil estimate` over tables and logs."""

import csv
import json

import numpy as np
import pytest

from hil.__main__ import main
from support.recorded_sea import sea, text_of

SHIP = "K=0.049,T=4,alpha=0,speed=0.5"


@pytest.fixture(scope="session")
def recording():
    return sea()


@pytest.fixture(scope="session")
def estimate(tmp_path_factory):
    """Return a function that runs the command over columns and returns the columns of its CSV and its JSON."""

    def run(columns, *arguments):
        folder = tmp_path_factory.mktemp("estimate")
        table, out, summary = (folder / name for name in ("table.csv", "out.csv", "out.json"))
        if isinstance(columns, bytes):
            table = table.with_suffix(".BIN")
            table.write_bytes(columns)
        else:
            table.write_text(columns if isinstance(columns, str) else text_of(columns))
        ship = () if "--ship" in arguments or "--params" in arguments else ("--ship", SHIP)
        assert main(["estimate", str(table), *ship, "--out", str(out), "--json", str(summary), *arguments]) == 0
        with out.open() as file:
            rows = list(csv.DictReader(file))
        columns = {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}
        return columns, json.loads(summary.read_text())

    return run


@pytest.fixture(scope="session")
def whole_estimate(recording, estimate):
    """Return the estimate over the whole recording."""
    return estimate(recording.columns)
