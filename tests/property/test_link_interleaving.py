"""Several ground stations at once: requests in any order raise no exception and are not mixed up.

The test decides when disk jobs complete. Logs are added and removed meanwhile, as by pruning.
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
from firmware_py.link.files.payload import Opcode
from firmware_py.link.files.tree import FileRoot
from support.ftp import FtpStation
from support.link import Rig, of_type

# Two stations have the default system id of ground stations.
STATIONS = {"one": (255, 190), "two": (255, 190), "three": (254, 190)}
LOG_BYTES = 60_000


class SlowWorker:
    """A worker that runs one job at each call of `work` and delivers the results at `poll`."""

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
            except Exception as error:  # noqa: BLE001 - as the real worker does
                result = error
            self.results.append((done, result))

    def poll(self):
        for _ in range(len(self.results)):
            done, result = self.results.popleft()
            done(result)

    def close(self):
        pass


class PlanAuthor:
    """Source of the plans of a station; all items of a plan have the same, unique longitude [1e-7 deg]."""

    def __init__(self, number):
        self.longitude = number * 1_000_000

    def begin(self, count):
        self.longitude += 1000
        return mavlink.MAVLink_mission_count_message(1, 1, count, 0)

    def item(self, sequence):
        place = (360_000_000 + sequence, self.longitude, 0.0)
        frame, command = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_CMD_NAV_WAYPOINT
        return mavlink.MAVLink_mission_item_int_message(1, 1, sequence, frame, command, 0, 1, 0, 0, 0, 0, *place, 0)


class BoatWithLogs:
    """A boat with logs, and its ground stations."""

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
        self.authors = {name: PlanAuthor(number) for number, name in enumerate(STATIONS, start=1)}
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
        """Check that blocks belong to one log and that the mission belongs to one upload."""
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

    def complete_job(self):
        self.worker.work()
        self.worker.poll()
        self.check()

    def lose_station(self):
        """Close a connection, like one of TCP; after the last one, all stations connect again."""
        self.rig.transport.is_datagram = False
        self.rig.transport.served = self.rig.transport.served[1:] or tuple(STATIONS)
        self.tick()


STATION_NAMES = st.sampled_from(sorted(STATIONS))
LOG_NUMBERS = st.sampled_from([0, 1, 2, 0xFFFF])
STARTS = st.sampled_from([0, 90, LOG_BYTES - 1, LOG_BYTES, 0xFFFFFFFF])
COUNTS = st.sampled_from([90, 46_080, 0xFFFFFFFF])
LIST = st.builds(mavlink.MAVLink_log_request_list_message, st.just(1), st.just(1), LOG_NUMBERS, LOG_NUMBERS)
DATA = st.builds(mavlink.MAVLink_log_request_data_message, st.just(1), st.just(1), LOG_NUMBERS, STARTS, COUNTS)
STREAM = st.just(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 0xFFFFFFFF))
END = st.just(mavlink.MAVLink_log_request_end_message(1, 1))
ERASE = st.just(mavlink.MAVLink_log_erase_message(1, 1))
SESSION = st.integers(0, 2)
FILES = st.one_of(
    st.tuples(
        st.sampled_from([Opcode.OPEN_READ, Opcode.RENAME, Opcode.CHECKSUM]),
        st.sampled_from(["logs/00000001.BIN", "@MISSION/mission.dat"]),
        SESSION,
    ),
    st.tuples(
        st.sampled_from([Opcode.CREATE, Opcode.OPEN_WRITE, Opcode.CHECKSUM]),
        st.sampled_from(["uploads/a", "@MISSION/fence.dat"]),
        SESSION,
    ),
    st.tuples(st.sampled_from([Opcode.LIST, Opcode.LIST_WITH_TIME]), st.sampled_from(["logs", "uploads", ""]), SESSION),
    st.tuples(
        st.sampled_from([Opcode.TERMINATE, Opcode.RESET, Opcode.READ, Opcode.WRITE, Opcode.BURST_READ]),
        st.just(""),
        SESSION,
    ),
)
PLANS = st.one_of(
    st.sampled_from([3, 4, 2500]).map(lambda count: lambda author: author.begin(count)),
    st.integers(0, 3).map(lambda sequence: lambda author: author.item(sequence)),
    st.just(lambda author: author.item(0)),
    st.just(mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0)),
    st.just(mavlink.MAVLink_mission_clear_all_message(1, 1, mavlink.MAV_MISSION_TYPE_MISSION)),
)
BOAT_ACTIONS = {
    "tick": BoatWithLogs.tick,
    "disk works": BoatWithLogs.work,
    "disk completes": BoatWithLogs.complete_job,
    "log begins": BoatWithLogs.begin_log,
    "oldest log is removed": BoatWithLogs.remove_oldest,
    "all logs are removed": BoatWithLogs.remove_all,
    "station disconnects": BoatWithLogs.lose_station,
}
BOAT_ACTION = st.tuples(st.just("boat"), st.sampled_from(sorted(BOAT_ACTIONS)))


def run(steps):
    """Execute the steps, then complete all jobs."""
    with tempfile.TemporaryDirectory() as name:
        boat = BoatWithLogs(Path(name))
        for source, action in steps:
            if source == "boat":
                BOAT_ACTIONS[action](boat)
            elif isinstance(action, tuple):
                opcode, path, session = action
                boat.feed(source, boat.clients[source][0].request(opcode, path, session=session))
            elif callable(action):
                boat.feed(source, action(boat.authors[source]))
            else:
                boat.feed(source, action)
        for _ in range(20):
            boat.work()
            boat.tick()
        assert not boat.worker.jobs


@pytest.fixture
def slow_disk(monkeypatch):
    monkeypatch.setattr(endpoint_module, "Worker", SlowWorker)


INTERLEAVED = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.mark.usefixtures("slow_disk")
@INTERLEAVED
@given(st.lists(st.tuples(STATION_NAMES, LIST | DATA | STREAM | END | ERASE) | BOAT_ACTION, min_size=4, max_size=30))
def test_concurrent_log_requests_and_erasures_are_not_mixed(steps):
    run(steps)


@pytest.mark.usefixtures("slow_disk")
@INTERLEAVED
@given(
    st.lists(
        st.tuples(STATION_NAMES, FILES) | st.tuples(STATION_NAMES, LIST | ERASE) | BOAT_ACTION, min_size=4, max_size=30
    )
)
def test_concurrent_file_requests_raise_nothing(steps):
    run(steps)


@pytest.mark.usefixtures("slow_disk")
@INTERLEAVED
@given(st.lists(st.tuples(STATION_NAMES, PLANS) | BOAT_ACTION, min_size=4, max_size=40))
def test_concurrent_uploads_leave_one_complete_plan(steps):
    run(steps)


@pytest.mark.usefixtures("slow_disk")
@INTERLEAVED
@given(st.data(), st.sampled_from([2500, 3]), st.permutations(range(4)))
def test_upload_that_interrupts_another_is_not_mixed_with_it(data, second_count, order):
    """The second station sends its items in any order, regardless of the requests."""
    author = data.draw(STATION_NAMES)
    other = data.draw(STATION_NAMES)
    first_upload = [
        (author, lambda plan_author: plan_author.begin(4)),
        *((author, lambda plan_author, n=n: plan_author.item(n)) for n in range(2)),
    ]
    second_start = (other, lambda plan_author: plan_author.begin(second_count))
    run([*first_upload, second_start, *((other, lambda plan_author, n=n: plan_author.item(n)) for n in sorted(order))])
