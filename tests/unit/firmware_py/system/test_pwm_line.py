"""PWM output on a directory that imitates sysfs."""

import errno
import os

import pytest

from firmware_py.system import pwm_line
from firmware_py.system.pwm_line import PwmLine
from firmware_py.system.serial_port import PortError


class Chip:
    """A PWM chip as a directory; `export` creates the channel, as the kernel does at once."""

    def __init__(self, path):
        self.path, self.channel = path, path / "pwm0"
        path.mkdir()
        (path / "export").touch()
        (path / "unexport").touch()

    def create_channel(self, **values):
        self.channel.mkdir()
        for name, text in ({"period": "0", "duty_cycle": "0", "enable": "0", "polarity": "normal"} | values).items():
            (self.channel / name).write_text(f"{text}\n")

    def read(self, name):
        return (self.channel / name).read_text().strip()


@pytest.fixture
def chip(tmp_path):
    return Chip(tmp_path / "pwmchip0")


@pytest.fixture
def writes(monkeypatch):
    """The attributes written, in order, with their texts."""
    writes, write = [], pwm_line._write

    def recorded_write(file, data):
        write(file, data)
        writes.append((file.name, data.decode().strip()))

    monkeypatch.setattr(pwm_line, "_write", recorded_write)
    return writes


def open_line(chip):
    line = PwmLine(f"pwm:{chip.path}/0")
    line.open()
    return line


def test_fresh_channel_gets_its_period_before_the_first_pulse(chip, writes):
    chip.create_channel()
    line = open_line(chip)
    assert (line.connected, line.openings, line.fileno(), line.read()) == (True, 1, -1, b"")
    assert (line.name, line.baud) == (f"pwm:{chip.path}/0", 0)
    assert line.write(b"1500000\n")
    assert line.write(b"1600000\n")
    assert writes == [("period", "20000000"), ("duty_cycle", "1500000"), ("enable", "1"), ("duty_cycle", "1600000")]
    assert line.written == 16


def test_no_pulse_disables_the_output(chip):
    chip.create_channel()
    line = open_line(chip)
    line.write(b"1500000\n")
    assert line.write(b"0\n")
    assert (chip.read("enable"), chip.read("duty_cycle")) == ("0", "0")
    assert line.write(b"1500000\n")
    assert (chip.read("enable"), chip.read("duty_cycle")) == ("1", "1500000")


def test_running_pulse_continues_over_a_restart_of_the_program(chip, writes):
    chip.create_channel(period="20000000", duty_cycle="1400000", enable="1")
    line = open_line(chip)
    assert writes == []
    line.close()
    assert not line.connected
    assert (chip.read("enable"), chip.read("duty_cycle")) == ("1", "1400000")
    assert not line.write(b"1500000\n")


def test_other_period_is_replaced_without_a_pulse(chip, writes):
    """The kernel refuses a period that is shorter than the pulse."""
    chip.create_channel(period="50000000", duty_cycle="25000000", enable="1")
    open_line(chip)
    assert writes == [("duty_cycle", "0"), ("period", "20000000")]


def test_inverted_output_is_disabled_and_made_normal(chip, writes):
    chip.create_channel(period="20000000", polarity="inversed", enable="1")
    open_line(chip)
    assert writes == [("enable", "0"), ("polarity", "normal")]


def test_chip_without_polarity_is_used(chip):
    chip.create_channel()
    (chip.channel / "polarity").unlink()
    assert open_line(chip).connected


def test_channel_is_exported_and_opened_once_it_exists(chip):
    line = PwmLine(f"pwm:{chip.path}/0")
    with pytest.raises(PortError, match="no such file or directory; the channel does not exist"):
        line.open()
    assert (chip.path / "export").read_text() == "0"
    assert line.reopen(10.0) == ""
    assert not line.connected
    chip.create_channel()
    line.reopen(10.9)  # at most once a second
    assert not line.connected
    line.reopen(11.0)
    assert line.connected


def test_channel_that_udev_has_not_released_yet_is_opened_later(chip, monkeypatch):
    """At the export the files belong to root; udev changes their group some milliseconds later."""
    write = pwm_line._write

    def export(file, data):
        if file.name == "export":
            chip.create_channel()
        elif not is_released:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        write(file, data)

    is_released = False
    monkeypatch.setattr(pwm_line, "_write", export)
    line = PwmLine(f"pwm:{chip.path}/0")
    line.open()
    assert not line.connected
    with pytest.raises(PortError, match=r"permission denied.*udev"):
        line.open()  # the second time it is an error
    is_released = True
    line.reopen(1.0)
    assert line.connected


def test_lost_chip_is_noticed_and_opened_again(chip):
    chip.create_channel(period="20000000")
    line = PwmLine(f"pwm:{chip.path}/0")
    line.reopen(0.0)
    line.write(b"1500000\n")
    for file in chip.channel.iterdir():
        file.unlink()
    chip.channel.rmdir()
    assert not line.write(b"1600000\n")
    assert not line.connected
    chip.create_channel()
    line.reopen(5.0)
    assert (line.connected, line.openings, line.written) == (True, 2, 0)
    assert line.write(b"1700000\n")
    assert (chip.read("duty_cycle"), chip.read("enable")) == ("1700000", "1")


@pytest.mark.parametrize(
    "data", [b"", b"\n", b"001500000\n", b"1500000", b"-5\n", b"1e6\n", b" 15\n", b"3000001\n", b"999999999\n"]
)
def test_invalid_pulse_widths_are_refused(chip, data):
    chip.create_channel(period="20000000", duty_cycle="7")
    line = open_line(chip)
    assert not line.write(data)
    assert line.connected
    assert chip.read("duty_cycle") == "7"


def test_longest_pulse_is_accepted(chip):
    chip.create_channel(period="20000000")
    line = open_line(chip)
    assert line.written == 0
    assert line.write(b"3000000\n")
    assert line.write(b"03000000\n")


@pytest.mark.parametrize("name", ["pwm:", "pwm:0", "pwm:pwmchip0/0", "pwm:/sys/class/pwm/pwmchip0", "pwm:/x/1000"])
def test_invalid_names_are_refused(name):
    with pytest.raises(PortError, match="write pwm:CHIP/CHANNEL, as in pwm:/sys/class/pwm/pwmchip0/0"):
        PwmLine(name).open()


def test_missing_chip_is_explained(tmp_path):
    with pytest.raises(PortError, match="no such PWM chip; load its overlay"):
        PwmLine(f"pwm:{tmp_path}/pwmchip3/999").open()


def test_path_that_cannot_be_looked_up_does_not_end_the_loop():
    """The kernel refuses such a name itself, as it does a path in a directory without permission."""
    line = PwmLine(f"pwm:/{'a' * 300}/0")
    with pytest.raises(PortError, match="no such PWM chip"):
        line.open()
    assert line.reopen(1.0) == ""
    assert not line.connected


def test_output_that_systemd_has_made_read_only_is_explained(chip, monkeypatch):
    def refuse(_file, _data):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(pwm_line, "_write", refuse)
    with pytest.raises(PortError, match=r"hidden by the service; add ReadWritePaths=/.*pwmchip0 to its drop-in"):
        open_line(chip)
