"""Months without an operator: the logs are complete, and memory and disk space do not increase.

`pytest -m proof tests/voyages/test_months.py -s` simulates 60 days in about ten minutes of one core: each day the boat
sails for an hour with a tick per second; then it is at a mooring with a tick every 14 s.
"""

import gc
import math
import os
from itertools import pairwise

import pytest

from firmware_py import loop
from firmware_py.core.state_codec import state_from_text
from firmware_py.core.step import step
from firmware_py.faults.fault import Fault
from firmware_py.log import daily_energy
from firmware_py.log.disk import THIN, log_files
from firmware_py.log.replay import replay_log
from firmware_py.system.state_directory import LOG_DIRECTORY
from firmware_py.system.store import Store
from support.months import DAY_S, SETTINGS, UTC_S, WARM_UP_S, Cause, End, Months, sparse_timer
from support.plans import item, mission_file

HOUR_S, MINUTE_S = 3600.0, 60.0
SQUARE = (item(16, 600, 0), item(16, 600, 600), item(16, 0, 600), item(16, 0, 0), item(177, None, None, 0, -1))
MOORED = frozenset({Fault.COMPASS_LOST, Fault.COMPASS_SILENT, Fault.POSITION_LOST})
CLEARING_S = 150.0  # a fault needs time to clear and is in the row of the minute in which it was active
SETTLED_H = 6  # after this time the memory of a run should be constant
LOW_CHARGE, CLEAR_CHARGE = 0.405, 0.455  # near PWR_SAVE_PCT, and where the fault clears


def simulate(directory, monkeypatch, days, sailing_s, causes, ends):
    """Simulate some days and return the boat."""
    store = Store(directory)
    name, content = mission_file(*SQUARE)
    store.save(name, content.encode())
    store.close()
    # Other tests check synchronisation to the disk, which would take minutes here.
    monkeypatch.setattr(os, "fsync", lambda _descriptor: None)
    monkeypatch.setattr(os, "fdatasync", lambda _descriptor: None)
    boat = Months(directory, days, sailing_s, causes, ends)
    monkeypatch.setattr(loop, "TickTimer", sparse_timer(boat.world))
    gc.collect()
    gc.freeze()  # as at the start of the program
    try:
        return boat.run()
    finally:
        gc.unfreeze()


def rows_of(boat):
    return list(daily_energy.read_rows(daily_energy.list_thin_logs(boat.directory / LOG_DIRECTORY)))


def gaps(boat, rows):
    """Return the intervals without rows of the thin log, in seconds since the start."""
    ends = [(row.utc_s - row.span_s - UTC_S, row.utc_s - UTC_S) for row in rows]
    between = [(previous[1], after[0]) for previous, after in pairwise([(0.0, 0.0), *ends, (boat.days * DAY_S,) * 2])]
    return [(begin_s, end_s) for begin_s, end_s in between if end_s - begin_s > 1.5]


def unexplained_faults(boat, rows):
    """Return day and name of each fault in a row that neither the script nor the battery charge explains."""
    moorings = [
        Cause("mooring", day * DAY_S + boat.sailing_s, (day + 1) * DAY_S - WARM_UP_S, MOORED)
        for day in range(math.ceil(boat.days))
    ]
    unexplained_rows = []
    for row in rows:
        end_s = row.utc_s - UTC_S
        begin_s = end_s - row.span_s
        explained = (
            {Fault.BATTERY_LOW} if 0.0 < min(_charges(boat, begin_s, end_s), default=1.0) < CLEAR_CHARGE else set()
        )
        for cause in (*boat.causes, *moorings):
            if begin_s < cause.end_s + CLEARING_S and end_s > cause.begin_s:
                explained |= cause.faults
        active = {fault for fault in Fault if int(row.values["Flt"]) >> fault & 1}
        unexplained_rows += [(round(end_s / DAY_S, 4), fault.name) for fault in active - explained]
    return unexplained_rows


def _charges(boat, begin_s, end_s):
    first, last = int(begin_s // MINUTE_S) - 2, int(end_s // MINUTE_S) + 2
    return [charge for charge in boat.charge[max(0, first) : last] if charge > 0.0]


def active_faults(rows):
    """Return all faults that were active at some time."""
    fault_bits = 0
    for row in rows:
        fault_bits |= int(row.values["Flt"])
    return {fault for fault in Fault if fault_bits >> fault & 1}


def measured_wh(rows):
    """Return the energies that `rambler energy` shows, by name."""
    days = [day.amounts(None) for day in daily_energy.sum_by_day(rows)]
    return {name: sum(day[name].wh for day in days) for name in ("solar", "load", "servo", "charged", "discharged")}


def assert_good(boat, ends):
    """Check log rows, faults and replay; return the relative errors of the logged energies."""
    rows = rows_of(boat)
    allowed = [(end.at_s - 130.0, end.at_s + end.off_s + 5.0) for end in (*ends, End("stop", boat.days * DAY_S))]
    unexpected_gaps = [
        gap
        for gap in gaps(boat, rows)
        if not any(allowed_from_s <= gap[0] and gap[1] <= allowed_to_s for allowed_from_s, allowed_to_s in allowed)
    ]
    assert unexpected_gaps == []
    assert unexplained_faults(boat, rows) == []
    assert {fault for cause in boat.causes for fault in cause.faults} <= active_faults(rows)
    truth, logged_wh = boat.truth._asdict(), measured_wh(rows)
    logs = log_files(boat.directory / LOG_DIRECTORY)
    assert replay_log(logs[max(logs)], state_from_text, step).identical
    return {name: abs(logged_wh[name] / truth[name] - 1.0) for name in truth}


def test_six_hours_with_a_power_cut_are_logged_completely(tmp_path, monkeypatch):
    """Power is cut under way, and the power monitor stops sending at the mooring."""
    causes = (Cause("monitor", 7200.0, 7800.0, frozenset({Fault.POWER_SILENT})),)
    ends = (End("cut", 150.0),)
    boat = simulate(tmp_path, monkeypatch, 0.25, 300.0, causes, ends)
    errors = assert_good(boat, ends)
    # The others are so small that the loss at the cut is significant.
    assert max(errors["solar"], errors["load"]) < 0.01
    assert "Started again: cut off (the first time)" in boat.text_counts
    assert boat.text_counts["Armed"] == 1  # after the cut the boat continues


@pytest.mark.proof
@pytest.mark.timeout(4 * HOUR_S)
def test_sixty_days_are_logged_completely_with_constant_memory(tmp_path, monkeypatch, figures):
    """The environment variable MONTHS_DAYS changes the number of days."""
    days, sailing_s = int(os.environ.get("MONTHS_DAYS", "60")), HOUR_S

    def at(day, hour):
        return day * days // 60 * DAY_S + hour * HOUR_S

    causes = (
        Cause("receiver", at(9, 0.3), at(9, 0.7), frozenset({Fault.POSITION_LOST})),
        Cause("compass", at(14, 0.5), at(14, 0.6), frozenset({Fault.COMPASS_SILENT})),
        Cause("monitor", at(17, 7.0), at(17, 8.0), frozenset({Fault.POWER_SILENT})),
        Cause("disk", at(23, 0.4), at(23, 0.8), frozenset({Fault.STORAGE_FAILING})),
        Cause("servo", at(28, 0.75), at(28, 0.85), frozenset({Fault.RUDDER_SILENT})),
    )
    ends = (
        End("cut", at(5, 0.5)),
        End("stop", at(12, 0.5), 60.0),
        End("cut", at(20, 0.5)),
        End("cut", at(20, 0.6)),
        End("crash", at(33, 0.7), 5.0),
        End("stop", at(41, 10.0), 6.0 * HOUR_S),
        End("cut", at(50, 12.0)),
    )
    boat = simulate(tmp_path, monkeypatch, days, sailing_s, causes, ends)
    print(boat.ticks, "ticks", dict(boat.text_counts))
    errors = assert_good(boat, ends)
    runs = [readings[SETTLED_H:] for readings in boat.resident_kib if len(readings) > 2 * SETTLED_H]
    growth_mib = max(max(readings) - readings[0] for readings in runs) / 1024.0
    print([list(readings) for readings in runs])
    thin_bytes = sum(path.stat().st_size for path in (tmp_path / LOG_DIRECTORY / THIN).iterdir())
    figures.keep("months_memory", growth_mib, "MiB")
    figures.keep("months_thin_year", thin_bytes / 1e6 * 365.0 / days, "MB")
    figures.keep("months_logs", max(boat.disk_bytes) / 1e6, "MB")
    figures.keep("months_energy", 100.0 * max(errors.values()), "%")
    # With fewer days the losses are a larger fraction: an hour without a monitor, minutes lost at a cut.
    assert max(errors.values()) <= (0.01 if days >= 60 else 0.05)
    assert growth_mib <= 1.0
    assert thin_bytes / days * 365.0 <= 100e6
    assert max(boat.disk_bytes) <= (SETTINGS["LOG_KEEP_MB"] + SETTINGS["LOG_FILE_MB"]) * 1e6 + thin_bytes
