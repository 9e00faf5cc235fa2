"""The clocks of the loop: simulated and real-time."""

import time

import numpy as np
import pytest

from baqueano.worlds import clock


def test_a_simulated_clock_ends_each_tick_on_a_whole_nanosecond():
    assert list(clock.simulated_ticks(100.0, 0.03)) == [10_000_000, 20_000_000, 30_000_000]
    thirds = list(clock.simulated_ticks(3.0, 1.0))
    assert thirds == [333_333_333, 666_666_667, 1_000_000_000]


def test_a_clock_without_a_duration_is_endless():
    for duration_s in (None, float("inf")):
        ticking = clock.simulated_ticks(100.0, duration_s)
        assert [next(ticking) for _ in range(500)][-1] == 5_000_000_000
    assert next(iter(clock.Wall(100.0, float("inf"), lambda: 0, lambda _: None))) == 10_000_000


class FakeTime:
    """A clock that sleeping and working advance."""

    def __init__(self):
        self.ns = 1_000

    def now(self):
        return self.ns

    def sleep(self, s):
        self.ns += round(s * 1e9)


@pytest.mark.parametrize(
    ("work_ms", "ticks_ms", "misses"),
    [
        ([1, 9, 10, 1], [10, 20, 30, 40], 0),
        # 25 ms of work at 20 ms: 30 and 40 are skipped, not made up for
        ([1, 25, 1, 1], [10, 20, 50, 60], 2),
        ([1, 10.5, 1, 1], [10, 20, 40, 50], 1),
        ([300, 1, 1, 1], [10, 310, 320, 330], 29),
    ],
)
def test_rt1_an_overloaded_loop_skips_and_counts_ticks(work_ms, ticks_ms, misses):
    fake, tick_times = FakeTime(), []
    wall = clock.Wall(100.0, None, now_ns=fake.now, sleep=fake.sleep)
    for t_ns, work in zip(wall, work_ms, strict=False):
        tick_times.append((t_ns - 1_000) / 1e6)
        fake.ns += round(work * 1e6)
        if len(tick_times) == len(work_ms):
            break
    assert tick_times == ticks_ms
    assert wall.missed_ticks == misses


def test_the_real_time_clock_ticks_at_its_rate():
    wall, start_ns = clock.wall(200.0, 0.05), time.monotonic_ns()
    times = list(wall)
    took = time.monotonic_ns() - start_ns  # longer on a busy machine, because ticks are skipped
    assert 10 <= len(times) + wall.missed_ticks <= took / 5e6 + 1
    assert all(step % 5_000_000 == 0 and step > 0 for step in np.diff(times))


def test_rt11_the_real_time_clock_is_monotonic():
    before, now, after = time.monotonic_ns(), clock.wall(100.0).now_ns(), time.monotonic_ns()
    assert before <= now <= after
    assert not time.get_clock_info("monotonic").adjustable
