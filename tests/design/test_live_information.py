"""The information of a drive, added window by window, equals the information of one batch."""

import numpy as np
import pytest

from baqueano.design.information import DriveInformation
from baqueano.design.live import WINDOW_TICKS, RecursiveInformation, information_bits
from baqueano.identify import excitation
from baqueano.vehicle_file import load

EXACT = 1e-9  # relative


def drive_named(name, seconds=6.0):
    file = load(name)
    return file, excitation("random_steps", file.command.limit, seconds, file.rate_hz, seed=3)


def relative(estimate, expected):
    """Return the largest difference relative to the scale of the entry, √(F_ii F_jj)."""
    std = np.sqrt(np.diagonal(expected))
    std = np.where(std > 0.0, std, 1.0)
    return np.max(np.abs(estimate - expected) / np.outer(std, std))


@pytest.mark.parametrize("name", ["small", "case-study-1", "car"])
def test_the_sum_over_windows_equals_the_information_of_one_batch(name):
    file, u = drive_named(name)
    drive_information = DriveInformation(file)
    live = RecursiveInformation(drive_information)
    theta = drive_information.nominal.copy()
    theta[: drive_information.unknowns.interest_count] *= 1.2  # not only at the values of the file
    for point in (drive_information.nominal, theta):
        F = live.add(live.begin(point), u).F * np.outer(
            drive_information.unknowns.size, drive_information.unknowns.size
        )
        assert relative(F, drive_information.information(u, point)) < EXACT


def test_information_does_not_depend_on_the_grouping_of_ticks():
    file, u = drive_named("small", 2.0)
    live = RecursiveInformation(DriveInformation(file))
    state, row = live.begin(), 0
    for count in (1, 7, WINDOW_TICKS, 33, len(u)):
        state, row = live.add(state, u[row : row + count]), row + count
    assert relative(state.F, live.add(live.begin(), u).F) < EXACT


def test_information_is_the_same_without_a_compiler():
    file, u = drive_named("small", 0.5)
    quick, slow = (RecursiveInformation(DriveInformation(file, backend)) for backend in ("auto", "python"))
    assert relative(slow.add(slow.begin(), u).F, quick.add(quick.begin(), u).F) < EXACT


def test_unmeasured_ticks_add_no_information():
    file, u = drive_named("small", 2.0)
    live = RecursiveInformation(DriveInformation(file))
    none = live.add(live.begin(), u, np.zeros((len(u), 3)))
    assert not none.F.any()
    rest_part = live.add(none, u, np.ones((len(u), 3)))  # the state has advanced meanwhile
    total = live.add(live.begin(), np.concatenate([u, u]))
    first = live.add(live.begin(), u)
    assert relative(rest_part.F, total.F - first.F) < EXACT


def test_predicted_errors_decrease_and_information_grows_with_each_window():
    file, u = drive_named("small", 3.0)
    live = RecursiveInformation(DriveInformation(file))
    state, before = live.begin(), np.ones(live.unknowns.interest_count)
    np.testing.assert_allclose(live.relative_std(state), before)
    assert information_bits(before) == 0.0
    for row in range(0, len(u), WINDOW_TICKS):
        state = live.add(state, u[row : row + WINDOW_TICKS])
        now = live.relative_std(state)
        assert np.all(now <= before + 1e-12)
        assert information_bits(now) >= information_bits(before) - 1e-9
        before = now
    assert information_bits(before) > 20.0
