"""Vehicle files: values, defaults, and messages for every problem."""

from pathlib import Path

import pytest

from firmware_py.common.options import meanings
from firmware_py.devices import SECTIONS
from firmware_py.link.wire.urls import parse_url
from firmware_py.vehicle import DeviceEntry, VehicleError, load

MAX_PROBLEMS = 20

ROOT = Path(__file__).parents[3]

VALID = """
[vehicle]
name = "Ocean Rambler"
[compass]
driver = "nmea"
port = "/dev/ttyUSB0"
baud = 4800
sentences = ["HDT"]
[position]
driver = "ubx"
port = "/dev/ttyUSB1"
baud = 9600
[rudder]
driver = "volz"
port = "/dev/ttyUSB2"
baud = 115200
id = 3
[link]
urls = ["udpout:127.0.0.1:14550"]
[hull]
length_m = 3.05
[parameters]
CTL_K1 = 41
"""


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "boat.toml"
        path.write_text(text)
        return path

    return write


def test_valid_file_is_read(write):
    vehicle = load(write(VALID))
    assert vehicle.name == "Ocean Rambler"
    assert (vehicle.compass.driver, vehicle.compass.baud, vehicle.compass.options.sentences) == ("nmea", 4800, ("HDT",))
    assert vehicle.position.driver == "ubx"
    assert (vehicle.rudder.driver, vehicle.rudder.options.id) == ("volz", 3)
    assert vehicle.link_urls == ("udpout:127.0.0.1:14550",)
    assert vehicle.hull.length_m == 3.05
    assert vehicle.parameters == {"CTL_K1": 41.0}


def test_parameters_are_also_read_from_their_own_file(write, tmp_path):
    (tmp_path / "boat.param").write_text("CTL_K1 39\nCTL_K2 0.5\n")
    vehicle = load(write(VALID.replace("CTL_K1 = 41", 'file = "boat.param"\nCTL_K1 = 41')))
    assert vehicle.parameters == {"CTL_K1": 41.0, "CTL_K2": 0.5}


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("[compass]", "[compas]", r"'compas' is not known; did you mean 'compass'\?$"),
        ("[rudder]", "[hull2]", "is not known"),
        (
            'driver = "nmea"',
            'driver = "nmae"',
            r"\[compass\] driver 'nmae' is not known; use one of nmea, pni_tcm, mti",
        ),
        ("baud = 4800", "baud = 4800.5", r"\[compass\] baud: 4800.5 is not a whole number"),
        ("baud = 4800", "baud = 299", "out of range; allowed: 300 to"),
        ("baud = 4800", "baud = 12000001", "out of range; allowed: 300 to"),
        ('name = "Ocean Rambler"', f'name = "{"n" * 61}"', r"\[vehicle\] name: expected a text of 1 to 60 characters"),
        ('name = "Ocean Rambler"', 'name = ""', r"\[vehicle\] name: expected a text of 1 to 60 characters"),
        ("CTL_K1 = 41", "file = 5", "expected a text in quotes"),
        ("CTL_K1 = 41", 'file = ""', "expected a text in quotes"),
        ("CTL_K1 = 41", f"CTL_K1 = {1 << 4095}", "CTL_K1: expected a number"),
        ("CTL_K1 = 41", f"CTL_K1 = {1 << 4096}", "'CTL_K1' has too many digits"),
        ("CTL_K1 = 41", f"CTL_K1 = [[{-1 << 4096}]]", "'CTL_K1' has too many digits"),
        ("CTL_K1 = 41", f"{'N' * 61} = {1 << 4096}", "'N{60}' has too many digits"),
        ("CTL_K1 = 41", f'{"N" * 61} = "\\u0001"', "'N{60}' contains characters"),
        ("[rudder]", f"[{'N' * 61}]", "section 'N{60}' is not known"),
        ("id = 3", f"id = 3\n{'n' * 61} = 3", "'n{60}' is not read"),
        ("baud = 4800", 'baud = "4800"', "expected a number"),
        ("baud = 4800", "", r"\[compass\] baud is missing"),
        ("baud = 4800", "boud = 4800", "did you mean 'baud'"),
        ('driver = "nmea"', "", r"\[compass\] driver is missing; use one of nmea, pni_tcm, mti"),
        ('driver = "nmea"', "driver = 5", r"\[compass\] driver '5' is not known; use one of nmea"),
        ('["HDT"]', '["HDX"]', r"\[compass\] sentences: 'HDX' is not known; use one of HDG, HDT, HDM"),
        ('["HDT"]', '"HDT"', r"\[compass\] sentences: expected a list of texts"),
        ("id = 3", "id = 300", r"\[rudder\] id: 300 is out of range; allowed: 1 to 30"),
        ("id = 3", "id = 0", r"\[rudder\] id: 0 is out of range; allowed: 1 to 30"),
        ("id = 3", "id = true", "expected a number"),
        ("length_m = 3.05", "length_m = nan", r"\[hull\] length_m"),
        ("length_m = 3.05", "length_m = 1e300", "out of range"),
        ("CTL_K1 = 41", "CTL_KK = 41", r"unknown parameter 'CTL_KK'; near it"),
        ("CTL_K1 = 41", "CTL_K1 = 1e300", "out of range"),
        ("CTL_K1 = 41", 'CTL_K1 = "x"', "expected a number"),
        ("CTL_K1 = 41", "CTL_K1 = 1" + "0" * 400, "CTL_K1: expected a number"),
        ("baud = 4800", "baud = 1" + "0" * 400, r"\[compass\] baud: expected a number from 300"),
        ("CTL_K1 = 41", 'file = "none.param"', "cannot be read"),
        ("CTL_K1 = 41", 'file = "a\\u0000"', "'file' contains characters that cannot be printed: 'a.x00'"),
        ("CTL_K1 = 41", 'file = "\\u0010"', "'file' contains characters that cannot be printed"),
        ("CTL_K1 = 41", "CTL_K1 = 1" + "0" * 5000, "not valid TOML"),
        ("CTL_K1 = 41", "CTL_K1 = " + "[" * 3000, "nested too deeply"),
        ("CTL_K1 = 41", "C" * 5000 + " = 41", r"unknown parameter 'C{30}'; near it"),
        ('port = "/dev/ttyUSB2"', 'port = "udp:10110"', r"\[rudder\] port: driver volz writes to its device and needs"),
        (
            'port = "/dev/ttyUSB2"',
            'port = "pwm:/sys/class/pwm/pwmchip0/0"',
            r"port: driver volz needs a serial port",
        ),
        ('driver = "volz"', 'driver = "pwm"', r"\[rudder\] port: driver pwm needs a PWM output, as pwm:/sys"),
        *(('urls = ["udpout:127.0.0.1:14550"]', f"urls = {urls}", r"\[link\] urls") for urls in ("5", "[5]", '[""]')),
        ('name = "Ocean Rambler"', "name = 5", r"\[vehicle\] name"),
        ('[vehicle]\nname = "Ocean Rambler"', "vehicle = 5", "must be a section"),
        ("[vehicle]", "[vehicle", "not valid TOML"),
        ('["HDT"]', '["HDT"]\nrate_hz = 20', r"\[compass\] 'rate_hz' is not read by driver nmea, which has sentences,"),
        ('["HDT"]', '["HDT"]\nsentence = "HDT"', r"require_checksum; did you mean 'sentences'\?"),
        ('driver = "nmea"', 'driver = "pni_tcm"', "'sentences' is not read by driver pni_tcm, which has rate_hz"),
        ("baud = 9600", "baud = 9600\nrequire_checksum = false", "driver ubx, which has no option of its own"),
        ("id = 3", "id = 3\nslew_rad_s = 1.0", r"\[rudder\] 'slew_rad_s' is not read by driver volz, which has id"),
    ],
)
def test_problem_of_an_invalid_file_is_one_line(write, old, new, problem):
    assert old in VALID
    path = write(VALID.replace(old, new, 1))
    with pytest.raises(VehicleError, match=problem) as raised:
        load(path)
    assert "\n" not in str(raised.value)
    assert "boat.toml" in str(raised.value)


HULL = {
    "length_m": (0.1, 1000.0), "beam_m": (0.01, 200.0), "draft_m": (0.01, 50.0), "block_coefficient": (0.05, 1.0),
    "mass_kg": (0.1, 1e9),
}  # fmt: skip


@pytest.mark.parametrize("name", HULL)
def test_hull_has_limits(write, name):
    low, high = HULL[name]
    for value in (low, high):
        assert getattr(load(write(VALID.replace("length_m = 3.05", f"{name} = {value!r}"))).hull, name) == value
    for value in (0.99 * low, 1.01 * high):
        with pytest.raises(VehicleError, match="out of range"):
            load(write(VALID.replace("length_m = 3.05", f"{name} = {value!r}")))


@pytest.mark.parametrize(("old", "new"), [("4800", "300"), ("4800", "12000000"), ("Ocean Rambler", "n" * 60)])
def test_values_at_their_limits_are_accepted(write, old, new):
    load(write(VALID.replace(old, new)))


def test_file_has_at_most_one_mebibyte(write):
    content = VALID + "#" * ((1 << 20) - len(VALID))
    load(write(content))
    with pytest.raises(VehicleError, match="cannot be read"):
        load(write(content + "#"))


def test_missing_and_unreadable_files_are_reported(tmp_path):
    with pytest.raises(VehicleError, match="no such vehicle file"):
        load(tmp_path / "none.toml")
    with pytest.raises(VehicleError, match="cannot be read"):
        load(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VehicleError, match="cannot be read"):
        load(tmp_path / "binary.toml")


@pytest.mark.parametrize(
    ("section", "name"),
    [
        (section, name)
        for section, drivers in SECTIONS.items()
        for name, driver in drivers.items()
        if section != "compass" or driver.has_north
    ],
)
def test_drivers_of_the_registry_are_known_and_have_defaults(write, section, name):
    port = f"{SECTIONS[section][name].port}/dev/x"
    entry = f'[{section}]\ndriver = "{name}"\nport = "{port}"\nbaud = 9600\n'
    others = {
        "compass": '[compass]\ndriver = "nmea"\nport = "/dev/c"\nbaud = 4800\n',
        "rudder": '[rudder]\ndriver = "volz"\nport = "/dev/r"\nbaud = 115200\n',
    }
    vehicle = load(write("\n".join({**others, section: entry}.values())))
    assert getattr(vehicle, section) == DeviceEntry(name, port, 9600, SECTIONS[section][name].options())


@pytest.mark.parametrize("name", ["ocean_rambler.toml", "shared_port_volz.toml"])
def test_examples_are_valid_and_accept_only_local_connections(name):
    vehicle = load(ROOT / "params" / name)
    assert vehicle.compass.port
    urls = [parse_url(url) for url in vehicle.link_urls]
    assert all(url.host == "127.0.0.1" for url in urls if url.kind in ("udpin", "tcpin"))


@pytest.mark.parametrize(
    "driver", [driver for drivers in SECTIONS.values() for driver in drivers.values()], ids=lambda driver: driver.device
)
def test_options_have_a_description(driver):
    for name, meaning in meanings(driver.options).items():
        assert meaning.text, name


def test_all_problems_are_reported_with_their_location(write, tmp_path):
    (tmp_path / "boat.param").write_text("CTL_K1 1e9\nCTL_KK 1\n")
    replacements = {
        'name = "Ocean Rambler"': "name = 5",
        "baud = 4800": "baud = 1\nparity = 0",
        '["HDT"]': '["HDX"]',
        'port = "/dev/ttyUSB1"': "",
        "id = 3": "id = 300\nslew = 1",
        'urls = ["udpout:127.0.0.1:14550"]': "urls = 5\nurl = 6",
        "length_m = 3.05": "length_m = nan\nbeam_m = 1e300\nlenght_m = 1",
        "CTL_K1 = 41": 'CTL_K1 = 1e300\nCTL_KK = 1\nCTL_K2 = true\nfile = "boat.param"',
    }
    text = VALID
    for old, new in replacements.items():
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(VehicleError) as raised:
        load(write(text + "[hulls]\n"))
    lines = str(raised.value).splitlines()
    locations = (
        *("section 'hulls'", "[vehicle] name", "[compass] 'parity'", "[compass] baud", "[compass] sentences"),
        *("[rudder] 'slew'", "[rudder] id", "[position] port is missing", "[hull] 'lenght_m'", "[hull] length_m"),
        *("[hull] beam_m", "[link] 'url'", "[link] urls", "boat.param:1: CTL_K1", "boat.param:2: unknown"),
        *("[parameters] CTL_K1", "[parameters] unknown parameter 'CTL_KK'", "[parameters] CTL_K2"),
    )
    for location in locations:
        assert sum(location in line for line in lines) == 1, (location, lines)
    assert len(lines) == len(locations)
    assert all(str(tmp_path) in line for line in lines)


def test_missing_key_is_not_reported_beside_an_unknown_one(write):
    with pytest.raises(VehicleError) as raised:
        load(write(VALID.replace("[compass]", "[compas]").replace("baud = 115200", "boud = 115200")))
    assert len(str(raised.value).splitlines()) == 2


def test_number_of_reported_problems_is_limited(write):
    text = VALID + "".join(f"NONE_{number} = 1\n" for number in range(2000))
    with pytest.raises(VehicleError) as raised:
        load(write(text))
    assert len(str(raised.value).splitlines()) == MAX_PROBLEMS


GYROSCOPE = 'driver = "bno08x_rvc"\nport = "/dev/ttyUSB3"\nbaud = 115200\n'


def test_gyroscope_without_north_is_the_second_compass_and_never_the_first(write):
    vehicle = load(write(f"{VALID}[compass_b]\n{GYROSCOPE}clockwise = false\n"))
    assert (vehicle.compass.driver, vehicle.compass_b.driver) == ("nmea", "bno08x_rvc")
    assert vehicle.compass_b.options.clockwise is False
    compass = VALID[VALID.index("[compass]") : VALID.index("[position]")]
    for second in ("", compass.replace("[compass]", "[compass_b]")):
        path = write(VALID.replace(compass, f"[compass]\n{GYROSCOPE}") + second)
        with pytest.raises(VehicleError) as raised:
            load(path)
        assert str(raised.value) == (
            f"{path}: [compass] driver bno08x_rvc knows no north, and its heading drifts; put it into [compass_b],"
            " where its yaw rate is used, and a compass with north into [compass]"
        )


def test_pwm_output_needs_no_baud_rate_and_the_rudder_angle_sensor_may_share_a_port(write):
    rudder = '[rudder]\ndriver = "pwm"\nport = "pwm:/sys/class/pwm/pwmchip0/1"\ncentre_us = 1480\n'
    sensor = '[rudder_angle]\ndriver = "nmea"\nport = "/dev/c"\nbaud = 4800\noffset_deg = -2\n'
    compass = '[compass]\ndriver = "nmea"\nport = "/dev/c"\nbaud = 4800\n'
    vehicle = load(write(compass + rudder + sensor))
    assert (vehicle.rudder.port, vehicle.rudder.options.centre_us) == ("pwm:/sys/class/pwm/pwmchip0/1", 1480.0)
    assert vehicle.rudder_angle is not None
    assert vehicle.rudder_angle.options.offset_deg == -2.0


def boat(**sections: str) -> str:
    """Return a vehicle file of an NMEA compass on /dev/c, a servo on /dev/r, and these sections."""
    texts = {
        "compass": 'driver = "nmea"\nport = "/dev/c"\nbaud = 4800\n',
        "rudder": 'driver = "volz"\nport = "/dev/r"\nbaud = 115200\n',
    }
    return "".join(f"[{name}]\n{text}\n" for name, text in (texts | sections).items())


NMEA2000 = 'driver = "nmea2000"\nport = "/dev/c"\nbaud = 115200\n'


@pytest.mark.parametrize(
    ("sections", "expected"),
    [
        (
            {"rudder": 'driver = "volz"\nport = "/dev/c"\nbaud = 4800'},
            "[rudder] port: /dev/c is the port of [compass]; [rudder] needs a port of its own",
        ),
        (
            {"rudder_angle": 'driver = "nmea"\nport = "/dev/r"\nbaud = 115200'},
            "[rudder_angle] port: /dev/r is the port of [rudder]; [rudder] needs a port of its own",
        ),
        (
            {"power_b": 'driver = "vedirect"\nport = "/dev/c"\nbaud = 4800'},
            "[power_b] port: /dev/c is the port of [compass]; [power_b] needs a port of its own",
        ),
        (
            {"wind": 'driver = "nmea"\nport = "/dev/c"\nbaud = 38400'},
            "[wind] baud: 38400 is not the 4800 of [compass] on the same port; correct one of them",
        ),
        (
            {"compass": NMEA2000.replace("nmea2000", "witmotion"), "wind": NMEA2000.replace("nmea2000", "nmea")},
            "[wind] driver: nmea cannot share /dev/c with driver witmotion of [compass]; name another port",
        ),
        (
            {"power": 'driver = "mavlink"\nport = "/dev/c"\nbaud = 4800'},
            "[power] driver: mavlink cannot share /dev/c with driver nmea of [compass]; name another port",
        ),
        (
            {"compass": NMEA2000, "compass_b": NMEA2000},
            "[compass_b] reads the same device as [compass]; name another port, or options that select another device",
        ),
        (
            {"link": 'urls = ["serial:/dev/r:57600?signed=yes"]'},
            "[link] serial:/dev/r:57600?signed=yes: /dev/r is the port of [rudder]; name another port",
        ),
        ({"link": 'urls = ["sbd:/dev/c"]'}, "[link] sbd:/dev/c: /dev/c is the port of [compass]; name another port"),
        (
            {"link": 'urls = ["nmea:serial:/dev/c:4800"]'},
            "[link] nmea:serial:/dev/c:4800: /dev/c is the port of [compass]; name another port",
        ),
    ],
)
def test_sections_that_cannot_share_a_port_are_refused(write, sections, expected):
    path = write(boat(**sections))
    with pytest.raises(VehicleError) as raised:
        load(path)
    assert str(raised.value) == f"{path}: {expected}"


@pytest.mark.parametrize(
    "sections",
    [
        {"compass": NMEA2000 + "source = 0x23\n", "compass_b": NMEA2000 + "source = 0x24\n", "wind": NMEA2000},
        {
            "position": 'driver = "ubx"\nport = "/dev/c"\nbaud = 4800',
            "power": 'driver = "vedirect"\nport = "/dev/p"\nbaud = 19200',
        },
        {"compass": 'driver = "nmea"\nport = "udp:1000"', "wind": 'driver = "nmea"\nport = "udp:1000"\nbaud = 4800'},
        {
            "power": 'driver = "vedirect"\nport = "/dev/p"\nbaud = 19200',
            "power_b": 'driver = "vedirect"\nport = "/dev/q"\nbaud = 19200',
        },
        {"link": 'urls = ["serial:/dev/s:57600", "udpout:/dev/c:14550", "nmea:serial:/dev/t:4800", "serial"]'},
    ],
)
def test_sections_that_can_share_a_port_and_those_on_other_ports_are_accepted(write, sections):
    load(write(boat(**sections)))


@pytest.mark.parametrize(
    ("section", "text", "expected"),
    [
        ("wind", 'driver = "nmea"\nport = "can:can0"', "driver nmea reads no CAN bus; use driver nmea2000"),
        ("power", 'driver = "vedirect"\nport = "can:can0"', "driver vedirect reads no CAN bus; it needs a serial port"),
        (
            "wind",
            'driver = "nmea2000"\nport = "can0"',
            "'can0' is neither the path of a serial port nor one of udp:PORT,",
        ),
        ("wind", 'driver = "nmea"\nport = "udpin:0.0.0.0:99"', "'udpin:0.0.0.0:99' is neither the path of a serial"),
    ],
)
def test_port_of_the_wrong_kind_names_the_right_one(write, section, text, expected):
    path = write(boat(**{section: text}))
    with pytest.raises(VehicleError) as raised:
        load(path)
    assert str(raised.value).startswith(f"{path}: [{section}] port: {expected}")


@pytest.mark.parametrize("section", ["compass", "compass_b", "position", "rudder_angle", "ais", "wind", "depth"])
def test_devices_of_nmea_2000_may_have_a_can_port(write, section):
    assert load(write(boat(**{section: 'driver = "nmea2000"\nport = "can:can0"'})))


def test_placeholder_in_several_sections_is_no_shared_port(tmp_path):
    """The simulator replaces the ports of a vehicle file; many files have the same word in all of them."""
    device = 'port = "given by the simulator"\nbaud = 9600\n'
    path = tmp_path / "boat.toml"
    path.write_text(f'[compass]\ndriver = "nmea"\n{device}[rudder]\ndriver = "volz"\n{device}')
    assert load(path).rudder.port == "given by the simulator"
