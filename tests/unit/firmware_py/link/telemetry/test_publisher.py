"""Telemetry within the capacity of a line, and reports by satellite at their interval and after a change of mode."""

from types import SimpleNamespace

import pytest

from firmware_py.common.mode_table import Mode
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.telemetry.publisher import TelemetryPublisher
from firmware_py.link.telemetry.streams import Streams
from firmware_py.link.wire.urls import LinkClass
from support.satellite import SatelliteBoat


def make_boat(interval_min):
    """Return a boat out of reach of the network, whose reports remain queued."""
    return SatelliteBoat(signal=lambda _now_s: 0, parameters={"SBD_REPORT_MIN": interval_min})


def count_reports(boat, now_s, **changes):
    boat.changes |= changes
    boat.run_to(now_s, step_s=now_s - boat.now_s)
    return boat.status().waiting


def test_report_is_sent_at_its_interval():
    boat = make_boat(30.0)
    assert [count_reports(boat, now_s) for now_s in (1.0, 1799.0, 1802.0, 3599.0, 3602.0)] == [1, 1, 2, 2, 3]


def test_six_changes_of_mode_are_reported_then_two_per_hour():
    boat = make_boat(0.0)
    modes = [Mode.GUIDED, Mode.HOLD] * 5
    counts = [count_reports(boat, 1.0 + number, mode=mode) for number, mode in enumerate(modes)]
    assert counts == [1, 2, 3, 4, 5, 6, 7, 7, 7, 7]
    assert [count_reports(boat, now_s) for now_s in (1795.0, 1810.0, 3595.0)] == [7, 8, 8]
    assert count_reports(boat, 3610.0, armed=False) == 9


@pytest.mark.parametrize(("free_bytes", "count"), [(30.0, 3), (29.0, 2), (0.0, 0)])
def test_rows_that_exceed_the_free_capacity_remain_due(snapshot, free_bytes, count):
    sent, introduced = [], []
    outbox = SimpleNamespace(
        available_bytes=lambda _now_s: free_bytes,
        size_of=lambda _packed: 10,
        push=lambda packed, _: sent.append(packed),
    )
    peer = SimpleNamespace(streams=Streams(LinkClass.FAST, 0.0), outbox=outbox)
    context = SimpleNamespace(
        telemetry_context=lambda: TelemetryContext(snapshot, 1.7e9, 0.5, 3, 0.0, 0),
        codec=SimpleNamespace(pack=lambda message: message.get_type()),
        introduce=introduced.append,
    )
    publisher, due = TelemetryPublisher(context), len(peer.streams.due_rows(0.0, 0.1))
    publisher.send_due([peer], 0.1, 0.0)
    assert (sent[0], len(sent), introduced) == ("HEARTBEAT", 1 + count, [peer])
    assert len(peer.streams.due_rows(0.0, 0.0)) < due - count
    waiting = sent[1:]
    sent.clear()
    publisher.send_due([peer], 0.1, 0.05)
    assert not set(waiting) & set(sent)  # those that were not sent before come first
