"""Pages in a real browser: the live page compared with the true state, reports of runs and logs."""

import json
import re
import shutil
import threading
import time

import numpy as np
import pytest

from firmware_py.common.plan import PlanKind
from firmware_py.log.thin import HEAD, SAILING, UPKEEP, Minute
from firmware_py.plans.items import Command
from firmware_py.system.status_file import Freshness, StatusReading
from firmware_py.view.feed import Feed
from firmware_py.view.guard import Guard
from firmware_py.view.history import History
from firmware_py.view.server import Hub, ViewServer
from hil.__main__ import main
from hil.sim.truth import read
from support.browser import Browser
from support.harness import rambler_hil, read_events, start_rambler_hil
from support.paths import REPLAY
from support.plans import FENCE_ITEMS, item, save_plans

LOW_BATTERY = (
    "--with",
    "supply=20:0.9:30:6:0.22,vessels=crossing:0",
    "--set",
    "PWR_SAVE_PCT=21.9",
    "FS_BATT_ACT=0",
    "AIS_NEAR_S=2400",
)
CLIPPED = (
    "[...document.querySelectorAll('td.words')].filter((one) => one.getBoundingClientRect().right > innerWidth).length"
)
AXIS_TIMES = """[...document.querySelectorAll('svg.time text')].map((one) => one.textContent.match(/^([\\d.]+) s$/))
.filter(Boolean).map((one) => Number(one[1]))"""
LAST_TEXT = "[...document.querySelectorAll('tr[data-time] td.words')].pop().textContent"
TIME_AND_HEADING = (
    "[Number(document.querySelector('.now').dataset.time), document.querySelector('#now-heading').textContent]"
)


@pytest.fixture(scope="module")
def shared_browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


@pytest.fixture
def browser(shared_browser):
    """The shared browser with an empty page; a start would take a second."""
    shared_browser.open("about:blank")
    shared_browser.errors.clear()
    shared_browser.requests.clear()
    return shared_browser


def read_address(process):
    """Return the address that a run prints for its page."""
    return re.fullmatch(r"page: (http://127\.0\.0\.1:\d+/)\n", process.stdout.readline())[1]


def assert_success(process):
    """Wait for a run, which must end without an error; return its output."""
    output, errors = process.communicate(timeout=100.0)
    assert (process.returncode, errors) == (0, "")
    return output


def assert_readable(browser, url):
    """Check the requests of a page, its width at 400 and 1200 px, and its contrast in both colour schemes."""
    for width, dark in ((1200, True), (400, False)):
        browser.set_screen(width, 900, dark=dark)
        contrasts = browser.contrasts()
        assert len(contrasts) > 60
        assert contrasts[0][0] >= 4.5, contrasts[0]
        assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.value(CLIPPED) == 0
    assert browser.value("document.querySelector('meta[name=viewport]').content").startswith("width=device-width")
    assert {request.removesuffix("events") for request in browser.requests} == {url}
    browser.requests.clear()


def test_live_page_and_report_of_a_mission(tmp_path, browser):
    """The live page shows the true heading and faults; the report shows plan and figures and can be zoomed."""
    plans = {
        PlanKind.MISSION: [item(Command.WAYPOINT, 15, 0), item(Command.WAYPOINT, 15, 15), item(Command.RETURN)],
        PlanKind.FENCE: FENCE_ITEMS,
        PlanKind.RALLY: [item(Command.RALLY_POINT, 0, 50)],
    }
    out = tmp_path / "run"
    words = ["run", "mission", "--mode", "auto", "--state", save_plans(tmp_path / "memory", plans), "--speed", "30"]
    words += ["--seconds", "120", *LOW_BATTERY, "FENCE_ENABLE=1", "WP_RADIUS=10"]
    process = start_rambler_hil(*words, "--view", "127.0.0.1:0", "--out", out)
    browser.set_screen(400, 900)
    browser.open(address := read_address(process))
    browser.wait_for("document.querySelectorAll('path.line').length > 5")
    samples = []
    while len(samples) < 3 or not browser.value("document.querySelector('#now-faults').textContent > '0'"):
        sample = browser.value(TIME_AND_HEADING)
        if not samples or sample[0] > samples[-1][0]:
            samples.append(sample)
        time.sleep(0.05)
    browser.wait_for(
        "['Battery low', 'Vessels', 'Vessel approaching'].every((one) => document.body.innerText.includes(one))"
    )
    browser.wait_for("document.querySelectorAll('line.mark.bad').length > 0")
    assert_readable(browser, address)
    browser.wait_for("document.querySelector('.banner').textContent.startsWith('The run has ended')")
    assert_success(process)
    truth = read(out / "truth.csv")
    true_deg = np.degrees(np.interp([sample[0] for sample in samples], truth.time_s, truth.heading_low_rad)) % 360.0
    page_deg = np.array([float(text.rstrip("\u00b0")) for _, text in samples])
    assert np.abs((page_deg - true_deg + 180.0) % 360.0 - 180.0).max() < 0.1
    assert browser.errors == []
    browser.open((out / "report.html").as_uri())
    assert browser.value("document.querySelectorAll('svg.time path.line').length") > 6
    assert browser.value("document.querySelectorAll('line.mark.bad').length") > 0
    assert_readable(browser, (out / "report.html").as_uri())
    summary = json.loads((out / "summary.json").read_text())
    first_arrival, second_arrival = summary["arrivals"]
    assert (first_arrival["item"], second_arrival["item"]) == (1, 2)
    assert 5.0 < first_arrival["time_s"] < second_arrival["time_s"] < 120.0
    assert 0.0 < summary["cross_track"]["rms_m"] <= summary["cross_track"]["p95_m"] < 20.0
    for shape, number in (("fence", 3), ("fence.out", 2), ("leg", 1), ("spot", 2), ("home", 2), ("boat", 1)):
        assert browser.value(f"document.querySelectorAll('svg.track .{shape}').length") == number, shape
    page_text = browser.value("document.body.innerText")
    assert f"Cross-track error {summary['cross_track']['rms_m']:.1f} m (rms)" in page_text
    assert f"1 at {first_arrival['time_s']:.0f} s" in page_text
    assert "cross-track distance (m, + to starboard)" in page_text
    all_times_s = browser.value(AXIS_TIMES)
    browser.value("document.querySelector('button[title=\"show less\"]').click()")
    zoomed_times_s = browser.value(AXIS_TIMES)
    assert all_times_s[0] <= zoomed_times_s[0] < zoomed_times_s[-1] <= all_times_s[-1]
    assert zoomed_times_s[-1] - zoomed_times_s[0] < 0.7 * (all_times_s[-1] - all_times_s[0])
    assert browser.errors == []


def test_page_of_logs_is_drawn_with_constant_signals(tmp_path, browser):
    logs = tmp_path / "logs"
    (logs / "thin").mkdir(parents=True)
    shutil.copy(REPLAY / "tank_pni_volz.BIN", logs / "00000001.BIN")
    constants = {
        "latitude_rad": 0.6,
        "longitude_rad": 2.1,
        "rms_error_rad": 0.0,
        "travel_rad": 0.0,
        "wave_period_s": 6.0,
    }
    minutes = [Minute(1.8e9 + 60.0 * n, 60.0, 15, armed=True, faults=0, **constants) for n in range(100)]
    rows = [SAILING.pack(60.0 * n, minute) + UPKEEP.pack(60.0 * n, minute) for n, minute in enumerate(minutes)]
    (logs / "thin" / "00000001.BIN").write_bytes(HEAD + b"".join(rows))
    assert rambler_hil("report", tmp_path, "--out", tmp_path / "page.html")[0] == 0
    browser.set_screen(1280, 900)
    browser.open((tmp_path / "page.html").as_uri())
    assert browser.value("document.querySelectorAll('svg.time').length") == 2
    assert browser.value("[...document.querySelectorAll('svg.time')].every((one) => one.querySelector('path.line'))")
    browser.value("[...document.querySelectorAll('tr[data-time]')].pop().click()")
    assert browser.value("document.querySelectorAll('.readout')[0].textContent").endswith(browser.value(LAST_TEXT))
    assert browser.errors == []


def start_server(history, port=0):
    """Serve the page of a history as `rambler view` does; return server and hub."""
    hub = Hub(history.all_data)
    server = ViewServer(("127.0.0.1", port), Guard("", is_loopback=True), hub)
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
    return server, hub


def serve(port=0):
    """Serve a page with one sample; return server and hub."""
    history = History()
    server, hub = start_server(history, port)
    hub.publish(lambda: (history.add({"time_s": 1.0, "heading_deg": 10.0}, [], {"title": "boat"}), history.epoch))
    return server, hub


def end_server(server):
    server.shutdown()
    server.server_close()


STATUS = {
    "vehicle": "boat", "pid": 7, "written_machine_s": 100.0, "utc_s": 1.8e9, "uptime_s": 50.0, "mode": "GUIDED",
    "armed": True, "heading_ok": True, "heading_deg": 359.97, "heading_age_s": 0.1, "goal_deg": 10.0, "error_deg": 10.0,
    "faults": [], "plan_identities": [0, 0, 0], "links": [], "estimate": {"heading_deg": 359.97, "wave_sd_deg": 3.0},
    "events": [{"t_s": 48.0, "severity": 5, "text": "Armed"}],
    "devices": [{"device": "compass", "state": "running", "rate_hz": 10.0, "rejected": 0, "error": "", "age_s": 0.1}],
    "position": {"ok": True, "age_s": 0.4, "lat_deg": 36.0, "lon_deg": 121.0, "sog_m_s": 0.52, "cog_deg": 12.0},
    "rudder": {"ok": True, "age_s": 0.1, "angle_deg": 4.0, "command_deg": 4.0}, "energy": {"travel_deg_per_h": 405.0},
}  # fmt: skip
LOST_CHANGES = {
    "heading_ok": False,
    "heading_age_s": 35.0,
    "position": {**STATUS["position"], "ok": False, "age_s": 95.0},
    "faults": [
        {"fault": fault, "severity": "error", "text": text, "since_s": 30.0}
        for fault, text in (("COMPASS_LOST", "No valid heading"), ("POSITION_LOST", "GPS position lost"))
    ],
    "devices": [{**STATUS["devices"][0], "state": "absent", "rate_hz": 0.0, "age_s": 35.0, "error": "no port"}],
}
CARD = "document.querySelector('#now-{}').parentNode"


def test_stale_values_are_grey_with_their_age_and_viewers_acknowledge_faults(browser):
    status = [StatusReading(Freshness.RUNNING, STATUS, 0.0)]
    history = History()
    feed = Feed(history, lambda: status[0], dict, {"POSITION_LOST": "look at the antenna"})
    feed.add_line(b'{"time_s": 0.5, "true_heading_deg": 405.0}')
    server, hub = start_server(history)

    def publish(**changes):
        content = status[0].content
        status[0] = StatusReading(
            Freshness.RUNNING, content | {"written_machine_s": content["written_machine_s"] + 1} | changes, 0.0
        )
        hub.publish(lambda: (feed.poll(), history.epoch))

    def text(element):
        return browser.value(f"{element}.innerText").replace("\n\n", "\n")

    def is_stale(name):
        return browser.value(f"{CARD.format(name)}.classList.contains('stale')")

    publish()
    browser.open(address := f"http://127.0.0.1:{server.server_address[1]}/")
    browser.wait_for("document.querySelectorAll('.age').length > 5")
    assert re.fullmatch(r"over ground\n0.52 m/s\ncourse 12°\n[01] s old", text(CARD.format("over-ground")))
    assert text("document.querySelector('#now-heading')") == "45.0°"
    assert text("document.querySelector('#now-estimated-heading')") == "0.0°"
    page_text = text("document.body")
    assert "0.0 s\tArmed" in page_text
    assert "compass 0.0" in browser.value("document.querySelector('svg.time').textContent")
    for label in ("speed over ground\t0.52 m/s", "wave standard deviation\t3 deg", "valid\tyes", "travel\t405 deg/h"):
        assert label in page_text
    assert not any(is_stale(name) for name in ("estimated-heading", "over-ground", "rudder", "goal"))
    publish(**LOST_CHANGES)
    browser.wait_for("document.querySelectorAll('.faults button').length === 2")
    assert [is_stale(name) for name in ("estimated-heading", "over-ground", "rudder")] == [True, True, False]
    assert re.search(r"\b3[5-9] s old", text(CARD.format("estimated-heading")))
    assert re.search(r"\b9[5-9] s old", text(CARD.format("over-ground")))
    assert "What to do: look at the antenna" in text("document.querySelector('.faults')")
    assert text("document.querySelector('#now-faults')") == "2"
    assert "No valid heading; GPS position lost" in text(CARD.format("faults"))
    assert re.search(r"absent, 0 Hz, last message 35 s ago, 0 rejected, no port", text("document.body"))
    browser.value("document.querySelector('.faults button').click()")
    assert "No valid heading" not in text(CARD.format("faults"))
    browser.open(address)
    browser.wait_for("document.querySelectorAll('.faults button').length === 2")
    assert browser.value("[...document.querySelectorAll('.faults button')].map((one) => one.disabled)") == [True, False]
    for width in (400, 1280):
        browser.set_screen(width, 900)
        assert browser.contrasts()[0][0] >= 4.5, browser.contrasts()[0]
        assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.value(CLIPPED) == 0
    publish(faults=[fault | {"since_s": 1.0} for fault in LOST_CHANGES["faults"]])
    browser.wait_for("[...document.querySelectorAll('.faults button')].every((one) => !one.disabled)")
    status[0] = StatusReading(Freshness.STALE, status[0].content, 9.0, "process 7 hangs")
    hub.publish(lambda: (feed.poll(), history.epoch))
    browser.wait_for("document.querySelector('#live').classList.contains('stale')")
    assert "No report from the autopilot for" in text("document.querySelector('.banner')")
    assert browser.errors == []
    hub.close(is_over=True)
    end_server(server)


@pytest.mark.proof
def test_browsers_reconnect_to_a_restarted_and_to_a_full_service(browser):
    banner = "document.querySelector('.banner')"
    server, hub = serve()
    port = server.server_address[1]
    server.readers = threading.BoundedSemaphore(1)
    server.readers.acquire()
    browser.open(f"http://127.0.0.1:{port}/")
    browser.wait_for(f"{banner}.textContent.startsWith('No connection')")
    server.readers.release()
    browser.wait_for(f"{banner}.hidden")
    hub.close(is_over=False)
    end_server(server)
    browser.wait_for(f"{banner}.textContent.startsWith('No connection')")
    server, hub = serve(port)
    browser.wait_for(f"{banner}.hidden")
    hub.close(is_over=True)
    browser.wait_for(f"{banner}.textContent.startsWith('The run has ended')")
    end_server(server)


@pytest.mark.parametrize("listen", ["nowhere", "127.0.0.1:99999", "0.0.0.0:0"])
def test_invalid_page_address_is_refused_before_the_run(tmp_path, capsys, listen):
    code = main(["run", "calm", "--goal", "0:0", "--view", listen, "--out", str(tmp_path / "run")])
    output = capsys.readouterr()
    assert (code, output.out, len(output.err.splitlines())) == (2, "", 1)
    assert listen in output.err
    assert not (tmp_path / "run" / "report.html").exists()


@pytest.mark.proof
def test_ten_readers_delay_no_tick(tmp_path):
    """In real time, on an idle machine: pytest -m proof tests/process/test_view.py -s."""
    lateness_us = {}
    for readers in (0, 10):
        out = tmp_path / str(readers)
        words = ["run", "sea", "--seconds", "120", "--goal", "0:30", "--view", "127.0.0.1:0", "--out", out]
        with start_rambler_hil(*words) as process:
            port = int(read_address(process).rstrip("/").rpartition(":")[2])
            threads = [threading.Thread(target=read_events, args=(port,)) for _ in range(readers)]
            for thread in threads:
                thread.start()
            assert process.wait(200.0) == 0
        for thread in threads:
            thread.join(60.0)
        loop = json.loads((out / "summary.json").read_text())["loop"]
        lateness_us[readers] = loop["lateness_us"]
        print(f"{readers} readers: skipped {loop['skipped']}, late {loop['lateness_us']}")
        assert loop["skipped"] == 0
    assert lateness_us[10]["p50"] <= 2.0 * lateness_us[0]["p50"] + 100.0
    assert lateness_us[10]["p99"] <= 2.0 * lateness_us[0]["p99"] + 1000.0


@pytest.mark.proof
def test_page_of_an_estimate(tmp_path, browser):
    path, figures = tmp_path / "page.html", tmp_path / "estimate.json"
    words = ["estimate", REPLAY / "second_compass.BIN", "--page", path, "--json", figures]
    assert rambler_hil(*words)[0] == 0
    browser.open(path.as_uri())
    browser.wait_for("document.querySelectorAll('path.line').length > 8")
    assert_readable(browser, path.as_uri())
    (fault,) = json.loads(figures.read_text())["faults"]
    assert fault["name"] in browser.value("document.querySelector('tr[data-time]').innerText")
    browser.value("document.querySelector('tr[data-time]').click()")
    assert browser.value("document.querySelector('.readout').textContent").endswith(fault["name"])
    assert browser.errors == []
