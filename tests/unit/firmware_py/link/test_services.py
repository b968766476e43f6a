"""The services of the link, and their order of sending."""

from itertools import chain, pairwise

from pymavlink.dialects.v20 import common as mavlink

SYSTEM_AND_COMPONENT = (1, 1)


def test_no_message_is_handled_by_two_services(rig):
    numbers = list(chain.from_iterable(service.handlers() for service in rig.endpoint._services._all))
    assert len(numbers) == len(set(numbers))
    assert set(numbers) <= set(rig.endpoint.handlers)


def test_long_replies_to_two_peers_are_sent_in_turn(make_rig, of):
    rig = make_rig(addresses=("first", "second"))
    rig.tick()
    wanted = mavlink.MAVLink_param_request_list_message(*SYSTEM_AND_COMPONENT)
    rig.transport.inbox += [("first", rig.frame(wanted)), ("second", rig.frame(wanted))]
    rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    while rig.endpoint.busy:
        rig.endpoint.service(rig.now_s, [])
    turns = [address for address, _ in rig.transport.sent]
    assert set(turns) == {"first", "second"}
    assert all(before != after for before, after in pairwise(turns[:8]))
    lists = {address: of(decoded(rig, address), "PARAM_VALUE") for address in ("first", "second")}
    assert [value.param_index for value in lists["first"]] == list(range(lists["first"][0].param_count))
    assert len(lists["second"]) == len(lists["first"])


def decoded(rig, address):
    data = b"".join(data for to, data in rig.transport.sent if to == address)
    return mavlink.MAVLink(None).parse_buffer(data)
