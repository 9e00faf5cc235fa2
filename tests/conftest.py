"""Recordings of real vehicles do not come with the package: a test that needs them is skipped, by name."""

import pytest


@pytest.fixture(scope="session")
def cpm_recordings():
    """Skips where the recordings of the CPM µCar are not there."""
    from baqueano.errors import FileError
    from baqueano.study.recordings import check_present

    try:
        check_present()
    except FileError as error:
        pytest.skip(f"recordings of the CPM µCar: {error}")
