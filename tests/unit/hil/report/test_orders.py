"""Plans and home from the state and the requests in a log."""

import json

import pytest

from firmware_py.common.intents import ReplacePlan, Request, SetHome
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.log import schema
from hil.report.orders import LoggedPlans

MISSION = Plan.of(PlanKind.MISSION, [PlanItem(16, x=360000000, y=1210000000)])
FIX = {"lat": 0.5, "lng": 2.0}


def request(intent):
    return schema.encode_request(Request(1.0, intent, 255, 190))


def test_plan_of_a_request_replaces_that_of_the_state():
    logged = LoggedPlans()
    logged.add_state(json.dumps({"plans": {}, "home": {"latitude_rad": 0.1, "longitude_rad": 0.2}}))
    assert logged.home == pytest.approx((5.729578, 11.459156))
    logged.add_request(request(ReplacePlan(MISSION)), {})
    assert logged.plans == {"mission": MISSION}


def test_home_is_the_fix_or_the_given_position():
    logged = LoggedPlans()
    logged.add_request(request(SetHome()), {})
    assert logged.home is None
    logged.add_request(request(SetHome()), FIX)
    assert logged.home == pytest.approx((28.64789, 114.591559))
    logged.add_request(request(SetHome(0.0, 0.0)), FIX)
    assert logged.home == (0.0, 0.0)


@pytest.mark.parametrize("text", ["", "[]", "{}", "nul", '{"plans": 3}', '{"plans": {"mission": 1}}', "[" * 10_000])
def test_unreadable_texts_are_ignored(text):
    logged = LoggedPlans()
    logged.add_state(text)
    logged.add_request(text, FIX)
    logged.add_request(text + "SetHome", FIX)
    assert (logged.plans, logged.home) == ({}, None)
