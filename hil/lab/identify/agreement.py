"""Checks that the columns of a recording show one motion: leaves out frozen rows and a yaw rate of another scale."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.identify.mend import without_spikes
from hil.lab.identify.recording import LEAST_ROWS, Floats, Recording

LONG_STILL = 10.0  # times as long as a value usually stays the same
MOSTLY = 0.5  # of the rows: beyond, the column is left out instead of the rows
AS_BUSY = 0.5  # of its root mean square elsewhere: another column that shows that the motion went on
NEXT_STEPS = 2.0  # sensor steps within which the reading continues after a standstill, as at the end of a turn
COARSE_STEPS = 5.0  # sensor steps that the boat turns by elsewhere in the same time
DEGREES_SLOPE = 20.0  # a heading that turns this many times faster than the yaw rate is in degrees
WINDOWS = (1000, 300, 100, 30, 15)  # of a recording, over which the turns of both are compared
LEAST_WINDOWS = 10
CERTAIN, MATTERS = 4.0, 0.02  # standard errors; of the scale


def without_standstill(recording: Recording, warnings: list[str]) -> Recording:
    """Leave out the rows in which heading or yaw rate is frozen, or a column that is frozen in most rows."""
    frozen = np.zeros(recording.time_s.size, dtype=bool)
    for name, other in (("heading_rad", recording.yaw_rate_rad_s), ("yaw_rate_rad_s", recording.heading_rad)):
        values = getattr(recording, name)
        if values is None:
            continue
        if other is not None and np.ptp(values) == 0.0 < np.ptp(other):
            warnings.append(f"{recording.name}: {name} never changes: dead sensor; the column is left out")
            return _without(recording, name)
        if name == "heading_rad":
            rows = _frozen(np.unwrap(values), recording.rudder_rad, None if other is None else (other, other))
        elif other is None:
            rows = _frozen(values, recording.rudder_rad, None)
        else:
            # A coarse yaw rate stands still in a steady turn: only the heading can show that it should have changed.
            turning = np.gradient(np.unwrap(other), recording.time_s)
            apart = turning - values
            rows = _frozen(values, None, (apart - float(np.median(apart)), turning))
        if rows.any():
            most = other is not None and float(rows.mean()) > MOSTLY
            seconds = float(np.sum(np.diff(recording.time_s)[rows[1:]]))
            first = float(recording.time_s[int(np.argmax(rows))])
            warnings.append(
                f"{recording.name}: {name} stays exactly the same for {seconds:.0f} s (first from {first:.6g} s) "
                "while rudder or turning is as elsewhere: frozen sensor; "
                f"{'the column is' if most else 'those rows are'} left out"
            )
            if most:
                return without_standstill(_without(recording, name), warnings)
        frozen |= rows
    if not frozen.any():
        return recording
    if int(np.count_nonzero(~frozen)) < LEAST_ROWS:
        raise UsageError(
            f"{recording.name}: heading or yaw rate is frozen nearly throughout; repair the sensor, or empty its column"
        )
    return recording.rows(~frozen)


def _without(recording: Recording, name: str) -> Recording:
    return replace(recording, heading_rad=None) if name == "heading_rad" else replace(recording, yaw_rate_rad_s=None)


def _frozen(values: Floats, rudder: Floats | None, turning: tuple[Floats, Floats] | None) -> NDArray[np.bool_]:
    """Return in which rows values stay the same for long, although rudder or turning are as busy as elsewhere.

    rudder: None where it proves nothing. turning: of another sensor, as compared there and as compared elsewhere.
    """
    bounds = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1, [values.size]))
    lengths = np.diff(bounds)
    long = lengths > max(LEAST_ROWS, LONG_STILL * float(np.median(lengths)))
    frozen, moving = np.zeros(values.size, dtype=bool), np.repeat(~long, lengths)
    elsewhere = int(np.count_nonzero(moving))
    if not long.any() or elsewhere < LEAST_WINDOWS:
        return frozen
    steps = np.abs(np.diff(values)[np.diff(values) != 0.0])
    step, usual = (float(np.quantile(steps, share)) for share in (0.05, 0.5))  # the sensor's own, and with noise
    for number in np.flatnonzero(long).tolist():
        rows = slice(int(bounds[number]), int(bounds[number + 1]))
        width = max(min(int(lengths[number]), elsewhere // 4), 2)
        parts = values[moving][: elsewhere // width * width].reshape(-1, width)
        if float(np.quantile(np.ptp(parts, axis=1), 0.25)) <= COARSE_STEPS * step:
            continue
        # Digits that are cut off make the steps of a coarse sensor larger for larger headings.
        own = max(step, float(abs(values[rows.start] - values[max(rows.start - 1, 0)])), usual)
        goes_on = rows.stop < values.size and abs(values[rows.stop] - values[rows.start]) <= NEXT_STEPS * own
        turns = turning is not None and _rms(turning[0][rows]) > AS_BUSY * _rms(turning[1][moving])
        steered = rudder is not None and _rms(rudder[rows]) > AS_BUSY * _rms(rudder[moving])
        # A coarse compass may stand still while one turn ends and another begins, whatever the rudder does.
        frozen[rows] = turns or (steered and not goes_on)
    return frozen


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(values**2)))


def with_agreeing_rate(recording: Recording, warnings: list[str]) -> Recording:
    """Leave out a yaw rate of which the heading is not the integral, with a warning.

    Errors of the yaw rate make the heading's regression on it too small, those of the heading the opposite one too
    large: only what is beyond both counts.
    """
    if recording.heading_rad is None or recording.yaw_rate_rad_s is None:
        return recording
    psi, _ = without_spikes(np.unwrap(recording.heading_rad))
    rate = recording.yaw_rate_rad_s
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(recording.time_s))))
    found = [_slopes(recording.time_s, psi, turned, parts) for parts in WINDOWS if 2 * parts < psi.size]
    low, high = min((one for one in found if one is not None), key=lambda one: one[1] - one[0], default=(1.0, 1.0))
    scale = 0.5 * (low + high)
    if low <= 1.0 <= high or abs(scale - 1.0) < MATTERS or low <= 0.0 <= high:
        return recording
    doubt = "turns against" if high < 0.0 else f"turns {scale:.3g} times as far as the sum of"
    unit = "is one of them in degrees? " if low > DEGREES_SLOPE or 0.0 < high < 1.0 / DEGREES_SLOPE else ""
    warnings.append(
        f"{recording.name}: heading_rad {doubt} yaw_rate_rad_s; {unit}the heading is taken, and the yaw rate left out"
    )
    return replace(recording, yaw_rate_rad_s=None)


def _slopes(time_s: Floats, psi: Floats, turned: Floats, parts: int) -> tuple[float, float] | None:
    """Return bounds of the heading's turns over those of the yaw rate, allowing for a constant error of the latter."""
    cuts = np.linspace(0, time_s.size - 1, parts + 1).astype(int)
    spans, y, x = (np.diff(values[cuts]) for values in (time_s, psi, turned))
    whole = spans < 3.0 * float(np.median(spans))  # no gap in it
    spans, y, x = spans[whole], y[whole], x[whole]
    share = spans / float(spans @ spans)
    x, y = x - spans * float(share @ x), y - spans * float(share @ y)
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if spans.size < LEAST_WINDOWS or not xx * yy > 0.0 or xy == 0.0:
        return None
    rest = max(1.0 - xy * xy / (xx * yy), 0.0) / (spans.size - 2)
    near, far = xy / xx, yy / xy
    spread = CERTAIN * math.sqrt(rest * yy / xx)
    return min(near, far) - spread, max(near, far) + spread
