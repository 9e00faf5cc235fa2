"""Fixtures: the small vehicle of the tests of a fit."""

from tests.identify.conftest import small  # noqa: F401
