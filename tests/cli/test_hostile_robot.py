"""A malicious robot: its names and texts cannot write other files or send terminal control codes."""

import base64
import json
import os
import socket
import threading
from itertools import product

import pytest

from baqueano.door import remote
from baqueano.door.operator import Operator
from baqueano.door.sockets import Door
from baqueano.runs.folder import is_run_name
from tests.codes import refused

READY = {"type": "state", "state": "READY", "reason": ""}
NAMES = (
    "../../x.sh", "../x.mcap", "/tmp/baqueano-pwned/authorized_keys", "/tmp/x.mcap", "a/b.mcap", "a\\b.mcap",
    "C:x.mcap", "C:\\x.mcap", ".hidden.mcap", "..mcap", ".mcap", "-rf.mcap", "x.sh", "x.mcap.sh", "", ".", "..",
    "x\n.mcap", "x.mcap\n", "\x1b]0;x\x07.mcap", "\u202e.mcap", "a\u202eb.mcap", "x\0.mcap", "NUL.mcap",
    "con.lap.mcap", "com1.mcap", "LPT¹.mcap", "x .mcap", "x..mcap", "x" * 300 + ".mcap", "~.mcap", "$(x).mcap",
    "~root.mcap", " x.mcap", "a;b.mcap", "a*b.mcap", None, 7, ["x.mcap"],
)  # fmt: skip


@pytest.fixture
def liar(tmp_path):
    """Return `liar(runs=…, file=…)`, which gives the path of a socket that answers each request with these messages."""
    listener, path = socket.socket(socket.AF_UNIX), tmp_path / "liar"
    listener.bind(str(path))
    listener.listen(1)
    answers = {}

    def work():
        line, _ = listener.accept()
        with line, line.makefile("rb") as coming:
            try:
                for message in answers.get("first", [READY]):
                    line.sendall(json.dumps(message).encode() + b"\n")
                for word in coming:
                    for message in answers.get(json.loads(word)["type"], []):
                        line.sendall(
                            message if isinstance(message, bytes) else json.dumps(message).encode() + b"\n"
                        )
            except OSError:
                return

    thread = threading.Thread(target=work, daemon=True)

    def begin(**replies):
        answers.update(replies)
        thread.start()
        return str(path)

    yield begin
    listener.close()


def piece(data, remaining):
    return {"type": "file", "run": "x", "data": base64.b64encode(data).decode(), "left": remaining}


def files(folder):
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file() or p.is_symlink()}


def test_ne6_invalid_run_names_are_refused_and_the_others_are_fetched(baqueano, liar, tmp_path):
    host = liar(runs=[{"type": "runs", "runs": [*NAMES, "1.mcap"]}], fetch=[piece(b"evil", 0)])
    before = files(tmp_path)
    end = baqueano("robot", "runs", host, "--fetch", "--runs", str(tmp_path / "a" / "b" / "runs"))
    assert end.code == 3
    assert (end.reason.code, end.reason.figures["count"]) == ("cli.run-names-invalid", len(NAMES))
    assert "\x1b" not in end.err + end.out
    assert files(tmp_path) - before == {"a/b/runs/1.mcap"}
    assert not os.path.exists("/tmp/baqueano-pwned")


@pytest.mark.parametrize("name", NAMES)
def test_an_invalid_run_name_is_not_accepted(name):
    assert not is_run_name(name)


@pytest.mark.parametrize(
    "name",
    ["20260314-101500-first drive.mcap", "20260314-101500-repeat-2.mcap", "0001-Núñez.mcap", "console.mcap"],
)
def test_valid_run_names_are_accepted(name):
    assert is_run_name(name)


def test_ne6_a_door_lists_and_serves_only_names_of_runs(baqueano, tmp_path):
    (tmp_path / "secret").write_bytes(b"secret")
    (tmp_path / "link.mcap").symlink_to(tmp_path / "secret")
    for name in ("ok.mcap", ".hidden.mcap", "a\x1bb.mcap", "-x.mcap"):
        (tmp_path / name).write_bytes(b"run")
    door = Door(tmp_path / "s", Operator(), tmp_path)
    try:
        door.broadcast(READY)
        assert baqueano("robot", "runs", str(door.path)).out == "ok.mcap\n"
        names = "link.mcap", ".hidden.mcap", "../" + tmp_path.name + "/ok.mcap"
        for name, request in product(names, ("fetch", "head")):
            with remote.connect(str(door.path)) as client:
                client.send(type=request, run=name)
                with refused("door.no-run", Exception):
                    client.receive(("file",), 10.0)
    finally:
        door.close()


@pytest.mark.parametrize("link", [False, True, "dangling"])
def test_existing_local_files_and_links_are_not_changed(baqueano, liar, tmp_path, link):
    folder, target = tmp_path / "runs", tmp_path / "other"
    folder.mkdir()
    if link != "dangling":
        target.write_bytes(b"mine")
    if link:
        (folder / "1.mcap").symlink_to(target)
        (folder / "1.mcap.part").symlink_to(target)
    else:
        (folder / "1.mcap").write_bytes(b"mine")
    host = liar(
        runs=[{"type": "runs", "runs": ["1.mcap"]}], head=[piece(b"ev", 2)], fetch=[piece(b"evil", 0)]
    )
    assert baqueano("robot", "runs", host, "--fetch", "--runs", str(folder)).code == 0
    assert not target.exists() if link == "dangling" else (folder / "1.mcap").read_bytes() == b"mine"
    assert (folder / "1.mcap").is_symlink() == bool(link)


@pytest.mark.parametrize(
    ("pieces", "code"),
    [
        ([piece(b"x", 1 << 60)], 3),
        ([piece(b"x", 5), piece(b"y", 100)], 4),
        ([piece(b"x", 5), piece(b"", 5)], 4),
        ([piece(b"x", -7)], 4),
        ([{"type": "file", "run": "x", "data": "no base64!", "left": 0}], 4),
        ([{"type": "refused", "reason": "\x1b[2J gone", "code": 1}], 1),
        ([b"x" * (2 << 20)], 4),
    ],
)
def test_a_run_of_wrong_length_is_discarded(baqueano, liar, tmp_path, pieces, code):
    host = liar(runs=[{"type": "runs", "runs": ["1.mcap"]}], fetch=pieces)
    end = baqueano("robot", "runs", host, "--fetch", "--runs", str(tmp_path / "runs"))
    assert end.code == code
    assert "\x1b" not in end.paragraph
    assert files(tmp_path / "runs") == set()


def test_a_status_text_cannot_send_terminal_control_codes(baqueano, liar):
    status = READY | {"reason": "\x1b[2J\x9b\u202e all\nbaqueano: forged", "more\x1b": "x\r"}
    end = baqueano(
        "robot", "status", liar(first=[[], "x", {"type": []}, {"type": "state", "state": 7}, status])
    )
    assert end.code == 0
    assert r"\x1b[2J\x9b\u202e all baqueano: forged" in end.out
    assert not {"\x1b", "\x9b", "\u202e", "\r"} & set(end.out)
    assert len(end.out.splitlines()) == 3


def test_a_fetched_run_cannot_send_terminal_control_codes(baqueano, lab, tmp_path):
    from dataclasses import replace

    from baqueano.runs import Event, read_run, write_run

    run = read_run(lab / "runs" / "0001-experiment.mcap")
    event = Event(int(run.t_ns[0]), "error", "\x1b[1mloop", "why\x1b]0;x\x07\nrun: forged")
    (tmp_path / "runs").mkdir()
    metadata = run.metadata | {"kind": "\x1b[2J"}
    write_run(replace(run, events=(event,), metadata=metadata), tmp_path / "runs" / "1.mcap")
    for line in ("runs show runs/1.mcap", "runs ls"):
        end = baqueano(*line.split())
        assert end.code == 0
        assert "\x1b" not in end.out + end.err
        assert not any(row.startswith("run: forged") for row in end.out.splitlines())
        assert r"\x1b" in end.out
