"""TCP on real loopback sockets."""

import select
import socket
import time

import pytest

from firmware_py.link.wire.open_transport import open_transport
from firmware_py.link.wire.transport_tcp import MAX_CLIENTS
from firmware_py.link.wire.urls import LinkError


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def opened():
    made = []

    def opening(thing):
        made.append(thing)
        return thing

    yield opening
    for thing in made:
        thing.close()


@pytest.fixture
def server(opened):
    return opened(open_transport(f"tcpin:127.0.0.1:{free_port()}", None))


def port_of(server):
    return server._listener.getsockname()[1]


def take(transport, *, until):
    """Serve a transport as the loop does until a condition holds; return what it read."""
    received = []
    end_s = time.monotonic() + 10.0
    while not until(received):
        assert time.monotonic() < end_s
        ready, _, _ = select.select(transport.descriptors(), [], [], 0.01)
        for descriptor in ready:
            received.extend(transport.receive(descriptor))
        transport.poll(time.monotonic())
    return received


def dial(server, opened, count=1):
    clients = [opened(socket.create_connection(("127.0.0.1", port_of(server)), 5.0)) for _ in range(count)]
    take(server, until=lambda _: len(server.connections()) >= min(count, MAX_CLIENTS))
    return clients


def test_each_client_is_a_correspondent(server, opened):
    one, two = dial(server, opened, 2)
    one.sendall(b"one")
    two.sendall(b"two")
    received = dict(take(server, until=lambda received: len(received) == 2))
    assert sorted(received.values()) == [b"one", b"two"]
    for address, data in received.items():
        assert server.send(address, b"to " + data)
    assert (one.recv(100), two.recv(100)) == (b"to one", b"to two")


def test_a_client_that_goes_is_forgotten_and_its_number_is_not_used_again(server, opened):
    (client,) = dial(server, opened)
    (number,) = server.connections()
    client.close()
    take(server, until=lambda _: not server.connections())
    assert not server.send(number, b"x")
    dial(server, opened)
    assert server.connections() != (number,)


def test_clients_are_bounded(server, opened):
    clients = dial(server, opened, MAX_CLIENTS) + dial(server, opened, 3)
    take(server, until=lambda _: not select.select([server._listener], [], [], 0.05)[0])
    assert len(server.connections()) == MAX_CLIENTS
    refused = clients[MAX_CLIENTS:]
    assert [client.recv(1) for client in refused] == [b""] * 3
    assert not select.select(clients[:MAX_CLIENTS], [], [], 0.0)[0]


def test_a_client_that_does_not_read_costs_bounded_memory_and_gets_whole_messages(server, opened):
    (client,) = dial(server, opened)
    (number,) = server.connections()
    message = b"m" * 1000 + b"\n"
    accepted = sum(server.send(number, message) for _ in range(20_000))
    assert accepted < 20_000
    client.settimeout(5.0)
    received = b""
    while len(received) < accepted * len(message):
        server.poll(0.0)
        received += client.recv(1 << 20)
    assert received == message * accepted


def test_what_cannot_leave_is_refused_so_that_what_is_newer_need_not_wait_behind_it(server, opened):
    """The system would hold megabytes of telemetry for a slow way: minutes, and answers come behind them."""
    client = opened(socket.socket())
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 11)
    client.connect(("127.0.0.1", port_of(server)))
    take(server, until=lambda _: server.connections())
    (number,) = server.connections()
    assert 1 <= sum(server.send(number, b"m" * 1000) for _ in range(1000)) <= 24


def test_a_port_in_use_is_said(server):
    with pytest.raises(LinkError, match=r"in use.*choose another port"):
        open_transport(f"tcpin:127.0.0.1:{port_of(server)}", None)


def test_a_client_connects_once_the_server_is_there_and_again_when_it_comes_back(opened):
    port = free_port()
    client = opened(open_transport(f"tcpout:127.0.0.1:{port}", None))
    client.poll(0.0)
    assert client.addresses() == ()
    numbers = []
    for now_s in (2.0, 4.0):
        with socket.create_server(("127.0.0.1", port)) as listener:
            listener.settimeout(5.0)
            take_until_connected(client, now_s)
            accepted, _ = listener.accept()
            with accepted:
                numbers.append(client.addresses()[0])
                assert client.send(client.addresses()[0], b"hello")
                accepted.settimeout(5.0)
                assert accepted.recv(100) == b"hello"
                accepted.sendall(b"answer")
                received = take_from(client)
                assert received == [(client.addresses()[0], b"answer")]
        assert take_from(client) == []
        assert client.addresses() == ()
    assert numbers[0] != numbers[1]


def take_until_connected(client, now_s, step_s=0.0):
    for _ in range(5000):
        client.poll(now_s)
        if client.addresses():
            return
        now_s += step_s
        time.sleep(0.001)
    pytest.fail("not connected")


def take_from(client):
    (descriptor,) = client.descriptors()
    assert select.select([descriptor], [], [], 5.0)[0]
    return list(client.receive(descriptor))


def test_a_client_tries_once_a_second(opened, monkeypatch):
    client = opened(open_transport(f"tcpout:127.0.0.1:{free_port()}", None))
    tries = []
    original = client._connect
    monkeypatch.setattr(client, "_connect", lambda now_s: (tries.append(now_s), original(now_s)))
    for tenth in range(35):
        client.poll(tenth * 0.1)
    assert 3 <= len({int(now_s + 1e-9) for now_s in tries}) <= 4
    assert len(tries) <= 8


def options_of(connected):
    """Seconds until the first probe, between probes, and until what no peer acknowledges ends the connection."""
    number = socket.IPPROTO_TCP
    kept_alive = connected.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
    times = [connected.getsockopt(number, option) for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL)]
    return bool(kept_alive), *times, connected.getsockopt(number, socket.TCP_USER_TIMEOUT) / 1000


def test_a_connection_whose_other_end_vanished_is_found_within_minutes(server, opened):
    """Without a word: its power failed. The system asks it for a sign of life."""
    dial(server, opened)
    (connection,) = server._clients.values()
    kept_alive, first_s, every_s, dead_s = options_of(connection._socket)
    assert kept_alive
    assert first_s + every_s + dead_s <= 120.0


def test_a_dropped_client_finds_its_connection_ended(server, opened):
    one, other = dial(server, opened, 2)
    first, second = server.connections()
    assert [server.host(number) for number in (first, second, 99)] == ["127.0.0.1", "127.0.0.1", None]
    server.drop(first)
    assert server.connections() == (second,)
    one.settimeout(5.0)
    assert one.recv(1) == b""
    assert server.send(second, b"still here")
    assert other.recv(100) == b"still here"


def test_a_server_that_has_moved_is_found_where_its_name_leads(opened, monkeypatch):
    port, where = free_port(), ["127.0.0.1"]
    monkeypatch.setattr("firmware_py.link.wire.urls.addresses_of", lambda _url: tuple(where))
    client = opened(open_transport(f"tcpout:station.example:{port}", None))
    where[:] = ["127.0.0.1", "127.0.0.3"]  # the first of which no peer answers at
    with socket.create_server(("127.0.0.3", port)):
        take_until_connected(client, 0.0, 1.0)
