"""Content of the status: values of the snapshot in the units of operators."""

import json
import math

import pytest
from msgspec.structs import replace

from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import (
    CalibrationState,
    DepthSample,
    DeviceHealth,
    DeviceRole,
    DeviceState,
    Event,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderFeedback,
    Severity,
    Tick,
)
from firmware_py.common.reports import (
    Activity,
    DeadReckoningPosition,
    Energy,
    Estimate,
    Flow,
    Home,
    MissionReport,
    MissionState,
    Navigation,
    Power,
    SwingReport,
    Water,
    Wind,
)
from firmware_py.common.vessels import Traffic, Vessel, VesselKind, VesselPosition
from firmware_py.core.state import State
from firmware_py.core.step import step
from firmware_py.faults.latch import LatchState
from firmware_py.faults.table import TABLE, Fault
from firmware_py.system.readings import device_values, format_device
from firmware_py.system.status_report import SECTIONS, StatusReporter, StatusSources, calibration_values

MAX_EVENTS = 30

PEER = PeerStatus(
    "10.0.0.7:14550",
    ground_station=True,
    has_place=True,
    signs=False,
    heard_age_s=0.45,
    sent_bytes=1200,
    dropped=3,
    rejected=1,
)
LINKS = (
    LinkStatus("udpin:0.0.0.0:14550", "fast", (PEER,)),
    LinkStatus("x", "radio", (), blocked_reason="the line is missing"),
)


class FakeStatusFile:
    """A status file in memory that can fail."""

    def __init__(self):
        self.written, self.failure = [], None

    def write(self, content):
        if self.failure is not None:
            raise self.failure
        self.written.append(json.loads(content))

    def remove(self):
        self.written.append(None)


class Boat:
    def __init__(self):
        self.samples_per_status = 20
        self.file, self.reports = FakeStatusFile(), []
        self.accepted = 0
        self.latch = LatchState()
        sources = StatusSources(
            about={"vehicle": "Rambler"},
            ports={DeviceRole.COMPASS: ("nmea", "/dev/compass")},
            devices=self.devices,
            links=lambda _now_s: LINKS,
            faults=lambda: self.latch,
            starts=lambda: 7,
            swing=SwingReport,
            update=lambda: "",
            written=lambda: (3, 12288),
            load=lambda: 0.0125,
            utc_s=lambda: 1.7e9,
            machine_s=lambda: 55.5,
        )
        self.reporter = StatusReporter(sources, self.file, self.reports.append)
        _, self.output = step(State.at_start(ParameterSet(), Plans()), Inputs(Tick(0, 10.0, 0.0, 0, 10.0)))

    def devices(self):
        self.accepted += self.samples_per_status
        rows = (
            (DeviceRole.COMPASS, DeviceState.RUNNING, self.accepted, 2, "checksum"),
            (DeviceRole.LINK, DeviceState.SILENT, 0, 0),
            (DeviceRole.STORAGE, DeviceState.FAULTY, 5, 1, "log: disk full"),
        )
        return {row[0]: DeviceHealth(0.0, *row) for row in rows}

    def status(self, now_s=10.0, **changes):
        """Update the reporter with a changed snapshot; return the last written status."""
        output = replace(self.output, snapshot=replace(self.output.snapshot, **changes))
        self.reporter.update(output, now_s)
        return self.file.written[-1]


@pytest.fixture
def boat():
    return Boat()


def test_the_status_contains_state_sources_and_loop(boat):
    status = boat.status(goal_heading_rad=math.radians(341.8), heading_rad=-0.1, heading_error_rad=-0.2)
    assert (status["mode"], status["armed"], status["goal_deg"]) == ("HOLD", False, 341.8)
    assert status["heading_deg"] == round(360.0 - math.degrees(0.1), 2)
    assert (status["starts"], status["uptime_s"], status["vehicle"]) == (7, 10.0, "Rambler")
    assert status["written_machine_s"] == 55.5
    assert status.keys() >= {"rudder", "position", "navigation", "estimate", "energy", "loop"}
    assert status["loop"]["processor_percent"] == 1.25
    assert status["state_written"] == {"versions": 3, "bytes": 12288}
    assert status["links"][0]["peers"][0]["heard_age_s"] == pytest.approx(0.45, abs=0.051)
    assert status["links"][1]["peers"] == []
    assert [link["hindrance"] for link in status["links"]] == ["", "the line is missing"]
    assert status["faults"] == []


def test_events_between_two_statuses_are_listed(boat):
    boat.status(10.0)
    output = replace(boat.output, events=(Event(Severity.WARNING, "GPS position lost"),))
    boat.reporter.update(output, 10.1)
    assert {"t_s": 10.1, "severity": 4, "text": "GPS position lost"} in boat.status(11.0)["events"]
    for number in range(1000):
        boat.reporter.update(output, 11.0 + 1e-4 * number)
    assert len(boat.status(12.5)["events"]) == MAX_EVENTS


POWER = Power(voltage_v=13.123, current_a=-0.5, charge=0.876, solar=Flow(3600.0, 60.0), discharged=Flow(7200.0, 60.0))

WIND = Wind(
    10.5,
    apparent_m_s=6.12,
    apparent_rad=math.radians(-90.0),
    north_m_s=-3.0,
    east_m_s=4.0,
    wind_m_s=5.12,
    from_rad=math.pi / 2,
    mean_m_s=4.42,
    mean_from_rad=math.pi,
    sd_m_s=0.7,
    gust_m_s=8.12,
)


@pytest.mark.parametrize(
    ("section", "changes", "values"),
    [
        (
            "power",
            {"power": POWER},
            {"battery_v": 13.12, "charge_percent": 87.6, "load_w": None, "solar_wh": 1.0, "discharged_wh": 2.0},
        ),
        (
            "wind",
            {"wind": WIND, "wind_ok": True, "t_s": 12.0},
            {"ok": True, "age_s": 1.5, "wind_m_s": 5.1, "wind_from_deg": 90.0, "mean_wind_m_s": 4.4,
             "mean_wind_from_deg": 180.0, "gust_m_s": 8.1, "apparent_wind_m_s": 6.1, "apparent_wind_deg": 270.0},
        ),
        ("wind", {"wind": Wind(10.0), "t_s": 30.0}, {"ok": False, "age_s": 20.0, "wind_m_s": None, "gust_m_s": None}),
    ],
)  # fmt: skip
def test_a_section_contains_the_values_of_the_snapshot(boat, section, changes, values):
    section_values = boat.status(**changes)[section]
    assert {name: section_values[name] for name in values} == values


ANGLE_RAD, NUMBER = 0.1234567, 12.3456789  # 7.07354785 degrees
ESTIMATE = Estimate(
    source=1,
    heading_rad=ANGLE_RAD,
    heading_sd_rad=ANGLE_RAD,
    yaw_rate_rad_s=0.0,
    yaw_rate_sd_rad_s=0.0,
    bias_rad=-ANGLE_RAD,
    bias_sd_rad=0.0,
    wave_period_s=NUMBER,
    wave_sd_rad=ANGLE_RAD,
    compass_noise_rad=ANGLE_RAD,
    speed_m_s=0.0,
    speed_sd_m_s=0.0,
    current_north_m_s=0.0,
    current_east_m_s=0.0,
    innovation_rad=0.0,
    innovation_sd_rad=0.0,
    innovation_square=NUMBER,
    yaw_diffusion_rad2_s=0.00123456,
    prediction_square=1.23456,
)
WATER = Water(
    speed_m_s=0.123456,
    speed_sd_m_s=0.0123456,
    current_north_m_s=0.345678,
    current_east_m_s=-0.456789,
    current_sd_m_s=0.0567891,
    leeway_rad=-ANGLE_RAD,
)
DEAD_RECKONING = DeadReckoningPosition(
    latitude_rad=ANGLE_RAD, longitude_rad=-ANGLE_RAD, north_m_s=0.3, east_m_s=0.0, sd_m=NUMBER, time_since_fix_s=NUMBER
)
NAVIGATION = Navigation(
    Activity.LINE,
    target_latitude_rad=ANGLE_RAD,
    target_longitude_rad=-ANGLE_RAD,
    radius_m=NUMBER,
    cross_track_m=-NUMBER,
    fence_margin_m=NUMBER,
)
ENERGY = Energy(
    travel_rad=0.0,
    reversals=0,
    energy_j=4567.89,
    travel_rad_per_h=ANGLE_RAD,
    reversals_per_h=NUMBER,
    power_w=NUMBER,
    resting=True,
)
UNROUNDED_WIND = Wind(
    6.54321,
    apparent_m_s=NUMBER,
    apparent_rad=ANGLE_RAD,
    north_m_s=0.0,
    east_m_s=0.0,
    wind_m_s=NUMBER,
    from_rad=ANGLE_RAD,
    mean_m_s=NUMBER,
    mean_from_rad=ANGLE_RAD,
    sd_m_s=0.0,
    gust_m_s=NUMBER,
)
SWING = SwingReport(
    CalibrationState.DONE,
    percent=70,
    minutes=41,
    sectors=0b1011,
    present_rad=(0.0,) * 5,
    estimated_rad=(ANGLE_RAD, -0.02, 0.03, 0.01, -0.01),
    sd_rad=ANGLE_RAD,
    max_change_rad=0.02,
    residual_before_rad=0.03,
    residual_after_rad=0.01,
)


@pytest.mark.parametrize(
    ("section", "changes", "values"),
    [
        (
            "rudder",
            {"rudder_rad": ANGLE_RAD, "rudder_estimate_rad": -ANGLE_RAD, "rudder_command_rad": 0.2, "rudder_ok": True,
             "gain_reduction": NUMBER, "servo": RudderFeedback(6.54321), "t_s": 10.0},
            {"angle_deg": 7.07, "estimated_deg": -7.07, "command_deg": 11.46, "ok": True, "helm_softness": 12.35,
             "age_s": 3.5},
        ),
        (
            "position",
            {"dead_reckoning": DEAD_RECKONING},
            {"reckoned_lat_deg": 7.07355, "reckoned_lon_deg": -7.07355, "reckoned_sd_m": 12.0, "reckoned_s": 12.0},
        ),
        (
            "navigation",
            {"navigation": NAVIGATION,
             "distance_m": NUMBER, "bearing_rad": -ANGLE_RAD,
             "mission": MissionReport(MissionState.ACTIVE, index=2, count=5, first_item_number=1)},
            {"activity": "LINE", "target_lat_deg": 7.0735479, "target_lon_deg": -7.0735479, "radius_m": 12.3,
             "distance_m": 12.3, "bearing_deg": 352.9, "cross_track_m": -12.3, "fence_margin_m": 12.3,
             "mission": "ACTIVE", "item": 3, "items": 5, "first_item": 1},
        ),
        ("home", {"home": Home(ANGLE_RAD, -ANGLE_RAD, 0.0)}, {"lat_deg": 7.0735479, "lon_deg": -7.0735479}),
        (
            "estimate",
            {"estimate": ESTIMATE, "water": WATER},
            {"heading_source": "compass_b", "heading_deg": 7.07, "heading_sd_deg": 7.07, "rudder_bias_deg": -7.07,
             "wave_period_s": 12.3, "wave_sd_deg": 7.07, "compass_noise_deg": 7.07, "yaw_diffusion_deg2_s": 4.053,
             "prediction_square": 1.23, "innovation_square": 12.35, "speed_m_s": 0.123, "speed_sd_m_s": 0.012,
             "current_m_s": 0.573, "current_to_deg": 307.0, "current_sd_m_s": 0.057, "leeway_deg": -7.1},
        ),
        (
            "energy",
            {"energy": ENERGY},
            {"steering_wh": 1.269, "servo_power_w": 12.35, "travel_deg_per_h": 7.0, "reversals_per_h": 12.0,
             "servo_resting": True},
        ),
        (
            "power",
            {"power": Power(NUMBER, -NUMBER, 0.876543, NUMBER, NUMBER, NUMBER, *[Flow(4567.89, 1.0)] * 4),
             "power_saving_level": 1},
            {"saving": "saves", "battery_v": 12.35, "battery_a": -12.35, "charge_percent": 87.7, "battery_c": 12.0,
             "solar_w": 12.3, "load_w": 12.35, "solar_wh": 1.27, "load_wh": 1.27, "charged_wh": 1.27,
             "discharged_wh": 1.27},
        ),
        (
            "wind",
            {"wind": UNROUNDED_WIND,
             "t_s": 10.0},
            {"ok": False, "age_s": 3.5, "wind_m_s": 12.3, "wind_from_deg": 7.0, "mean_wind_m_s": 12.3,
             "mean_wind_from_deg": 7.0, "gust_m_s": 12.3, "apparent_wind_m_s": 12.3, "apparent_wind_deg": 7.0},
        ),
        *(
            ("depth", {"depth": DepthSample(6.54321, NUMBER), "depth_ok": is_ok, "t_s": 10.0},
             {"ok": is_ok, "age_s": 3.5, "depth_m": 12.3})
            for is_ok in (False, True)
        ),
    ],
)  # fmt: skip
def test_values_of_a_section_are_rounded_to_their_accuracy(boat, section, changes, values):
    section_values = boat.status(**changes)[section]
    assert {name: section_values[name] for name in values} == values
    assert section == "rudder" or section_values.keys() - values.keys() <= {"ok"}


@pytest.mark.parametrize(("level", "text"), [(0, "nothing"), (1, "saves"), (2, "keeps heading")])
def test_saving_of_energy_has_a_name(boat, level, text):
    assert boat.status(power=POWER, power_saving_level=level)["power"]["saving"] == text


def test_proposal_of_a_compass_swing_is_rounded():
    assert calibration_values(SWING) == {
        "compass": "proposal waits", "percent": 70, "minutes": 41, "sectors": 3, "a_deg": 7.07, "b_deg": -1.15,
        "c_deg": 1.72, "d_deg": 0.57, "e_deg": -0.57, "sd_deg": 7.07, "in_force_off_deg": 1.15,
        "residual_before_deg": 1.72, "residual_after_deg": 0.57,
    }  # fmt: skip
    assert calibration_values(replace(SWING, state=CalibrationState.RUNNING))["compass"] == "under way"
    assert calibration_values(SwingReport()) == {}


def vessel(mmsi, distance_m, near_s=None):
    position = VesselPosition(6.54321, mmsi, VesselKind.CLASS_A, 0.0, 0.0, NUMBER, -ANGLE_RAD)
    return Vessel(
        position,
        identity=None,
        doubted=None,
        doubts=0,
        distance_m=distance_m,
        bearing_rad=ANGLE_RAD,
        cpa_m=234.567,
        cpa_in_s=345.678,
        near_s=near_s,
    )


def test_five_vessels_are_listed_in_the_order_of_urgency(boat):
    vessels = (
        # An MMSI that begins with 970 belongs to a search and rescue transmitter (ITU-R M.585).
        *(vessel(211000000 + n, 1000.0 - n) for n in range(5)), vessel(211000009, 2000.0, 5.0),
        vessel(970000001, 9000.0), vessel(211000010, None),
    )  # fmt: skip
    traffic = boat.status(t_s=10.0, traffic=Traffic(vessels, rejected=3, aside_rad=-ANGLE_RAD))["traffic"]
    assert (traffic["vessels"], traffic["no_room_for"], traffic["aside_deg"]) == (8, 3, 353.0)
    listed = [row["mmsi"] for row in traffic["nearest"]]
    assert listed == [970000001, 211000009, 211000004, 211000003, 211000002]
    row = traffic["nearest"][1]
    assert {name: row[name] for name in row if name != "title"} == {
        "mmsi": 211000009, "age_s": 3.0, "distance_m": 2000.0, "bearing_deg": 7.0, "sog_m_s": 12.3, "cog_deg": 353.0,
        "cpa_m": 235.0, "cpa_in_s": 346.0, "near": True,
    }  # fmt: skip
    assert not traffic["nearest"][2]["near"]


def test_uptime_has_one_decimal_and_the_loop_values_have_three(boat):
    status = boat.status(10.06, rate_hz=NUMBER, late_s=0.0123456789, skipped_total=4, tick=8)
    assert status["uptime_s"] == 10.1
    assert status["loop"] == {
        "rate_hz": 12.346, "ticks": 9, "skipped": 4, "late_ms": 12.346, "processor_percent": 1.25
    }  # fmt: skip


def test_values_that_the_snapshot_does_not_have_are_omitted(boat):
    status = boat.status(energy=None)
    assert (status["energy"], status["power"]) == ({}, {})
    assert "reckoned_sd_m" not in status["position"]
    assert "load_wh" not in boat.status(12.0, power=POWER)["power"]  # not measured


def test_plan_identities_are_listed(boat):
    assert boat.status(mission=MissionReport(identities=(1, 2, 3)))["plan_identities"] == [1, 2, 3]


def test_a_fault_has_its_text_and_duration(boat):
    since = [None] * len(TABLE)
    since[Fault.SUPPLY_LOW] = 4.0
    boat.latch = LatchState(tuple(since), tuple(since), 1 << Fault.SUPPLY_LOW)
    (fault,) = boat.status(faults=1 << Fault.SUPPLY_LOW)["faults"]
    row = TABLE[Fault.SUPPLY_LOW]
    expected = {"fault": "SUPPLY_LOW", "severity": row.severity.name.lower(), "text": row.text, "since_s": 6.0}
    assert fault == expected


def test_rates_are_means_of_ten_seconds_and_the_link_is_not_listed_as_a_device(boat):
    compass, storage = boat.status(10.0)["devices"]
    assert (compass["device"], storage["device"]) == ("compass", "storage")
    assert (compass["rate_hz"], compass["driver"], compass["port"]) == (None, "nmea", "/dev/compass")
    assert (compass["rejected"], compass["error"]) == (2, "checksum")
    for second in range(11, 40):
        compass, storage = boat.status(float(second))["devices"]
        assert compass["rate_hz"] == 20.0
    boat.samples_per_status = 0
    rates_hz = [boat.status(float(second))["devices"][0]["rate_hz"] for second in range(40, 50)]
    assert rates_hz == [18.0, 16.0, 14.0, 12.0, 10.0, 8.0, 6.0, 4.0, 2.0, 0.0]
    assert (storage["state"], storage["error"], storage["rate_hz"]) == ("faulty", "log: disk full", None)


def test_each_measured_value_has_its_age(boat):
    position = PositionSample(1.9, FixType.FIX_3D)
    status = boat.status(10.0, t_s=10.0, heading_age_s=3.25, servo=RudderFeedback(6.5), position=position)
    assert (status["heading_age_s"], status["rudder"]["age_s"], status["position"]["age_s"]) == (3.2, 3.5, 8.1)
    assert status["devices"][0]["age_s"] == 0.0
    boat.samples_per_status = 0
    compass, storage = boat.status(14.0)["devices"]
    assert compass["age_s"] == 4.0
    assert "age_s" not in storage


def test_the_age_of_the_heading_counts_from_the_last_sample_used(boat):
    assert boat.status()["heading_age_s"] is None
    state = State.at_start(ParameterSet(), Plans())
    sample = HeadingSample(10.0, 0.5, NorthReference.TRUE)
    for tick in range(4):
        inputs = Inputs(Tick(tick, 10.0 + tick, 0.0, 0, 1.0), headings=(sample,) if not tick else ())
        state, output = step(state, inputs)
    assert output.snapshot.heading_age_s == 3.0


def test_the_status_is_written_every_second(boat):
    for tick in range(200):
        boat.status(10.0 + 0.1 * tick)
    assert len(boat.file.written) == 20


def test_numbers_that_are_not_finite_are_null(boat):
    status = boat.status(heading_rad=math.nan, rate_hz=math.inf, late_s=math.nan, distance_m=-math.inf)
    assert (status["heading_deg"], status["loop"]["rate_hz"], status["navigation"]["distance_m"]) == (None, None, None)


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), RuntimeError("odd")])
def test_an_error_is_reported_once_and_the_next_status_is_written(boat, failure):
    boat.file.failure = failure
    for now_s in (10.0, 20.0):
        boat.reporter.update(boat.output, now_s)
    (report,) = boat.reports
    assert "No space left" in report or "odd" in report
    boat.file.failure = None
    assert boat.status(30.0)["mode"] == "HOLD"
    boat.reporter.close()
    assert boat.file.written[-1] is None


def test_every_section_is_valid_json_before_any_measurement(boat):
    for name, values_of in SECTIONS.items():
        assert isinstance(json.loads(json.dumps(values_of(boat.output.snapshot), allow_nan=False)), dict), name


def test_long_names_of_devices_are_separated():
    values = device_values("rudder_angle", "bno08x_rvc", "/dev/x", None, None)
    assert format_device(values).split()[:3] == ["rudder_angle", "bno08x_rvc", "absent"]
