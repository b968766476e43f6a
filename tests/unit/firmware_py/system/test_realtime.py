"""Large pages: where they may lie, and that they cost no memory and change nothing; what is freed is given back."""

import json
import subprocess
import sys

from firmware_py.system.realtime import MAX_UNUSED_BYTES, spans

SIZE = 0x1000
MAPS = """\
10000-13000 rw-p 00000000 00:00 0
20800-22800 rw-p 00000000 00:00 0                                        [heap]
30800-31800 rw-p 00000000 00:00 0
40000-42000 r--p 00000000 00:00 0
50000-52000 rw-s 00000000 00:00 0
60000-62000 rw-p 00001000 fe:00 26933                                    /usr/lib/a library.so
70000-72000 rw-p 00000000 00:00 0                                        [stack]
"""

# Half of one area is in use and all of the other; a filled heap beside them.
PROGRAM = """
import json, mmap
from firmware_py.system import realtime
def resident_bytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * mmap.PAGESIZE
area = 8 << 20
full, half = (mmap.mmap(-1, area, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) for _ in range(2))
for place in range(0, area, mmap.PAGESIZE):
    full[place] = place // mmap.PAGESIZE % 251
    if place // mmap.PAGESIZE % 2:
        half[place] = 7
before = resident_bytes()
realtime.use_large_pages()
grown = resident_bytes() - before
kept = all(full[place] == place // mmap.PAGESIZE % 251 for place in range(0, area, mmap.PAGESIZE))
print(json.dumps({"grown": grown, "kept": kept}))
"""

# Pieces that the C library keeps when they are freed, for the last of them is in use.
FREED = """
import ctypes, json, mmap
from firmware_py.system import realtime
def resident_bytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * mmap.PAGESIZE
ctypes.CDLL(None).mallopt(-3, 1 << 20)  # none of them a mapping of its own
pieces = [bytes(60000) for _ in range(300)]
last = pieces.pop()
pieces.clear()
before = resident_bytes()
realtime.prepare(real_time=False)
print(json.dumps(before - resident_bytes()))
"""


def test_large_pages_lie_wholly_within_private_memory_without_a_file():
    assert list(spans(MAPS, SIZE)) == [0x10000, 0x11000, 0x12000, 0x21000]


def test_nothing_is_changed_and_memory_hardly_grows():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, timeout=60)
    result = json.loads(done.stdout)
    assert result["kept"]
    assert result["grown"] <= 16 * MAX_UNUSED_BYTES


def test_memory_freed_by_the_start_is_released():
    done = subprocess.run([sys.executable, "-c", FREED], capture_output=True, text=True, check=True, timeout=60)
    assert json.loads(done.stdout) > 200 * 60000
