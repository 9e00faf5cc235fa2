"""The files of a report: a page, and each figure as SVG, PDF or PNG, by the same options of every command."""

import csv
import shutil
from types import SimpleNamespace

import click
import numpy as np
import pytest

from baqueano.cli.subcommands import SUBCOMMANDS, load_command
from baqueano.report import Page, Section, draw, figures
from tests.figure_files import width_mm

WITH_A_PAGE = {  # commands that write a report on request
    "identify", "replay", "repeat", "compare", "forecast", "sweep", "noise", "wear", "paper", "identification",
    "recordings", "check",
}  # fmt: skip
LINES = {
    "identify 1 --vehicle small --free model.actuator_matrix[0,0] --no-noise": ("svg", "column", 88.0),
    "replay 1": ("pdf", "60", 60.0),
    "repeat lab --vehicle small": ("png", "column", 88.0),
    "compare 1": ("svg", "page", 181.0),
    "forecast lab --vehicle small": ("pdf", "column", 88.0),
    "route check lab --vehicle small": ("svg", "page", 181.0),
    "sweep 1 --estimator augmented_ekf": ("png", "60.5", 60.5),
}


def commands(name: str, command: click.Command):
    """Yield each command below `command` with its name."""
    if isinstance(command, click.Group):
        for subname, subcommand in command.commands.items():
            yield from commands(subname, subcommand)
    else:
        yield name, command


def test_every_command_with_a_report_has_the_same_options_for_its_figures():
    of_report = {}
    for name, command in (pair for verb in SUBCOMMANDS for pair in commands(verb, load_command(verb))):
        options = [param for param in command.params if isinstance(param, click.Option)]
        helps = {name: option.help for option in options for name in option.opts}
        if "--report" in helps or name in ("report", "demo"):
            of_report[name] = [helps.get(name) for name in ("--figures", "--format", "--width")]
    assert set(of_report) == {*WITH_A_PAGE, "report", "demo"}
    first = of_report["report"]
    assert all(first)
    assert all(helps == first for helps in of_report.values())


@pytest.mark.parametrize("line", LINES)
def test_a_command_writes_its_figures_without_a_page(baqueano, lab, tmp_path, line):
    for name in ("runs", "routes"):
        shutil.copytree(lab / name, tmp_path / name)
    file_format, width, mm = LINES[line]
    end = baqueano(*line.split(), "--json", "--figures", "f", "--format", file_format, "--width", width)
    files = list((tmp_path / "f").iterdir())
    assert len(files) >= 1, end.err
    assert {path.suffix for path in files} == {f".{file_format}"}
    assert [width_mm(path) for path in files] == pytest.approx([mm] * len(files), abs=0.1)
    assert f"figures: {len(files)} in f" in end.err
    assert not list(tmp_path.glob("*.html"))


@pytest.mark.parametrize("line", LINES)
def test_a_command_writes_the_rows_of_its_result_as_a_table(baqueano, lab, tmp_path, line):
    for name in ("runs", "routes"):
        shutil.copytree(lab / name, tmp_path / name)
    end = baqueano(*line.split(), "--table", "t.csv", "--decimal", ",")
    assert "table: t.csv" in end.err
    head, first, *_ = (tmp_path / "t.csv").read_text(encoding="utf-8-sig").splitlines()
    assert len(next(csv.reader([first], delimiter=";"))) == len(head.split(";")) >= 3


@pytest.mark.parametrize("study", ["paper", "recordings"])
def test_a_study_writes_its_page_and_its_figures(baqueano, tmp_path, monkeypatch, study):
    path = draw(figures.paths({"truth": np.eye(2)}), "a path")
    page = Page("t", "", "", [], [Section("Path", "", [path])])
    result = SimpleNamespace(fits=[None], rows=list, verdict="USABLE", is_interrupted=False)
    values = {
        "paper.case_study.case_study": result, "paper.case_study.simulate_seed": (None, None),
        "paper.dynamic_vs_kinematic.compare_models": (), "paper.page.paper_page": page,
        "recordings.recordings": result, "recordings_page.make_recordings_page": page,
    }  # fmt: skip
    for name, value in values.items():
        monkeypatch.setattr(f"baqueano.study.{name}", lambda *arguments, value=value: value)
    monkeypatch.setenv("BAQUEANO_DATA", str(tmp_path))
    end = baqueano("study", study, "--json", "--figures", "f", "--format", "png", "--width", "column")
    assert end.code == 0, end.err
    assert (tmp_path / f"study-{study}.html").exists()
    assert width_mm(tmp_path / "f" / "01-path.png") == pytest.approx(88.0, abs=0.1)


@pytest.mark.parametrize(("option", "value"), [("--width", "column"), ("--format", "pdf")])
def test_an_option_for_figures_is_refused_without_their_folder(baqueano, lab, option, value):
    run = str(next((lab / "runs").glob("0001*")))
    end = baqueano("compare", run, option, value)
    assert (end.code, end.out, end.reason.code) == (2, "", "cli.figures-absent")
    assert end.fix.endswith(f"{option} {value} --figures figures")


def test_an_invalid_width_is_refused_before_the_work(baqueano, lab):
    run = str(next((lab / "runs").glob("0001*")))
    end = baqueano("compare", run, "--figures", "f", "--width", "nine")
    assert (end.code, end.out, end.reason.code) == (2, "", "front.width-unknown")
