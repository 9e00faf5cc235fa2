"""Fixtures and marks of all tests.

Recordings of real vehicles are not part of the package: a test that needs them is skipped by name.

Tests that drive, fit, draw, install or emulate, and those of much computation, have the mark `slow`; `make test-fast`
skips them. Studies of many fits, tutorials and benchmarks have the mark `long`: only `make test-all` runs them.

Tests press Ctrl-C, also in programs that they start. A shell lets its background jobs ignore it; here it is enabled.
Hypothesis checks no time limits, because a busy machine is slow. A stalled machine delays sockets, firmware and
browsers. So a failed test of REAL_TIME is repeated up to twice while the other processes wait (tests/turns.py). The
summary lists each (RERUN): a test that is often listed has a fault. A limit in milliseconds has the mark `alone`:
the others wait from the first attempt on.

With BAQUEANO_NO_SKIPS=1, as in the public workflow, a skipped test fails; MAY_LACK lists the exceptions. Otherwise a
test that is left out silently would test nothing.
"""

import builtins
import gc
import os
import re
import shlex
import shutil
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing
from functools import cache
from pathlib import Path
from typing import TypeVar

import pytest
from hypothesis import HealthCheck, settings

from tests.turns import lock_files, turn

HERE = Path(__file__).parent
SLOW = {  # folders and files
    "calibration", "cli", "design", "door", "drive", "emulated", "fuzz", "identify", "monitor", "report",
    "robot", "selection", "study", "sweep", "tune", "validation", "web", "blocks/test_blocks_of_the_package.py",
    "compare/test_comparison_of_runs.py", "compare/test_consistency.py", "compare/test_corridor.py",
    "compare/test_evenness.py", "compare/test_laps.py", "controllers/test_model_errors.py",
    "controllers/test_model_following.py", "controllers/test_mpc.py", "estimators/test_augmented_ekf.py",
    "estimators/test_complementary.py", "estimators/test_dead_reckoning.py", "estimators/test_ekf_ages.py",
    "estimators/test_ekf_laws.py", "estimators/test_ekf_pauses.py", "estimators/test_every_sensor.py",
    "estimators/test_inconsistency.py", "estimators/test_noise_levels.py", "estimators/test_place_gate.py",
    "estimators/test_repetition.py", "estimators/test_sideslip.py", "estimators/test_smoother.py",
    "estimators/test_unscented.py", "guides/test_repeat_by_progress.py", "routes/test_profile.py",
    "runs/test_damage_is_bounded.py", "runs/test_durability.py", "runs/test_hostile_recordings.py",
    "runs/test_import.py", "runs/test_import_findings.py", "runs/test_import_recordings.py",
    "runs/test_importing_page.py", "sensors/test_noise.py", "simulate/test_closed_loop.py",
    "symbolic/test_c_compile.py", "symbolic/test_c_emit.py", "symbolic/test_c_kernels.py",
    "symbolic/test_jacobian.py", "symbolic/test_scan.py", "test_any_laptop.py", "test_benchmarks.py",
    "test_docs.py", "test_examples.py", "test_first_evening.py", "test_house.py", "test_layers.py",
    "test_notebooks.py", "test_site.py", "test_wheel.py", "vehicle_file/test_garage.py",
    "vehicles/test_continuous_time.py", "worlds/test_long_ticks.py", "worlds/test_shaken.py",
}  # fmt: skip

LONG_RUNS = {  # whose kernels run long enough to be worth an optimisation
    "calibration", "design", "identify", "selection", "study", "sweep", "tune", "validation",
    "estimators/test_ekf_pauses.py", "monitor/test_sound_sensors.py", "test_docs.py",
}  # fmt: skip

SHORT_RUNS = {  # but those of these files are compiled for more than two thirds of their time
    "identify/test_clocks.py", "identify/test_hidden_parts.py", "identify/test_marks_at_places.py",
    "identify/test_parameters_on_demand.py", "identify/test_result.py", "identify/test_spread.py",
}  # fmt: skip

LONGEST = {  # begun first, otherwise one would end alone
    "fuzz/test_fuzz.py", "web/test_in_browser.py", "web/test_questions.py",
}  # fmt: skip

POSIX = (
    "door",
    "emulated",
    "robot/service",
    "robot/imu",
    "cli/test_robot_from_afar.py",
    "cli/test_hostile_robot.py",
)

REAL_TIME = {  # sockets, processes, firmware and browsers whose time is that of the wall
    "door", "emulated", "web", "robot", "cli", "drive", "worlds/test_clock.py", "test_any_laptop.py",
    "test_notebooks.py", "test_wheel.py",
}  # fmt: skip

NO_SKIPS = bool(os.environ.get("BAQUEANO_NO_SKIPS")) and sys.platform == "linux"  # a skipped test fails
MAY_LACK = re.compile(  # reasons of skips in CI
    r"\brecordings\b|(is long|left out)\. Type|real-time priority|aarch64"
)

Report = TypeVar("Report", pytest.TestReport, pytest.CollectReport)
ALONE = pytest.StashKey[Callable[[], None]]()  # of a test: from its call on, the other processes wait

COMPILERS = () if os.name == "nt" or os.environ.get("BAQUEANO_CC") else ("cc", "gcc", "clang")
QUICK = "-fno-schedule-insns --param=ira-max-conflict-table-size=0 -DCALLED -Wno-psabi"
COMPILER = next(filter(None, map(shutil.which, COMPILERS)), "")

os.environ["BAQUEANO_LANG"] = "en"  # with any locale of this machine
# of the processes of a run: threads of one would wait for those of another
os.environ["OPENBLAS_NUM_THREADS"] = "1"
# tests start many programs: each would compile the package again
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

# graphs of kernels are many objects that live long: looking through them is slow
gc.set_threshold(200_000, 20, 100)

if threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@cache
def places_of(path: Path) -> frozenset[str]:
    """Return the file of a test and the folders that contain it, relative to tests/."""
    if not path.is_relative_to(HERE):
        return frozenset()
    file = path.relative_to(HERE)
    return frozenset(part.as_posix() for part in (file, *file.parents))


def is_in(path: Path, places: set[str]) -> bool:
    """Return True for a test in one of these files and folders."""
    return not places.isdisjoint(places_of(path))


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no slow test if only fast tests are wanted; the import takes longer than many tests."""
    return True if config.option.markexpr == "not slow" and is_in(collection_path, SLOW) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the slow tests and run them first: on several cores the short files then fill the gaps at the end.

    Files of exclusive tests are the first of all: later each of these tests would wait for the other processes.
    """
    for item in items if os.name == "nt" else ():
        if any(item.path.is_relative_to(HERE / room) for room in POSIX):
            item.add_marker(
                pytest.mark.skip(reason=f"{item.path.name}: sockets of files and ttys are of POSIX")
            )
    for item in items:
        if is_in(item.path, SLOW):
            item.add_marker("slow")
        if is_in(item.path, REAL_TIME):
            item.add_marker(pytest.mark.flaky(reruns=2))
        if item.get_closest_marker("long") and not os.environ.get("BAQUEANO_LONG"):
            item.add_marker(pytest.mark.skip(reason=f"{item.name} is long. Type: make test-all"))
    exclusive_files = {item.path for item in items if item.get_closest_marker("alone")}
    items.sort(
        key=lambda item: (
            item.path not in exclusive_files,
            item.get_closest_marker("slow") is None,
            not is_in(item.path, LONGEST),
        )
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Run a test beside those of the other processes, or alone."""
    with turn(item.get_closest_marker("alone") is not None) as is_exclusive:
        item.stash[ALONE] = is_exclusive
        try:
            return (yield)
        finally:
            if getattr(item, "execution_count", 1) > 1:  # of pytest-rerunfailures
                forget_failed_attempt()


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove the locks of a run whose processes have all ended."""
    manager = getattr(config.pluginmanager.getplugin("dsession"), "nodemanager", None)
    if manager is not None:
        for path in lock_files(manager.testrunuid):
            path.unlink(missing_ok=True)


def forget_failed_attempt() -> None:
    """Release what a failed attempt left open; otherwise its sockets would fail a later test."""
    for name in ("last_exc", "last_type", "last_value", "last_traceback"):
        sys.__dict__.pop(name, None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    return not_skipped((yield))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    return not_skipped((yield))


def not_skipped(report: Report) -> Report:
    """Let a skipped test fail in CI, except for a reason of MAY_LACK."""
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else ""
    if NO_SKIPS and report.skipped and not hasattr(report, "wasxfail") and not MAY_LACK.search(reason):
        report.outcome, report.longrepr = "failed", f"skipped, but BAQUEANO_NO_SKIPS is set: {reason}"
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Compile the many short kernels quickly, also in the programs that a test starts.

    Tests of the engine, and limits in milliseconds, use the compiler flags of the package.
    """
    level = "-Og" if is_in(item.path, LONG_RUNS) and not is_in(item.path, SHORT_RUNS) else "-O0"
    if COMPILER:
        is_quick = not (is_in(item.path, {"symbolic"}) or item.get_closest_marker("alone"))
        os.environ["BAQUEANO_CC"] = quick_compiler(level) if is_quick else ""
    if getattr(item, "execution_count", 1) > 1:  # of pytest-rerunfailures
        item.stash[ALONE]()


def quick_compiler(level: str) -> str:
    """Return the command of the compiler with this level and QUICK, which replace options of the package."""
    script = f'exec "$0" "$@" {level} {QUICK}'
    return shlex.join(("sh", "-c", script, COMPILER))


@pytest.fixture
def until_end():
    """Return a function that returns its argument, and closes it at the end of the test."""
    with ExitStack() as stack:
        yield lambda opened: stack.enter_context(closing(opened))


@pytest.fixture
def without_scipy(monkeypatch):
    """Let every import of scipy fail."""
    real = builtins.__import__

    def fail_import(name, *args, **kwargs):
        if name.startswith("scipy"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", fail_import)


@pytest.fixture(scope="session")
def cpm_recordings():
    """Skip the test if the recordings of the CPM µCar are missing."""
    from baqueano.errors import FileError
    from baqueano.study.recordings import check_cpm_present

    try:
        check_cpm_present()
    except FileError as error:
        pytest.skip(f"recordings of the CPM µCar: {error}")
