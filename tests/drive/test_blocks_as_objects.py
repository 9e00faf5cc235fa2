"""Blocks that are passed as classes or objects, and the information that the run stores about them."""

import linecache
import pickle
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from baqueano.blocks import resolve
from baqueano.controllers import PdFeedforward
from baqueano.diagnostics import StopReason, note
from baqueano.drive import experiment, repeat, replay, teach
from baqueano.drive.session import drive_stop_reason
from baqueano.errors import UsageError
from baqueano.estimators import DeadReckoning
from baqueano.guides import Repeat
from baqueano.guides.repeat import RepeatState
from baqueano.guides.shapes import circle
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.runs import read_run
from baqueano.signals import Command, Reference
from baqueano.vehicle_file import load
from baqueano.worlds import SimulatedWorld
from tests.codes import refused

SMALL, ROUTE = load("small"), circle(0.3, 0.2)
CELL = """
import numpy as np
from baqueano.signals import Command

class InACell:
    def __init__(self, gain=3.0):
        self.gain = gain
    def init(self):
        return 0.0
    def step(self, state, reference, estimate):
        e = reference.eta - estimate.eta
        return state, Command(estimate.t_ns, np.clip(np.array([self.gain * e[0], 0.0, e[2]]), -1.0, 1.0))
"""
GUIDE_INSIDE = """import numpy as np
from baqueano.signals import Reference

class Mine:
    def init(self):
        return 0.0
    def step(self, state, estimate):
        made = {returned}
        return None if made is None else (state, Reference(estimate.t_ns, made, np.zeros(3), 0.0))
"""


@dataclass(frozen=True, slots=True, eq=False)
class Push:
    """A controller that always commands forward motion."""

    gain: float = 2.0

    def init(self):
        return 0.0

    def step(self, state, reference, estimate):
        e = reference.eta - estimate.eta
        return state, Command(estimate.t_ns, np.clip(np.array([self.gain * e[0], 0.0, e[2]]), -1.0, 1.0))


class Pull(Push):
    """Another controller, whose gain has the same name."""


@dataclass(frozen=True, slots=True, eq=False)
class Ahead:
    """A guide that returns the end of its route."""

    eta: np.ndarray

    def init(self):
        return 0.0

    def step(self, state, estimate):
        return state, Reference(estimate.t_ns, self.eta[-1], np.zeros(3), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class FromStart:
    """A guide that drives straight ahead for a second."""

    speed_m_s: float = 0.2

    def init(self):
        return 0

    def step(self, state, estimate):
        t_s = state / 100.0
        eta = np.array([self.speed_m_s * t_s, 0.0, 0.0])
        nu = np.array([self.speed_m_s, 0.0, 0.0])
        return state + 1, Reference(estimate.t_ns, eta, nu, np.where(t_s > 1.0, 1.0, 0.0))


def drive_with(**blocks):
    return repeat(SMALL, ROUTE, duration_s=0.3, rest_s=0.0, **blocks)


def in_a_cell(name="<cell 1>"):
    """Return the class of CELL as a notebook defines it: its module is not a file, and linecache contains the cell."""
    linecache.cache[name] = (len(CELL), None, CELL.splitlines(keepends=True), name)
    cell = {"__name__": "__main__"}
    exec(compile(CELL, name, "exec"), cell)
    return cell["InACell"]


def test_a_block_given_as_class_object_or_file_gives_the_same_drive():
    by_file = drive_with(controller=f"{__file__}:Push")
    for controller in (Push, Push()):
        assert np.array_equal(drive_with(controller=controller).applied_commands, by_file.applied_commands)
    assert not np.array_equal(drive_with(controller=Push(4.0)).applied_commands, by_file.applied_commands)


def test_a_block_class_is_configured_by_the_vehicle_file():
    file = SMALL.with_values({"controller.kind": f"{__file__}:Push"}).with_values({"controller.gain": 5.0})
    assert file.controller(Push).gain == 5.0
    assert type(SMALL.estimator(DeadReckoning)) is DeadReckoning
    assert SMALL.guide(ROUTE, Ahead).eta is ROUTE.eta


def test_a_controller_receives_its_own_gains_and_not_those_of_another_kind():
    of_another_kind = SMALL.with_values({"controller.kind": Pull, "controller.gain": 7.0})
    assert of_another_kind.controller(Push).gain == Push().gain
    of_this_kind = SMALL.with_values({"controller.kind": Push, "controller.gain": 7.0})
    assert of_this_kind.controller(Push).gain == of_this_kind.controller().gain == 7.0
    tuned_kanayama = SMALL.with_values({"controller.kind": "kanayama", "controller.k_x": 7.0})
    assert tuned_kanayama.controller("stanley").k_x == SMALL.controller("stanley").k_x != 7.0


def test_each_drive_function_accepts_classes_and_objects():
    assert experiment(SMALL, np.zeros((10, 3)), estimator=DeadReckoning).estimate is not None
    lesson = teach(
        SMALL, ROUTE, estimator=DeadReckoning, controller=Push(4.0), duration_s=2.0, rest_s=0.0
    ).run
    assert lesson.metadata["controller"] == "Push(gain=4.0)"
    assert teach(SMALL, FromStart, rest_s=0.0).route.eta[-1, 0] == pytest.approx(0.17, abs=0.02)
    run = drive_with(guide=Ahead, estimator="dead_reckoning", controller=Push)
    assert np.array_equal(run.reference.eta[0], ROUTE.eta[-1])
    replayed_run = replay(run, estimator="dead_reckoning", controller=Push())
    assert np.array_equal(replayed_run.requested_commands, run.requested_commands)
    assert np.array_equal(replay(run, guide=Ahead, controller=Push).reference.eta[0], ROUTE.eta[-1])


def test_a_run_stores_the_source_and_parameters_of_a_block(tmp_path):
    run = drive_with(controller=Push(4.0), path=tmp_path / "run.mcap")
    metadata = read_run(tmp_path / "run.mcap").metadata
    assert metadata["controller"] == run.metadata["controller"] == "Push(gain=4.0)"
    assert metadata["controller.text"] == Path(__file__).read_text(encoding="utf-8")
    assert "estimator.text" not in metadata  # it is built in, and the run contains the version


def test_a_run_stores_the_source_of_a_file_or_a_notebook_cell():
    controller = resolve("controller", f"{__file__}:Push")()
    assert "class Push" in drive_with(controller=controller).metadata["controller.text"]
    assert drive_with(controller=in_a_cell()).metadata["controller.text"] == CELL


@pytest.mark.parametrize(("backend", "eta"), [("numpy", (0.0, 0.0, 0.0)), ("auto", (-0.02, 0.0, 0.0))])
@pytest.mark.parametrize(
    ("returned", "code", "figure"),
    [
        ("1 / 0", StopReason.BLOCK_RAISED, ("error", "ZeroDivisionError: division by zero")),
        ("None", StopReason.BLOCK_RETURNED, ("value", "None")),
        ("np.zeros(2)", StopReason.BLOCK_RETURNED, ("value", "Reference.eta.shape = (2,)")),
        ("np.full(3, np.nan)", StopReason.BLOCK_RETURNED, ("value", "Reference.eta = [nan, nan, nan]")),
    ],
)
def test_an_error_in_a_wrapped_guide_is_located_and_its_source_stored(
    tmp_path, returned, code, figure, backend, eta
):
    """Guides of the package wrap the faulty guide: a rest, a pace, a return path and, behind the route, a lead-in."""
    own_file, line = tmp_path / "mine.py", 8 if code == StopReason.BLOCK_RAISED else 7
    own_file.write_text(GUIDE_INSIDE.format(returned=returned), encoding="utf-8")
    options = {"way_back": True, "backend": backend, "rest_s": 0.1, "duration_s": 9.0, "check": False}
    run = repeat(
        SMALL, ROUTE, guide=resolve("guide", f"{own_file}:Mine")(), eta=ROUTE.eta[0] + eta, **options
    )
    reason = drive_stop_reason(run)
    assert (reason.code, reason.figures[figure[0]]) == (code, figure[1])
    assert reason.figures["block"] == f"guide Mine ({own_file}:{line})"
    with use_language("es"):
        assert text(reason).startswith("guía Mine (")
    assert not [line for line in repr(run).splitlines()[1:3] if "command applied" in line], (
        "the error comes first"
    )
    assert run.metadata["guide"] == "Mine()"
    assert "class Mine" in run.metadata["guide.text"]


class Telling(Repeat):
    """A guide that reports in a diagnostic if it received its own state."""

    def diagnostic(self, state):
        return note("drive.on-mark") if isinstance(state, RepeatState) else None


def test_diagnostics_of_a_wrapped_guide_are_stored_in_the_run():
    guide = Telling.along(ROUTE)
    run = repeat(
        SMALL,
        ROUTE,
        guide=guide,
        eta=ROUTE.eta[0] + (0.1, 0.3, 0.0),
        way_back=True,
        duration_s=0.1,
        rest_s=0.0,
    )
    codes = [event.diagnostic.code for event in run.events if event.source == "guide"]
    assert codes == ["drive.on-mark"] * len(run.t_ns)


def test_a_run_reports_a_block_with_unknown_source():
    controller = in_a_cell("<cell 2>")
    del linecache.cache["<cell 2>"]
    run = drive_with(controller=controller)
    assert "controller.text" not in run.metadata
    (event,) = [
        e.diagnostic for e in run.events if e.diagnostic and e.diagnostic.code == "drive.text-unknown"
    ]
    assert event.figures == {"role": "controller", "block": "InACell"}


def test_a_block_without_a_method_is_refused_with_the_name_of_the_method():
    with refused("block.lacks-method", role="estimator", block="StepOnly", method="init"):
        drive_with(estimator=type("StepOnly", (), {"step": lambda self, belief, tick: belief}))


@pytest.mark.parametrize(
    ("block", "code"),
    [(3, "block.not-a-block"), (ROUTE, "block.not-a-block"), (PdFeedforward, "block.of-other-role"),
     (Push(), "block.of-other-role")],
)  # fmt: skip
def test_an_unsuitable_block_is_refused(block, code):
    with refused(code, UsageError):
        drive_with(estimator=block)


def test_a_replay_of_a_run_without_a_vehicle_file_is_refused():

    with refused("drive.no-vehicle-in-run", UsageError):
        replay(replace(drive_with(), vehicle_text=""))


@pytest.mark.parametrize(
    ("code", "options"),
    [
        ("call.unknown", {"controler": Push}),
        ("call.kind", {"duration_s": "3"}),
        ("call.kind", {"truth": "small"}),
        ("call.kind", {"eta": "start"}),
        ("call.kind", {"path": 3}),
        ("call.kind", {"check": "no"}),
        ("call.kind", {"patience_s": "long"}),
        ("world.incomplete", {"world": 3}),
        ("world.incomplete", {"world": 0}),
        ("world.is-class", {"world": SimulatedWorld}),
        ("drive.duration", {"duration_s": -1.0}),
        ("drive.duration", {"duration_s": np.nan}),
        ("call.kind", {"seed": 1.5}),
        ("drive.seed", {"seed": -1}),
        ("simulate.pose", {"eta": [1.0, 2.0]}),
    ],
)
def test_an_invalid_option_of_a_drive_is_refused_by_its_name(code, options):
    with refused(code):
        repeat(SMALL, ROUTE, **options)


def test_a_vehicle_file_can_be_pickled():
    file_copy = pickle.loads(pickle.dumps(SMALL))
    assert type(file_copy.sensors) is type(SMALL.sensors)
    assert file_copy.text == SMALL.text
