"""A lap that returns to its start identifies the gyro scale, wherever its marks are; a lap without this is refused."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.drive import closure as module, teach
from baqueano.drive.closure import lap_closure
from baqueano.drive.session import MARK_SOURCE
from baqueano.errors import AnswerNo, Invalid
from baqueano.guides.shapes import eight
from baqueano.runs import Channel, Run
from baqueano.runs.logs import Event
from baqueano.worlds import SimulatedWorld
from tests.codes import refused

TRUE = 0.97
NOISE = {
    "disturbance_std": [0.03, 0.8],
    "disturbance_fade_s": [1.0, 2.5],
    "velocity_walk_std": [0.01, 0.01, 1e-4],
}


@pytest.fixture(scope="module", autouse=True)
def _each_replay_once():
    """Compute each replay once: two replays of a run by one file are equal to the last bit."""
    replays, replay = {}, module.replay

    def replay_once(run, file, **options):
        columns = run.t_ns, run.applied_commands, *(channel.z for channel in run.sensors.values())
        key = file.text, repr(options), *(column.tobytes() for column in columns)
        if key not in replays:
            replays[key] = replay(run, file, **options)
        return replays[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "replay", replay_once)
        yield


@pytest.fixture(scope="module")
def file():
    """A vehicle file with the noise of its estimator, as `identify` writes it."""
    return vehicle_file.load("small").with_values({f"estimator.{key}": x for key, x in NOISE.items()})


@pytest.fixture(scope="module")
def lap(file):
    """A taught eight that ends at its start; the scale of the gyro differs from the file."""
    true_file = file.with_values({"sensors.imu.gyro_scale": TRUE})
    return teach(true_file, eight(0.4, 0.3), seed=3, backend="python").run


@pytest.fixture(scope="module")
def result(lap, file):
    return lap_closure(lap, file)


def marked(run, *times_ns):
    return replace(run, events=tuple(Event(int(t_ns), "info", MARK_SOURCE, "") for t_ns in times_ns))


def after_another_drive(run):
    """Return the run after a copy of itself and 2 s of rest, with marks at the start and the end of the last lap."""
    period_ns = int(run.t_ns[1] - run.t_ns[0])
    rest_ns = run.t_ns[-1] + period_ns * np.arange(1, 201)
    shift_ns = int(rest_ns[-1]) + period_ns - int(run.t_ns[0])
    t_ns = np.concatenate([run.t_ns, rest_ns, run.t_ns + shift_ns])
    applied_commands = np.concatenate(
        [run.applied_commands, np.zeros((200, run.applied_commands.shape[1])), run.applied_commands]
    )
    imu = run.sensors["imu"]
    rest_z = np.repeat(imu.z[:1], 200, axis=0)
    sensors = {
        "imu": Channel(
            np.concatenate([imu.t_ns, rest_ns, imu.t_ns + shift_ns]),
            np.concatenate([imu.arrival_ns, rest_ns, imu.arrival_ns + shift_ns]),
            np.concatenate([imu.z, rest_z, imu.z]),
        )
    }
    long_run = Run("two laps", None, t_ns, applied_commands, sensors=sensors, metadata={"start": "5 7 2"})
    return marked(long_run, run.t_ns[0] + shift_ns, run.t_ns[-1] + shift_ns)


def test_a_lap_identifies_the_gyro_scale_without_marks(result):
    assert abs(result.scale - TRUE) < 3.0 * result.std < 0.02
    assert result.values["sensors.imu.gyro_scale_std"] == pytest.approx(result.std / result.scale, rel=0.05)


def test_the_motion_before_the_first_mark_does_not_count(file, lap, result):
    second = lap_closure(after_another_drive(lap), file)
    assert second.std == pytest.approx(result.std, rel=0.05)
    assert second.scale == pytest.approx(result.scale, abs=0.3 * result.std)
    assert second.gap_m == pytest.approx(result.gap_m, rel=0.2)


def test_a_scale_without_a_standard_deviation_in_the_file_does_not_bound_the_lap(file, lap, result):
    free = lap_closure(lap, file.with_values({"sensors.imu.gyro_scale_std": 0.0}))
    assert abs(free.scale - TRUE) < 3.0 * free.std
    assert free.std >= result.std


@pytest.mark.parametrize("std", [0.0, 0.03])
def test_a_run_at_rest_does_not_identify_a_scale(file, lap, std):
    rest = lap.cut(0.0, 0.5)
    rest = replace(rest, applied_commands=0.0 * rest.applied_commands)
    with refused("marks.lap-no-scale", AnswerNo, gyro="imu"):
        lap_closure(rest, file.with_values({"sensors.imu.gyro_scale_std": std}))


def test_a_run_that_does_not_return_is_refused(file, lap):
    half = lap.cut(0.0, lap.rest_s + 0.3 * lap.without_rest.duration_s)
    with refused("marks.lap-open", AnswerNo, gyro="imu"):
        lap_closure(half, file)


def with_end(monkeypatch, offset):
    """Let the lap end elsewhere by this offset (3,), at which the estimator looks."""
    replay = module.replay

    def replay_elsewhere(*args, **options):
        run = replay(*args, **options)
        eta = run.estimate.eta.copy()
        eta[-1] += offset
        return replace(run, estimate=run.estimate._replace(eta=eta))

    monkeypatch.setattr(module, "replay", replay_elsewhere)


@pytest.mark.parametrize(
    "offset",
    [(0.14, -0.14, 0.0), (-0.14, 0.14, 0.0), (0.0, 0.0, np.radians(15.0)), (0.0, 0.0, -np.radians(15.0))],
)
def test_a_lap_that_ends_elsewhere_is_refused(file, lap, monkeypatch, offset):
    with_end(monkeypatch, np.array(offset))
    with refused("marks.lap-open", AnswerNo, maximum=pytest.approx(-2.0 * np.log(0.001), abs=1e-3)):
        lap_closure(lap, file)


def test_a_lap_that_is_cut_short_by_20_cm_is_refused(file, lap):
    far_m = np.hypot(*(lap.truth.eta[:, :2] - lap.truth.eta[-1, :2]).T)
    end_ns = lap.truth.t_ns[np.flatnonzero(far_m > 0.2)[-1]]
    with refused("marks.lap-open", AnswerNo):
        lap_closure(lap.cut(0.0, float(end_ns - lap.t_ns[0]) / 1e9), file)


def test_an_error_of_the_end_along_the_derivative_is_not_noticed(file, lap, result, monkeypatch):
    def end(scale):
        log = module.replay(
            lap, file.with_values({"sensors.imu.gyro_scale": scale}), backend="python"
        ).estimate
        return log.eta[-1]

    J = (end(1.005) - end(0.995)) / 0.01
    with_end(monkeypatch, -0.02 * J)
    assert np.linalg.norm(0.02 * J[:2]) > 0.05
    assert lap_closure(lap, file).scale == pytest.approx(result.scale + 0.02, abs=0.004)


def test_a_lap_that_closes_in_its_estimate_only_confirms_a_wrong_scale(file):
    true_file = file.with_values({"sensors.imu.gyro_scale": TRUE})
    world = SimulatedWorld(true_file.vehicle, true_file.sensors, file.rate_hz, 3)
    run = teach(file, eight(0.4, 0.3), world=world, backend="python").run
    closure = lap_closure(run, file)
    assert np.hypot(*(run.truth.eta[-1] - run.estimate.eta[-1])[:2]) > 0.06
    assert abs(closure.scale - file.sensors.imu.gyro_scale) < 3.0 * closure.std < 0.5 * (1.0 - TRUE)


@pytest.mark.parametrize(("scale", "std", "limit"), [(1.0, 0.001, 1.5), (1.11 * TRUE, 0.0, 10.0)])
def test_a_scale_that_contradicts_the_file_is_refused(file, lap, scale, std, limit):
    prior = {"sensors.imu.gyro_scale": scale, "sensors.imu.gyro_scale_std": std}
    with refused("marks.lap-other-scale", AnswerNo) as no:
        lap_closure(lap, file.with_values(prior))
    assert no.value.diagnostic.figures["value"] == pytest.approx(TRUE, abs=0.015)
    assert no.value.diagnostic.figures["max_percent"] == pytest.approx(limit, abs=0.2)


@pytest.mark.parametrize("column", ["eta", "cov"])
def test_an_estimate_that_is_not_finite_is_refused(file, lap, monkeypatch, column):
    def replay(*args, **options):
        values = getattr(lap.estimate, column).copy()
        values[-1] = np.nan
        return replace(lap, estimate=lap.estimate._replace(**{column: values}))

    monkeypatch.setattr(module, "replay", replay)
    with refused("marks.no-covariance", AnswerNo, kind="AugmentedEkf"):
        lap_closure(lap, file)


def test_marks_without_ticks_between_them_are_refused(file, lap):
    last_ns = int(lap.t_ns[-1])
    for times_ns in ((last_ns + 1, last_ns + 10), (last_ns, last_ns)):
        with refused("marks.no-lap", AnswerNo):
            lap_closure(marked(lap, *times_ns), file)
    with refused("marks.no-lap", AnswerNo, ticks=0):
        lap_closure(lap.cut(0.0, 0.0), file)


@pytest.mark.parametrize("place_std_m", [0.0, -1.0, np.nan, np.inf])
def test_a_mark_needs_a_positive_standard_deviation(file, lap, place_std_m):
    with refused("marks.place-std", Invalid):
        lap_closure(lap, file, place_std_m)


def test_the_gyro_is_the_one_that_the_run_contains(file, lap, tmp_path):
    text = file.text.replace("[sensors.imu]", '[sensors.front]\nkind = "imu"\n\n[sensors.imu]', 1)
    path = tmp_path / "two.toml"
    path.write_text(text, encoding="utf-8")
    assert module._gyro_name(lap, vehicle_file.load(path)) == "imu"
