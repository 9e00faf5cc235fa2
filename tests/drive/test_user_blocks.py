"""A block from a file of the user in the loop: it runs, its failure is reported, and it need not be compilable."""

import textwrap
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from baqueano.blocks import resolve
from baqueano.drive import drive, drive_stop_reason, experiment, replay
from baqueano.drive.replay import replay_blocks
from baqueano.guides import SinuousCircle
from baqueano.loop import Blocks
from baqueano.messages import text
from baqueano.monitor import REJECTIONS_SOURCE
from baqueano.vehicle_file import load

FILE = load("small")
HEAD = """\
from dataclasses import dataclass

import numpy as np

from baqueano.signals import Command


@dataclass(frozen=True, slots=True, eq=False)
class Mine:
    gain: float = 2.0

    def init(self):
        return 0.0

    def step(self, state, reference, estimate):
"""


def blocks_with(tmp_path, body):
    path = tmp_path / "mi contról.py"
    path.write_text(HEAD + textwrap.indent(textwrap.dedent(body).strip(), " " * 8) + "\n", encoding="utf-8")
    controller = resolve("controller", f"{path}:Mine")()
    return Blocks(FILE.estimator(), SinuousCircle(laps=0), controller, FILE.supervisor())


def load_run(blocks, **options):
    return drive(blocks, FILE, kind="repeat", duration_s=0.3, **options)


GOOD = """
e = reference.eta - estimate.eta
return state + 1.0, Command(estimate.t_ns, np.array([self.gain * e[0], 0.0, e[2]]))
"""
BRANCH = """
if reference.eta[0] > estimate.eta[0]:
    return state, Command(estimate.t_ns, np.array([0.6, 0.0, 0.0]))
return state, Command(estimate.t_ns, np.zeros(3))
"""


def test_a_user_block_is_compiled_like_a_built_in_block(tmp_path):
    blocks = blocks_with(tmp_path, GOOD)
    run, numpy_run = load_run(blocks), load_run(blocks, backend="numpy")
    assert [e for e in run.events if e.source != REJECTIONS_SOURCE] == []
    np.testing.assert_allclose(run.requested_commands, numpy_run.requested_commands, atol=1e-9)


def test_a_block_that_branches_on_data_runs_uncompiled_with_a_note(tmp_path):
    run = load_run(blocks_with(tmp_path, BRANCH))
    assert drive_stop_reason(run) is None
    assert len(run.t_ns) == 30
    (note,) = [e for e in run.events if e.source != REJECTIONS_SOURCE]
    assert note.level == "info"
    assert (note.diagnostic.code, note.diagnostic.figures["role"]) == ("drive.not-compiled", "controller")
    assert "mi contról.py:16" in note.text
    assert "where" in note.text


MEMORY = """
object.__setattr__(self, "gain", self.gain + 0.01)
return state, Command(estimate.t_ns, np.array([self.gain - 2.0, 0.0, 0.0]))
"""


def test_a_block_that_keeps_memory_in_itself_runs_as_written(tmp_path):
    run = load_run(blocks_with(tmp_path, MEMORY))
    (note,) = [e for e in run.events if e.source != REJECTIONS_SOURCE]
    assert note.diagnostic.figures["error"].code == "trace.not-pure"
    np.testing.assert_allclose(np.diff(run.requested_commands[:, 0]), 0.01)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return state, Command(estimate.t_ns, np.ones(3) @ np.ones(4))", "ValueError"),
        (
            "return state, Command(estimate.t_ns, np.ones(4))",
            "returned Command.u.shape = (4,), expected (3,)",
        ),
        ("return state, Command(estimate.t_ns, np.array([np.nan, 0, 0]))", "Command.u = [nan, 0., 0.]"),
        ("return estimate.unknown", "AttributeError"),
        ("return Command(estimate.t_ns, np.zeros(3))", "returned Command, expected (state, output)"),
    ],
)
@pytest.mark.parametrize("backend", ["auto", "numpy"])
def test_a_failing_block_is_named_with_its_file_and_line(tmp_path, body, words, backend):
    run = load_run(blocks_with(tmp_path, body), backend=backend)
    reason = drive_stop_reason(run)
    assert reason.figures["block"].startswith("controller Mine (")
    assert "mi contról.py:" in reason.figures["block"]
    assert reason.figures["kind"].endswith("mi contról.py:Mine")
    assert words in text(reason)
    assert np.array_equal(run.applied_commands, np.zeros_like(run.applied_commands))
    assert np.isfinite(run.estimate.eta).all()
    assert len(run.t_ns) == 30


OWN_ESTIMATOR = """\
from dataclasses import dataclass

import numpy as np

from baqueano.signals import Estimate


@dataclass(frozen=True, slots=True, eq=False)
class Gyro:
    \"\"\"Integrates the gyro, and believes in nothing else.\"\"\"

    def init(self):
        return np.zeros(3)

    def step(self, eta, tick):
        imu = tick.sensors.imu
        nu = np.array([0.0, 0.0, np.where(imu.is_new > 0.0, imu.z[2], 0.0)])
        eta = eta + 0.01 * nu
        return eta, Estimate(tick.t_ns, eta, nu, np.eye(6))
"""


def test_an_estimator_without_a_start_pose_drives_with_a_note(tmp_path):
    (tmp_path / "gyro.py").write_text(OWN_ESTIMATOR, encoding="utf-8")
    blocks = Blocks(
        resolve("estimator", "gyro.py:Gyro", tmp_path)(),
        SinuousCircle(),
        FILE.controller(),
        FILE.supervisor(),
    )
    assert load_run(blocks).events == ()
    run = load_run(blocks, eta=np.array([1.0, 0.0, 0.0]))
    assert drive_stop_reason(run) is None
    (note,) = run.events
    assert note.diagnostic.code == "drive.own-origin"
    assert note.diagnostic.figures["start"] == "[1.0, 0.0, 0.0]"
    assert run.estimate.innovation is None


def test_the_project_estimator_accepts_timestamps_since_1970():
    run = experiment(FILE, np.tile([0.6, 0.0, 0.1], (200, 1))).cut(1.0)  # the run begins in motion
    estimator = FILE.estimator(kind=f"{files('baqueano.project').joinpath('my_estimator.py')}:MyEstimator")
    now, since_1970 = (
        replay(r, FILE, replay_blocks(r, FILE)._replace(estimator=estimator)).estimate
        for r in (run, shifted(run, 1_700_000_000_000_000_000))
    )
    assert now is not None
    assert since_1970 is not None
    np.testing.assert_allclose(since_1970.eta, now.eta, atol=1e-6)
    np.testing.assert_allclose(since_1970.cov, now.cov, rtol=1e-4, atol=1e-12)


def shifted(run, ns):
    """Return the same run with shifted timestamps."""
    logs = {name: getattr(run, name) for name in ("estimate", "reference", "truth")}
    return replace(
        run,
        t_ns=run.t_ns + ns,
        sensors={
            name: c._replace(t_ns=c.t_ns + ns, arrival_ns=c.arrival_ns + ns)
            for name, c in run.sensors.items()
        },
        **{name: log if log is None else log._replace(t_ns=log.t_ns + ns) for name, log in logs.items()},
    )
