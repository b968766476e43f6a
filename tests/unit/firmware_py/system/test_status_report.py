"""What a status says: everything of the snapshot that an operator asks for, in the units of the shore."""

import json
import math

import pytest
from msgspec.structs import replace

from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import (
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
    DeadReckoningPosition,
    Energy,
    Flow,
    Home,
    MissionReport,
    Navigation,
    Power,
    SwingReport,
)
from firmware_py.core.state import State
from firmware_py.core.step import step
from firmware_py.faults.latch import LatchState
from firmware_py.faults.table import TABLE, Fault
from firmware_py.system.status_report import MAX_EVENTS, SECTIONS, StatusReporter, StatusSources


class FakeStatusFile:
    """Takes what is written, as the file does, or fails."""

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
        self.per_status = 20
        self.file, self.reports = FakeStatusFile(), []
        self.accepted = 0
        self.swing = SwingReport()
        self.latch = LatchState()
        peer = PeerStatus("10.0.0.7:14550", True, True, False, 0.45, 1200, 3, 1)
        self.reporter = StatusReporter(
            StatusSources(
                about={"vehicle": "Rambler"},
                ports={DeviceRole.COMPASS: ("nmea", "/dev/compass")},
                devices=self.devices,
                links=lambda _now_s: (
                    LinkStatus("udpin:0.0.0.0:14550", "fast", (peer,)),
                    LinkStatus("x", "radio", (), blocked_reason="the line is not there"),
                ),
                faults=lambda: self.latch,
                starts=lambda: 7,
                swing=lambda: self.swing,
                update=lambda: "",
                written=lambda: (3, 12288),
                load=lambda: 0.0125,
                utc_s=lambda: 1.7e9,
                machine_s=lambda: 55.5,
            ),
            self.file,
            self.reports.append,
        )
        _, self.output = step(State.at_start(ParameterSet(), Plans()), Inputs(Tick(0, 10.0, 0.0, 0, 10.0)))

    def devices(self):
        self.accepted += self.per_status
        return {
            DeviceRole.COMPASS: DeviceHealth(
                0.0, DeviceRole.COMPASS, DeviceState.RUNNING, self.accepted, 2, "checksum"
            ),
            DeviceRole.LINK: DeviceHealth(0.0, DeviceRole.LINK, DeviceState.SILENT, 0, 0),
            DeviceRole.STORAGE: DeviceHealth(0.0, DeviceRole.STORAGE, DeviceState.FAULTY, 5, 1, "log: disk full"),
        }

    def status(self, now_s=10.0, **changes):
        output = replace(self.output, snapshot=replace(self.output.snapshot, **changes))
        self.reporter.update(output, now_s)
        return self.file.written[-1]


@pytest.fixture
def boat():
    return Boat()


def test_it_has_what_the_operator_asks_for(boat):
    status = boat.status(goal_heading_rad=math.radians(341.8), heading_rad=-0.1, heading_error_rad=-0.2)
    assert (status["mode"], status["armed"], status["goal_deg"]) == ("HOLD", False, 341.8)
    assert status["heading_deg"] == round(360.0 - math.degrees(0.1), 2)
    assert (status["starts"], status["uptime_s"], status["vehicle"]) == (7, 10.0, "Rambler")
    assert status["written_machine_s"] == 55.5
    assert {"rudder", "position", "navigation", "estimate", "energy", "loop"} <= set(status)
    assert status["loop"]["processor_percent"] == 1.25
    assert status["state_written"] == {"versions": 3, "bytes": 12288}
    assert status["links"][0]["peers"][0]["heard_age_s"] == pytest.approx(0.45, abs=0.051)
    assert status["links"][1]["peers"] == []
    assert [link["hindrance"] for link in status["links"]] == ["", "the line is not there"]
    assert status["faults"] == []


def test_events_between_two_statuses_are_listed(boat):
    boat.status(10.0)
    output = replace(boat.output, events=(Event(Severity.WARNING, "GPS position lost"),))
    boat.reporter.update(output, 10.1)
    event = {"t_s": 10.1, "severity": 4, "text": "GPS position lost"}
    assert event in boat.status(11.0)["events"]
    for number in range(1000):
        boat.reporter.update(output, 11.0 + 1e-4 * number)
    assert len(boat.status(12.5)["events"]) == MAX_EVENTS


def test_target_and_home_are_in_the_status(boat):
    going = Navigation(target_latitude_rad=0.1, target_longitude_rad=0.2, radius_m=40.0)
    status = boat.status(navigation=going, home=Home(0.3, 0.4, 0.0), mission=MissionReport(identities=(1, 2, 3)))
    assert (status["navigation"]["target_lat_deg"], status["navigation"]["radius_m"]) == (5.7295780, 40.0)
    assert status["home"] == {"lat_deg": 17.1887339, "lon_deg": 22.9183118}
    assert status["plan_identities"] == [1, 2, 3]


def test_a_dead_reckoning_position_is_not_a_fix_and_has_its_uncertainty(boat):
    assert "reckoned_sd_m" not in boat.status()["position"]
    values = boat.status(
        12.0, position_ok=False, dead_reckoning=DeadReckoningPosition(0.1, 0.2, 0.3, 0.0, 250.4, 3600.2)
    )["position"]
    assert (values["ok"], values["reckoned_lat_deg"], values["reckoned_lon_deg"]) == (False, 5.72958, 11.45916)
    assert (values["reckoned_sd_m"], values["reckoned_s"]) == (250.0, 3600.0)


def test_energy_is_there_when_the_snapshot_has_it(boat):
    assert boat.status(energy=None)["energy"] == {}
    status = boat.status(12.0, energy=Energy(energy_j=7200.0, power_w=1.234, travel_rad_per_h=math.pi))
    assert status["energy"]["steering_wh"] == 2.0
    assert (status["energy"]["servo_power_w"], status["energy"]["travel_deg_per_h"]) == (1.23, 180.0)


def test_battery_and_solar_power_are_shown_if_measured(boat):
    assert boat.status()["power"] == {}
    power = Power(13.123, -0.5, 0.876, solar=Flow(3600.0, 60.0), discharged=Flow(7200.0, 60.0))
    values = boat.status(12.0, power=power)["power"]
    assert (values["battery_v"], values["charge_percent"], values["load_w"]) == (13.12, 87.6, None)
    assert (values["solar_wh"], values["discharged_wh"]) == (1.0, 2.0)
    assert "load_wh" not in values  # not measured


def test_a_fault_has_its_text_and_duration(boat):
    since = [None] * len(TABLE)
    since[Fault.SUPPLY_LOW] = 4.0
    boat.latch = LatchState(tuple(since), tuple(since), 1 << Fault.SUPPLY_LOW)
    (fault,) = boat.status(faults=1 << Fault.SUPPLY_LOW)["faults"]
    assert fault == {"fault": "SUPPLY_LOW", "severity": TABLE[Fault.SUPPLY_LOW].severity.name.lower(),
                     "text": TABLE[Fault.SUPPLY_LOW].text, "since_s": 6.0}  # fmt: skip


def test_rates_are_means_of_ten_seconds_and_stations_are_peers(boat):
    first = boat.status(10.0)["devices"]
    assert [device["device"] for device in first] == ["compass", "storage"]
    assert (first[0]["rate_hz"], first[0]["driver"], first[0]["port"]) == (None, "nmea", "/dev/compass")
    assert (first[0]["rejected"], first[0]["error"]) == (2, "checksum")
    for second in range(11, 40):
        device, storage = boat.status(float(second))["devices"]
        assert device["rate_hz"] == 20.0
    assert (storage["state"], storage["error"], storage["rate_hz"]) == ("faulty", "log: disk full", None)


def test_each_measured_value_has_its_age(boat):
    status = boat.status(
        10.0, t_s=10.0, heading_age_s=3.25, servo=RudderFeedback(6.5), position=PositionSample(1.9, FixType.FIX_3D)
    )
    assert (status["heading_age_s"], status["rudder"]["age_s"], status["position"]["age_s"]) == (3.2, 3.5, 8.1)
    assert status["devices"][0]["age_s"] == 0.0
    boat.per_status = 0  # unplugged
    compass, storage = boat.status(14.0)["devices"]
    assert compass["age_s"] == 4.0
    assert "age_s" not in storage


def test_the_age_of_the_heading_counts_from_the_last_one_taken_in(boat):
    assert boat.status()["heading_age_s"] is None
    state = State.at_start(ParameterSet(), Plans())
    sample = HeadingSample(10.0, 0.5, NorthReference.TRUE)
    for tick in range(4):
        inputs = Inputs(Tick(tick, 10.0 + tick, 0.0, 0, 1.0), headings=(sample,) if not tick else ())
        state, output = step(state, inputs)
    assert output.snapshot.heading_age_s == 3.0


def test_it_is_written_every_second_and_no_oftener(boat):
    for tick in range(100):
        boat.status(10.0 + 0.1 * tick)
    assert len(boat.file.written) == 10


def test_numbers_that_are_none_are_null_so_that_any_reader_of_json_takes_it(boat):
    status = boat.status(heading_rad=math.nan, rate_hz=math.inf, late_s=math.nan, distance_m=-math.inf)
    assert (status["heading_deg"], status["loop"]["rate_hz"], status["navigation"]["distance_m"]) == (None, None, None)


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), RuntimeError("odd")])
def test_an_error_of_the_status_is_reported_once_and_ends_nothing(boat, failure):
    boat.file.failure = failure
    with pytest.raises(IndexError):
        boat.status(10.0)
    boat.reporter.update(boat.output, 20.0)
    assert len(boat.reports) == 1
    assert "No space left" in boat.reports[0] or "odd" in boat.reports[0]
    boat.file.failure = None
    assert boat.status(30.0)["mode"] == "HOLD"
    boat.reporter.close()
    assert boat.file.written[-1] is None


def test_every_section_can_be_made_of_a_boat_that_knows_nothing_yet(boat):
    for name, make in SECTIONS.items():
        assert isinstance(json.loads(json.dumps(make(boat.output.snapshot), allow_nan=False)), dict), name
