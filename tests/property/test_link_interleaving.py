"""Several stations at once: whatever they ask for in whatever order, nothing raises and nothing is mixed up.

The disk answers when the test says so; logs come and go meanwhile, as they do when room is made for new ones.
"""

import tempfile
from collections import deque
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.mode_table import Mode
from firmware_py.link import endpoint as endpoint_module
from firmware_py.link.files.tree import FileRoot
from support.ftp import FtpStation
from support.link import Rig, of_type

# Two of them have the number that every ground station has unless it is reported otherwise.
STATIONS = {"one": (255, 190), "two": (255, 190), "three": (254, 190)}
LOG_BYTES = 60_000


class SlowWorker:
    """Does a job when it is reported to, in order; the results wait for `poll`."""

    def __init__(self, *, background):
        assert background
        self.jobs = deque()
        self.results = deque()

    def fileno(self):
        return -1

    @property
    def has_pending_jobs(self):
        return bool(self.jobs or self.results)

    def submit(self, job, done):
        if len(self.jobs) + len(self.results) >= 6:
            return False
        self.jobs.append((job, done))
        return True

    def work(self):
        if self.jobs:
            job, done = self.jobs.popleft()
            try:
                result = job()
            except Exception as failure:  # noqa: BLE001 - as the real one does
                result = failure
            self.results.append((done, result))

    def poll(self):
        for _ in range(len(self.results)):
            done, result = self.results.popleft()
            done(result)

    def close(self):
        pass


class Author:
    """What a station uploads: each plan of its own, reported by the longitude of its items."""

    def __init__(self, place):
        self.longitude = place * 1_000_000

    def begin(self, count):
        self.longitude += 1000
        return mavlink.MAVLink_mission_count_message(1, 1, count, 0)

    def item(self, sequence):
        place = (360_000_000 + sequence, self.longitude, 0.0)
        return mavlink.MAVLink_mission_item_int_message(1, 1, sequence, 6, 16, 0, 1, 0, 0, 0, 0, *place, 0)


class Sea:
    """A boat with logs, and stations that ask for them."""

    def __init__(self, root):
        self.logs = root / "logs"
        self.logs.mkdir()
        (root / "uploads").mkdir()
        self.newest = 0
        for _ in range(3):
            self.begin_log()
        storage = FileRoot(self.catalogue, self.logs, root / "uploads", logging=False, background=True)
        self.rig = Rig(storage=storage, addresses=tuple(STATIONS))
        self.worker = self.rig.endpoint._worker
        self.clients = {}
        self.authors = {name: Author(place) for place, name in enumerate(STATIONS, start=1)}
        for name, (system, component) in STATIONS.items():
            self.clients[name] = FtpStation(self.rig, name), mavlink.MAVLink(None, system, component)
        self.tick()

    def catalogue(self):
        return {int(path.stem): path for path in self.logs.glob("*.BIN")}

    def begin_log(self):
        self.newest += 1
        (self.logs / f"{self.newest:08d}.BIN").write_bytes(bytes((self.newest % 256,)) * LOG_BYTES)

    def tick(self):
        self.rig.tick_silently(armed=False, mode=Mode.HOLD)
        self.check()

    def feed(self, name, message):
        _, station = self.clients[name]
        self.rig.transport.inbox.append((name, message.pack(station)))
        station.seq = (station.seq + 1) % 256
        self.rig.endpoint.service(self.rig.now_s, [self.rig.transport.descriptor])
        self.check()

    def check(self):
        """A block of a log is of one log, and where it says it is."""
        for block in of_type(self.rig.replies(), "LOG_DATA"):
            assert len(set(block.data[: block.count])) <= 1
            assert block.ofs + block.count <= LOG_BYTES or block.count == 0
        items = self.rig.request_handler.plans().mission.items
        assert len({item.y for item in items}) <= 1
        assert [item.x - 360_000_001 for item in items] == list(range(len(items)))

    def remove_oldest(self):
        for path in sorted(self.logs.glob("*.BIN"))[:1]:
            path.unlink()

    def remove_all(self):
        for path in self.logs.glob("*.BIN"):
            path.unlink()

    def work(self):
        self.worker.work()

    def answer(self):
        self.worker.work()
        self.worker.poll()
        self.check()

    def lose_station(self):
        """One connection goes, as those of TCP do; when there is none left, all come back."""
        self.rig.transport.datagrams = False
        self.rig.transport.served = self.rig.transport.served[1:] or tuple(STATIONS)
        self.tick()


WHO = st.sampled_from(sorted(STATIONS))
NUMBERS = st.sampled_from([0, 1, 2, 0xFFFF])
STARTS = st.sampled_from([0, 90, LOG_BYTES - 1, LOG_BYTES, 0xFFFFFFFF])
COUNTS = st.sampled_from([90, 46_080, 0xFFFFFFFF])
LIST = st.builds(mavlink.MAVLink_log_request_list_message, st.just(1), st.just(1), NUMBERS, NUMBERS)
DATA = st.builds(mavlink.MAVLink_log_request_data_message, st.just(1), st.just(1), NUMBERS, STARTS, COUNTS)
STREAM = st.just(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 0xFFFFFFFF))
END = st.just(mavlink.MAVLink_log_request_end_message(1, 1))
ERASE = st.just(mavlink.MAVLink_log_erase_message(1, 1))
SESSION = st.integers(0, 2)
FILES = st.one_of(
    st.tuples(st.sampled_from([4, 13, 14]), st.sampled_from(["logs/00000001.BIN", "@MISSION/mission.dat"]), SESSION),
    st.tuples(st.sampled_from([6, 11, 14]), st.sampled_from(["uploads/a", "@MISSION/fence.dat"]), SESSION),
    st.tuples(st.sampled_from([3, 16]), st.sampled_from(["logs", "uploads", ""]), SESSION),
    st.tuples(st.sampled_from([1, 2, 5, 7, 15]), st.just(""), SESSION),
)
PLANS = st.one_of(
    st.sampled_from([3, 4, 2500]).map(lambda count: lambda author: author.begin(count)),
    st.integers(0, 3).map(lambda sequence: lambda author: author.item(sequence)),
    st.just(lambda author: author.item(0)),
    st.just(mavlink.MAVLink_mission_ack_message(1, 1, 15, 0)),
    st.just(mavlink.MAVLink_mission_clear_all_message(1, 1, 0)),
)
EVENTS = {
    "tick": Sea.tick,
    "the disk works": Sea.work,
    "the disk answers": Sea.answer,
    "a log begins": Sea.begin_log,
    "room is made": Sea.remove_oldest,
    "all logs go": Sea.remove_all,
    "a station goes": Sea.lose_station,
}
EVENT = st.tuples(st.just("sea"), st.sampled_from(sorted(EVENTS)))


def run(steps):
    """Do one thing after the other, then let everything come to its end."""
    with tempfile.TemporaryDirectory() as name:
        sea = Sea(Path(name))
        for who, what in steps:
            if who == "sea":
                EVENTS[what](sea)
            elif isinstance(what, tuple):
                opcode, path, session = what
                sea.feed(who, sea.clients[who][0].request(opcode, path, session=session))
            elif callable(what):
                sea.feed(who, what(sea.authors[who]))
            else:
                sea.feed(who, what)
        for _ in range(20):
            sea.work()
            sea.tick()
        assert not sea.worker.jobs


@pytest.fixture
def slow_disk(monkeypatch):
    monkeypatch.setattr(endpoint_module, "Worker", SlowWorker)


INTERLEAVED = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.mark.usefixtures("slow_disk")
@INTERLEAVED
@given(st.lists(st.tuples(WHO, LIST | DATA | STREAM | END | ERASE) | EVENT, min_size=4, max_size=30))
def test_stations_that_fetch_and_erase_logs_at_once_get_no_mixture(steps):
    run(steps)


@pytest.mark.usefixtures("slow_disk")
@INTERLEAVED
@given(st.lists(st.tuples(WHO, FILES) | st.tuples(WHO, LIST | ERASE) | EVENT, min_size=4, max_size=30))
def test_stations_that_use_files_at_once_are_served(steps):
    run(steps)


@pytest.mark.usefixtures("slow_disk")
@INTERLEAVED
@given(st.lists(st.tuples(WHO, PLANS) | EVENT, min_size=4, max_size=40))
def test_stations_that_upload_at_once_leave_one_plan_whole(steps):
    run(steps)


@pytest.mark.usefixtures("slow_disk")
@INTERLEAVED
@given(st.data(), st.sampled_from([2500, 3]), st.permutations(range(4)))
def test_plans_that_follow_each_other_at_any_item_do_not_mix(data, second, order):
    """Each station sends all of its items at any time, whatever it is asked for."""
    author = data.draw(WHO)
    other = data.draw(WHO)
    begun = [(author, lambda one: one.begin(4)), *((author, lambda one, n=n: one.item(n)) for n in range(2))]
    again = (other, lambda one: one.begin(second))
    run([*begun, again, *((other, lambda one, n=n: one.item(n)) for n in sorted(order))])
