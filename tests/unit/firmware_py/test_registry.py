"""Registry of own objects and those of installed packages."""

import sys

import pytest

from firmware_py.common.driver import Driver
from firmware_py.devices import DriverRegistry
from firmware_py.registry import PackageError, Registry, find_unused_entry_points

OWN = {"mti": "firmware_py.sensors.mti:DRIVER", "nmea": "firmware_py.sensors.nmea_compass:DRIVER"}
MODULE = """
from dataclasses import dataclass
from firmware_py.common.driver import Driver
from firmware_py.common.options import option
from firmware_py.devices import NoOptions
class Strange:
    pass
@dataclass
class NeedsOption:
    needed: int = option("an option")
DRIVER = Driver(interface={interface}, device="Acme", options={options}, make=lambda line, options: None)
OTHER = Strange()
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that installs a package with one entry point."""
    monkeypatch.syspath_prepend(tmp_path)

    def install(point, value, package="acme", interface=1, options="NoOptions"):
        module = value.partition(":")[0]
        monkeypatch.delitem(sys.modules, module, raising=False)
        (tmp_path / f"{module}.py").write_text(MODULE.format(interface=interface, options=options))
        (folder := tmp_path / f"{package}-1.2.dist-info").mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
        (folder / "entry_points.txt").write_text(f"[rambler.drivers]\n{point} = {value}\n")

    return install


def registry():
    return Registry("rambler.drivers", "compass", OWN, Driver, 1)


def test_own_objects_are_found_without_a_search(monkeypatch):
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: pytest.fail("searched"))
    assert registry()["mti"].device == "Xsens (Movella) MTi"
    assert "mti" in registry()
    assert registry().package_of("mti") == ""


def test_object_of_a_package_is_found_by_kind_and_name(install):
    install("compass.acme", "acme_module:DRIVER")
    found = registry()
    assert list(found) == ["mti", "nmea", "acme"]
    assert len(found) == 3
    assert found["acme"] is found["acme"]
    assert found["acme"].device == "Acme"
    assert found.package_of("acme") == "acme 1.2"
    assert "acme" not in Registry("rambler.drivers", "rudder", OWN, Driver, 1)


@pytest.mark.parametrize("name", ["none", ""])
def test_unknown_name_raises_key_error(name):
    assert name not in registry()
    with pytest.raises(KeyError):
        registry()[name]


def test_package_cannot_replace_an_own_object(install):
    install("compass.mti", "acme_module:DRIVER")
    assert registry()["mti"].device == "Xsens (Movella) MTi"
    assert list(registry()) == ["mti", "nmea"]


def test_two_packages_with_one_name_are_refused(install):
    install("compass.acme", "acme_module:DRIVER")
    install("compass.acme", "other_module:DRIVER", package="other")
    with pytest.raises(PackageError, match=r"several packages provide compass acme: acme 1.2, other 1.2; remove"):
        registry()["acme"]


@pytest.mark.parametrize(
    ("value", "interface", "text"),
    [
        ("acme_module:MISSING", 1, "package acme 1.2: acme_module:MISSING: AttributeError: module"),
        ("acme_module:OTHER", 1, "package acme 1.2: acme_module:OTHER is not a Driver; update it"),
        ("acme_module:DRIVER", 0, "is for interface version 0, this program has version 1"),
        (
            "acme_module:DRIVER",
            "1 / 0",
            "package acme 1.2: acme_module:DRIVER: ZeroDivisionError: division by zero; correct",
        ),
        ("acme_module:DRIVER", "exit(3)", "package acme 1.2: acme_module:DRIVER: SystemExit: 3"),
    ],
)
def test_unusable_package_is_named_with_the_reason(install, value, interface, text):
    install("compass.acme", value, interface=interface)
    with pytest.raises(PackageError, match=r"acme 1\.2") as caught:
        registry()["acme"]
    assert text in str(caught.value)


def test_option_record_without_defaults_makes_a_driver_unusable(install):
    install("compass.acme", "acme_module:DRIVER", options="NeedsOption")
    drivers = DriverRegistry("compass", 0, (), OWN)
    assert drivers["acme"].problem == "package acme 1.2: option without a default or of another type: needed is missing"
    assert drivers["mti"].problem == ""


def test_drivers_of_packages_are_guarded(install):
    install("compass.acme", "acme_module:DRIVER")
    device = DriverRegistry("compass", 0, (), OWN)["acme"].make(None, None)
    assert type(device).__name__ == "GuardedDevice"


def test_entry_points_that_are_never_used_are_named(install):
    install("kompass.acme", "acme_module:DRIVER")
    install("compass.mti", "other_module:DRIVER", package="other")
    install("compass.good", "good_module:DRIVER", package="good")
    assert sorted(find_unused_entry_points("rambler.drivers", {"compass": registry(), "rudder": registry()})) == [
        "package acme 1.2: kompass.acme is not used; its kind must be one of compass, rudder",
        "package other 1.2: compass.mti is not used; this program has a compass mti",
    ]
