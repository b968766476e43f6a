"""Memory of `rambler run`: OpenSSL and the texts of pymavlink are not loaded; pymavlink is imported before numpy."""

import ctypes
import mmap
import resource
import subprocess
import sys
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from firmware_py import __main__
from support.paths import ROOT

PROGRAM = """
import sys
from pathlib import Path
from firmware_py.__main__ import main
code = main(["run", "none.toml"])
import hashlib
print(code, hashlib.sha256(b"abc").hexdigest()[:8], "libcrypto" in Path("/proc/self/maps").read_text())
from firmware_py.link.wire.frames import Codec, stamp
from firmware_py.link.wire.dialect import mavlink
names = list(sys.modules)
print(names.index("pymavlink") < names.index("numpy"))
# MAV_TYPE, MAV_AUTOPILOT, base_mode, custom_mode, MAV_STATE, version of MAVLink.
codec, message = Codec(1, 1), mavlink.MAVLink_heartbeat_message(11, 3, 0, 15, 4, 3)
frame = stamp(codec.pack(message), 0)
print(codec.decode(frame).custom_mode, len(mavlink.enums), hasattr(mavlink.MAVLink, "heartbeat_encode"))
"""


def test_openssl_is_not_loaded_and_frames_work_without_pymavlink_texts():
    command = [sys.executable, "-c", PROGRAM]
    process = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True, timeout=60)
    assert process.stdout.splitlines() == ["2 ba7816bf False", "True", "15 0 False"], process.stderr


def test_blocks_of_64_kib_and_more_are_returned_to_the_system(monkeypatch):
    calls = []
    library = SimpleNamespace(mallopt=lambda *arguments: calls.append(arguments))
    monkeypatch.setattr(ctypes, "CDLL", lambda _name: library)
    imported = SimpleNamespace()  # by the program that runs this one
    monkeypatch.setitem(sys.modules, "_hashlib", imported)
    __main__._reduce_memory()
    assert sys.modules["_hashlib"] is imported
    assert calls == [(-3, 65_536)]  # M_MMAP_THRESHOLD of mallopt(3)


@pytest.mark.parametrize("limits", [(1 << 30, resource.RLIM_INFINITY), (resource.RLIM_INFINITY, 1 << 30)])
def test_memory_limit_below_the_library_of_numpy_is_out_of_memory(limits, monkeypatch):
    """Only the soft limit applies; the library and its buffer need 80 MiB."""
    sizes = []

    def refuse(_descriptor, size, **_options):
        sizes.append(size)
        raise OSError

    monkeypatch.setattr(mmap, "mmap", refuse)
    monkeypatch.setattr(resource, "getrlimit", lambda _kind: limits)
    with nullcontext() if limits[0] == resource.RLIM_INFINITY else pytest.raises(MemoryError):
        __main__._check_memory_limit()
    assert sizes == ([] if limits[0] == resource.RLIM_INFINITY else [83_886_080])
