"""`rambler energy`: watt-hours by day and by consumer, measured or marked as estimated."""

import json

import pytest

from firmware_py.__main__ import main
from firmware_py.log.thin import HEAD, SAILING, UPKEEP, Minute

DAY_UTC_S = 1_798_761_600.0  # 2027-01-01


def minutes(start_utc_s, count, **values):
    """Return rows of the thin log, one a minute. A callable value gets the number of the row."""
    data = b""
    for number in range(1, count + 1):
        fields = {name: value(number) if callable(value) else value for name, value in values.items()}
        row = Minute(start_utc_s + 60.0 * number, 60.0, 0, True, 0, **fields)
        data += SAILING.pack(60.0 * number, row) + UPKEEP.pack(60.0 * number, row)
    return data


MEASURED = {"servo_v": 12.0, "steering_j": 30.0, "battery_v": 12.5, "load_w": 5.0, "solar_w": 8.0, "battery_a": 0.24}


@pytest.fixture
def energy(tmp_path, capsys):
    """Run the command on a thin log in a state directory."""

    def run(data, *words, name="00000001.BIN"):
        thin = tmp_path / "logs" / "thin"
        thin.mkdir(parents=True, exist_ok=True)
        (thin / name).write_bytes(HEAD + data)
        code = main(["energy", str(tmp_path), *words])
        return code, capsys.readouterr().out

    return run


def test_energy_of_a_day_by_consumer(energy):
    code, out = energy(minutes(DAY_UTC_S, 600, **MEASURED, charge=0.75), "--json")
    (day,) = json.loads(out)["days"]
    assert (code, day["day"], day["logged_h"], day["charge"]) == (0, "2027-01-01", 10.0, 0.75)
    amounts = {name: (day[name]["wh"], day[name]["estimated"]) for name in ("solar", "load", "servo", "rest")}
    assert amounts == {"solar": (80.0, False), "load": (50.0, False), "servo": (5.0, False), "rest": (45.0, False)}
    assert (day["charged"]["wh"], day["discharged"]["wh"]) == (pytest.approx(30.0), 0.0)


def test_days_begin_at_midnight_utc_and_undated_minutes_are_separate(energy):
    data = minutes(DAY_UTC_S - 1800.0, 60, **MEASURED) + minutes(0.0, 5, **MEASURED)
    days = json.loads(energy(data, "--json")[1])["days"]
    assert [(day["day"], day["load"]["wh"]) for day in days] == [
        (None, 0.4167),
        ("2026-12-31", pytest.approx(2.5)),
        ("2027-01-01", pytest.approx(2.5)),
    ]


def test_minutes_before_clock_setting_belong_to_the_day(energy):
    undated, dated = minutes(0.0, 3, **MEASURED), minutes(DAY_UTC_S, 60, **MEASURED)
    days = json.loads(energy(undated + dated[len(undated) :], "--json")[1])["days"]
    assert [(day["day"], day["logged_h"], day["load"]["wh"]) for day in days] == [("2027-01-01", 1.0, 5.0)]


def test_unmeasured_time_is_extrapolated_and_marked(energy):
    data = minutes(DAY_UTC_S, 300, **MEASURED) + minutes(DAY_UTC_S + 18000.0, 300, steering_j=30.0, servo_v=12.0)
    (day,) = json.loads(energy(data, "--json")[1])["days"]
    assert day["load"] == {"wh": 50.0, "measured_h": 5.0, "estimated": True}
    assert day["servo"] == {"wh": 5.0, "measured_h": 10.0, "estimated": False}
    assert day["rest"]["estimated"]
    code, out = energy(minutes(0.0, 6, load_w=10.0) + data)
    assert (code, out.splitlines()) == (0, [
        "Wh by day (UTC)  hours    panels     loads     servo  all else        in       out    charge",
        "no valid clock    0.10         -      1.00         -         -         -         -         -",
        "2027-01-01       10.00    ~80.00    ~50.00      5.00    ~45.00    ~30.00     ~0.00         -",
        "in, out: battery charge and discharge; ~ estimated, at least in part; - unknown",
    ])  # fmt: skip
    assert energy(minutes(DAY_UTC_S, 6, charge=0.756))[1].splitlines()[1].endswith("      76 %")
    day = json.loads(energy(minutes(0.0, 1, load_w=1.0), "--json")[1])["days"][0]
    assert (day["day"], day["logged_h"], day["load"]["wh"]) == (None, 0.0167, 0.0167)


def test_rest_needs_a_monitor_or_rest_w(energy):
    data = minutes(DAY_UTC_S, 600, steering_j=30.0, servo_v=12.0)
    (day,) = json.loads(energy(data, "--json")[1])["days"]
    assert (day["load"], day["rest"], day["servo"]["wh"]) == (None, None, 5.0)
    (day,) = json.loads(energy(data, "--json", "--rest-w", "4")[1])["days"]
    assert (day["load"], day["rest"]["wh"]) == ({"wh": 45.0, "measured_h": 0.0, "estimated": True}, 40.0)


@pytest.mark.parametrize("cut_bytes", [1, 40, 200])
def test_incomplete_row_is_ignored(energy, cut_bytes):
    data = minutes(DAY_UTC_S, 60, **MEASURED)
    (day,) = json.loads(energy(data[:-cut_bytes], "--json")[1])["days"]
    assert day["logged_h"] in (pytest.approx(59 / 60, abs=1e-4), pytest.approx(58 / 60, abs=1e-4))


def test_log_without_records_is_a_finding_and_bad_arguments_are_errors(energy, tmp_path, capsys):
    assert energy(b"") == (1, "no energy records yet; run for at least a minute\n")
    assert main(["energy", str(tmp_path / "nothing.BIN")]) == 2
    assert "give a thin log" in capsys.readouterr().err
    for rest_w, code in (("nan", 2), ("-0.1", 2), ("100000.1", 2), ("0", 1), ("100000", 1)):
        assert main(["energy", str(tmp_path), "--rest-w", rest_w]) == code


def test_column_of_another_type_is_ignored(energy):
    values, index = UPKEEP.type.values, UPKEEP.type.labels.split(",").index("Load")
    changed_values = f"{values[:index]}n{values[index + 1 :]}"  # n: a text of four characters
    changed_header = HEAD.replace(values.encode(), changed_values.encode())
    assert changed_header != HEAD
    (day,) = json.loads(energy(changed_header + minutes(DAY_UTC_S, 60, **MEASURED), "--json")[1])["days"]
    assert (day["load"], day["solar"]["wh"]) == (None, pytest.approx(8.0))
