"""Fixtures: the vehicles of the tests of a fit."""

from tests.identify.conftest import case, case_run, small  # noqa: F401
