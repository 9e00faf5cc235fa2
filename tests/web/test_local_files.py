"""The page's files of a robot: a fetched run is listed even without its route, and what is kept is bounded."""

import asyncio
import os
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.diagnostics import Diagnostic
from baqueano.runs import Run, write_run
from baqueano.runs.folder_listing import listing
from baqueano.web.lab import worker
from baqueano.web.lab.local_files import MAX_EXPECTED, LocalFiles

STILL = Run("still", None, np.arange(3), np.zeros((3, 1)))


class OwnWorker:
    """A worker in this process."""

    async def request(self, request, **words):
        return worker.Worker().answer({"type": request, **words})

    async def close(self):
        pass


@pytest.fixture
def robot(monkeypatch):
    """A robot whose only run does not have a path."""
    robot = SimpleNamespace(fetch=lambda run, path: write_run(STILL, path))
    monkeypatch.setattr("baqueano.door.remote.connect", lambda host: nullcontext(robot))


def test_a_fetched_run_is_listed_although_its_route_fails(robot, tmp_path):
    async def fetched():
        files, reports = LocalFiles("robot", "small", tmp_path, tmp_path / "runs"), []
        files._lab = OwnWorker()
        files.expect("1", "teach", {"name": "ring"})
        files.fetch({"id": "1", "run": "a", "reason": None}, lambda *report: reports.append(report))
        await asyncio.gather(*files._fetch_tasks)
        return reports

    ((message, routes),) = asyncio.run(fetched())
    (run,) = listing(tmp_path / "runs")
    assert (message.code, routes) == ("web.not-taught", [])
    assert message.figures["run"] == run.name.removesuffix(".mcap")
    assert isinstance(message.figures["reason"], Diagnostic)
    assert message.figures["reason"].code == "route.no-estimates"


def test_only_the_newest_missions_are_stored(tmp_path):
    files = LocalFiles("robot", "small", tmp_path, tmp_path)
    for number in range(10 * MAX_EXPECTED):
        files.expect(str(number), "drive", {})
    assert len(files._requests) == MAX_EXPECTED
    assert str(10 * MAX_EXPECTED - 1) in files._requests


def test_a_run_that_changes_has_one_list_entry(tmp_path):
    path, own = write_run(STILL, tmp_path / "a.mcap"), worker.Worker()
    for t_s in range(20):
        os.utime(path, (t_s, t_s))
        own.answer({"type": "runs", "paths": [str(path)]})
    assert len(own._lines) == 1
    own.answer({"type": "runs", "paths": []})
    assert not own._lines
