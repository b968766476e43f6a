"""Bundles: integrity, signatures, versions."""

import io
import json
import shutil
import subprocess
import tarfile

import pytest

from firmware_py.install import bundle as module
from firmware_py.install.bundle import (
    LIST,
    SIGNATURE,
    UpdateError,
    check_computer,
    is_older,
    read_list,
    unpack,
    version_key,
)
from support.small_bundle import load_bundle_maker

FILES = {"a-1.0-py3-none-any.whl": b"x" * 700, "requirements.txt": b"a==1.0\n", "pip-25.3-py3-none-any.whl": b""}
KEYGEN = shutil.which("ssh-keygen")


@pytest.fixture
def make(tmp_path):
    def create(version="0.2.0", utc_s=1000, key=None, name="b.bundle", files=FILES):
        (folder := tmp_path / f"files of {name}").mkdir()
        for file, content in files.items():
            (folder / file).write_bytes(content)
        load_bundle_maker().write_bundle(folder, tmp_path / name, version, "abcd1234", utc_s, key)
        return tmp_path / name

    return create


def refusal(path, folder, signers=None):
    shutil.rmtree(folder, ignore_errors=True)
    with pytest.raises(UpdateError) as error:
        unpack(path, folder, signers)
    return str(error.value)


def repack(path, change):
    """Change the members of a bundle."""
    with tarfile.open(path) as archive:
        members = [(member, archive.extractfile(member).read()) for member in archive]
    with tarfile.open(path, "w:") as archive:
        for member, content in change(members):
            member.size = len(content) if member.isreg() else 0
            archive.addfile(member, io.BytesIO(content))
    return path


def test_bundle_round_trip(make, tmp_path):
    bundle = unpack(make(), tmp_path / "out", None)
    assert (bundle.version, bundle.commit, bundle.commit_utc_s) == ("0.2.0", "abcd1234", 1000)
    assert bundle.title == "0.2.0 (git abcd1234)"
    assert {name: (tmp_path / "out" / name).read_bytes() for name in FILES} == FILES
    assert read_list((tmp_path / "out" / LIST).read_bytes()) == bundle
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o700
    assert bundle.wheel_of("pip") == "pip-25.3-py3-none-any.whl"
    with pytest.raises(UpdateError, match="no wheel of numpy"):
        bundle.wheel_of("numpy")


def test_same_files_make_the_same_bundle(make):
    assert make(name="one").read_bytes() == make(name="two").read_bytes()


def test_truncated_bundle_is_refused(make, tmp_path):
    path = make()
    content = path.read_bytes()
    with tarfile.open(path) as archive:
        end = max(member.offset_data + member.size for member in archive)
    for length in (*range(0, end, 97), end - 1):
        path.write_bytes(content[:length])
        assert "copy it again" in (output := refusal(path, tmp_path / "out")) or "not a bundle" in output, length


def test_changed_byte_is_detected_or_has_no_effect(make, tmp_path):
    path = make()
    content = path.read_bytes()
    for offset in range(0, len(content), 61):
        path.write_bytes(content[:offset] + bytes([content[offset] ^ 0x55]) + content[offset + 1 :])
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        try:
            unpack(path, tmp_path / "out", None)
        except UpdateError:
            continue
        assert {name: (tmp_path / "out" / name).read_bytes() for name in FILES} == FILES, offset


def link(name):
    def change(members):
        for member, _ in members:
            if member.name == name:
                member.type, member.linkname = tarfile.SYMTYPE, "/etc/passwd"
        return members

    return change


def pad_list(size):
    return lambda members: [(members[0][0], members[0][1].ljust(size)), *members[1:]]


def add_signature(size):
    return lambda members: [members[0], (tarfile.TarInfo(SIGNATURE), bytes(size)), *members[1:]]


def cut_first(members):
    return [members[0], (members[1][0], members[1][1][:-1]), *members[2:]]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda members: [*members, (tarfile.TarInfo("more.whl"), b"")], "'more.whl', which is not in its list"),
        (lambda members: [*members, members[-1]], "is not in its list"),
        (link("requirements.txt"), "requirements.txt has 0 bytes, 7 in the list"),
        (link("pip-25.3-py3-none-any.whl"), "pip-25.3-py3-none-any.whl has 0 bytes"),
        (cut_first, "a-1.0-py3-none-any.whl has 699 bytes, 700 in the list"),
        (link(LIST), "bundle.json is not valid in a bundle"),
        (pad_list((1 << 20) + 1), "bundle.json is not valid in a bundle"),
        (add_signature((1 << 16) + 1), "bundle.json.sig is not valid in a bundle"),
        (lambda _members: [], "it is not a bundle; make one"),
        (lambda members: members[1:], "it is not a bundle; make one"),
        (lambda members: members[:1], "is missing, the bundle is incomplete"),
    ],
)
def test_changed_members_are_refused(make, tmp_path, change, text):
    assert text in refusal(repack(make(), change), tmp_path / "out")


@pytest.mark.parametrize("change", [pad_list(1 << 20), add_signature(1 << 16)])
def test_longest_list_and_signature_are_read(make, tmp_path, change):
    assert unpack(repack(make(), change), tmp_path / "out", None).version == "0.2.0"


def list_of(name="a.whl", count=1, digest="0" * 64, **changes):
    files = {name: {"bytes": count, "sha256": digest}}
    data = {"format": 1, "version": "1.0.0", "commit": "", "commit_utc_s": 0, "files": files}
    return json.dumps(data | changes).encode()


@pytest.mark.parametrize(
    ("name", "count", "digest"),
    [
        *((name, 1, "0" * 64) for name in ("../evil", "/etc/evil", "a/b", "", ".hidden", "x" * 300)),
        *(("a.whl", count, "0" * 64) for count in (-1, (1 << 30) + 1)),
        *(("a.whl", 1, digest) for digest in ("0" * 63, "0" * 65, "A" * 64)),
    ],
)
def test_entry_with_a_path_or_an_impossible_size_or_hash_is_refused(name, count, digest):
    with pytest.raises(UpdateError) as refused:
        read_list(list_of(name, count, digest))
    assert str(refused.value) == f"the list of the bundle has an invalid entry: {name[:60]!r}"


def test_sizes_at_the_limits_are_read_and_texts_are_shortened():
    bundle = read_list(list_of(count=0, commit="c" * 61))
    assert (bundle.files, bundle.commit) == ({"a.whl": (0, "0" * 64)}, "c" * 60)
    assert read_list(list_of(count=1 << 30)).files["a.whl"][0] == 1 << 30
    with pytest.raises(UpdateError, match=f"has format {'x' * 20}, this program reads format 1"):
        read_list(list_of(format="x" * 21))
    with pytest.raises(UpdateError, match=f"'{'9' * 40}' is not a version"):
        read_list(list_of(version="9" * 41))


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b"\xff", b'{"format": 2}', b"[" * 100_000, b'{"format": 1}'])
def test_invalid_list_is_a_one_line_error(content):
    with pytest.raises(UpdateError) as error:
        read_list(content)
    assert "\n" not in str(error.value)


@pytest.fixture
def key(tmp_path):
    if KEYGEN is None:
        pytest.skip("ssh-keygen is not installed (openssh-client)")

    def create(name):
        command = [KEYGEN, "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(tmp_path / name)]
        subprocess.run(command, check=True)
        return tmp_path / name

    return create


@pytest.fixture
def signers(tmp_path, key):
    public = key("owner").with_suffix(".pub").read_text()
    (tmp_path / "signers").write_text(f"rambler {public}")
    return tmp_path / "signers"


def test_only_signed_bundles_are_accepted(make, tmp_path, key, signers):
    assert unpack(make(key=tmp_path / "owner"), tmp_path / "out", signers).version == "0.2.0"
    assert unpack(tmp_path / "b.bundle", tmp_path / "out2", None).version == "0.2.0"
    assert "not signed, but" in refusal(make(name="unsigned"), tmp_path / "out", signers)
    assert "not signed by one of" in refusal(make(name="stranger", key=key("stranger")), tmp_path / "out", signers)


def test_signature_covers_the_list_and_is_checked_first(make, tmp_path, signers):
    signed = make(key=tmp_path / "owner")
    with tarfile.open(signed) as archive:
        signature = archive.extractfile(SIGNATURE).read()
    other = make(version="0.3.0", name="other", key=tmp_path / "owner")

    def replace_signature(members):
        return [(member, signature if member.name == SIGNATURE else content) for member, content in members]

    assert "not signed by one of" in refusal(repack(other, replace_signature), tmp_path / "out", signers)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {SIGNATURE}


def test_signature_of_another_namespace_is_refused(make, tmp_path, signers):
    def sign_for_files(members):
        content = members[0][1]
        command = [KEYGEN, "-Y", "sign", "-f", str(tmp_path / "owner"), "-n", "file"]
        signature = subprocess.run(command, input=content, check=True, capture_output=True).stdout
        return [members[0], (tarfile.TarInfo(SIGNATURE), signature), *members[2:]]

    signed = make(key=tmp_path / "owner")
    assert "not signed by one of" in refusal(repack(signed, sign_for_files), tmp_path / "out", signers)


@pytest.mark.parametrize(("output", "error", "text"), [("out", "err " * 50, ("err " * 50)[:160]), ("b\n c", "", "b c")])
def test_reason_of_a_refused_signature_is_one_short_line(make, tmp_path, monkeypatch, output, error, text):
    timeouts_s = []

    def run(command, *, timeout, **_options):
        timeouts_s.append(timeout)
        return subprocess.CompletedProcess(command, 255, output.encode(), error.encode())

    signed = repack(make(), add_signature(9))
    monkeypatch.setattr(module.shutil, "which", lambda name: name)
    monkeypatch.setattr(module.subprocess, "run", run)
    reason = f"the bundle is not signed by one of {tmp_path}/s: {text}"
    assert refusal(signed, tmp_path / "out", tmp_path / "s") == reason
    assert timeouts_s == [30.0]
    monkeypatch.setattr(module.shutil, "which", lambda _name: None)
    assert "ssh-keygen is missing" in refusal(signed, tmp_path / "out", tmp_path / "s")


def test_versions_are_ordered():
    order = ["0.1.0.dev0", "0.1.0.dev1", "0.1.0a1", "0.1.0rc1", "0.1.0", "0.1.1.dev0", "0.2.0", "0.10.0", "1.0.0"]
    newest_first = order[::-1]
    assert sorted(newest_first, key=version_key) == order
    for text in ("", "1", "1.0", "1.0.0.0", "1.0.0+local", "v1.0.0", "1.0.x"):
        with pytest.raises(UpdateError):
            version_key(text)


@pytest.mark.parametrize(
    ("version", "commit_utc_s", "expected"),
    [
        ("0.3.0", None, True),
        ("0.2.0", None, False),
        ("0.2.0", 2000, True),
        ("0.2.0", 1000, False),
        ("0.1.9", 9000, False),
    ],
)
def test_older_by_version_then_by_commit_time(make, tmp_path, version, commit_utc_s, expected):
    assert is_older(unpack(make(), tmp_path / "out", None), version, commit_utc_s) is expected


@pytest.mark.parametrize(
    ("machine", "python", "missing"),
    [
        ("aarch64", (3, 13), None),
        ("aarch64", (3, 11), None),
        ("aarch64", (3, 12), "lxml"),
        ("x86_64", (3, 13), "hidapi"),
    ],
)
def test_bundle_for_other_computers_names_the_make_command(make, monkeypatch, machine, python, missing):
    names = [f"lxml-6.1-cp{n}-cp{n}-manylinux_2_26_aarch64.manylinux_2_28_aarch64.whl" for n in (311, 313)]
    more = ["fastcrc-0.5-cp37-abi3-manylinux2014_aarch64.whl", "fastcrc-0.5-cp37-abi3-manylinux2014_x86_64.whl"]
    more += ["pyserial-3.5-py2.py3-none-any.whl", "hidapi-1.0-1-py3-none-manylinux_2_17_aarch64.whl"]
    more += ["notes-1-cp2-cp2-any.txt", "other-1.whl"]  # not the name of a wheel
    path = make(files=FILES | dict.fromkeys((*names, *more), b""))
    bundle = unpack(path, path.with_name("out"), None)
    if missing is None:
        check_computer(bundle, machine, python)
    else:
        remedy = rf"for other computers \({missing}\); make bundle FOR={machine}:{python[0]}\.{python[1]}$"
        with pytest.raises(UpdateError, match=remedy):
            check_computer(bundle, machine, python)
        monkeypatch.setattr(module.sys, "maxsize", 2**31 - 1)
        check_computer(bundle, machine, python)  # pip checks the wheels of a 32-bit Python
