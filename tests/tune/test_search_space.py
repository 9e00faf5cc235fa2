"""Gains of any controller: entries of arrays, user classes, and the vehicle file with the gains."""

import numpy as np
import pytest

from baqueano.controllers import ModelFollower
from baqueano.errors import UsageError
from baqueano.geometry import pose_error
from baqueano.guides.shapes import circle
from baqueano.parameter import parameter
from baqueano.signals import Command
from baqueano.tune import tune
from baqueano.tune.objective import tuning_objective
from baqueano.tune.search import at_limit
from baqueano.tune.search_space import search_space
from baqueano.vehicle_file import load
from tests.codes import refused

QUICK: dict = {"starts": 1, "polish": False, "duration_s": 1.0}
ROUTE = circle(0.3, 0.2)


@pytest.fixture(scope="module")
def lqr():
    return tune(load("small"), ROUTE, controller="lqr", gains=["e_max"], **QUICK)


def test_each_entry_of_an_array_is_a_gain():
    space = search_space(load("small"), controller="lqr")
    assert space.names == (
        "k_i", "e_max[0]", "e_max[1]", "e_max[2]", "change_max[0]", "change_max[1]",
    )  # fmt: skip
    assert space.units[1:4] == ("m", "m", "rad")
    assert np.all(space.low < space.file_gains)
    assert np.all(space.file_gains < space.high)
    block = space.with_gains(np.arange(1.0, 7.0))
    assert block.e_max.tolist() == [2.0, 3.0, 4.0]


def test_an_array_gain_is_named_as_a_whole_or_by_entry():
    assert search_space(load("small"), ["e_max"], controller="lqr").names == (
        "e_max[0]",
        "e_max[1]",
        "e_max[2]",
    )
    space = search_space(load("small"), ["e_max[1]"], {"e_max": (0.01, 1.0)}, "lqr")
    assert (space.names, space.low[0], space.high[0]) == (("e_max[1]",), 0.01, 1.0)


def test_the_gradient_with_respect_to_an_entry_is_exact():
    drive = tuning_objective(load("small"), ROUTE, controller="lqr", gains=["e_max", "k_i"], duration_s=1.0)
    gains = drive.space.file_gains
    slope = drive.cost_and_gradient(gains)[1]
    steps = np.diag(1e-6 * gains)
    numeric = [(drive.cost(gains + h) - drive.cost(gains - h)) / (2 * h.sum()) for h in steps]
    np.testing.assert_allclose(slope, numeric, rtol=2e-3, atol=1e-7)


def test_the_memory_of_the_controller_at_the_start_follows_its_gains():
    """The regulator starts with the cost matrix of its own weights, so the weights in the file have no effect."""
    weights = np.array([0.2, 0.02, 0.1])
    options = {"controller": "lqr", "gains": ["e_max"], "duration_s": 1.0}
    file = load("small").with_values({"controller.kind": "lqr", "controller.e_max": weights})
    drive = tuning_objective(load("small"), ROUTE, **options)
    assert drive.cost(weights) == pytest.approx(
        tuning_objective(file, ROUTE, **options).cost(weights), rel=1e-9
    )
    _, slope = drive.cost_and_gradient(weights)
    for k, step in enumerate(1e-6 * np.eye(3)):
        difference = (drive.cost(weights + step) - drive.cost(weights - step)) / 2e-6
        assert slope[k] == pytest.approx(difference, rel=1e-4)


def test_a_tuned_controller_is_written_with_its_kind_and_provenance(lqr):
    file = lqr.updated_file()
    assert file.data["controller"]["kind"] == "lqr"
    np.testing.assert_allclose(file.controller().e_max, lqr.controller.e_max, rtol=1e-3)
    assert file.provenance["controller.e_max"].run == "tune, perfect pose"


def test_gains_of_the_previous_controller_are_removed_from_the_file(lqr):
    before = load("small").with_values({"controller.k_x": 2.0}, {"controller.k_x": {"run": "tune"}})
    file = before.with_values({"controller.kind": "lqr", "controller.k_i": 0.3})
    assert file.data["controller"] == {"kind": "lqr", "k_i": 0.3}
    assert "controller.k_x" not in file.provenance


def test_the_reported_cost_equals_the_cost_of_a_drive_with_these_gains(lqr):
    """The memory of a linear quadratic regulator is initialised with its gains."""
    drive = tuning_objective(lqr.updated_file(), ROUTE, gains=["e_max"], duration_s=1.0)
    assert drive.cost(drive.space.file_gains) == pytest.approx(lqr.cost, rel=1e-3)


def own_class(module: str = "__main__") -> type:
    """Return a class as a cell of a notebook defines it."""
    from dataclasses import dataclass

    @dataclass(frozen=True, slots=True, eq=False)
    class Steady(ModelFollower):
        k: float = parameter("1/s", "turn per error of the course", low=0.0, high=20.0, default=1.0)

        def velocity_law(self, memory, now):
            return memory, (now.nu_f[0] + now.e[0], now.nu_f[2] + self.k * (now.e_chi + 4.0 * now.e[1]))

    Steady.__module__ = module
    return Steady


def test_a_controller_class_of_a_notebook_cell_is_tuned():
    tuning = tune(load("small"), ROUTE, controller=own_class("a cell"), gains=["k"], **QUICK)
    assert tuning.cost < tuning.cost_before
    assert tuning.controller.k == tuning.values["k"] != 1.0
    with refused("tune.of-a-cell", UsageError, controller="Steady"):
        tuning.updated_file()


class Plain:
    """A class without metadata, as a first attempt in a notebook."""

    def __init__(self, k_x=1.0, k_y=-4.0, limit=1.0):
        self.k_x, self.k_y, self.limit = k_x, k_y, limit

    def init(self):
        return None

    def step(self, state, reference, estimate):
        e = pose_error(reference.eta, estimate.eta)
        u_psi = (reference.nu[2] - self.k_y * e[1] + 2.0 * np.sin(e[2])) / 8.0
        return state, Command(estimate.t_ns, np.array([2.0 * reference.nu[0] + self.k_x * e[0], 0.0, u_psi]))


def test_each_number_of_a_plain_class_is_a_gain_and_keeps_its_sign():
    tuning = tune(load("small"), ROUTE, controller=Plain, **QUICK)
    assert [(gain.name, gain.unit) for gain in tuning.gains] == [("k_x", ""), ("k_y", "")]
    assert tuning.cost < tuning.cost_before
    assert tuning.controller.k_y == tuning.values["k_y"] < 0.0
    assert "NaN" not in tuning.table()
    fixed_result = tune(load("small"), ROUTE, controller=Plain(k_y=-6.0), gains=["k_x"], **QUICK)
    assert (list(fixed_result.values), fixed_result.controller.k_y) == (["k_x"], -6.0)


def test_a_soft_bound_is_widened_and_a_hard_bound_is_not():
    space = search_space(load("small"), ["e_max[0]", "k_i"], controller="lqr")
    wider = space.widen(np.array([1, 1]))
    assert wider.high.tolist() == [4.0 * space.high[0], 10.0]
    bounded_space = search_space(load("small"), ["e_max[0]"], {"e_max[0]": (0.1, 0.2)}, "lqr")
    assert bounded_space.widen(np.array([1])).high.tolist() == [0.2]
    assert space.widen(np.array([-1, 0])).low[0] == space.low[0] / 4.0


def test_a_gain_at_a_soft_bound_is_searched_again_with_wider_bounds():
    """A drive of one second needs a far larger weight on the forward error than the first bounds allow."""
    narrow = load("small").with_values({"controller.kind": "lqr", "controller.e_max": [40.0, 0.05, 0.3]})
    first = search_space(narrow, ["e_max[0]"])
    tuning = tune(narrow, ROUTE, gains=["e_max[0]"], **QUICK)
    (gain,) = tuning.gains
    assert gain.low < first.low[0]
    assert gain.value < first.low[0]
    is_inside = at_limit(np.array([gain.value]), np.array([gain.low]), np.array([gain.high]))
    assert is_inside[0] == 0 or gain.low == pytest.approx(first.low[0] / 64.0)


def test_a_controller_whose_step_calls_a_library_is_refused_before_the_search():
    pytest.importorskip("osqp")
    with refused("tune.as-written", UsageError, controller="Mpc"):
        search_space(load("small"), controller="mpc")
