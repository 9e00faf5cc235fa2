"""`baqueano study laps`: readings of marks in the truth, and the errors and covariances of laps over the marks."""

import numpy as np
import pytest

from baqueano.drive.closure import closure, lap_closure
from baqueano.errors import AnswerNo
from baqueano.study import driving
from baqueano.study.corridor.vehicles import identify_vehicles, vehicles
from baqueano.study.driving import SHAPES, initial_file
from baqueano.study.laps import all_cases, study_fix_laps, team
from baqueano.study.laps.drives import STEP_S, Laps
from baqueano.study.laps.fixes import FIXES, THREE_FRACTIONS, lap_poses, with_fix
from baqueano.study.laps.result import FullDrive, LapCase, LapStudy, robot_laps
from baqueano.study.truth import FloorLines, Gate, PassingFaults, TagReaders, TruthWorld, draw_robots
from baqueano.study.truth.transmission import Transmission
from baqueano.symbolic import function
from baqueano.vehicle_file import Provenance
from benchmarks.lap_returns import lap_ends, refused_share
from tests.codes import refused

TWO = np.array([[1.0, 0.0], [2.0, 1.0]])


def readings_of(floor, path):
    """Return the readings of one vehicle along a path (T, 3), by the index of the step."""
    readings = [floor.read(0.01 * (k + 1), eta[None])[0] for k, eta in enumerate(path)]
    return {k: z for k, z in enumerate(readings) if not np.isnan(z).all()}


def floor(seed=0, faults=PassingFaults(), noise=0.0):  # noqa: B008 a tuple
    return TagReaders(TWO, 0.1, noise, [seed], np.array([[0.0, 0.05]]), faults)


def line(y, n=300):
    return np.column_stack([np.linspace(0.01, 3.0, n), np.full(n, y), np.full(n, 0.1)])


def test_a_tag_is_read_once_at_the_nearest_point():
    readings = readings_of(floor(), line(0.05))
    ((k, z),) = readings.items()
    assert z == pytest.approx([1.0, 0.05], abs=0.02)
    assert 99 <= k <= 101
    assert readings_of(floor(), line(0.11)) == {}


def test_tag_faults_occur_at_the_specified_rate():
    readings_by_seed = [
        readings_of(floor(seed, PassingFaults(0.2, 0.1, 0.05)), line(0.05)) for seed in range(400)
    ]
    counts = np.bincount([len(readings) for readings in readings_by_seed], minlength=3)
    assert counts[0] / 400 == pytest.approx(0.2, abs=0.06)
    assert counts[2] / 400 == pytest.approx(0.08, abs=0.05)
    mistaken = [
        readings
        for readings in readings_by_seed
        if readings and abs(next(iter(readings.values()))[0] - 2.0) < 0.05
    ]
    assert len(mistaken) / 400 == pytest.approx(0.04, abs=0.03)


ACROSS = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.5, 0.0, np.pi]])


def lines(seed=0, faults=PassingFaults()):  # noqa: B008 a tuple
    return FloorLines(ACROSS, 0.1, 0.0, [seed], np.array([[0.0, 0.05]]), faults)


def test_a_line_is_read_once_when_crossed_in_its_direction():
    readings = readings_of(lines(), line(0.05))
    assert [int(np.flatnonzero(np.isfinite(z))[0]) for z in readings.values()] == [0, 1]
    assert all(0.0 <= np.nanmax(z) < 0.011 for z in readings.values())
    assert readings_of(lines(), line(0.11)) == {}


def test_a_confused_line_reading_names_another_line():
    readings_by_seed = [
        readings_of(lines(seed, PassingFaults(mistaken_rate=1.0)), line(0.05)) for seed in range(20)
    ]
    first = [
        int(np.flatnonzero(np.isfinite(next(iter(readings.values()))))[0]) for readings in readings_by_seed
    ]
    assert set(first) == {1, 2}


def test_a_gate_measures_the_pose_relative_to_the_gate_it_reports():
    poses, start = np.array([[1.0, 0.0, 0.1], [0.0, 5.0, 3.0]]), np.array([[0.0, 0.05]])
    for mistaken, expected in ((0.0, [1.0, 0.05, 0.1]), (1.0, [0.0, 5.05, 3.0])):
        gate = Gate(poses, 0.1, np.zeros(3), [0], start, PassingFaults(mistaken_rate=mistaken))
        (z,) = readings_of(gate, line(0.05)).values()
        assert z == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("fix", FIXES)
@pytest.mark.parametrize("shape", SHAPES)
def test_the_vehicle_file_declares_the_sensors_of_each_kind_of_mark(fix, shape):
    route, sizes = SHAPES[shape](0.3), FIXES[fix].sizes
    origins = {key: Provenance("laps") for key in ("model.mass_kg", "sensors.tags.measurement_noise_cov")}
    file = initial_file().with_values({}, {"model.mass_kg": origins["model.mass_kg"]})
    file = with_fix(with_fix(file, "tags", route).with_values({}, origins), fix, route)
    assert {name: sensor.size for name, sensor in file.sensors._asdict().items()} == {"imu": 3, **sizes}
    assert list(file.estimator().use) == ["imu", *sizes]
    reader = FIXES[fix].reader(route, [0], route.eta[:1, :2], PassingFaults())
    poses = np.column_stack(
        [np.interp(np.arange(0.01, route.t_s[-1], 0.01), route.t_s, x) for x in route.eta.T]
    )
    readings = np.array([reader.read(0.01 * k, eta[None])[0] for k, eta in enumerate(poses)])
    assert np.sum(np.isfinite(readings), axis=0).tolist() == COUNTS[fix]  # once a lap each


@pytest.mark.parametrize("shape", SHAPES)
def test_three_lines_determine_the_pose_on_every_route(shape):
    route = SHAPES[shape](0.3)
    middle = 0.5 * (route.eta[:, :2].min(axis=0) + route.eta[:, :2].max(axis=0))
    x, y, psi = (lap_poses(route, THREE_FRACTIONS) - np.append(middle, 0.0)).T
    H = np.column_stack([np.cos(psi), np.sin(psi), x * np.sin(psi) - y * np.cos(psi)])
    assert np.linalg.svd(H, compute_uv=False)[-1] > 0.7


COUNTS = {"none": [], "tags": [2, 2], "lines": [1, 1, 1], "gate": [1, 1, 1]}


def test_two_turns_on_a_mark_calibrate_the_gyro():
    robots = vehicles(range(3))
    for run, scale in zip(team.simulate_two_turns(robots, range(3)), robots.imu.gyro_scale, strict=True):
        result = closure(run, initial_file())
        assert result.turns == 2
        assert result.scale == pytest.approx(scale, abs=3.0 * result.std)
        assert result.std < 0.004


@pytest.mark.long
def test_an_estimated_end_of_a_lap_is_refused_if_it_is_away_from_the_mark():
    seeds = range(10, 12)
    ends = lap_ends(seeds, identify_vehicles(vehicles(seeds), seeds, "auto"), "rectangle")
    assert refused_share(ends) == 0.0
    assert refused_share(ends, distance_m=0.05) < refused_share(ends, distance_m=0.1) <= 1.0
    assert refused_share(ends, distance_m=0.2) == 1.0


@pytest.mark.long
@pytest.mark.parametrize(("seed", "end"), [(10, (0.2, 0.0, 0.0)), (11, (0.0, -0.2, 0.0))])
def test_a_lap_of_an_independent_robot_is_refused_if_it_ends_away_from_its_mark(seed, end):
    """The estimated end is turned by 20°, and a lap of the simulator ends 20 cm away."""
    robots = vehicles([seed])
    files = identify_vehicles(robots, [seed], "auto")
    ends = lap_ends([seed], files, "rectangle")
    assert refused_share(ends, turn_rad=np.radians(20.0)) == 1.0
    (lap,) = team.simulate_taught_laps(robots, [seed], files, ends=np.array([end]))
    with refused("marks.lap-open", AnswerNo):
        lap_closure(lap, files[0])


def test_the_compiled_truth_gives_the_same_path_with_longer_steps():
    robots = draw_robots(1, 4)
    robots = robots.with_parameters(floor=0.0 * robots.floor)
    worlds = [
        TruthWorld(robots, [1], step_s=step_s, fast=fast)
        for step_s, fast in ((1e-3, slow), (STEP_S, function))
    ]
    rng = np.random.default_rng(0)
    for _ in range(20):
        u = np.array([[rng.uniform(0.3, 0.8), 0.0, rng.uniform(-0.3, 0.3)]])
        for world in worlds:
            for _ in range(50):
                world.tick(u, 0.01)
    assert worlds[0].truth.eta[0] == pytest.approx(worlds[1].truth.eta[0], abs=2e-3)


@pytest.mark.parametrize("is_ideal", [True, False])
def test_the_compiled_truth_equals_the_truth(is_ideal):
    """Also with second lags, play in the gears and slip."""
    robots, u = vehicles(range(3)), np.array([[0.6, 0.0, 0.1], [0.5, 0.0, -0.3], [-0.7, 0.0, 0.0]])
    parts = Transmission(
        np.array([0.02, 0.0, 0.01]), np.array([0.0, 1e-3, 2e-3]), np.array([np.inf, 2.0, 1.0])
    )
    robots = robots if is_ideal else robots.with_parameters(transmission=parts)
    reference, compiled_world = (TruthWorld(robots, [1, 2, 3], fast=fast) for fast in (slow, function))
    for _ in range(100):
        z = reference.tick(u, 0.01), compiled_world.tick(u, 0.01)
        assert z[0] == pytest.approx(z[1], abs=1e-12)
    assert reference.truth.eta == pytest.approx(compiled_world.truth.eta, abs=1e-12)


def slow(f, *examples):
    return f


@pytest.mark.long
def test_tags_limit_the_errors_and_a_drive_without_tags_stops(monkeypatch):
    monkeypatch.setattr(driving, "EXPERIMENT_S", 40.0)
    monkeypatch.setattr(team, "LEARNING_LAPS", 3)
    cases = [LapCase("rectangle", fix, "calibrated", "no reading lost") for fix in ("none", "tags")]
    study = study_fix_laps(1, 40, 4, cases=cases)
    assert study.refused_robots == ()
    imu_only, tags = study.rows()
    assert imu_only["wall_contacts"] == 0
    assert tags["success_share"] == 1.0
    assert tags["position_worst_m"] < 0.05
    assert tags["last_across_p95_m"] < 0.05


TAGS = LapCase("eight", "tags", "calibrated", "no reading lost")


def study_of(error_m, std_m, laps=5, across_m=0.02, stops=False, case=TAGS, forecast=float("nan")):
    """Return a study of two robots with a constant error in x. Robot 3 is `across_m` off the route, and may stop."""
    error, drives = np.tile([error_m, 0.0, 0.0], (10 * laps, 2, 1)), np.ones((10 * laps, 2), bool)
    cov = np.tile(np.diag([std_m**2, std_m**2, 1e-4]), (10 * laps, 2, 1, 1))
    distance = np.tile([across_m, -0.01], (10 * laps, 1))
    drives[15 if stops else 10 * laps :, 0] = False
    driven_laps = Laps(error, cov, distance, drives, np.zeros(2, bool), ())
    wholes = tuple(FullDrive(case, seed, False, forecast) for seed in (3, 4))
    return LapStudy(tuple(robot_laps(driven_laps, case, [3, 4], laps, 10)), wholes, 2, laps, ())


def test_a_stop_or_a_large_distance_fails_the_study_despite_faults():
    study = study_of(0.02, 0.02, across_m=-0.12, case=TAGS._replace(read="faults"))
    assert study.rows()[0]["success_share"] == 0.5
    assert (
        "eight, tags, calibrated, faults: 50% of the robots keep to the route; expected 90 %" in study.reasons
    )
    assert study_of(0.02, 0.02).rows()[0]["success_share"] == 1.0
    (row,) = study_of(0.02, 0.02, stops=True).rows()
    assert (row["success_share"], row["stopped"], row["stop_lap_median"]) == (0.5, 1, 2.0)
    e = study_of(0, 1, 3, 0.2).reasons
    assert (
        "eight, tags, calibrated, no reading lost: lap 3: 19 cm from the route; expected at most 10 cm" in e
    )


def test_a_too_small_covariance_is_named_by_the_study():
    assert study_of(0.02, 0.02).verdict == "USABLE"
    assert "all bounds are met" in study_of(0.02, 0.02).table()
    precise = study_of(0.05, 0.01)
    assert precise.verdict == "WARN"
    assert "0% are within the 95 % region" in precise.reasons[0]
    assert "NEES 8.33" in precise.reasons[1]
    assert "the error of the estimate is 20 cm; expected at most 10 cm" in study_of(0.2, 0.2).reasons[0]


def test_the_limits_depend_on_the_gyro_and_the_position_sensor():
    bought = TAGS._replace(gyro="uncalibrated")
    assert study_of(0.02, 0.02, across_m=0.2, case=bought, forecast=0.55).verdict == "USABLE"
    study = study_of(0.02, 0.02, across_m=0.2, case=bought, forecast=0.9)
    assert "50% of the robots keep to the route; the forecast was 90%" in study.reasons[0]
    imu_only = TAGS._replace(fix="none")
    assert study_of(0.02, 0.02, across_m=0.3, stops=True, case=imu_only).verdict == "USABLE"
    assert study_of(0.1, 0.02, stops=True, case=imu_only).verdict == "WARN"


def test_the_study_combines_every_position_sensor_with_every_route():
    cases = all_cases()
    assert len(cases) == len(set(cases)) == 48
    assert {(case.fix, case.route) for case in cases} == {(fix, shape) for fix in FIXES for shape in SHAPES}
