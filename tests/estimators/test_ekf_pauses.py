"""A pause in the ticks is split into rows; after one second the mean is constant and the uncertainty grows."""

from functools import cache

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.estimators.pauses import silent_times, split_ticks
from baqueano.runs.filter_ticks import example_filter_tick
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.symbolic import compile_block, scan
from tests.ekf_file import with_ekf

MS = 1_000_000
GARAGE = ("small", "car", "case-study-1")
BOTH = (*GARAGE, "small, ekf", "car, ekf")
COMMANDS = {"small": (0.6, 0.0, 0.1), "car": (0.3, 0.2), "case-study-1": (3.0, 0.0, 9.0)}


@cache
def ekf(name, backend="c"):
    """Return the estimator of a vehicle of the garage; "small, ekf" and "car, ekf" use the state of the paper."""
    vehicle, _, kind = name.partition(", ")
    return compile_block((with_ekf(load(vehicle), vehicle) if kind else load(vehicle)).estimator(), backend)


@cache
def load(name):
    return vehicle_file.load(name.partition(", ")[0])


def tick(name, t_ms, z=None, u=None):
    sensors = load(name).sensors._asdict()
    slots = [
        Slot(0.0, np.zeros(s.size)) if z is None else Slot(1.0, z * np.ones(s.size)) for s in sensors.values()
    ]
    t_ns = round(t_ms * MS)
    return Tick(
        t_ns,
        np.array(COMMANDS[name.partition(", ")[0]] if u is None else u),
        sensor_slots(tuple(sensors))(*slots),
    )


def drive_ekf(name, times, belief=None, backend="c"):
    belief = ekf(name).init() if belief is None else belief
    for t_ms in times:
        belief, _ = ekf(name, backend).step(belief, tick(name, t_ms))
    return belief


@cache
def moving(name):
    """Return the state at 1 s of a vehicle under a command, and its period [ms]."""
    period = round(1e3 / load(name).rate_hz)
    return drive_ekf(name, range(period, 1001, period)), period


def random_ticks(name, n, seed, shortest_s=0.0, longest_s=10.0):
    """Return n ticks of any length, with all kinds of invalid data."""
    file, rng = load(name), np.random.default_rng(seed)
    short, tiny = rng.uniform(0.0, 0.1, n), 10.0 ** rng.uniform(-9.0, 1.0, n)
    dt_s = np.choose(rng.integers(0, 4, n), [rng.uniform(0.0, longest_s, n), short, tiny, np.full(n, 0.01)])
    slots = {}
    for sensor, block in file.sensors._asdict().items():
        z = rng.standard_normal((n, block.size)) * 10.0 ** rng.uniform(-2.0, 2.0, (n, 1))
        z[rng.random(n) < 0.01] = 1e6
        z[rng.random(n) < 0.01] = np.nan
        age_s = np.where(rng.random(n) < 0.2, rng.uniform(0.0, 0.1, n), 0.0)
        slots[sensor] = Slot((rng.random(n) < 0.7) * 1.0, z, age_s)
    u = rng.uniform(-1.0, 1.0, (n, file.vehicle.commands)) * np.array(file.command.limit)
    t_ns = 10 * MS + np.cumsum(np.round(np.clip(dt_s, shortest_s, longest_s) * 1e9).astype(np.int64))
    return Tick(t_ns, u, sensor_slots(tuple(slots))(**slots))


def make_ticks(ticks):
    kind = type(ticks.sensors)
    for k, t_ns in enumerate(ticks.t_ns):
        slots = (Slot(float(s.is_new[k]), s.z[k], float(s.age_s[k])) for s in ticks.sensors)
        yield Tick(int(t_ns), ticks.u[k], kind(*slots))


def sound(mean, cov):
    """Return True for finite means and positive definite covariances; for others `cholesky` raises LinAlgError."""
    return np.isfinite(mean).all() and np.isfinite(np.linalg.cholesky(cov)).all()


@cache
def kernel(name):
    """Return the function (belief, row) → mean and covariance, in one kernel."""
    block = ekf(name).block

    def step(belief, tick):
        belief, _ = block.row(belief, tick)
        return belief, (belief.mean, belief.cov)

    return scan(step, block.init(), example_filter_tick(block), backend="c")


@pytest.mark.parametrize("backend", ["c", "plain"])
@pytest.mark.parametrize("pause_ms", [25, 300, 500, 1000])
@pytest.mark.parametrize("name", GARAGE)
def test_a_pause_equals_the_same_number_of_ticks_without_readings(name, pause_ms, backend):
    belief, period = moving(name)
    block = ekf(name).block if backend == "plain" else ekf(name)
    paused_belief, _ = block.step(belief, tick(name, 1000 + pause_ms))
    ticked_belief = drive_ekf(name, [*range(1000 + period, 1000 + pause_ms, period), 1000 + pause_ms], belief)
    np.testing.assert_allclose(paused_belief.mean, ticked_belief.mean, rtol=0.0, atol=2e-5)
    if pause_ms % period == 0 and backend == "c":
        assert np.array_equal(paused_belief.mean, ticked_belief.mean), "the rows must be equal bit by bit"
        assert np.array_equal(paused_belief.cov, ticked_belief.cov)


@pytest.mark.parametrize("name", GARAGE)
def test_a_measurement_after_a_pause_corrects_the_state_at_its_tick(name):
    belief, period = moving(name)
    _, estimate = ekf(name).step(belief, tick(name, 1500, z=0.1))
    before = drive_ekf(name, range(1000 + period, 1500, period), belief)
    _, expected = ekf(name).step(before, tick(name, 1500, z=0.1))
    np.testing.assert_array_equal(estimate.innovation, expected.innovation)
    assert estimate.t_ns == 1500 * MS


@pytest.mark.parametrize("call", ["step", "row"])
@pytest.mark.parametrize("name", GARAGE)
def test_after_one_second_of_pause_only_the_covariance_grows(name, call):
    belief, _ = moving(name)
    # hundreds of rows: one row of plain NumPy
    step = getattr(ekf(name).block if name == "car" else ekf(name), call)
    after_1_ms, two, ten = (step(belief, tick(name, 1000 + ms))[0] for ms in (1001, 2000, 10_000))
    np.testing.assert_array_equal(two.mean, after_1_ms.mean)
    np.testing.assert_array_equal(ten.mean, after_1_ms.mean)
    spread = [np.diag(b.cov)[:6] for b in (after_1_ms, two, ten)]
    assert np.all(spread[1] > spread[0])
    assert np.all(spread[2] > spread[1])
    path_m = np.hypot(*ten.mean[3:5]) * 8.9
    assert np.sqrt(ten.cov[0, 0]) > path_m, "the vehicle may have continued at its velocity"
    state = drive_ekf(name, range(1010, 2001, 10), belief) if call == "step" else after_1_ms
    np.testing.assert_allclose(after_1_ms.mean, state.mean, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("name", GARAGE)
def test_covariance_stays_positive_definite_over_a_million_rows_of_any_length(name):
    """A million rows over the vehicles of the garage."""
    belief = ekf(name).init()
    last = 0
    for seed in range(7):
        ticks = random_ticks(name, 50_000, seed)
        ticks = ticks._replace(t_ns=ticks.t_ns + last)
        belief, (mean, cov) = kernel(name).run(ticks, carry=belief)
        last = int(ticks.t_ns[-1])
        assert sound(mean[::5], cov[::5])
        assert np.isfinite(mean).all()
    assert np.sqrt(cov[:, 0, 0].max()) > 100.0, "the covariance must show the lost position"
    assert np.sqrt(cov[:, 0, 0].max()) <= 2000.0


@pytest.mark.parametrize("name", GARAGE)
def test_a_million_ticks_of_ten_seconds_cause_no_overflow(name):
    """A million ticks over the vehicles of the garage."""
    ticks = random_ticks(name, 100_000, 0)
    belief, last = ekf(name).init(), 0
    for _ in range(4):
        t_ns = last + 10_000 * MS * np.arange(1, 100_001)
        belief, (mean, cov) = kernel(name).run(ticks._replace(t_ns=t_ns), carry=belief)
        last = int(t_ns[-1])
        assert sound(mean[::7], cov[::7])


@pytest.mark.parametrize("backend", ["numpy", "python", "c"])
@pytest.mark.parametrize("name", GARAGE)
def test_es11_random_ticks_leave_every_back_end_finite_and_positive_definite(name, backend):
    belief = ekf(name).init()
    count, longest_s = {"numpy": (25, 0.5), "python": (150, 10.0), "c": (1000, 10.0)}[backend]
    for each_tick in make_ticks(random_ticks(name, count, 3, longest_s=longest_s)):
        belief, estimate = ekf(name, backend).step(belief, each_tick)
        assert sound(belief.mean, belief.cov)
        assert sound(estimate.nu, estimate.cov)


@pytest.mark.parametrize("name", GARAGE)
def test_all_back_ends_give_the_same_estimate_over_pauses(name):
    belief = ekf(name).init()
    for each_tick in make_ticks(random_ticks(name, 12, 5, 1e-3, 1.5)):
        belief, *beliefs = (
            ekf(name, backend).step(belief, each_tick)[0] for backend in ("c", "numpy", "python")
        )
        std = np.sqrt(np.diag(belief.cov))
        for second in beliefs:
            np.testing.assert_allclose(second.mean, belief.mean, rtol=1e-12, atol=1e-12)
            correlation = (second.cov - belief.cov) / np.outer(std, std)
            np.testing.assert_allclose(correlation, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", BOTH)
def test_a_scan_over_split_ticks_equals_single_steps(name):
    ticks = random_ticks(name, 300, 7)
    rows, indices = split_ticks(ticks, load(name).rate_hz)
    _, (mean, cov) = kernel(name).run(rows)
    assert np.array_equal(rows.t_ns[indices], ticks.t_ns)
    # 9: the paper's state
    belief, rtol = ekf(name).init(), 1e-12 if len(ekf(name).init().mean) == 9 else 1e-11
    for k, each_tick in zip(indices, make_ticks(ticks), strict=True):
        belief, _ = ekf(name).step(belief, each_tick)
        np.testing.assert_allclose(mean[k], belief.mean, rtol=rtol, atol=rtol)
        np.testing.assert_allclose(np.diag(cov[k]), np.diag(belief.cov), rtol=rtol)


def test_a_pause_is_split_into_periods_and_jitter_is_not_split():
    assert silent_times(0, 20 * MS, 100.0) == []
    assert silent_times(0, 24 * MS, 50.0) == []
    assert silent_times(-1, 900 * MS, 100.0) == [], "no pause precedes the first tick"
    assert silent_times(0, 100 * MS, 10.0) == [20 * MS, 40 * MS, 60 * MS, 80 * MS], (
        "a period too long for RK4"
    )
    assert silent_times(-1, 100 * MS, 10.0) == [20 * MS, 40 * MS, 60 * MS, 80 * MS]
    assert silent_times(5, 5 + 50 * MS, 100.0) == [5 + k * 10 * MS for k in (1, 2, 3, 4)]
    assert silent_times(0, 120 * MS + 1, 50.0) == [k * 20 * MS for k in range(1, 6)]
    assert max(np.diff([0, *silent_times(0, 990 * MS, 50.0), 990 * MS])) <= 25 * MS
    rows = silent_times(0, 5000 * MS, 100.0)
    assert (len(rows), rows[-1]) == (98, 980 * MS), "and the last row moves for 20 ms"


def test_a_pause_does_not_change_the_command_delay():
    """The delay of the car is 80 ms: after a pause a new command acts four periods later, as without a pause."""
    block = ekf("car, ekf").block

    def efforts(times):
        belief = block.init()
        for t_ms in times:
            belief, _ = block.step(belief, tick("car", t_ms, u=(0.5 if t_ms > 520 else 0.0, 0.0)))
            if t_ms > 520:
                yield belief.effort[0]

    after = range(540, 700, 20)
    steady = list(efforts([*range(20, 521, 20), *after]))
    assert steady[:4] == [0.0] * 4
    assert steady[4] > 0.4
    assert list(efforts([20, 40, 520, *after])) == steady
    uneven_times = [t + 4 * (k % 2) for k, t in enumerate(range(20, 700, 20))]
    assert list(efforts(uneven_times))[:5] == pytest.approx(steady[:5], abs=0.11), (
        "ticks that jitter keep their delay"
    )
