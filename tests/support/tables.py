"""Columns of a manoeuvre, their times in several forms, and the text of a table."""

from datetime import UTC, datetime, timedelta

import numpy as np

DEGREE, KNOT = np.pi / 180.0, 1852.0 / 3600.0
ROWS = 200
TIME = np.arange(ROWS) * 0.5
RUDDER = np.where((np.arange(ROWS) // 20) % 2, 0.3, -0.3)
HEADING = 1.0 + 0.2 * np.sin(TIME / 5.0)
RATE = 0.04 * np.cos(TIME / 5.0)
SPEED = np.full(ROWS, 0.5)


def table(header, columns, separator=",", decimal="."):
    rows = zip(*columns, strict=True)
    texts = [[cell if isinstance(cell, str) else f"{cell:.7f}".replace(".", decimal) for cell in row] for row in rows]
    return "\n".join([header, *(separator.join(row) for row in texts)]) + "\n"


# Columns in degrees, degrees per second and knots, and in SI units.
DEGREES = (TIME, RUDDER / DEGREE, HEADING / DEGREE, RATE / DEGREE, SPEED / KNOT)
PLAIN = (TIME, RUDDER, HEADING, RATE, SPEED)
MIDNIGHT = datetime(2024, 5, 1, 23, 59, 50, tzinfo=UTC)
ISO = [(MIDNIGHT + timedelta(seconds=seconds)).isoformat() for seconds in TIME.tolist()]
CLOCK = [f"10:0{n // 120}:{n % 120 / 2:04.1f}" for n in range(ROWS)]
