"""Code that a vehicle file or a run of another user names is executed only with the permission of the user."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from baqueano import blocks
from baqueano.cli import main
from baqueano.cli.errors import command_error
from baqueano.drive import experiment, replay
from baqueano.drive.replay import recorded_vehicle_file
from baqueano.errors import FileError
from baqueano.runs import read_run, write_run
from baqueano.vehicle_file import load, override
from tests.codes import refused

TEXT = """
from pathlib import Path

from baqueano.controllers import PdFeedforward

Path({mark!r}).touch()


class Mine(PdFeedforward):
    __slots__ = ()
"""


@pytest.fixture(autouse=True)
def _a_process_that_trusts_nobody(monkeypatch, tmp_path):
    monkeypatch.setattr(blocks, "_trusted_files", set())
    monkeypatch.setattr(blocks, "_modules", {})
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def mark(tmp_path) -> Path:
    return tmp_path / "executed"


def text_at(path: Path, mark: Path) -> Path:
    """Write a block that creates the file `mark` when the block is executed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(TEXT.format(mark=str(mark)), encoding="utf-8")
    return path


def vehicle_at(path: Path, kind: str) -> Path:
    """Write a vehicle file whose controller is `kind`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = load("small").text.replace('kind = "pd_feedforward"', f"kind = {str(kind)!r}")
    path.write_text(text, encoding="utf-8")
    return path


def run_that_names(kind: str, path: Path) -> Path:
    """Write the run of another user whose vehicle file has the controller `kind`."""
    small = load("small")
    run = experiment(small, np.tile([0.5, 0.0, 0.0], (20, 1)))
    text = small.text.replace('kind = "pd_feedforward"', f"kind = {kind!r}")
    object.__setattr__(run, "vehicle_text", text)
    object.__setattr__(run, "metadata", run.metadata | {"kind": "repeat"})
    return write_run(run, path)


def test_a_block_file_beside_the_users_vehicle_file_is_executed(tmp_path, mark):
    text_at(tmp_path / "lab" / "mine.py", mark)
    load(vehicle_at(tmp_path / "lab" / "vehicle.toml", "mine.py:Mine")).controller()
    assert mark.exists()


def test_a_vehicle_file_may_name_a_block_in_the_user_folder(tmp_path, mark):
    text_at(tmp_path / "mine.py", mark)
    load(vehicle_at(tmp_path / "vehicles" / "rover.toml", "mine.py:Mine")).controller()
    assert mark.exists()


@pytest.mark.parametrize("path_form", ["absolute", "upwards", "where the user stands", "by a link"])
def test_a_block_outside_the_folder_needs_permission(tmp_path, mark, monkeypatch, path_form):
    outside_file = text_at(tmp_path / "elsewhere" / "theirs.py", mark)
    home = tmp_path / "lab"
    kind = {"absolute": f"{outside_file}:Mine", "upwards": "../elsewhere/theirs.py:Mine"}.get(
        path_form, "theirs.py:Mine"
    )
    file = vehicle_at(home / "vehicle.toml", kind)
    monkeypatch.chdir(home if path_form != "where the user stands" else outside_file.parent)
    if path_form == "by a link":
        (home / "theirs.py").symlink_to(outside_file)
    with refused("block.outside-folder", FileError):
        load(file)
    assert not mark.exists(), "no line of the file was executed"
    load(file, allow_blocks=True).controller()
    assert mark.exists()


def test_permission_holds_for_started_processes_while_it_lasts(tmp_path, mark):
    """As for the workers of a page and its simulated vehicle."""
    outside_file = text_at(tmp_path / "elsewhere" / "theirs.py", mark)
    file = vehicle_at(tmp_path / "lab" / "vehicle.toml", f"{outside_file}:Mine")
    load_there = f"from baqueano.vehicle_file import load; load({str(file)!r}).controller()"
    for allow in (False, True, False):
        mark.unlink(missing_ok=True)
        with blocks.permit_blocks(allow):
            result = subprocess.run(
                [sys.executable, "-c", load_there], cwd=file.parent, capture_output=True, check=False
            )
        assert (result.returncode == 0, mark.exists()) == (allow, allow), result.stderr
    assert blocks.ALLOW not in os.environ


def test_a_forbidden_block_file_is_not_executed_to_list_its_classes(tmp_path, mark, monkeypatch):
    outside_file = text_at(tmp_path / "elsewhere" / "theirs.py", mark)
    file = vehicle_at(tmp_path / "lab" / "vehicle.toml", str(outside_file))
    monkeypatch.chdir(file.parent)
    with refused("block.outside-folder", FileError):
        load(file)
    assert not mark.exists()


def test_a_block_named_by_a_run_needs_permission(tmp_path, mark):
    text_at(tmp_path / "mine.py", mark)
    run = read_run(run_that_names("mine.py:Mine", tmp_path / "sent.mcap"))
    with refused("block.in-run", FileError):
        replay(run)
    assert not mark.exists()
    assert len(replay(run, allow_blocks=True).t_ns) == len(run.t_ns)
    assert mark.exists()


def test_blocks_named_by_the_users_vehicle_file_need_no_permission(tmp_path, mark):
    text_at(tmp_path / "mine.py", mark)
    vehicle_at(tmp_path / "vehicle.toml", "mine.py:Mine")
    replay(read_run(run_that_names("mine.py:Mine", tmp_path / "own.mcap")))
    assert mark.exists()


@pytest.mark.parametrize(
    "kind", ["{theirs}:Mine", "../elsewhere/theirs.py:Mine", "~/theirs.py:Mine", "~/no.py:Mine"]
)
def test_a_block_outside_the_folder_named_by_a_run_is_never_executed(tmp_path, mark, monkeypatch, kind):
    outside_file = text_at(tmp_path / "elsewhere" / "theirs.py", mark)
    monkeypatch.setenv("HOME", str(outside_file.parent))
    lab = tmp_path / "lab"
    run = read_run(run_that_names(kind.format(theirs=outside_file), lab / "sent.mcap"))
    monkeypatch.chdir(lab)
    blocks.read_module(str(outside_file))  # even where the user has executed it
    mark.unlink()
    with refused("block.in-run-elsewhere", FileError):
        replay(run, allow_blocks=True)
    assert not mark.exists()


@pytest.mark.parametrize("table", ["model", "sensors.imu"])
def test_models_and_sensors_named_by_a_run_need_permission(tmp_path, mark, table):
    text_at(tmp_path / "mine.py", mark)
    run = read_run(run_that_names("pd_feedforward", tmp_path / "sent.mcap"))
    kind_line = {"model": 'kind = "planar"', "sensors.imu": 'kind = "imu"'}[table]
    object.__setattr__(run, "vehicle_text", run.vehicle_text.replace(kind_line, 'kind = "mine.py:Mine"'))
    with refused("block.in-run", FileError):
        recorded_vehicle_file(run)
    assert not mark.exists()


def test_a_block_typed_by_the_user_is_executed(tmp_path, mark):
    outside_file = text_at(tmp_path / "elsewhere" / "theirs.py", mark)
    load("small").controller(f"{outside_file}:Mine")
    assert mark.exists()
    mark.unlink()
    blocks._trusted_files.clear()
    blocks._modules.clear()
    override(load("small"), [f"controller.kind={outside_file}:Mine"]).controller()
    assert mark.exists()


def test_a_refused_block_runs_only_with_the_advised_permission_option(tmp_path, mark, capsys):
    text_at(tmp_path / "mine.py", mark)
    run_that_names("mine.py:Mine", tmp_path / "sent.mcap")
    line = ["replay", "sent.mcap"]
    try:
        replay(read_run("sent.mcap"))
    except FileError as error:
        end = command_error(error, line)
    assert end.code == 3
    assert end.next is not None
    assert (end.next.code, end.next.fix) == (
        "next.allow-blocks", "baqueano replay sent.mcap --allow-blocks",
    )  # fmt: skip
    for words, code, ran in ((line, 3, False), ([*line, "--allow-blocks"], 0, True), (line, 3, False)):
        blocks._trusted_files.clear()
        mark.unlink(missing_ok=True)
        with pytest.raises(SystemExit) as exit_info:
            main(words)
        assert (int(exit_info.value.code or 0), mark.exists() or not ran) == (code, True), (
            capsys.readouterr().err
        )


def test_a_simulated_truth_outside_the_folder_is_refused(tmp_path):
    load("small").save(tmp_path / "elsewhere.toml")
    file = tmp_path / "lab" / "vehicle.toml"
    file.parent.mkdir()
    for truth in ("../elsewhere.toml", str(tmp_path / "elsewhere.toml")):
        file.write_text(f"{load('small').text}\n[simulation]\ntruth = {truth!r}\n", encoding="utf-8")
        with refused("vehicle.truth-elsewhere", FileError):
            experiment(load(file), np.zeros((5, 3)))


@pytest.mark.parametrize("checksum", ["0", "wrong"])
def test_a_vehicle_file_in_a_run_with_a_wrong_checksum_is_discarded(tmp_path, checksum):
    path = write_run(experiment(load("small"), np.zeros((5, 3))), tmp_path / "run.mcap")
    data = bytearray(path.read_bytes())
    k = data.index(b"max_yaw_rate_rad_s = 15.0") + len("max_yaw_rate_rad_s = 15.0\nimu_timeout_s = 0.5\n")
    data[k : k + 4] = bytes(4) if checksum == "0" else bytes([data[k] ^ 1, *data[k + 1 : k + 4]])
    path.write_bytes(data)
    run = read_run(path)
    assert run.vehicle_text == ""
    assert "run.vehicle-file-lost" in [note.code for note in run.notes]
    assert len(run.t_ns) == 6, "the other data are unchanged"
