"""Parameters for a recording: those of the boat, without failsafe actions and without repeated corrections."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from firmware_py.common.parameter_row import ParameterError, to_single
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet, parse_file
from firmware_py.files.reading import read_text
from hil.errors import UsageError
from hil.lab.estimate.recording import Recording

SHIP_PARAMETERS: Final = {"K": "MDL_K", "T": "MDL_T_S", "alpha": "MDL_ALPHA_S2", "speed": "MDL_SPEED"}
MAX_BYTES: Final = 1 << 20
MIN_SPEED_M_S, MAX_SPEED_M_S = 0.05, 5.0  # limits of CRUISE_SPEED and MDL_SPEED
# Corrections of raw samples; tables and ArduPilot logs contain true headings and rudder angles, which need none.
CORRECTIONS: Final = ("CMP_OFFSET_DEG", "CMP_DEV_", "RUD_CENTRE_DEG", "RUD_REVERSE")


def read_ship(text: str) -> dict[str, float]:
    """Read the value of --ship, K=..,T=..,alpha=..,speed=.., as parameters, or raise UsageError."""
    values: dict[str, float] = {}
    for item in text.split(","):
        name, _, number = (part.strip() for part in item.partition("="))
        if name not in SHIP_PARAMETERS:
            raise UsageError(f"--ship: {item.strip()[:30]!r} is unknown; use K=, T=, alpha=, speed=")
        if SHIP_PARAMETERS[name] in values:
            raise UsageError(f"--ship: {name} is given twice; give it once")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise UsageError(f"--ship: {name}={number[:30]} is not a number; give K in 1/s, T in s, speed in m/s")
        values[SHIP_PARAMETERS[name]] = _check(SHIP_PARAMETERS[name], value, f"--ship {name}")
    return values


def read_parameters(path: Path) -> dict[str, float]:
    """Read a parameter file, or raise UsageError."""
    try:
        return parse_file(read_text(path, MAX_BYTES), str(path))
    except OSError as error:
        raise UsageError(f"--params {path} cannot be read: {error.strerror or error}; give another") from None
    except UnicodeError:
        raise UsageError(f"--params {path} is not a text file; give a parameter file") from None
    except ParameterError as error:
        raise UsageError(str(error)) from None


def parameters_for(
    recording: Recording, given: Mapping[str, float], ship: Mapping[str, float]
) -> tuple[ParameterSet, tuple[str, ...]]:
    """Return the parameters for a recording, and notes on them.

    `given`: those of the vehicle and the parameter file, which replace those of the recording. `ship`: those of --ship.
    Failsafe actions are off, because the recorded boat did not follow this autopilot.
    """
    values = {**recording.parameters, **given, **ship}
    notes = []
    if not values.keys() & {"MDL_K", "MDL_T_S"}:
        notes.append("no ship given: K, T and alpha are defaults and may be wrong; give --ship or --params")
    if (recorded_speed := _speed(recording)) is not None:
        speed_m_s, speed_name = recorded_speed
        sets_initial_speed, sets_model_speed = "CRUISE_SPEED" not in values, bool(ship) and "MDL_SPEED" not in ship
        if sets_initial_speed:
            values["CRUISE_SPEED"] = speed_m_s
        if sets_model_speed:
            values["MDL_SPEED"] = speed_m_s
        roles = " and ".join(
            (*("initial speed",) * sets_initial_speed, *("speed of the ship model",) * sets_model_speed)
        )
        if roles:
            notes.append(f"{roles}: mean speed {speed_name}, {speed_m_s:.2f} m/s")
    for row in TABLE:
        is_failsafe_action = row.name.startswith("FS_") and row.name.endswith("_ACT")
        is_unneeded_correction = not recording.is_shaft and row.name.startswith(CORRECTIONS)
        if is_failsafe_action or is_unneeded_correction:
            values[row.name] = 0.0
    return ParameterSet([values.get(row.name, row.default) for row in TABLE]), tuple(notes)


def _speed(recording: Recording) -> tuple[float, str] | None:
    """Return the recorded mean speed through the water, or else over ground, and its name."""
    for speed_m_s, speed_name in ((recording.water_m_s, "through the water"), (recording.ground_m_s, "over ground")):
        if speed_m_s is not None:
            return to_single(min(max(speed_m_s, MIN_SPEED_M_S), MAX_SPEED_M_S)), speed_name
    return None


def _check(name: str, value: float, where: str) -> float:
    try:
        return TABLE[INDEX[name]].check(value)
    except ParameterError as error:
        raise UsageError(f"{where}: {error}") from None
