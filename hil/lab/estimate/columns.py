"""The table that `estimate --out` writes: a row for each heading, cells empty where something is not known."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping

import numpy as np

from firmware_py.common.angles import TWO_PI
from hil.lab.estimate.predictions import Prediction
from hil.lab.estimate.tick import COLUMNS, Watched
from hil.lab.identify.recording import Floats

ESTIMATED = COLUMNS[:-2]  # the command and the compass are not estimates
DIGITS = 9


def table_of(time_s: Floats, watched: Watched, predictions: Mapping[int, Prediction]) -> dict[str, Floats]:
    """Return the columns by name; time_s as the file has it."""
    table = {"time_s": time_s, **{name: watched.columns[name] for name in ESTIMATED}}
    for seconds, prediction in predictions.items():
        table[f"heading_in_{seconds}_s_rad"] = np.asarray(prediction.heading_rad % TWO_PI)
        table[f"heading_in_{seconds}_s_sd_rad"] = prediction.sd_rad
    return table


def as_csv(table: Mapping[str, Floats]) -> str:
    """Return the columns as text; times as exact as they were read."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    names = list(table)[1:]
    for time_s, *values in zip(table["time_s"].tolist(), *(table[name].tolist() for name in names), strict=True):
        writer.writerow((time_s, *(f"{value:.{DIGITS}g}" if math.isfinite(value) else "" for value in values)))
    return text.getvalue()
