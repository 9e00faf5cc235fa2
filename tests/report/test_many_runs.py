"""A fit to many runs is summarised together; the page draws only the runs that the model explains least."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import identify
from baqueano.report.fit_report import MAX_DRAWN_RUNS, fit_page
from baqueano.report.page import Drawing, Table
from baqueano.simulate import simulate
from baqueano.vehicle_file import load


@pytest.fixture(scope="module")
def fits():
    """One fit to 3 s of a car, presented as twelve runs, each explained a little less."""
    file = load("car")
    u = np.stack([0.3 + 0.2 * np.sin(0.1 * np.arange(150)), 0.5 * np.cos(0.07 * np.arange(150))], axis=1)
    fit = identify(
        simulate(file, u, 0), file, ["model.throttle_gain", "model.steering_gain"], use=("odometer", "imu[2]")
    )
    names = tuple(f"run-{k:02d}" for k in range(12))
    channels = [
        c._replace(run=name, explained_fraction=c.explained_fraction - 0.01 * k)
        for k, name in enumerate(names)
        for c in fit.channels
    ]
    return replace(fit, runs=names, channels=tuple(channels))


def test_the_table_has_a_line_per_channel_and_names_the_worst_run(fits):
    lines = [line for line in fits.table().splitlines() if "of 12 runs: noise" in line]
    assert [line.split()[0] for line in lines] == ["odometer[0]", "imu[2]"]
    assert all(line.endswith("of run-11") for line in lines)


def test_the_page_draws_the_least_explained_runs(fits):
    page = fit_page(fits)
    titles = [s.title for s in page.sections if s.title.startswith("Data and model")]
    assert titles == [f"Data and model: run-{k:02d}" for k in range(12 - MAX_DRAWN_RUNS, 12)]
    assert page.subtitle.startswith("12 runs, run-00 to run-11")
    assert any(
        "Of 12 runs, the plot shows the 6 that the model explains least" in s.text for s in page.sections
    )


def test_the_headlines_show_the_least_explained_run(fits):
    page = fit_page(fits)
    assert [h.label for h in page.headlines] == [
        "noise of odometer [m/s], run-11", "noise of ω_z [rad/s], run-11",
    ]  # fmt: skip
    assert any("The model explains run-11 least of all runs." in s.text for s in page.sections)


def test_the_four_least_explained_channels_are_in_the_headlines(fits):
    """There are eight channels: IMU, wheels and a pose."""
    first, shares = fits.channels[0], (0.99, 0.4, 0.98, 0.97, 0.3, 0.96, 0.5, 0.6)
    names = [
        ("imu", 0),
        ("imu", 1),
        ("imu", 2),
        ("wheels", 0),
        ("wheels", 1),
        ("pose", 0),
        ("pose", 1),
        ("pose", 2),
    ]
    channels = tuple(
        first._replace(sensor=name, entry=entry, explained_fraction=part)
        for (name, entry), part in zip(names, shares, strict=True)
    )
    page = fit_page(replace(fits, runs=fits.runs[:1], channels=channels))
    assert [h.label for h in page.headlines] == [
        "noise of a_y [m/s²]", "noise of wheels[1]", "noise of pose[1]", "noise of pose[2]",
    ]  # fmt: skip


def test_a_table_has_noise_and_explained_share_of_every_run(fits):
    table = next(s for s in fit_page(fits).sections if s.title == "Runs").parts[0]
    assert isinstance(table, Table)
    assert [row["run"] for row in table.rows] == list(fits.runs)
    assert list(table.headings.values()) == ["run", "odometer [m/s]", "ω_z [rad/s]"]
    for c in [c for c in fits.channels if np.isfinite(c.explained_fraction)]:
        row = next(row for row in table.rows if row["run"] == c.run)
        name = "odometer [m/s]" if c.sensor == "odometer" else "ω_z [rad/s]"
        assert row[name] == f"{c.sigma:.3g}, {100 * c.explained_fraction:.1f} %"


def test_a_fit_to_one_run_has_no_table_of_runs(fits):
    single = replace(fits, runs=fits.runs[:1], channels=tuple(c for c in fits.channels if c.run == "run-00"))
    assert all(s.title != "Runs" for s in fit_page(single).sections)
    assert [h.label for h in fit_page(single).headlines] == [
        "noise of odometer [m/s]",
        "noise of ω_z [rad/s]",
    ]


def test_data_and_model_are_drawn_for_the_period_of_most_motion(fits):
    """A run that rests for 40 s, moves for 20 s and rests again."""
    t_s = 0.02 * np.arange(4000)
    signal = np.where((t_s >= 40.0) & (t_s <= 60.0), np.sin(t_s), 0.0)
    channels = tuple(c._replace(t_s=t_s, measurements=signal, predictions=signal) for c in fits.channels[:2])
    for shown_channels, period in (
        (channels, "20 s from 40 s, with most motion"),
        (fits.channels[:2], "all 3 s"),
    ):
        page = fit_page(replace(fits, runs=fits.runs[:1], channels=shown_channels))
        drawing = next(s for s in page.sections if s.title.startswith("Data and model")).parts[0]
        assert isinstance(drawing, Drawing)
        assert drawing.caption.startswith(f"Sensors and model, {period}.")
