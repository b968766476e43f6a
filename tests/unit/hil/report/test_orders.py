"""Plans and home out of a log's state and requests, whatever those hold."""

import json

import pytest

from firmware_py.common.intents import ReplacePlan, Request, SetHome
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.log import schema
from hil.report.orders import Orders

MISSION = Plan.of(PlanKind.MISSION, [PlanItem(16, x=360000000, y=1210000000)])
FIX = {"lat": 0.5, "lng": 2.0}


def request(intent):
    return schema.request_text(Request(1.0, intent, 255, 190))


def test_a_later_plan_replaces_that_of_the_state():
    orders = Orders()
    orders.add_state(json.dumps({"plans": {}, "home": {"latitude_rad": 0.1, "longitude_rad": 0.2}}))
    assert orders.home == pytest.approx((5.729578, 11.459156))
    orders.add_request(request(ReplacePlan(MISSION)), {})
    assert orders.plans == {"mission": MISSION}


def test_home():
    orders = Orders()
    orders.add_request(request(SetHome()), {})
    assert orders.home is None
    orders.add_request(request(SetHome()), FIX)
    assert orders.home == pytest.approx((28.64789, 114.591559))
    orders.add_request(request(SetHome(0.0, 0.0)), FIX)
    assert orders.home == (0.0, 0.0)


@pytest.mark.parametrize("text", ["", "[]", "{}", "nul", '{"plans": 3}', '{"plans": {"mission": 1}}', "[" * 10_000])
def test_unreadable_texts_are_ignored(text):
    orders = Orders()
    orders.add_state(text)
    orders.add_request(text, FIX)
    orders.add_request(text + "SetHome", FIX)
    assert (orders.plans, orders.home) == ({}, None)
