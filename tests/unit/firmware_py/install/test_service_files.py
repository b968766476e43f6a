"""The files of the service and their installation."""

import fnmatch
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py.__main__ import main
from firmware_py.cli.example import FILE_NAMES
from firmware_py.cli.run import EXIT_SHUT_DOWN
from firmware_py.install.service_files import (
    STATE,
    Page,
    Service,
    build_page_unit,
    build_unit,
    example,
    is_hidden,
    service_files,
)
from firmware_py.install.steps import InstallError, check_service
from firmware_py.vehicle import load
from support.paths import ROOT
from support.service_manager import parse, seconds, words

RETRY_DELAY_S = 5.0
DEVICES_S = 30.0
WATCHDOG_INTERVAL_S = 1.0
TIMEOUT_S = 15

ANALYZE = shutil.which("systemd-analyze")
MAX_EXPOSURE = 3.0
SERVICE = Service((sys.executable, "-m", "firmware_py"), Path("/etc/rambler/boat.toml"))
REMOTE_PAGE = Page("0.0.0.0:8046", Path("/etc/rambler/view%.token"))


@pytest.fixture(params=["rambler", "rambler-view"])
def unit_file(tmp_path, request):
    path = tmp_path / f"{request.param}.service"
    path.write_text(build_unit(SERVICE) if request.param == "rambler" else build_page_unit(SERVICE, REMOTE_PAGE))
    return path


def test_unit_restarts_without_limit_except_after_shut_down():
    unit = parse(build_unit(SERVICE))
    service = unit["Service"]
    assert (service["Type"], service["Restart"], unit["Unit"]["StartLimitIntervalSec"]) == ("notify", "always", "0")
    assert service["RestartPreventExitStatus"] == service["SuccessExitStatus"] == str(EXIT_SHUT_DOWN)
    assert unit["Install"]["WantedBy"] == "multi-user.target"
    # Two notifications may be lost, also at the lowest rate of the loop.
    assert seconds(service["WatchdogSec"]) > 2.0 * (WATCHDOG_INTERVAL_S + 1.0)
    assert seconds(service["RestartSec"]) < RETRY_DELAY_S
    assert words(service["ExecStart"])[-5:] == ["run", "/etc/rambler/boat.toml", "--state", str(STATE), "--wait"]


@pytest.mark.parametrize("word", ["plain", "with space", 'a"quote', "per%cent", "dol$lar", "back\\slash", "semi;colon"])
def test_command_is_quoted_for_systemd(word):
    text = build_unit(Service(("/opt/rambler",), Path("/etc") / word, Path("/srv") / word, Path("/dev/watchdog")))
    settings = parse(text)["Service"]
    assert words(settings["ExecStart"])[2] == f"/etc/{word}"
    assert "DeviceAllow=/dev/watchdog rw\n" in text
    (writable,) = words(settings["ReadWritePaths"].replace("$", "$$"))  # dollars are not escaped in paths
    assert writable.removeprefix("-") == f"/srv/{word}"
    assert settings["ReadWritePaths"].lstrip('"').startswith("-/")  # the directory may be missing


def test_optional_settings_are_absent_by_default():
    text = build_unit(SERVICE)
    assert "watchdog" not in text.lower().replace("watchdogsec", "")
    assert "ReadWritePaths" not in text
    assert "@COMMAND@" not in text
    assert "ReadWritePaths" not in build_unit(Service(("/x",), Path("/y"), STATE / "disk"))


@pytest.mark.parametrize("driver", ["ttyS", "ttyAMA", "ttyUSB", "ttyACM", "ttySC", "ttymxc", "ttySTM", "ttyTHS"])
def test_device_access_covers_serial_ports_only(driver):
    """Names of /proc/devices, matched as in DeviceAllow of systemd.resource-control(5)."""
    allowed = re.findall(r"^DeviceAllow=char-(\S+) rw$", build_unit(SERVICE), re.MULTILINE)
    assert any(fnmatch.fnmatchcase(driver, pattern) for pattern in allowed)
    for other in ("tty", "/dev/tty", "mem", "i2c", "spi", "hidraw", "input"):
        assert not any(fnmatch.fnmatchcase(other, pattern) for pattern in allowed)


def analyze(*arguments):
    if ANALYZE is None:
        pytest.skip("systemd-analyze is not installed (apt-get install systemd)")
    return subprocess.run([ANALYZE, *arguments], capture_output=True, text=True, check=False, timeout=60)


def test_systemd_verifies_the_unit(unit_file):
    result = analyze("verify", "--man=no", str(unit_file))
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_exposure_is_below_3(unit_file):
    result = analyze("security", "--offline=true", "--no-pager", str(unit_file))
    exposure = float(re.search(rf"Overall exposure level for {unit_file.name}: ([0-9.]+)", result.stdout)[1])
    assert exposure < MAX_EXPOSURE


def test_manual_matches_the_unit():
    page = " ".join((ROOT / "docs/how-to/installation.md").read_text().split())
    service = parse(build_unit(SERVICE))["Service"]
    assert f"After {service['WatchdogSec']} s without a message" in page
    assert f"tried again every {RETRY_DELAY_S:.0f} s" in page
    assert f"| {DEVICES_S:.0f} to " in page
    assert f"{TIMEOUT_S} s, with `--watchdog`" in page


def test_device_names_match_sockets():
    rules = next(file.text for file in service_files(SERVICE) if file.path.suffix == ".rules")
    lines = [line for line in rules.splitlines() if line and not line.startswith("#")]
    assert any('SYMLINK+="rambler/usb-%b"' in line and "bInterfaceNumber" in line for line in lines)
    for line in lines:
        for part in line.split(", "):
            assert re.fullmatch(r'[A-Z]+(\{\w+\})?(==|=|\+=)"[^"]*"', part), part


def test_other_programs_cannot_open_serial_ports():
    (file,) = (file for file in service_files(SERVICE) if file.path.suffix == ".rules")
    assert file.path.name > "90-brltty"  # gpsd has 60, ModemManager 77 to 80, brltty 85 or 90
    (ports,) = (line for line in file.text.splitlines() if "ID_MM_PORT_IGNORE" in line)
    assert 'KERNEL=="tty[a-zA-Z]*"' in ports  # ttyUSB0, ttyACM0, ttyS1, ttyAMA0; no tty1
    assert "usb" not in ports
    assert 'ENV{SYSTEMD_WANTS}=""' in ports
    (adapters,) = (line for line in file.text.splitlines() if "BRLTTY" in line)
    assert 'ENV{DEVTYPE}=="usb_device"' in adapters
    assert 'ENV{SYSTEMD_WANTS}=""' in adapters
    assert {"0403", "067b", "10c4", "1a86"} <= set(re.findall("[0-9a-f]{4}", adapters))


@pytest.mark.parametrize(
    ("path", "expected"),
    [("/home/pi/boat.toml", True), ("/root", True), ("/tmp/x", True), ("/etc/rambler/boat.toml", False)],
)
def test_home_and_temporary_directories_are_hidden_from_the_service(path, expected):
    assert is_hidden(Path(path)) is expected


def test_examples_and_pages_are_packaged():
    for name in ("REFERENCE.md", "FAULTS.md", "MESSAGES.md", "TEXTS.md", *FILE_NAMES.values()):
        assert example(name).is_file()
    with pytest.raises(FileNotFoundError, match=r"\[Errno 2\] is missing"):
        example("missing")


@pytest.mark.parametrize("kind", FILE_NAMES)
def test_example_is_a_vehicle_file_and_never_overwrites(tmp_path, kind, capsys):
    path = tmp_path / "new" / "boat.toml"
    assert main(["example", str(path), "--kind", kind]) == 0
    assert load(path).compass.driver
    content = path.read_text()
    assert main(["example", str(path), "--kind", "shared-port"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert path.read_text() == content


def test_example_has_no_active_settings_of_one_boat(tmp_path, capsys):
    for kind in FILE_NAMES:
        path = tmp_path / kind
        assert main(["example", str(path), "--kind", kind]) == 0
        vehicle = load(path)
        assert vehicle.parameters == {}
        assert vehicle.link_urls == ("udpin:127.0.0.1:14550",)
        for device in (vehicle.compass, vehicle.position, vehicle.rudder):
            assert re.fullmatch("/dev/serial/by-path/[A-Z]+", device.port)
    assert {path.name for path in tmp_path.iterdir()} == set(FILE_NAMES)
    assert main(["example", str(tmp_path)]) == 2
    assert "is a directory; give a file name" in capsys.readouterr().err


@pytest.fixture
def image(tmp_path, monkeypatch):
    """Return the root of a system image, and a function that returns the commands called."""
    root = tmp_path / "image"
    (root / "etc/rambler").mkdir(parents=True)
    assert main(["example", str(root / "etc/rambler/boat.toml")]) == 0
    (root / "usr/lib/systemd").mkdir(parents=True)
    (root / "usr/lib/systemd/systemd").touch()
    calls = tmp_path / "called"
    (programs := tmp_path / "bin").mkdir()
    for name in ("systemctl", "systemd-sysusers"):
        (programs / name).write_text(f'#!/bin/sh\necho "{name} $*" >>{shlex.quote(str(calls))}\n')
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    return root, lambda: calls.read_text().splitlines() if calls.exists() else []


def install(root, *arguments):
    options = ["--root", str(root), "--program", "/opt/rambler/x", *arguments]
    return main(["service", "install", "/etc/rambler/boat.toml", *options])


def test_install_in_image_is_idempotent_and_removable(image, capsys):
    root, calls = image
    previous_umask = os.umask(0o077)
    assert install(root) == 0
    os.umask(previous_umask)
    assert calls() == [f"systemd-sysusers --root={root}", f"systemctl --root={root} --quiet enable rambler"]
    files = [root / file.path.relative_to("/") for file in service_files(SERVICE)]
    assert all(path.stat().st_mode & 0o777 == 0o644 for path in files)
    assert "ExecStart=/opt/rambler/x run /etc/rambler/boat.toml" in files[0].read_text()
    capsys.readouterr()
    assert install(root) == 0
    assert capsys.readouterr().out.count("unchanged ") == len(files)
    assert install(root, "--state", "/srv/state") == 0
    assert "wrote /etc/systemd/system/rambler.service" in capsys.readouterr().out
    assert main(["service", "remove", "--root", str(root)]) == 0
    assert not any(path.exists() for path in files)
    assert (root / "etc/rambler/boat.toml").exists()
    assert main(["service", "remove", "--root", str(root)]) == 0
    assert "not installed" in capsys.readouterr().out


def test_live_page_has_its_own_service(image, capsys):
    root, calls = image
    page = root / "etc/systemd/system/rambler-view.service"
    assert install(root) == 0
    assert not page.exists()
    assert install(root, "--view") == 0
    assert calls()[-1] == f"systemctl --root={root} --quiet enable rambler rambler-view"
    settings = parse(page.read_text())["Service"]
    command = ["/opt/rambler/x", "view", "--state", str(STATE), "--listen", "127.0.0.1:8046"]
    assert words(settings["ExecStart"]) == command
    assert "LoadCredential" not in settings
    (root / "etc/rambler/view.token").write_text("0123456789abcdef\n")
    assert install(root, "--view", "0.0.0.0:80", "--view-token", "/etc/rambler/view.token") == 0
    settings = parse(page.read_text())["Service"]
    assert settings["ExecStart"].endswith(" --listen 0.0.0.0:80 --token %d/token")
    assert settings["LoadCredential"] == "token:/etc/rambler/view.token"
    assert "@" not in page.read_text().replace("@system-service", "").replace("@privileged", "")
    assert install(root) == 0
    assert page.exists()
    capsys.readouterr()
    assert main(["service", "remove", "--root", str(root)]) == 0
    assert calls()[-1] == f"systemctl --root={root} --quiet disable rambler rambler-view"
    assert not page.exists()


def test_page_token_is_passed_by_systemd():
    text = build_page_unit(SERVICE, REMOTE_PAGE)
    assert "LoadCredential=token:/etc/rambler/view%%.token\n" in text
    assert text.count("@COMMAND@") == text.count("@CREDENTIAL@") == 0


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (["--view", "0.0.0.0:8046"], "needs a token"),
        (["--view", "nowhere"], "ADDRESS:PORT"),
        (["--view-token", "/etc/rambler/view.token"], "needs --view"),
        (["--view", "0.0.0.0:8046", "--view-token", "/etc/rambler/none.token"], "create it"),
        (["--state", "/home/pi/state"], "omit --state"),
        (["--program", "/root/rambler"], "/etc or /opt"),
        (["--root", "/nowhere/at/all"], "no such directory"),
    ],
)
def test_invalid_arguments_are_refused_and_change_nothing(image, capsys, arguments, remedy):
    root, calls = image
    assert install(root, *arguments) == 2
    output = capsys.readouterr().err
    assert output.count("\n") == 1
    assert remedy in output
    assert calls() == []
    assert not (root / "etc/systemd").exists()


@pytest.mark.parametrize("missing", ["systemctl", "systemd-sysusers"])
def test_missing_systemd_program_prevents_installation(image, capsys, monkeypatch, missing):
    """Otherwise files would be written that `remove` cannot delete, as on Alpine."""
    root, calls = image
    (root.parent / "bin" / missing).unlink()
    monkeypatch.setenv("PATH", str(root.parent / "bin"))
    assert install(root) == 2
    assert f"{missing} not found" in capsys.readouterr().err
    assert not (root / "etc/systemd").exists()
    assert calls() == []


def fail(path):
    path.write_text("#!/bin/sh\necho 'no such unit' >&2\nexit 1\n")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda root: (root / "usr/lib/systemd/systemd").unlink(), "no systemd found"),
        (lambda root: (root / "etc/rambler/boat.toml").write_text("nonsense = 1\n"), "boat.toml"),
        (lambda root: fail(root.parent / "bin/systemctl"), "no such unit"),
    ],
    ids=["no systemd", "wrong vehicle file", "failing program"],
)
def test_failed_installation_names_the_reason(image, capsys, change, text):
    root, _ = image
    change(root)
    assert install(root) == 2
    assert text in capsys.readouterr().err
    assert (root / "etc/systemd").exists() == (text == "no such unit")


def test_systemd_must_run_except_in_a_chroot(image, tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_py.install.steps._SYSTEMD_RUNTIME", tmp_path / "none")
    monkeypatch.setattr("firmware_py.install.steps._INIT_ROOT", Path("/"))
    with pytest.raises(InstallError, match="systemd does not run"):
        check_service(SERVICE, Path("/"))
    monkeypatch.setattr("firmware_py.install.steps._INIT_ROOT", tmp_path)
    with pytest.raises(InstallError, match=r"vehicle file .* cannot read"):
        check_service(SERVICE, Path("/"))


def test_only_root_changes_the_system(monkeypatch, capsys):
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    for arguments in (["install", "/etc/rambler/boat.toml"], ["remove"]):
        assert main(["service", *arguments]) == 2
        assert "sudo" in capsys.readouterr().err
