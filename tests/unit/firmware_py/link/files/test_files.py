"""MAVLink FTP server: requests, replies, sessions, uploads and access limits."""

import errno
import gzip
import os
import random
import stat
import zlib
from pathlib import Path

import pytest

from firmware_py.log.archive import archive_log

# Errors and opcodes of the protocol
FAIL, ERRNO, SIZE, SESSION, NO_SESSIONS, END, UNKNOWN, EXISTS, PROTECTED, NOT_FOUND = range(1, 11)
TERMINATE, RESET, LIST, OPEN, READ, CREATE, WRITE, REMOVE, MKDIR, RMDIR = range(1, 11)
OPEN_WRITE, TRUNCATE, RENAME, CHECKSUM, BURST, LIST_TIMES = range(11, 17)
ACK, NAK = 128, 129
SIZE_FIELD, OPCODE_FIELD, BURST_END_FIELD, DATA_START = 4, 3, 6, 12  # offsets in the payload
LOG = "logs/00000001.BIN"
CONTENT = bytes(range(256)) * 5  # not a multiple of the payload size


@pytest.fixture
def disk(tmp_path):
    for name in ("logs", "uploads"):
        (tmp_path / name).mkdir()
    (tmp_path / LOG).write_bytes(CONTENT)
    (tmp_path / "secret").write_bytes(b"secret")
    return tmp_path


@pytest.fixture
def uploads(disk):
    return disk / "uploads"


@pytest.fixture
def client(disk, stored):
    return stored()[1]


def test_replies_carry_the_next_sequence_number_and_address_the_sender(client):
    reply = client.ask(0, sequence=0xFFFF, session=3)
    assert (reply.ok, reply.sequence, reply.session, reply.query, reply.to) == (True, 0, 3, 0, (255, 190))


@pytest.mark.parametrize("opcode", [ACK, NAK])
def test_replies_get_no_reply(client, opcode):
    assert client.all(opcode) == []


@pytest.mark.parametrize(
    ("opcode", "path", "error"),
    [
        *((opcode, "", UNKNOWN) for opcode in (17, 18, 100, 127, 130, 255)),
        *((LIST, path, NOT_FOUND) for path in ("/none", "/logs/none", "/@PARAM/none", f"/{LOG}")),
        (READ, "", SESSION),
        (BURST, "", SESSION),
    ],
)
def test_invalid_request_is_refused(client, opcode, path, error):
    assert client.ask(opcode, path).error == (error,)


def test_depth_of_directories_is_limited(client):
    assert client.ask(MKDIR, "uploads/d/d/d").error == (NOT_FOUND,)
    assert client.ask(MKDIR, "uploads/d/d/d/d").error == (ERRNO, errno.ENAMETOOLONG)


def test_size_of_more_than_239_bytes_is_refused(client):
    client.ask(OPEN, LOG)
    assert client.ask(READ, size=239).ok
    reply = client.ask(READ, size=240, offset=5, sequence=70)
    assert (reply.error, reply.sequence, reply.session, reply.query, reply.offset) == ((SIZE,), 71, 0, READ, 0)


def test_requests_to_other_components_are_ignored(client):
    message = client.request(LIST, "/")
    message.target_component = 42
    assert client.rig.send(message) == []


def test_the_root_shows_directories_and_files(client):
    parameters = f"Fparameters.param\t{len(client.get('parameters.param'))}"
    directories = ["D@MISSION", "D@PARAM", "Dlogs", "Dmetadata", "Duploads"]
    assert sorted(client.list("/")) == [*directories, parameters]


def test_listing_with_modification_times(client, disk):
    os.utime(disk / LOG, (1_700_000_000, 1_700_000_000))
    assert client.list("logs", LIST_TIMES) == [f"F00000001.BIN\t{len(CONTENT)}\t1700000000"]
    assert client.list("logs") == [f"F00000001.BIN\t{len(CONTENT)}"]
    os.utime(disk / LOG, (-5, -5))
    assert client.list("logs", LIST_TIMES) == [f"F00000001.BIN\t{len(CONTENT)}\t0"]
    assert "Dlogs" in client.list("/", LIST_TIMES)


def test_compressed_log_has_both_names(client, disk):
    (compression,) = [archive_log(disk / LOG)]
    next(compression)
    assert client.list("logs") == [f"F00000001.BIN\t{len(CONTENT)}"]  # an incomplete archive is not listed
    client.ask(OPEN, LOG)
    for _ in compression:
        pass
    assert client.ask(READ, offset=256 * 2, size=200).data == CONTENT[512:712]  # the session keeps the old file open
    client.ask(TERMINATE)
    compressed = (disk / "logs" / "00000001.BIN.gz").read_bytes()
    assert client.list("logs") == [f"F00000001.BIN.gz\t{len(compressed)}"]
    assert client.get("logs/00000001.BIN.gz") == compressed
    assert gzip.decompress(compressed) == client.get(LOG) == CONTENT
    assert client.ask(CHECKSUM, LOG).ok


def test_compressed_upload_has_only_its_own_name(client, uploads):
    (uploads / "a.gz").write_bytes(b"content")
    assert client.ask(OPEN, "uploads/a").error == (NOT_FOUND,)


@pytest.mark.parametrize(("others", "wait_s", "is_stored"), [(7, 29.0, True), (7, 30.0, False), (8, 0.0, False)])
def test_pages_of_a_long_listing_come_from_one_of_eight_snapshots(client, disk, others, wait_s, is_stored):
    for number in range(2, 60):
        (disk / "logs" / f"{number:08d}.BIN").write_bytes(b"")
    names = client.ask(LIST, "/logs").data.decode().rstrip("\0").split("\0")
    (disk / LOG).unlink()  # does not shift the entries of the next page of the snapshot
    for number in range(others):
        client.ask(LIST, "uploads" + "/" * number)
    client.rig.now_s += wait_s
    names += client.ask(LIST, "/logs", offset=len(names)).data.decode().rstrip("\0").split("\0")
    numbers = [int(name[1:].split(".")[0]) for name in names]
    assert numbers[:12] == list(range(1, 13))
    assert (numbers == list(range(1, len(names) + 1))) is is_stored


@pytest.mark.parametrize(("length", "count"), [(31, 4), (32, 3)])
def test_page_of_a_listing_has_at_most_239_bytes(client, uploads, length, count):
    for name in ("a" * 64, "b" * 64, "c" * 64, "d" * length):  # 204 bytes, and 4 more than the length
        (uploads / name).touch()
    assert client.ask(LIST, "uploads").data.count(b"\0") == count


def test_size_of_a_file_of_more_than_4_gib_is_the_largest_number(client, disk):
    os.truncate(disk / LOG, (1 << 32) + 5)
    assert client.ask(OPEN, LOG).data == b"\xff" * 4
    assert client.ask(READ, offset=0xFFFFFFFF, size=10).data == bytes(6)


def test_empty_directory_has_no_entries(client):
    assert client.list("/uploads") == []


@pytest.mark.parametrize("path", ["/logs/00000001.BIN", LOG, "//logs/./00000001.BIN\0"])
def test_a_file_is_read_whole(client, path):
    assert client.get(path) == CONTENT


def test_read_at_any_offset(client):
    assert client.ask(OPEN, LOG).data == len(CONTENT).to_bytes(4, "little")
    assert client.ask(READ, offset=300, size=17).data == CONTENT[300:317]
    assert client.ask(READ, offset=len(CONTENT) - 5, size=17).data == CONTENT[-5:]
    assert client.ask(READ, offset=len(CONTENT), size=17).error == (END,)
    assert client.ask(READ, offset=0xFFFFFFFF, size=17).error == (END,)


@pytest.mark.parametrize("part_bytes", [239, 110, 1])
def test_burst_sends_parts_of_the_requested_size(client, part_bytes):
    client.ask(OPEN, LOG)
    content, sequences, offset, counts = b"", [], 0, []
    while offset < len(CONTENT):
        parts = client.all(BURST, offset=offset, size=part_bytes)
        assert [part.last for part in parts] == [0] * (len(parts) - 1) + [1]
        assert {part.session for part in parts} == {0}
        counts.append(len(parts))
        sequences = [part.sequence for part in parts]
        assert sequences == list(range(client.sequence, client.sequence + len(parts)))
        for part in parts:
            assert part.offset == len(content)
            content += part.data
        offset = len(content)
    assert content == CONTENT
    assert counts == {239: [6], 110: [12], 1: [160] * 8}[part_bytes]
    assert client.ask(BURST, offset=offset, size=part_bytes).error == (END,)


def test_open_file_keeps_its_size_when_it_grows(client, disk):
    client.ask(OPEN, LOG)
    with (disk / LOG).open("ab") as log:
        log.write(b"more")
    assert client.ask(READ, offset=len(CONTENT)).error == (END,)


def test_open_for_writing_creates_the_file(client, uploads):
    assert client.ask(OPEN_WRITE, "uploads/new.plan").data == bytes(4)
    client.ask(WRITE, b"0123")
    assert client.ask(TERMINATE).ok
    assert (uploads / "new.plan").read_bytes() == b"0123"
    assert client.ask(OPEN_WRITE, "uploads/none/new.plan").ok
    assert not client.ask(TERMINATE).ok
    assert client.ask(OPEN_WRITE, "@PARAM/param.pck").data == bytes(4)


def test_reading_needs_an_open_session(client):
    client.ask(OPEN, LOG)
    assert client.ask(READ, session=1).error == (SESSION,)
    assert client.ask(WRITE, b"x").error == (SESSION,)  # it is open for reading
    assert client.ask(TERMINATE).ok
    assert client.ask(READ).error == (SESSION,)


def test_checksum_is_the_crc32_of_mavlink(client):
    for path in (LOG, "metadata/general.json"):
        expected = zlib.crc32(client.get(path), 0xFFFFFFFF) ^ 0xFFFFFFFF
        assert client.ask(CHECKSUM, path).data == expected.to_bytes(4, "little")


def test_each_client_has_separate_sessions(disk, stored, ftp_station):
    rig, client = stored(addresses=("one", "two"))
    (disk / "logs" / "00000002.BIN").write_bytes(b"second")
    client.address = "one"
    other = ftp_station(rig, "two")
    client.ask(OPEN, LOG)
    other.ask(OPEN, "logs/00000002.BIN")
    assert client.ask(READ, size=10).data == CONTENT[:10]
    assert other.ask(READ, size=10).data == b"second"
    assert other.ask(RESET).ok
    assert client.ask(READ, size=10).data == CONTENT[:10]


def test_client_has_six_sessions_and_those_idle_for_ten_seconds_are_closed(client):
    client.rig.now_s = 100.0
    for number in range(6):
        assert client.ask(OPEN, LOG, session=number).ok
    assert client.ask(OPEN, LOG, session=6).error == (NO_SESSIONS,)
    assert client.ask(OPEN, LOG, session=5).ok  # opens the same session again
    client.rig.now_s = 109.75
    assert client.ask(OPEN, LOG, session=6).error == (NO_SESSIONS,)
    assert client.ask(OPEN, "logs/none", session=6).error == (NO_SESSIONS,)  # without use of the disk
    client.rig.now_s = 110.0
    client.ask(READ, session=0)
    assert client.ask(OPEN, LOG, session=6).ok
    assert client.ask(READ, session=0).ok
    assert client.ask(READ, session=1).error == (SESSION,)


def test_all_clients_have_sixteen_sessions(disk, stored, ftp_station):
    rig, _ = stored(addresses=("one", "two", "three"))
    rig.now_s = 100.0
    clients = [ftp_station(rig, address) for address in ("one", "two", "three")]
    opened = [client.ask(OPEN, LOG, session=number).ok for client in clients for number in range(6)]
    assert opened == [True] * 16 + [False] * 2
    rig.now_s = 110.0
    assert clients[2].ask(OPEN, LOG, session=4).ok
    assert clients[0].ask(READ, session=0).error == (SESSION,)
    assert clients[0].ask(READ, session=1).ok


def test_descriptors_do_not_leak(client, uploads):
    (uploads / "d").mkdir()
    os.mkfifo(uploads / "pipe")
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(10):
        client.ask(OPEN, LOG)
        client.ask(LIST, "logs")
        client.ask(CHECKSUM, LOG)
        client.ask(CREATE, "uploads/a/b")
        client.ask(OPEN, "logs/none")
        client.ask(OPEN, "uploads/d/none")
        client.ask(OPEN, "uploads/pipe")
        client.put("uploads/d/c", b"content")
    client.ask(RESET)
    assert len(list(Path("/proc/self/fd").iterdir())) == descriptors


def test_complete_upload_replaces_the_file(client, uploads):
    (uploads / "a.plan").write_bytes(b"old")
    assert client.ask(CREATE, "/uploads/a.plan").ok
    assert client.ask(WRITE, CONTENT[200:400], offset=200).ok  # in any order
    assert client.ask(WRITE, CONTENT[:200]).ok
    assert (uploads / "a.plan").read_bytes() == b"old"
    assert client.ask(TERMINATE).ok
    assert (uploads / "a.plan").read_bytes() == CONTENT[:400]
    assert client.list("uploads") == ["Fa.plan\t400"]


@pytest.mark.parametrize(("wait_s", "is_stored"), [(15.0, True), (15.25, False)])
def test_reset_stores_a_recent_upload_and_discards_an_old_one(client, uploads, texts, wait_s, is_stored):
    """QGroundControl ends an upload by RESET; a restarted client also sends RESET."""
    (uploads / "a.plan").write_bytes(b"old")
    client.rig.now_s = 100.0
    client.ask(CREATE, "/uploads/a.plan")
    client.ask(WRITE, b"content")
    client.ask(OPEN, LOG, session=1)
    client.rig.now_s += wait_s
    replies = client.rig.send(client.request(RESET))
    assert [reply.error for reply in client.replies(replies) if not reply.ok] == ([] if is_stored else [(FAIL,)])
    assert texts(replies) == ([] if is_stored else ["Upload aborted: file unchanged"])
    assert (uploads / "a.plan").read_bytes() == (b"content" if is_stored else b"old")
    assert client.ask(RESET).ok


def test_incomplete_upload_keeps_the_old_file_and_is_reported(client, uploads, texts):
    (uploads / "a.plan").write_bytes(b"old")
    client.ask(CREATE, "/uploads/a.plan")
    client.ask(WRITE, CONTENT[:200])
    client.ask(WRITE, CONTENT[300:400], offset=300)
    client.ask(WRITE, CONTENT[190:250], offset=190)
    replies = client.rig.send(client.request(TERMINATE))
    assert [reply.error for reply in client.replies(replies)] == [(FAIL,)]
    assert texts(replies) == ["uploads/a.plan: upload incomplete, send the file again"]
    assert (uploads / "a.plan").read_bytes() == b"old"
    client.ask(CREATE, "/uploads/a.plan")
    for start in (300, 0, 200, 100):  # complete, in another order
        client.ask(WRITE, CONTENT[start : start + 100], offset=start)
    assert client.ask(TERMINATE).ok
    assert (uploads / "a.plan").read_bytes() == CONTENT[:400]


def test_number_of_gaps_in_an_upload_is_limited(client):
    client.ask(CREATE, "/uploads/a.plan")
    replies = [client.ask(WRITE, b"x", offset=2 * number + 1) for number in range(65)]
    assert all(reply.ok for reply in replies[:64])
    assert replies[64].error == (FAIL,)


def test_abandoned_upload_is_discarded_after_two_minutes(client, uploads):
    client.rig.now_s = 100.0
    (uploads / "a.plan").write_bytes(b"old")
    client.ask(CREATE, "/uploads/a.plan")
    client.ask(WRITE, b"new")
    client.rig.now_s += 120.0
    assert client.ask(WRITE, b"more", offset=3).ok
    client.rig.now_s += 120.25
    assert client.ask(WRITE, b"more", offset=7).error == (SESSION,)
    assert (uploads / "a.plan").read_bytes() == b"old"


def test_file_is_extended_truncated_renamed_and_removed(client, uploads):
    client.put("uploads/a.plan", b"0123456789")
    assert client.ask(OPEN_WRITE, "uploads/a.plan").data == (10).to_bytes(4, "little")
    client.ask(WRITE, b"ABC", offset=8)
    assert client.ask(TERMINATE).ok
    assert (uploads / "a.plan").read_bytes() == b"01234567ABC"
    assert client.ask(TRUNCATE, "uploads/a.plan", offset=4).ok
    assert (uploads / "a.plan").read_bytes() == b"0123"
    assert client.ask(TRUNCATE, "uploads/a.plan", offset=400).error == (ERRNO, errno.EINVAL)
    assert client.ask(MKDIR, "uploads/d").ok
    assert client.ask(MKDIR, "uploads/d").error == client.ask(MKDIR, "logs").error == (EXISTS,)
    (uploads / "link").symlink_to("nothing")
    assert client.ask(RENAME, "uploads/a.plan\0uploads/link").error == (EXISTS,)
    assert client.ask(RENAME, "uploads/link\0uploads/d/link").ok
    (uploads / "d" / "link").unlink()
    assert client.ask(RENAME, "uploads/a.plan\0uploads/d/b.plan\0").ok
    assert client.list("uploads/d") == ["Fb.plan\t4"]
    assert client.ask(RENAME, "uploads/d/b.plan\0uploads/b.plan").ok
    assert client.ask(RENAME, "uploads/b.plan\0uploads/d/b.plan").ok
    assert client.ask(RMDIR, "uploads/d").error == (ERRNO, errno.ENOTEMPTY)
    client.put("uploads/c", b"")
    assert client.ask(RENAME, "uploads/c\0uploads/d/b.plan").error == (EXISTS,)
    assert client.ask(RENAME, "uploads/none\0uploads/c").error == (NOT_FOUND,)
    assert client.ask(REMOVE, "uploads/d/b.plan").ok
    assert client.ask(REMOVE, "uploads/d/b.plan").error == (NOT_FOUND,)
    assert client.ask(REMOVE, "uploads/d").error == (ERRNO, errno.EISDIR)
    assert client.ask(RMDIR, "uploads/d").ok


@pytest.mark.parametrize(
    ("opcode", "path"),
    [
        *((CREATE, path) for path in ("logs/a", "a", "uploads", "metadata/general.json", "parameters.param")),
        *((opcode, LOG) for opcode in (OPEN_WRITE, REMOVE, TRUNCATE)),
        *((REMOVE, path) for path in ("parameters.param", "/")),
        *((RENAME, paths) for paths in (f"{LOG}\0uploads/a", "uploads/a\0logs/a", "a\0uploads/a", "uploads/a\0a")),
        *((MKDIR, path) for path in ("logs/d", "d", "/")),
        *((RMDIR, path) for path in ("logs", "uploads", "logs/d", "metadata")),
    ],
)
def test_only_uploads_are_writable(client, disk, opcode, path):
    (disk / "logs" / "d").mkdir()
    paths = sorted(disk.rglob("*"))
    assert client.ask(opcode, path).error == (PROTECTED,)
    assert sorted(disk.rglob("*")) == paths
    assert (disk / LOG).read_bytes() == CONTENT


def test_size_limits_of_uploads(client, uploads):
    (uploads / "a").write_bytes(bytes((1 << 20) + 1))
    assert client.ask(OPEN_WRITE, "uploads/a").error == (ERRNO, errno.EFBIG)
    (uploads / "a").write_bytes(bytes(1 << 20))
    assert client.ask(OPEN_WRITE, "uploads/a").ok
    assert client.ask(WRITE, b"x", offset=(1 << 20) - 1).ok
    assert client.ask(WRITE, b"x", offset=1 << 20).error == (ERRNO, errno.EFBIG)
    assert client.ask(WRITE, b"x", offset=0xFFFFFFFF).error == (ERRNO, errno.EFBIG)
    for number in range(15):
        (uploads / str(number)).write_bytes(bytes(1 << 20))
    assert client.ask(TERMINATE).ok  # the uploads now have 16 MiB, the limit
    assert client.put("uploads/b", b"one more").error == (ERRNO, errno.ENOSPC)
    assert sorted(path.name for path in uploads.iterdir()) == sorted(["a", *map(str, range(15))])


def test_number_of_open_uploads_is_limited_and_idle_ones_are_closed(client, uploads):
    client.rig.now_s = 100.0
    for number in range(4):
        assert client.ask(CREATE, f"uploads/{number}", session=number).ok
        assert client.ask(WRITE, b"x", session=number).ok
    assert client.ask(CREATE, "uploads/4", session=4).error == (NO_SESSIONS,)
    assert client.ask(OPEN_WRITE, LOG, session=4).error == (NO_SESSIONS,)  # without use of the disk
    assert client.ask(OPEN, LOG, session=4).ok
    assert client.ask(CREATE, "uploads/3", session=3).ok  # opens the same session again
    client.rig.now_s = 109.75
    assert client.ask(CREATE, "uploads/4", session=4).error == (NO_SESSIONS,)
    client.rig.now_s = 110.0
    assert client.ask(CREATE, "uploads/4", session=4).ok
    assert client.ask(WRITE, b"x", session=0).error == (SESSION,)
    assert client.ask(RESET).ok
    assert sorted(path.name for path in uploads.iterdir()) == ["1", "2", "3", "4"]


def test_simultaneous_bursts_are_all_completed(client):
    for number in range(3):
        client.ask(OPEN, LOG, session=number)
    requests = [client.request(BURST, size=20, session=number) for number in range(3)]
    replies = client.rig.send(*requests)
    assert sum(bytes(message.payload)[BURST_END_FIELD] for message in replies) == 3
    assert sum(bytes(message.payload)[SIZE_FIELD] for message in replies) == 3 * len(CONTENT)


def test_number_of_files_is_limited(client, uploads):
    (uploads / "d").mkdir()
    for number in range(127):
        (uploads / "d" / str(number)).touch()
    assert client.put("uploads/b", b"").error == (ERRNO, errno.ENOSPC)
    assert client.ask(MKDIR, "uploads/b").error == (ERRNO, errno.ENOSPC)
    assert client.put("uploads/d/5", b"replacement").ok


@pytest.mark.parametrize("opcode", [CREATE, MKDIR])
def test_retry_gets_the_same_reply_and_is_not_executed_again(client, uploads, opcode):
    reply = client.ask(opcode, "uploads/a", sequence=7)
    client.ask(WRITE, b"content", sequence=8)
    assert vars(client.ask(opcode, "uploads/a", sequence=7)) == vars(reply)
    client.ask(TERMINATE, sequence=9)
    if opcode == CREATE:
        assert (uploads / "a").read_bytes() == b"content"
    assert client.ask(opcode, "uploads/a", sequence=7).ok
    if opcode == CREATE:
        assert client.ask(TERMINATE, sequence=9).ok  # a duplicate; no session is open
        assert (uploads / "a").read_bytes() == b"content"


def test_duplicate_of_an_open_request_keeps_the_open_file(client, disk):
    size = client.ask(OPEN, LOG, sequence=1).data
    (disk / LOG).unlink()
    (disk / LOG).write_bytes(b"new")
    assert client.ask(OPEN, LOG, sequence=1).data == size
    assert client.ask(READ, size=10).data == CONTENT[:10]
    assert client.ask(TERMINATE, sequence=9).ok
    assert client.ask(OPEN, LOG, sequence=2).data == bytes((3, 0, 0, 0))
    assert client.ask(TERMINATE, sequence=9).ok  # a number that MAVProxy repeats
    assert client.ask(READ).error == (SESSION,)


def test_retry_of_a_removal_succeeds(client):
    client.put("uploads/a", b"")
    assert client.ask(REMOVE, "uploads/a", sequence=70).ok
    assert client.ask(REMOVE, "uploads/a", sequence=70).ok
    assert client.ask(REMOVE, "uploads/a", sequence=71).error == (NOT_FOUND,)


@pytest.mark.parametrize(("others", "wait_s", "is_stored"), [(63, 5.0, True), (64, 5.0, False), (0, 5.25, False)])
def test_replies_to_64_requests_are_stored_for_five_seconds(client, others, wait_s, is_stored):
    client.rig.now_s = 100.0
    assert client.ask(MKDIR, "uploads/a", sequence=7).ok
    for number in range(others):
        client.ask(REMOVE, "uploads/none", sequence=8 + number)
    client.rig.now_s += wait_s
    assert client.ask(MKDIR, "uploads/a", sequence=7).ok is is_stored


def test_restarted_client_gets_no_stored_reply(client):
    client.ask(OPEN, LOG, sequence=0)
    client.ask(TERMINATE, sequence=1)
    assert client.ask(OPEN, LOG, sequence=0).ok
    assert client.ask(READ, sequence=2).ok


def test_transfer_over_a_link_with_losses_duplicates_and_reordering(client, uploads):
    """A quarter of the requests and of the replies is lost; old requests arrive again at any time."""
    rng, sent = random.Random(3), []

    def send_until_reply(opcode, data=b"", *, offset=0, size=None):
        request = client.request(opcode, data, offset=offset, size=size)
        sent.append(request)
        while True:
            if rng.random() < 0.3:
                client.rig.send(rng.choice(sent[-12:]))
            if rng.random() < 0.75:
                replies = client.rig.send(request)
                if rng.random() < 0.75:
                    return bytes(replies[0].payload)
            client.rig.now_s += 0.05

    content = random.Random(4).randbytes(6000)
    for name in ("a", "b"):
        assert send_until_reply(CREATE, f"uploads/{name}")[OPCODE_FIELD] == ACK
        for start in range(0, len(content), 239):
            assert send_until_reply(WRITE, content[start : start + 239], offset=start)[OPCODE_FIELD] == ACK
        assert send_until_reply(TERMINATE)[OPCODE_FIELD] == ACK
    assert send_until_reply(REMOVE, "uploads/b")[OPCODE_FIELD] == ACK
    assert send_until_reply(OPEN, "uploads/a")[OPCODE_FIELD] == ACK
    read = b""
    while len(read) < len(content):
        reply = send_until_reply(READ, offset=len(read), size=239)
        assert reply[OPCODE_FIELD] == ACK
        read += reply[DATA_START : DATA_START + reply[SIZE_FIELD]]
    assert read == content
    send_until_reply(TERMINATE)
    assert {path.name: path.read_bytes() for path in uploads.iterdir()} == {"a": content}


@pytest.mark.parametrize(
    "path",
    [
        *("../secret", "/../secret", "logs/../../secret", "uploads/../secret", "uploads/..", "\\..\\secret"),
        *("uploads/link", "uploads/directory_link/secret", "uploads/pipe", "uploads/.hidden"),
        *("/etc/passwd", "logs//etc/passwd", "uploads/a\0/../../secret"),
        *("uploads/" + "n" * 65, "uploads/" + "d/" * 9 + "f", "uploads/a\x01b", b"uploads/\xff"),
    ],
)
def test_paths_outside_the_root_are_not_accessible(client, disk, uploads, path):
    (uploads / "link").symlink_to(disk / "secret")
    (uploads / "directory_link").symlink_to(disk)
    (uploads / ".hidden").write_bytes(b"hidden")
    os.mkfifo(uploads / "pipe")
    for opcode in (OPEN, OPEN_WRITE, CHECKSUM, TRUNCATE, MKDIR, RMDIR, LIST):
        reply = client.ask(opcode, path)
        # The server cuts a path at a NUL; the rest is inside the root and may be created.
        assert not reply.ok or opcode in (MKDIR, RMDIR) or (opcode == OPEN_WRITE and "\0" in str(path))
    for name in ("link", "directory_link"):
        assert (uploads / name).is_symlink()
    assert (disk / "secret").read_bytes() == b"secret"
    assert not any("link" in entry for entry in client.list("uploads"))
    assert {entry.name for entry in disk.iterdir()} == {"logs", "uploads", "secret"}


def test_upload_replaces_a_symbolic_link_and_does_not_follow_it(client, disk, uploads):
    (uploads / "link").symlink_to(disk / "secret")
    assert client.put("uploads/link", b"new").ok
    assert (disk / "secret").read_bytes() == b"secret"
    assert not (uploads / "link").is_symlink()


def test_without_storage_only_generated_files_are_listed(rig, ftp_station):
    client = ftp_station(rig)
    assert [line[0] for line in client.list("/")] == ["D", "D", "D", "F"]
    assert client.ask(CREATE, "uploads/a").error == (NOT_FOUND,)


def test_repeated_sequence_numbers_do_not_return_old_content(client, disk):
    for content in (b"first", b"second", b"third"):
        (disk / LOG).unlink()  # a new inode, so that a file still open keeps its content
        (disk / LOG).write_bytes(content)
        client.ask(OPEN, LOG, sequence=1)
        assert client.ask(READ, offset=0, size=20).data == content
        assert client.ask(TERMINATE, sequence=9).ok


def test_upload_is_synced_before_it_replaces_the_file(client, uploads, monkeypatch):
    calls, fsync, rename = [], os.fsync, os.rename

    def record_sync(descriptor):
        calls.append("directory" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else os.fstat(descriptor).st_size)
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", record_sync)
    monkeypatch.setattr(os, "rename", lambda *names, **more: calls.append("rename") or rename(*names, **more))
    assert client.put("uploads/a", b"content").ok
    assert calls == [7, "rename", "directory"]


def test_upload_to_a_full_disk_keeps_the_old_file(client, uploads, monkeypatch):
    (uploads / "a").write_bytes(b"old")
    write = os.write
    client.ask(CREATE, "uploads/a")
    client.ask(WRITE, b"content")
    with monkeypatch.context() as patches:
        patches.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:3]))
        assert client.ask(TERMINATE).error == (ERRNO, errno.ENOSPC)
    assert {path.name: path.read_bytes() for path in uploads.iterdir()} == {"a": b"old"}


def test_listing_has_at_most_4096_entries(client, uploads):
    for number in range(4097):
        (uploads / str(number)).touch()
    assert client.ask(LIST, "uploads", offset=4095).ok
    assert client.ask(LIST, "uploads", offset=4096).error == (END,)
