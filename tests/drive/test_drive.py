"""The functions experiment, teach, repeat and replay on a simulated vehicle."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.compare.laps import run_laps
from baqueano.controllers import Pd
from baqueano.controllers.schedule import script_commands
from baqueano.diagnostics import Severity, StopReason
from baqueano.drive import drive_stop_reason, experiment, repeat, replay, teach
from baqueano.drive.observers import Progress
from baqueano.drive.safety.final_pose import MAX_DISTANCE_M
from baqueano.drive.tasks import drive_with_driver
from baqueano.errors import AnswerNo, UsageError
from baqueano.estimators import Ekf
from baqueano.geometry import wrap
from baqueano.guides import Repeat, RepeatByProgress, SinuousCircle
from baqueano.guides.repeat_by_progress import END_WAIT_S
from baqueano.guides.route import move_route
from baqueano.guides.shapes import circle
from baqueano.loop import Blocks
from baqueano.runs import Channel, read_run
from baqueano.runs.run_path import run_route
from baqueano.sensors import Mark
from baqueano.signals import sensor_slots
from baqueano.supervisor import Supervisor
from baqueano.vehicle_file import load
from baqueano.vehicle_file.head import Geometry
from baqueano.vehicles import Planar
from baqueano.worlds import SimulatedWorld
from tests.codes import refused
from tests.light_robot import LIMIT, SENSORS, VEHICLE, R

FILE = SimpleNamespace(
    name="small",
    text="# small\n",
    path=None,
    is_guess=False,
    rate_hz=100.0,
    geometry=Geometry(),
    command=SimpleNamespace(names=("u_x", "u_y", "u_psi"), unit="duty", limit=LIMIT),
    vehicle=VEHICLE,
    sensors=SENSORS,
    envelope=None,
    sensors_without_noise=(),
    estimator=lambda kind=None: Ekf(VEHICLE, SENSORS, R),
    controller=lambda kind=None: Pd(alpha=8.0, beta=20.0, gamma=1.0),
    guide=lambda route, kind=None: Repeat.along(route),
    supervisor=lambda: Supervisor(LIMIT),
)
FILE.truth, FILE.simulation_truth = FILE, lambda truth: truth
ROUTE = circle(0.3, 0.3)


def same_log(a, b):
    return all(x is y is None or np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))


def test_an_experiment_applies_its_signal_one_tick_later():
    u = np.tile([0.5, 0.0, 0.1], (100, 1)) * np.sign(np.sin(np.arange(100) / 7.0))[:, None]
    run = experiment(FILE, u, seed=1)
    assert np.array_equal(run.requested_commands[:100], u)
    assert np.array_equal(run.applied_commands[1:101], u)
    assert np.array_equal(run.applied_commands[0], np.zeros(3))
    assert len(run.t_ns) == 101
    assert run.metadata["kind"] == "experiment"
    assert run.metadata["seed"] == "1"
    assert run.sensors["imu"].z.shape == (101, 3)
    assert run.truth.eta.shape == (101, 3)
    assert drive_stop_reason(run) is None


def test_a_clipped_signal_is_logged_before_and_after_the_supervisor():
    run = experiment(FILE, np.tile([3.0, 0.0, 0.0], (20, 1)))
    assert np.all(run.requested_commands[:20, 0] == 3.0)
    assert np.all(run.applied_commands[1:21, 0] == 1.0)


@pytest.mark.parametrize("u", [np.zeros((10, 2)), np.full((10, 3), np.nan)])
def test_a_signal_of_the_wrong_shape_is_refused_with_a_reason(u):
    with refused("drive.signal-shape", UsageError, names="u_x, u_y, u_psi"):
        experiment(FILE, u)


@pytest.mark.parametrize("driver", [ROUTE, SinuousCircle(0.3, 0.03, 0.3, waves=4)])
def test_teaching_along_a_shape_gives_a_closed_route(driver):
    run, route = teach(FILE, driver, closed=True, seed=2)
    assert run.metadata["kind"] == "teach"
    assert route.closed
    np.testing.assert_allclose(route.eta[-1] - route.eta[0], [0.0, 0.0, 2.0 * np.pi], atol=1e-9)
    assert np.max(np.diff(route.t_s)) <= 0.06
    assert np.ptp(route.eta[:, 1]) == pytest.approx(0.6, abs=0.15)
    Repeat.along(route, 3)


def test_a_taught_lap_points_along_its_path_everywhere():
    """A lap that ends before its start, by the delay of the vehicle, was closed by moving and turning all its poses."""
    eta = teach(load("small"), circle(0.3, 0.4), closed=True).route.eta
    dx, dy = np.diff(eta[:, :2], axis=0).T
    error = wrap(np.arctan2(dy, dx) - 0.5 * (eta[1:, 2] + eta[:-1, 2]))
    np.testing.assert_allclose(error[np.hypot(dx, dy) > 0.005], 0.0, atol=0.08)


@pytest.mark.parametrize("name", ["stanley", "pd_feedforward"])
def test_a_lesson_ends_when_the_vehicle_passes_its_start(name):
    run = teach(load("small"), circle(0.3, 0.4), closed=True, controller=name).run
    before, last = run.estimate.eta[-2:, 0]
    assert before < 0.0 <= last < 0.01
    assert run.reference.at_end[-1] == 1.0
    assert run.reference.at_end[-2] == 0.0


def test_teaching_accepts_a_list_of_commands():
    run, route = teach(FILE, [(1.0, (0.4, 0, 0)), (0.5, (0.4, 0, 0.2)), (0.5, (0, 0, 0))], seed=2)
    assert len(run.t_ns) == 201
    assert np.array_equal(run.applied_commands[1:101], np.tile([0.4, 0, 0], (100, 1)))
    assert not route.closed
    assert route.t_s[0] == 0.0
    assert route.eta[-1, 0] > 0.2
    assert route.eta[-1, 2] > 0.2


def test_manual_teaching_ends_with_the_last_manual_command():
    hand_commands = iter([np.array([0.5, 0.0, 0.0])] * 150)

    def hand():
        try:
            return next(hand_commands)
        except StopIteration:
            raise KeyboardInterrupt from None

    run, route = teach(FILE, hand, seed=2)
    assert len(run.t_ns) == 150
    assert drive_stop_reason(run).code == StopReason.INTERRUPTED
    assert route.eta[-1, 0] > 0.2


def test_a_drive_that_does_not_return_is_not_a_closed_route():
    with refused("route.open", AnswerNo):
        teach(FILE, [(2.0, (0.5, 0, 0))], closed=True)


def test_teaching_without_motion_is_refused():
    with refused("route.no-motion", AnswerNo):
        teach(FILE, [(0.1, (0.0, 0, 0))])


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ([(1.0,)], ("drive.step-pair", {"number": 1, "value": "(1.0,)"})),
        ([(1.0, (0, 0, 0)), (-1.0, (0, 0, 0))], ("drive.step-numbers", {"number": 2, "commands": 3})),
        ([(1.0, (0, 0))], ("drive.step-numbers", {"commands": 3})),
        ([(np.inf, (0, 0, 0))], ("drive.step-numbers", {"number": 1})),
        ([], ("drive.no-steps", {})),
    ],
)
def test_a_bad_script_is_refused_with_a_reason(script, words):
    with refused(words[0], UsageError, **words[1]):
        script_commands(script, 3, 100.0)


def test_a_step_of_a_script_lasts_at_least_one_tick():
    assert script_commands([(1e-4, (0, 0, 1)), (0.02, (0, 0, 0))], 3, 100.0).tolist() == [
        [0, 0, 1],
        [0, 0, 0],
        [0, 0, 0],
    ]
    with refused("drive.signal-shape", UsageError, value="(0, 3)"):
        experiment(FILE, np.zeros((0, 3)))


def test_an_unknown_driver_is_refused_with_a_reason():
    with refused("drive.driver-type", UsageError, kind="int"):
        teach(FILE, 7)


def test_three_laps_are_repeated_from_the_start_of_the_route():
    start = np.array([1.0, -1.0, 0.4])
    route = move_route(ROUTE, start)
    run = repeat(FILE, route, laps=3, seed=5)
    assert run.reference.at_end[-1] == 1.0
    assert run.duration_s == pytest.approx(run.rest_s + Repeat.along(ROUTE, 3).duration_s, abs=0.3)
    np.testing.assert_allclose(run.truth.eta[0], start, atol=0.01)
    error = np.hypot(*(run.reference.eta - run.estimate.eta)[:, :2].T)
    assert np.median(error) < 0.3  # the PD of the paper does not correct e_y (errata 10)


def test_laps_of_an_open_route_are_answered_with_a_warning():
    """Before, an open route was driven once without a message."""
    open_route = ROUTE._replace(closed=False)
    for route, laps, count in ((open_route, 3, 1), (open_route, 1, 0), (ROUTE, 3, 0)):
        events = repeat(FILE, route, laps=laps, duration_s=0.1).events
        codes = [event.diagnostic.code for event in events if event.diagnostic is not None]
        assert codes.count("drive.open-laps") == count


def test_an_endless_repetition_ends_when_the_clock_ends():
    run = repeat(FILE, ROUTE, laps=0, seed=5, duration_s=3.0)
    assert len(run.t_ns) == 300
    assert np.all(run.reference.at_end == 0.0)


@pytest.mark.parametrize("laps", [0, -1])
def test_a_repetition_in_memory_without_an_end_is_refused(laps):
    with refused("drive.laps", UsageError):
        repeat(FILE, ROUTE, laps=laps)


@pytest.mark.parametrize("verb", ["repeat", "experiment", "teach"])
def test_es12_a_replay_with_the_same_blocks_is_bit_identical(verb, tmp_path):
    path = tmp_path / "José Núñez" / "run.mcap"
    path.parent.mkdir()
    options = {"seed": 9, "path": path}
    if verb == "repeat":
        run = repeat(FILE, ROUTE, laps=1, **options)
    elif verb == "teach":
        run = teach(FILE, ROUTE, **options).run
    else:
        run = experiment(FILE, np.random.default_rng(0).uniform(-1, 1, (150, 3)) * LIMIT, **options)
    replayed_run = replay(read_run(path), FILE)
    for name in ("estimate", "reference", "truth"):
        assert same_log(getattr(replayed_run, name), getattr(run, name))
    assert np.array_equal(replayed_run.requested_commands, run.requested_commands, equal_nan=True)
    assert np.array_equal(replayed_run.sent_commands, run.sent_commands, equal_nan=True)
    assert np.array_equal(replayed_run.applied_commands, run.applied_commands)


def test_a_run_in_memory_equals_its_file(tmp_path):
    in_memory = repeat(FILE, ROUTE, laps=1, seed=9)
    from_file = repeat(FILE, ROUTE, laps=1, seed=9, path=tmp_path / "run.mcap")
    assert in_memory.metadata.items() <= from_file.metadata.items()
    for name in ("applied_commands", "requested_commands", "sent_commands", "t_ns"):
        assert np.array_equal(getattr(in_memory, name), getattr(from_file, name))
    for name in ("estimate", "reference", "truth"):
        assert same_log(getattr(in_memory, name), getattr(from_file, name))
    assert same_log(in_memory.sensors["imu"], from_file.sensors["imu"])
    assert from_file.vehicle_text == "# small\n"


def test_a_replay_with_other_blocks_retains_the_applied_commands():
    run = repeat(FILE, ROUTE, laps=1, seed=9)
    lazy = Blocks(FILE.estimator(), Repeat.along(ROUTE), Pd(alpha=0.1, beta=0.1), FILE.supervisor())
    replayed_run = replay(run, FILE, lazy)
    assert np.array_equal(replayed_run.applied_commands, run.applied_commands)
    assert same_log(replayed_run.estimate, run.estimate)
    assert not np.array_equal(replayed_run.requested_commands, run.requested_commands)


def test_a_replayed_drive_without_a_route_has_no_laps():
    """Its reference is the pose of its own estimate, not the recorded estimate, which would be a route."""
    robot = load("small")
    turning = experiment(robot, np.tile([0.55, 0.0, 0.35], (900, 1)))
    ekf = robot.estimator("ekf")
    replayed_run = replay(turning, estimator=ekf)
    assert np.array_equal(replayed_run.reference.at_end, turning.reference.at_end)
    for run in (replayed_run, replay(turning, estimator=ekf, smooth=True)):
        assert run.guide_reference is None
        assert not run_laps(run)


def test_a_replay_over_a_gap_has_growing_uncertainty_and_is_reproducible():
    run = repeat(FILE, ROUTE, laps=1, seed=9)
    keep = (run.t_ns < 2_000_000_000) | (run.t_ns > 3_000_000_000)
    imu = run.sensors["imu"]
    was_received = (imu.arrival_ns < 2_000_000_000) | (imu.arrival_ns > 3_000_000_000)
    gap_run = replace(
        run,
        t_ns=run.t_ns[keep],
        applied_commands=run.applied_commands[keep],
        requested_commands=run.requested_commands[keep],
        sent_commands=run.sent_commands[keep],
        sensors={"imu": Channel(*(column[was_received] for column in imu))},
    )
    replay_1 = replay(gap_run, FILE)
    reason = replay_1.events[0].diagnostic
    assert (reason.code, reason.figures) == ("replay.holes", {"count": 101})
    hole = (replay_1.t_ns >= 2_000_000_000) & (replay_1.t_ns <= 3_000_000_000)
    spread = np.trace(replay_1.estimate.cov[hole], axis1=1, axis2=2)
    assert np.all(np.diff(spread) > 0.0)
    assert np.isfinite(replay_1.estimate.eta).all()
    replay_2 = replay(replay_1, FILE)
    assert same_log(replay_2.estimate, replay_1.estimate)


def test_a_sensor_absent_from_the_run_is_silent_in_its_replay():
    run = repeat(FILE, ROUTE, laps=1, seed=9)
    sensors = sensor_slots(("imu", "mark"))(SENSORS.imu, Mark())
    with_mark = SimpleNamespace(
        **vars(FILE)
        | {"sensors": sensors, "estimator": lambda kind=None: Ekf(VEHICLE, sensors, R, use=("imu", "mark"))}
    )
    replayed_run = replay(run, with_mark)
    first = replayed_run.events[0].diagnostic
    assert (first.code, first.figures) == ("replay.without-sensor", {"sensor": "mark"})
    assert len(replayed_run.sensors["mark"].t_ns) == 0
    assert drive_stop_reason(replayed_run) is None
    np.testing.assert_allclose(replayed_run.estimate.eta, run.estimate.eta, atol=1e-9)
    np.testing.assert_allclose(replayed_run.estimate.cov, run.estimate.cov, atol=1e-9)
    assert np.isnan(replayed_run.estimate.innovation[:, 3]).all()


def test_a_replay_preserves_the_timestamps_of_a_sensor(tmp_path):
    run = repeat(FILE, ROUTE, laps=1, seed=9)
    imu = run.sensors["imu"]
    stamped_run = replace(run, sensors={"imu": imu._replace(t_ns=imu.t_ns - 3_000_000)})
    for path in (None, tmp_path / "run.mcap"):
        assert same_log(replay(stamped_run, FILE, path=path).sensors["imu"], stamped_run.sensors["imu"])


def test_the_simulated_vehicle_may_differ_from_the_model():
    heavy = SimpleNamespace(**(vars(FILE) | {"vehicle": Planar(2.0, 0.0015, VEHICLE.actuator_matrix)}))
    u = np.tile([0.5, 0.0, 0.0], (100, 1))
    repetition, real = experiment(FILE, u), experiment(FILE, u, truth=heavy)
    assert real.truth.nu[-1, 0] < 0.8 * repetition.truth.nu[-1, 0]


def test_a_world_and_a_file_of_different_kinds_are_refused():
    world = SimulatedWorld(VEHICLE, SENSORS)
    world.commands = 2
    with refused("drive.other-vehicle", UsageError, file="small", value=3, expected=2):
        experiment(FILE, np.zeros((5, 3)), world=world)


def test_the_progress_of_a_drive_is_reported():
    progress = []
    experiment(FILE, np.zeros((200, 3)), observers=[Progress(progress.append)])
    assert progress[0] == pytest.approx(0.01)
    assert len(progress) == 5
    assert np.all(np.diff(progress) > 0.0)


def test_an_experiment_warns_of_commands_that_are_clipped():
    robot = FILE
    commands = np.tile([100.0, 0.0, -1.0], (50, 1))
    commands[:10] /= 100.0
    diagnostics = [event.diagnostic for event in experiment(robot, commands).events]
    clip_notes = [d for d in diagnostics if d is not None and d.code == "drive.clipped"]
    assert [(d.subject, d.severity) for d in clip_notes] == [("u_x", Severity.WARNING)]
    assert (clip_notes[0].figures["share"], clip_notes[0].figures["largest"]) == (80.0, 100.0)
    small_drive = experiment(robot, commands / 100.0)
    assert all(
        event.diagnostic is None or event.diagnostic.code != "drive.clipped" for event in small_drive.events
    )


@pytest.mark.parametrize(("name", "speed", "end_m"), [("small", 0.2, 0.012), ("car", 0.5, 0.025)])
@pytest.mark.parametrize("guide", ["repeat", "repeat_by_progress"])
def test_a_vehicle_ends_a_drawn_route_slowly_at_its_last_pose(name, speed, end_m, guide):
    """Before, the motors were switched off at full speed, 29 mm (small) or 83 mm (car) before the end."""
    route, file = circle(3.0 * speed, speed), load(name)
    run = repeat(file, route, laps=2, guide=guide, seed=3)
    last = np.hypot(*(run.estimate.eta[-1] - route.eta[-1])[:2])
    assert last < end_m
    assert abs(run.truth.nu[-1, 0]) < 0.3 * speed
    cruise = slice(run.begin_index + round(2.0 * file.rate_hz), -round(2.5 * file.rate_hz))
    assert run.truth.nu[cruise, 0].min() > 0.7 * speed  # it does not brake between two laps


def late_drive(driver, **values):
    """Return a drive of the vehicle `small` if these values of its model are wrong."""
    file = load("small")
    return drive_with_driver(file, driver, truth=file.with_values(values), seed=3)


def test_a_lesson_of_a_vehicle_that_lags_behind_returns_to_its_start():
    """Before, the lesson ended at its planned time, 0.39 m and 91° before the end of the circle."""
    run = late_drive(circle(0.3, 0.4), **{"model.friction.linear": [13.2, 40.0, 0.046]})
    assert np.hypot(*run.estimate.eta[-1, :2]) < 0.1
    assert run_route(run, closed=True).closed
    assert run.estimate.nu[-1, 0] > 0.1  # a closed lesson ends in motion


def test_a_late_vehicle_is_at_rest_at_the_end_of_its_route():
    """Before, the motors were switched off at 0.38 m/s, 14 cm before the end."""
    route = circle(0.4, 0.4)
    guide = RepeatByProgress.along(route, acceleration_m_s2=2.0)
    run = late_drive(guide, **{"model.friction.linear": [9.9, 40.0, 0.0345]})
    assert np.hypot(*(run.estimate.eta[-1] - route.eta[-1])[:2]) < MAX_DISTANCE_M
    assert abs(run.estimate.nu[-1, 0]) <= 0.05


def test_a_lesson_of_a_vehicle_that_hardly_moves_lasts_at_most_twice_as_long():
    lesson = circle(0.3, 0.2)
    run = late_drive(lesson, **{"model.drivetrain.gain": [0.05, 0.05]})
    rest_s, start_s = 2.0, 1.0
    assert run.duration_s < rest_s + start_s + 2.0 * (lesson.t_s[-1] + END_WAIT_S)
