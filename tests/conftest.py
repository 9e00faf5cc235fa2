"""Recordings of real vehicles do not come with the package: a test that needs them is skipped, by name.

Tests press Ctrl-C, also in programs that they start. A shell lets its jobs in the background ignore it; here it counts.
Hypothesis judges no example by the clock on the wall: a busy machine is slow.
"""

import signal
import threading

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

if threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def cpm_recordings():
    """Skips where the recordings of the CPM µCar are not there."""
    from baqueano.errors import FileError
    from baqueano.study.recordings import check_present

    try:
        check_present()
    except FileError as error:
        pytest.skip(f"recordings of the CPM µCar: {error}")
