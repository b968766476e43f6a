"""A link that makes a mistake does not take the loop with it; one that makes many is ended."""

import pytest

from firmware_py.link.shelter import MOST, WITHIN_S, Shelter


class Faulty:
    busy, station_s = True, 3.0

    def __init__(self):
        self.calls = []
        self.good = False

    def descriptors(self):
        return [7]

    def service(self, now_s, ready):
        self.calls.append((now_s, ready))
        if not self.good:
            raise KeyError("inside")

    def publish(self, output, now_s):
        self.service(now_s, output)


def test_a_mistake_is_told_and_the_next_call_tries_again(capsys):
    told, link = [], Faulty()
    shelter = Shelter(link, told.append)
    shelter.service(1.0, [7])
    assert [event.text for event in told] == ["Link: KeyError inside, she steers on"]
    assert "KeyError: 'inside'" in capsys.readouterr().err
    link.good = True
    shelter.publish("output", 2.0)
    assert (link.calls, len(told)) == ([(1.0, [7]), (2.0, "output")], 1)
    assert (shelter.busy, shelter.station_s, shelter.descriptors()) == (True, 3.0, [7])


def test_too_many_mistakes_end_the_process():
    shelter = Shelter(Faulty(), lambda _event: None)
    for number in range(MOST):
        shelter.service(float(number), [])
    with pytest.raises(KeyError):
        shelter.publish("output", 10.0)


def test_rare_mistakes_do_not_add_up():
    shelter = Shelter(Faulty(), lambda _event: None)
    for number in range(3 * MOST):
        shelter.service(number * WITHIN_S, [])
