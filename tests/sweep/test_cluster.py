"""A sweep on a Dask cluster: a scheduler and two worker processes of this machine."""

import pytest

import baqueano as bq
from baqueano.errors import UsageError
from baqueano.guides.shapes import circle
from tests.codes import refused
from tests.sweep.test_sweep import rows_of

ASKED = {"routes": circle(0.3, 0.2), "controllers": ["kanayama", "lqr"], "seeds": (1, 2), "backend": "python"}


def test_without_the_library_the_line_to_type_is_shown(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with refused("sweep.no-distributed", UsageError):
        bq.sweep(bq.load("small"), **ASKED, cluster="tcp://127.0.0.1:8786")


@pytest.mark.filterwarnings("ignore")  # of the library, which closes its loops late
def test_two_workers_of_a_cluster_give_the_same_rows_bit_for_bit(tmp_path):
    distributed = pytest.importorskip("distributed")
    small, heard = bq.load("small"), []
    how = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**how) as cluster:
        address = cluster.scheduler_address
        found = bq.sweep(small, **ASKED, cluster=address, keep=tmp_path, each=heard.append)
    assert heard == [1, 1, 1, 1]
    assert rows_of(found) == rows_of(bq.sweep(small, **ASKED, processes=1))
    assert rows_of(bq.sweep(small, **ASKED, cluster=address, keep=tmp_path)) == rows_of(
        found
    )  # nothing is left to do
    with refused("sweep.no-cluster", UsageError):
        bq.sweep(small, **ASKED, cluster="nothing://here")
