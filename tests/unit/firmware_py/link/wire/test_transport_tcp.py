"""TCP over loopback sockets."""

import select
import socket
import time

import pytest

from firmware_py.link.wire import transport_tcp
from firmware_py.link.wire.open_transport import open_transport
from firmware_py.link.wire.urls import LinkError

MAX_CLIENTS = 25


@pytest.fixture
def server(closing_later, free_port):
    return closing_later(open_transport(f"tcpin:127.0.0.1:{free_port()}", None))


def port_of(server):
    return server._listener.getsockname()[1]


def serve(transport, *, until):
    """Serve a transport as the loop does until a condition of the received data is met; return the data."""
    received = []
    end_s = time.monotonic() + 10.0
    while not until(received):
        assert time.monotonic() < end_s
        ready, _, _ = select.select(transport.descriptors(), [], [], 0.01)
        for descriptor in ready:
            received.extend(transport.receive(descriptor))
        transport.poll(time.monotonic())
    return received


@pytest.fixture
def connect(server, closing_later):
    def make_clients(count=1):
        clients = [closing_later(socket.create_connection(("127.0.0.1", port_of(server)), 5.0)) for _ in range(count)]
        serve(server, until=lambda _: len(server.connections()) >= min(count, MAX_CLIENTS))
        return clients

    return make_clients


def test_each_client_is_a_peer(server, connect):
    first, second = connect(2)
    first.sendall(b"one")
    second.sendall(b"two")
    received = dict(serve(server, until=lambda received: len(received) == 2))
    assert sorted(received.values()) == [b"one", b"two"]
    for address, data in received.items():
        assert server.send(address, b"to " + data)
    assert (first.recv(100), second.recv(100)) == (b"to one", b"to two")
    assert server.addresses() == ()
    assert [server.send(address, b"x") for address in (2, -1, "line")] == [False] * 3
    server.close()
    assert (first.recv(1), second.recv(1), server.connections()) == (b"", b"", ())


def test_disconnected_client_is_removed_and_its_number_is_not_reused(server, connect):
    (client,) = connect()
    (number,) = server.connections()
    client.close()
    serve(server, until=lambda _: not server.connections())
    assert not server.send(number, b"x")
    connect()
    assert server.connections() != (number,)


def test_number_of_clients_is_limited(server, connect):
    clients = connect(MAX_CLIENTS) + connect(3)
    serve(server, until=lambda _: not select.select([server._listener], [], [], 0.05)[0])
    assert len(server.connections()) == MAX_CLIENTS
    assert [client.recv(1) for client in clients[MAX_CLIENTS:]] == [b""] * 3
    assert not select.select(clients[:MAX_CLIENTS], [], [], 0.0)[0]


def test_client_that_reads_late_receives_complete_messages(server, connect):
    (client,) = connect()
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


def test_slow_client_is_sent_little_so_that_new_data_is_not_delayed(server, closing_later):
    client = closing_later(socket.socket())
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 11)
    client.connect(("127.0.0.1", port_of(server)))
    serve(server, until=lambda _: server.connections())
    (number,) = server.connections()
    assert 1 <= sum(server.send(number, b"m" * 1000) for _ in range(1000)) <= 24


def test_occupied_port_is_an_error(server):
    with pytest.raises(LinkError, match=r"in use.*choose another port"):
        open_transport(f"tcpin:127.0.0.1:{port_of(server)}", None)


@pytest.fixture
def client_port(free_port):
    return free_port()


@pytest.fixture
def client(closing_later, client_port):
    return closing_later(open_transport(f"tcpout:127.0.0.1:{client_port}", None))


def wait_for_connection(client, now_s, step_s=0.0):
    for _ in range(5000):
        client.poll(now_s)
        if client.addresses():
            return
        now_s += step_s
        time.sleep(0.001)
    pytest.fail("not connected")


def receive(client):
    (descriptor,) = client.descriptors()
    assert select.select([descriptor], [], [], 5.0)[0]
    return list(client.receive(descriptor))


def test_client_connects_to_a_server_that_starts_later_and_reconnects(client, client_port):
    client.poll(0.0)
    assert client.addresses() == ()
    numbers = []
    for now_s in (2.0, 4.0):
        with socket.create_server(("127.0.0.1", client_port)) as listener:
            listener.settimeout(5.0)
            wait_for_connection(client, now_s)
            accepted, _ = listener.accept()
            with accepted:
                numbers.append(client.addresses()[0])
                assert has_all_options(client._connection._socket)
                assert not client.send(numbers[-1] - 1, b"to the former server")
                assert client.send(numbers[-1], b"hello")
                accepted.settimeout(5.0)
                assert accepted.recv(100) == b"hello"
                accepted.sendall(b"answer")
                assert receive(client) == [(numbers[-1], b"answer")]
        assert receive(client) == []
        assert client.addresses() == ()
    assert numbers[0] != numbers[1]
    assert client.host(numbers[1]) == numbers[1]


def test_client_tries_to_connect_once_per_second(client, monkeypatch):
    attempts, new_socket = [], transport_tcp._new_socket
    monkeypatch.setattr(transport_tcp, "_new_socket", lambda: attempts.append(tenth) or new_socket())
    for tenth in range(35):
        for _ in range(3):  # the refusal may come at a later call
            client.poll(tenth * 0.1)
    assert attempts == [0, 10, 20, 30]


def has_all_options(connected):
    """Whether a vanished peer is detected in time, and a slow one is sent no old data."""
    levels = {
        socket.IPPROTO_TCP: {
            socket.TCP_NODELAY: 1,
            socket.TCP_KEEPIDLE: 20,
            socket.TCP_KEEPINTVL: 10,
            socket.TCP_USER_TIMEOUT: 60_000,
            socket.TCP_NOTSENT_LOWAT: 4096,
        },
        socket.SOL_SOCKET: {socket.SO_KEEPALIVE: 1, socket.SO_RCVBUF: 2 * 32_768},  # the system doubles the size
    }
    for level, options in levels.items():
        assert {option: connected.getsockopt(level, option) for option in options} == options
    return not connected.getblocking()


def test_connections_detect_vanished_clients_and_send_no_old_data(server, connect):
    connect()
    (connection,) = server._clients.values()
    assert has_all_options(connection._socket)
    assert server._listener.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR) == 1


def test_client_is_read_in_pieces_of_256_bytes(server, connect):
    (client,) = connect()
    client.sendall(b"x" * 600)
    (number,) = server.connections()
    received = serve(server, until=lambda received: sum(len(data) for _, data in received) == 600)
    assert {address for address, _ in received} == {number}
    assert len(received[0][1]) == 256


def test_dropped_client_is_disconnected(server, connect):
    dropped, other = connect(2)
    first, second = server.connections()
    assert [server.host(number) for number in (first, second, 99)] == ["127.0.0.1", "127.0.0.1", None]
    server.drop(first)
    assert server.connections() == (second,)
    dropped.settimeout(5.0)
    assert dropped.recv(1) == b""
    assert server.send(second, b"still here")
    assert other.recv(100) == b"still here"


def test_client_tries_all_addresses_of_a_host_name(closing_later, free_port, monkeypatch):
    port, addresses = free_port(), ["127.0.0.1"]
    monkeypatch.setattr("firmware_py.link.wire.urls.addresses_of", lambda _url: tuple(addresses))
    client = closing_later(open_transport(f"tcpout:station.example:{port}", None))
    addresses[:] = ["127.0.0.1", "127.0.0.3"]  # the server has moved to the second address
    with socket.create_server(("127.0.0.3", port)):
        wait_for_connection(client, 0.0, 1.0)


def test_server_that_refuses_is_looked_up_every_ten_seconds(closing_later, free_port, monkeypatch):
    queries = []
    monkeypatch.setattr("firmware_py.link.wire.urls.addresses_of", lambda url: queries.append(url) or ("127.0.0.1",))
    client = closing_later(open_transport(f"tcpout:station.example:{free_port()}", None))
    for now_s, count in ((0.0, 2), (9.0, 2), (10.0, 3), (19.0, 3), (20.0, 4)):  # the first before the start
        end_s = time.monotonic() + 10.0
        for _ in range(3):
            client.poll(now_s)
        while len(queries) < count:
            assert time.monotonic() < end_s
    assert len(queries) == 4
