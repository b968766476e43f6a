"""The frame of a page: escaping, content security policy, style."""

import base64
import hashlib
import json
import math
import re

import pytest

from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.plans.items import Command
from firmware_py.view.document import LIVE, PLOTS, asset, data_block, document
from firmware_py.view.model import PANELS, plan_rows, voyage


def test_text_does_not_become_a_script():
    text = "</script><script>alert(1)</script>"
    page = document(text, [data_block("voyage", {"marks": [[1.0, 4, text]]})], PLOTS)
    assert page.count("<script") == 2
    assert "<title>&lt;/script&gt;" in page
    block = re.search(r'class="voyage">(.*?)</script>', page)[1]
    assert json.loads(block)["marks"][0][2] == text


def test_policy_forbids_other_scripts_and_resources():
    page = document("a page", [], PLOTS)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
    assert policy.startswith("default-src 'none'")
    assert "connect-src" not in policy
    for kind, tag in (("script", "script"), ("style", "style")):
        (content,) = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy


def test_scripts_are_small_and_contact_no_server():
    assert len(asset(*LIVE)) + len(asset("view.css")) < 60_000
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)|fetch\(|import\(|innerHTML|eval\(", asset(*LIVE))


def test_pages_support_phones_and_both_color_schemes():
    page = document("a page", [])
    assert 'name="viewport" content="width=device-width' in page
    assert "prefers-color-scheme: dark" in page
    assert "<script" not in page


def schemes():
    """Return the colours by name, of the light and the dark scheme."""
    blocks = re.findall(r":root \{(.*?)\}", asset("view.css"), re.DOTALL)
    return [dict(re.findall(r"--(\w+): (#[0-9a-f]{6})\b", block)) for block in blocks]


def luminance(colour):
    """Return the relative luminance of WCAG 2."""
    parts = [int(colour[index : index + 2], 16) / 255.0 for index in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("scheme", schemes(), ids=["light", "dark"])
@pytest.mark.parametrize("text", ["ink", "soft", "main", "second", "goal", "command", "bad", "good"])
@pytest.mark.parametrize("ground", ["page", "card"])
def test_text_contrast_meets_wcag_aa(scheme, text, ground):
    low, high = sorted((luminance(scheme[text]), luminance(scheme[ground])))
    assert (high + 0.05) / (low + 0.05) >= 4.5  # WCAG 2, level AA


def test_non_finite_values_are_null():
    data = voyage({"time_s": [0.0, 1.0], "heading_deg": [math.nan, 1.23456]}, [(math.nan, 1, "x"), (1.0, 2, "y")])
    assert data["columns"] == {"time_s": [0.0, 1.0], "heading_deg": [None, 1.235]}
    places = {"lat_deg": [36.123456789], "lon_deg": [math.inf]}
    assert voyage(places, [])["columns"] == {"lat_deg": [36.1234568], "lon_deg": [None]}
    assert data["marks"] == [[1.0, 2, "y"]]
    json.dumps(data, allow_nan=False)


def test_plan_rows_are_in_degrees():
    item = PlanItem(Command.LOITER_UNLIMITED, params=(0.0, math.nan, 40.0, 0.0), x=361234567, y=-1210000000)
    assert plan_rows(Plan.of(PlanKind.MISSION, [item])) == [
        [Command.LOITER_UNLIMITED, 0.0, None, 40.0, 0.0, 36.1234567, -121.0]
    ]


def test_axes_have_a_smallest_span_and_include_zero_except_for_levels():
    spans = [10.0, 2.0, 0.2, 4.0, 4.0, 10.0, 0.2, 2.0, 0.5, 5.0, 1.0, 2.0, 2.0, 1.0]
    assert [panel.min_span for panel in PANELS] == spans
    titles = {"heading (deg)", "battery voltage (V)", "battery charge (%)"}
    assert {panel.title for panel in PANELS if not panel.zero} == titles
    assert [panel.title for panel in PANELS if panel.wrap and panel.tall] == ["heading (deg)"]
    assert sum(panel.wrap + panel.tall + panel.step for panel in PANELS) == 3
    assert [panel.title for panel in PANELS if panel.step] == ["active faults"]
    assert {panel.title: panel.band for panel in PANELS if panel.band} == {"heading error (deg)": 3.0}


def test_times_of_marks_are_rounded_to_hundredths():
    assert voyage({}, [(1.23456, 4, "x")], PANELS[:1])["marks"] == [[1.23, 4, "x"]]
    assert len(voyage({}, [], PANELS[:1])["panels"]) == 1


def test_line_looks_are_css_classes():
    for panel in PANELS:
        for line in panel.lines:
            assert line.look == "main" or f".line.{line.look}" in asset("view.css")
