import pytest

from firmware_py.vehicle import VehicleError, load

GOOD = """
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
    def made(text):
        path = tmp_path / "boat.toml"
        path.write_text(text)
        return path

    return made


def test_a_good_file_is_read_whole(write):
    vehicle = load(write(GOOD))
    assert vehicle.name == "Ocean Rambler"
    assert (vehicle.compass.driver, vehicle.compass.baud, vehicle.compass.sentences) == ("nmea", 4800, ("HDT",))
    assert vehicle.position.driver == "ubx"
    assert (vehicle.rudder.driver, vehicle.rudder.id) == ("volz", 3)
    assert vehicle.link_urls == ("udpout:127.0.0.1:14550",)
    assert vehicle.hull.length_m == 3.05
    assert vehicle.parameters == {"CTL_K1": 41.0}


def test_parameters_may_stand_in_a_file_of_their_own(write, tmp_path):
    (tmp_path / "boat.param").write_text("CTL_K1 39\nCTL_K2 0.5\n")
    vehicle = load(write(GOOD.replace("CTL_K1 = 41", 'file = "boat.param"\nCTL_K1 = 41')))
    assert vehicle.parameters == {"CTL_K1": 41.0, "CTL_K2": 0.5}


@pytest.mark.parametrize(
    ("old", "new", "remedy"),
    [
        ("[compass]", "[compas]", r"'compas' is not known; did you mean 'compass'"),
        ("[rudder]", "[hull2]", "is not known"),
        ('driver = "nmea"', 'driver = "nmae"', r"\[compass\] driver 'nmae' is not known; there are nmea, pni_tcm"),
        ("baud = 4800", "baud = 4800.5", r"\[compass\] baud: 4800.5 is not a whole number"),
        ("baud = 4800", "baud = 1", "out of range; allowed: 300 to"),
        ("baud = 4800", 'baud = "4800"', "expected a number"),
        ("baud = 4800", "", r"\[compass\] baud is missing"),
        ("baud = 4800", "boud = 4800", "did you mean 'baud'"),
        ("id = 3", "id = 300", "out of range"),
        ("id = 3", "id = true", "expected a number"),
        ("length_m = 3.05", "length_m = nan", r"\[hull\] length_m"),
        ("length_m = 3.05", "length_m = 1e300", "out of range"),
        ("CTL_K1 = 41", "CTL_KK = 41", r"unknown parameter 'CTL_KK'; near it"),
        ("CTL_K1 = 41", "CTL_K1 = 1e300", "out of range"),
        ("CTL_K1 = 41", 'CTL_K1 = "x"', "expected a number"),
        ("CTL_K1 = 41", 'file = "none.param"', "cannot be read"),
        ('urls = ["udpout:127.0.0.1:14550"]', "urls = 5", r"\[link\] urls"),
        ('name = "Ocean Rambler"', "name = 5", r"\[vehicle\] name"),
        ('[vehicle]\nname = "Ocean Rambler"', "vehicle = 5", "must be a section"),
        ("[vehicle]", "[vehicle", "not valid TOML"),
    ],
)
def test_a_wrong_file_is_one_clear_line(write, old, new, remedy):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    with pytest.raises(VehicleError, match=remedy) as caught:
        load(path)
    assert "\n" not in str(caught.value)
    assert "boat.toml" in str(caught.value)


def test_missing_and_unreadable_files_are_one_clear_line(tmp_path):
    with pytest.raises(VehicleError, match="no such vehicle file"):
        load(tmp_path / "none.toml")
    with pytest.raises(VehicleError, match="cannot be read"):
        load(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VehicleError, match="cannot be read"):
        load(tmp_path / "binary.toml")
