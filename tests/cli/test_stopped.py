"""Ctrl-C during long work: the results so far are printed, nothing is written, and the exit code is 130."""

from importlib import import_module
from types import SimpleNamespace

import pytest

from baqueano.identify import identify
from baqueano.runs import read_run
from baqueano.study import recordings as collected
from baqueano.vehicle_file import load

ROW = {"recording": "one", "quantity": "speed", "value": 0.1, "bar": "≤ 1", "ok": True}


def test_id0_a_fit_that_is_stopped_is_reported_and_not_written(baqueano, lab, tmp_path, monkeypatch):
    def stopped_fit(runs, file, progress, **options):
        fit = identify(runs, file, ["model.actuator_matrix[0,0]"], progress=progress)
        progress.stopped = True
        return fit

    monkeypatch.setattr(import_module("baqueano.identify"), "identify", stopped_fit)
    path = str(lab / "runs" / "0001-experiment.mcap")
    end = baqueano("identify", path, "--vehicle", "small", "--update")
    assert end.code == 130
    assert "actuator_matrix[0,0]" in end.out
    assert end.reason.code == "cli.fit-interrupted"
    assert not (tmp_path / "vehicle.toml").exists()


def test_an_interrupted_fit_skips_the_test_for_unmodelled_effects(lab, monkeypatch):
    run = read_run(lab / "runs" / "0001-experiment.mcap")
    texts: list[str] = []

    def progress(text: str) -> bool:
        texts.append(text)
        return text.startswith("testing for effects")

    assemble = import_module("baqueano.identify.result.assemble")
    monkeypatch.setattr(assemble, "diagnose", lambda *of: pytest.fail("the function was called"))
    fit = identify(run, load("small"), ["model.actuator_matrix[0,0]"], progress=progress)
    assert fit.converged
    assert texts[-1] == "testing for effects that the model lacks"


def test_recordings_judged_before_an_interrupt_are_in_the_table(baqueano, monkeypatch):
    def stopping(progress, backend):
        raise KeyboardInterrupt

    modules = {
        "baqueano.study.recorded.cpm": SimpleNamespace(
            files=lambda: [], rows=lambda progress, backend: [ROW]
        ),
        "baqueano.study.recorded.dart": SimpleNamespace(files=lambda: [], rows=stopping),
    }
    monkeypatch.setattr(collected, "import_module", modules.__getitem__)
    end = baqueano("study", "recordings")
    assert end.code == 130
    assert "1 of 1 requirements are met" in end.out
    assert "stopped from the keyboard: dart and all later results are excluded" in end.out
    assert end.reason.code == "cli.recordings-interrupted"
