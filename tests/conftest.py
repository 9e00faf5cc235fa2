"""Recordings of real vehicles do not come with the package: a test that needs them is skipped, by name.

What drives, fits, draws, installs or emulates has the mark `slow`; `make test-fast` leaves it out.

What studies many fits, a whole tutorial or every benchmark has the mark `long`: only `make test-all` runs it.

Tests press Ctrl-C, also in programs that they start. A shell lets its jobs in the background ignore it; here it counts.
Hypothesis judges no example by the clock on the wall: a busy machine is slow. A machine that stalls lets sockets,
firmware and browsers miss their time. So a test of REAL_TIME that fails runs up to twice again, whatever the cause, and
then the other processes of the run wait (tests/turns.py). The summary lists each (RERUN): one that is listed often has
a fault. A bar of milliseconds has the mark `alone`: the others wait from the first attempt on.
"""

import builtins
import gc
import os
import signal
import threading
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from baqueano.symbolic.c_code import compile
from tests.turns import turn

HERE = Path(__file__).parent
SLOW = {  # folders and files
    "cli", "door", "drive", "emulated", "identify", "monitor", "report", "robot", "study", "sweep", "tune", "web",
    "compare/test_corridor.py", "controllers/test_model_following.py", "estimators/test_ekf_pauses.py",
    "estimators/test_every_sensor.py", "estimators/test_smoother.py", "test_any_laptop.py", "test_benchmarks.py",
    "test_docs.py", "test_examples.py", "test_house.py", "test_notebooks.py",
    "test_first_evening.py", "test_site.py", "test_wheel.py",
}  # fmt: skip

POSIX = (
    "door",
    "emulated",
    "robot/service",
    "robot/imu",
    "cli/test_robot_from_afar.py",
    "cli/test_robot_that_lies.py",
)

REAL_TIME = {  # sockets, processes, firmware and browsers whose time is that of the wall
    "door", "emulated", "web", "robot", "cli", "drive", "test_clock.py", "test_any_laptop.py", "test_notebooks.py",
    "test_wheel.py",
}  # fmt: skip

ALONE = pytest.StashKey[Callable[[], None]]()  # of a test: from its call on, the other processes wait

SHIPPED = compile.HASTY_ABOVE, compile.SCHEDULED_BELOW, compile.HASTY

os.environ["BAQUEANO_LANG"] = "en"  # whatever the locale of this machine

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

gc.set_threshold(
    200_000, 20, 100
)  # graphs of kernels are many objects that live long: looking through them is slow

if threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


def is_in(path: Path, places: set[str]) -> bool:
    """Return True for a test in one of these files and folders."""
    return path.is_relative_to(HERE) and not places.isdisjoint(
        {path.relative_to(HERE).as_posix(), *(part.as_posix() for part in path.relative_to(HERE).parents)}
    )


def is_slow(path: Path) -> bool:
    return is_in(path, SLOW)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no slow test where none is wanted; that alone takes longer than many tests."""
    return True if config.option.markexpr == "not slow" and is_slow(collection_path) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is slow, and begin with it: on several cores the short files then fill the gaps at the end."""
    for item in items if os.name == "nt" else ():
        if any(item.path.is_relative_to(HERE / room) for room in POSIX):
            item.add_marker(
                pytest.mark.skip(reason=f"{item.path.name}: sockets of files and ttys are of POSIX")
            )
    items.sort(key=lambda item: not is_slow(item.path))
    for item in items:
        if is_slow(item.path):
            item.add_marker("slow")
        if is_in(item.path, REAL_TIME):
            item.add_marker(pytest.mark.flaky(reruns=2))
        if item.get_closest_marker("long") and not os.environ.get("BAQUEANO_LONG"):
            item.add_marker(pytest.mark.skip(reason=f"{item.name} is long. Type: make test-all"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Run a test beside those of the other processes, or alone."""
    with turn(item.get_closest_marker("alone") is not None) as alone:
        item.stash[ALONE] = alone
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Compile quickly where many kernels run for a moment each; the others test what the package ships."""
    quick = 0, 0, "-O0"
    compile.HASTY_ABOVE, compile.SCHEDULED_BELOW, compile.HASTY = quick if is_slow(item.path) else SHIPPED
    if getattr(item, "execution_count", 1) > 1:  # of pytest-rerunfailures
        item.stash[ALONE]()


@pytest.fixture
def without_scipy(monkeypatch):
    """Lets every import of scipy fail."""
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith("scipy"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)


@pytest.fixture(scope="session")
def cpm_recordings():
    """Skips where the recordings of the CPM µCar are not there."""
    from baqueano.errors import FileError
    from baqueano.study.recordings import check_present

    try:
        check_present()
    except FileError as error:
        pytest.skip(f"recordings of the CPM µCar: {error}")
