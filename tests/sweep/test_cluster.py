"""A sweep on a Dask cluster: a scheduler and two worker processes of this machine."""

import warnings

import pytest

import baqueano as bq
from baqueano.errors import UsageError
from baqueano.guides.shapes import circle
from tests.codes import refused
from tests.sweep.test_sweep import rows_of

GRID = {"routes": circle(0.3, 0.2), "controllers": ["kanayama", "lqr"], "seeds": (1, 2), "backend": "python"}


def test_a_missing_cluster_library_is_reported_with_the_install_command(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with refused("sweep.no-distributed", UsageError):
        bq.sweep(bq.load("small"), **GRID, cluster="tcp://127.0.0.1:8786")


@pytest.fixture(scope="module")
def address():
    import distributed  # slowly: not at the import of the tests

    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the library closes its event loops with a delay
        with distributed.LocalCluster(**options) as cluster:
            yield cluster.scheduler_address


@pytest.fixture(scope="module")
def serial():
    return rows_of(bq.sweep(bq.load("small"), **GRID, processes=1))


@pytest.mark.filterwarnings("ignore")
def test_two_workers_of_a_cluster_give_the_same_rows_bit_for_bit(address, serial, tmp_path):
    small, counts = bq.load("small"), []
    result = bq.sweep(small, **GRID, cluster=address, drives_folder=tmp_path, advance=counts.append)
    assert counts == [1, 1, 1, 1]
    assert rows_of(result) == serial
    in_cluster = bq.sweep(small, **GRID, cluster="nothing://here", drives_folder=tmp_path)  # no drive remains
    assert rows_of(in_cluster) == serial
    with refused("sweep.no-cluster", UsageError):
        bq.sweep(small, **GRID, cluster="nothing://here")


@pytest.mark.filterwarnings("ignore")
def test_an_interrupted_sweep_on_a_cluster_is_resumed(address, serial, tmp_path):
    small, counts = bq.load("small"), []

    def until_two(n: int) -> None:
        counts.append(n)
        if len(counts) == 2:
            raise KeyboardInterrupt

    part = bq.sweep(small, **GRID, cluster=address, drives_folder=tmp_path, advance=until_two)
    assert (len(part.drives), part.requested_drives, [reason.code for reason in part.reasons]) == (
        2,
        4,
        ["sweep.part"],
    )
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert len(before) == 2
    assert rows_of(bq.sweep(small, **GRID, cluster=address, drives_folder=tmp_path)) == serial
    after = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert (len(after), before.items() <= after.items()) == (4, True)  # the first two were not driven again
