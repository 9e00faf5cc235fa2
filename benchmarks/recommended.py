"""Measure the recommended filter: ten minutes of log in one run, a single tick, compilation, and a tick of a drive.

The tick of a drive includes all blocks, health and log, with a simulated vehicle. Its time is estimated for a Pi 3 as
in onboard.py. The peers estimate 13 of its 16 states, without course, sideslip and bend, by the same g and h
(augmented_peer.py) and Kalman's gain. Our filter also has rest, gate and the choice of correcting sensors. The tests in
tests/estimators check that both filters are equal in their common part. The yaw rates must agree within AGREE.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from statistics import median

import numpy as np

from baqueano.drive import repeat
from baqueano.drive.observers import Observer
from baqueano.estimators import AugmentedEkf
from baqueano.guides.shapes import sinuous_circle
from baqueano.loop import Record
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.symbolic import compile_block, scan, with_value
from baqueano.vehicle_file import load
from benchmarks import augmented_peer, matched
from benchmarks.harness import Bench, Case, LeftOut, Row, measured
from benchmarks.limit import IMU, VEHICLE
from benchmarks.onboard import PI3_HELLO_S, hello_s

AGREE = 0.02  # rad/s, rms
ROUTE = sinuous_circle(1.0, 0.2, 6, 0.1)
MOST_TICK_MS = 1.5
MOST_S = {"compiled on an empty cache": 5.0, "a gradient through it": 10.0}
SLOTS = sensor_slots(("imu",))
EXAMPLE = Tick(1, np.zeros(3), SLOTS(Slot(0.0, np.zeros(3))))


def benches(smallest: bool) -> list[Bench | LeftOut]:
    """Return the benches of a log, a tick, the compilation and a drive."""
    block, n = _filter(), 200 if smallest else 60_000
    log = _log(block, n)
    benches = _of_a_tick(block, *log), _of_compiling(smallest), _of_a_drive(1.0 if smallest else 20.0)
    return [*_of_a_log(block, *log, smallest), *benches]


def _filter() -> AugmentedEkf:
    return AugmentedEkf(VEHICLE, SLOTS(IMU), course_std=0.0, sideslip_error_std=0.0)


def _log(block: AugmentedEkf, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return commands (n, 3) and readings (n, 3) of the matched model."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform([0.3, 0.0, -0.5], [0.9, 0.0, 0.5], (-(-n // 50), 3)), 50, axis=0)[:n]
    noise = np.array(
        [*IMU.accel_noise_std, IMU.gyro_noise_std, 0.0]
    )  # last: the odometer, which no peer uses
    start = np.sqrt(np.diag(block.init().cov))[matched.OF_FILTER]
    assumed_noise = matched.AssumedNoise(
        start, block.velocity_walk_std, block.disturbance_std, block.disturbance_fade_s,
        np.zeros(3), noise,
    )  # fmt: skip
    return u, matched.drive_matched(assumed_noise, u, 1, 3).z[:, 0, :3]


def _peer(block: AugmentedEkf) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the decay factor of a disturbance per tick (2,), and P₀, R and Q for the peers."""
    keep = np.exp(-matched.DT / block.disturbance_fade_s)
    fresh = block.disturbance_std**2 * (1.0 - keep**2)
    R = np.diag([*np.full(3, 1e-12), *block.velocity_walk_std**2 * matched.DT, *fresh, *np.full(5, 1e-12)])
    return keep, block.init().cov[np.ix_(matched.OF_FILTER, matched.OF_FILTER)], R, IMU.cov


def _of_a_log(block: AugmentedEkf, u: np.ndarray, z: np.ndarray, smallest: bool) -> list[Bench | LeftOut]:
    n, peer = len(u), _peer(block)
    t_ns = 10_000_000 * np.arange(1, n + 1)
    ticks = Tick(t_ns, u, SLOTS(Slot(np.ones(n), z, np.zeros(n))))

    def step(belief, tick):
        belief, estimate = block.row(belief, tick)
        return belief, (estimate.eta, estimate.nu, estimate.cov)

    kernel = scan(step, block.init(), EXAMPLE)
    count = min(n, 6000)  # filterpy takes the same time for each tick

    def by_filterpy():
        peer_filter = augmented_peer.Filterpy(*peer)
        return np.array([peer_filter.step(*row) for row in zip(u[:count], z[:count], strict=True)])

    outputs = kernel.run(ticks)[1]
    reference = by_filterpy()
    error = outputs[1][:count, 2] - reference[:, 5]
    assert np.sqrt(np.mean(error**2)) < AGREE, np.sqrt(np.mean(error**2))
    peer_name = f"filterpy, 13 states, {count / 100:g} s of it"
    cases = [
        Case("scan, recommended filter", lambda: kernel.run(ticks)),
        Case(peer_name, by_filterpy, 1 if smallest else 3),
    ]
    try:
        by_dynamax = augmented_peer.dynamax(u, z, *peer)
    except ImportError:
        cases.append(None)
    else:
        np.testing.assert_allclose(by_dynamax()[:count, 3:6], reference[:, 3:6], atol=1e-3)
        cases.append(Case("dynamax, 13 states, jit", by_dynamax, 1 if smallest else 3))
    left_out = [LeftOut("dynamax on ten minutes of log", "pip install dynamax")] if cases[-1] is None else []
    bench = measured(
        f"recommended filter over {n / 100:g} s at 100 Hz",
        [case for case in cases if case],
        {peer_name: 300.0 * count / n, "dynamax, 13 states, jit": 25.0},
        {peer_name: f"{n / count:g} times as long for all of it"} if count < n else {},
        clock=time.process_time,
    )
    return [bench, *left_out]


def _of_a_tick(block: AugmentedEkf, u: np.ndarray, z: np.ndarray) -> Bench:
    """Return the bench of single ticks, each by a call of the block's `step`."""

    def online(estimator):
        state = [estimator.init(), 0]

        def once():
            k = state[1] % len(u)
            tick = Tick(10_000_000 * (state[1] + 1), u[k], SLOTS(Slot(1.0, z[k])))
            state[0], _ = estimator.step(state[0], tick)
            state[1] += 1

        return once

    peer_filter, index = augmented_peer.Filterpy(*_peer(block)), [0]

    def by_filterpy():
        k = index[0] % len(u)
        peer_filter.step(u[k], z[k])
        index[0] += 1

    quick, slow = online(compile_block(block)), online(compile_block(block, "python"))
    cases = [
        Case("compiled", quick),
        Case("Python code (no compiler)", slow),
        Case("filterpy, 13 states", by_filterpy),
    ]
    bench = measured(
        "a tick on line, through step", cases, {"filterpy, 13 states": 20.0}, clock=time.process_time
    )
    own_row, reference = (row for row in bench.rows[1:])
    gain = reference.seconds / own_row.seconds
    row_of_target = own_row._replace(
        note=f"{gain:.1f} × as quick as filterpy (target 3)", is_missed=gain < 3.0
    )
    return bench._replace(rows=(bench.rows[0], row_of_target, reference))


def _of_compiling(smallest: bool) -> Bench:
    """Return the bench of compilation in separate processes with an empty cache.

    The gradient is with respect to the noise parameters of the filter.
    """
    rows = []
    for name, limit in MOST_S.items():
        compile_times = []
        for _ in range(1 if smallest else 3):
            with tempfile.TemporaryDirectory() as folder:
                environment = {**os.environ, "XDG_CACHE_HOME": folder}
                result = subprocess.run(
                    [sys.executable, "-m", __name__, name], capture_output=True, check=True, env=environment
                )
            compile_times.append(float(result.stdout))
        seconds = min(compile_times)
        rows.append(Row(name, seconds, 1.0, note=f"at most {limit:g} s", is_missed=seconds > limit))
    return Bench("compiling the recommended filter", tuple(rows))


@dataclass
class Stopwatch(Observer):
    """The processor time of this thread [s] at each tick."""

    marks: list[float]

    def on_record(self, record: Record) -> None:
        self.marks.append(time.thread_time())


def _of_a_drive(seconds: float) -> Bench:
    """Return the bench of a drive: the median tick of the second of two drives."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("first.mcap", "second.mcap"):
            marks: list[float] = []
            repeat(
                load("small"), ROUTE, path=f"{folder}/{name}", duration_s=seconds,
                observers=[Stopwatch(marks)],
            )  # fmt: skip
    tick_s, ratio = median(np.diff(marks).tolist()), PI3_HELLO_S / hello_s(20)
    note = (
        f"{1e3 * tick_s * ratio:.2f} ms of 10 on a Pi 3, estimated at ×{ratio:.1f} (at most {MOST_TICK_MS:g})"
    )
    row = Row(
        "a tick of repeat, into a file", tick_s, 1.0, note=note, is_missed=1e3 * tick_s * ratio > MOST_TICK_MS
    )
    return Bench("a whole tick without wires", (row,))


def _compile(name: str) -> float:
    """Return the time [s] until the first result of the case `name`."""
    block, start_s = _filter(), time.perf_counter()
    if name == "compiled on an empty cache":
        compiled_block = compile_block(block)
        compiled_block.step(compiled_block.init(), EXAMPLE)
        return time.perf_counter() - start_s

    def step(theta, belief, tick):
        trial = with_value(block, "disturbance_std", np.exp(theta[:2]))
        trial = with_value(trial, "velocity_walk_std", np.exp(theta[2:]))
        belief, estimate = trial.row(belief, tick)
        return belief, np.sum(estimate.nu**2)

    n, kernel = 10, scan(step, block.init(), EXAMPLE, np.zeros(5))
    ticks = Tick(
        10_000_000 * np.arange(1, n + 1),
        np.zeros((n, 3)),
        SLOTS(Slot(np.ones(n), np.zeros((n, 3)), np.zeros(n))),
    )
    kernel.cost_and_gradient(ticks, np.zeros(5))
    return time.perf_counter() - start_s


if __name__ == "__main__":
    print(_compile(sys.argv[1]))
