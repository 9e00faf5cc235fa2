"""Sums over long runs use one core, so their last bits do not depend on the threads of NumPy's library."""

import os
import subprocess
import sys

SUMS = """
import numpy as np
from baqueano.numerics.autocorrelation import _first_lag_products
from baqueano.numerics.score_test import _product, _part_sums
from baqueano.identify.result.fit_result import ChannelFit
from baqueano.identify.result.verdict import group_channels
from baqueano.runs.diagnostics.signal_map import channel_regression

n, rng = 60_000, np.random.default_rng(0)
z, h = rng.normal(size=(2, n))
x = rng.normal(size=(n, 3, 5))
channel = ChannelFit("long", "odometer", 0, z, z, h, 0.05, 1.0, 0.0)
parts = np.arange(n)[None] < [[n // 2], [n]]
for sums in (
    *group_channels([channel], None)["odometer[0]"][0][1:3],
    channel_regression(z, h),
    _first_lag_products(z[:, None], np.ones((n, 1))).tolist(),
    _product(x.reshape(n, 15).T, z).tolist(),
    _part_sums(x, x, parts.sum(0), parts).tolist(),
):
    print(repr(sums))
"""


def sums_with(threads):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": str(threads)}
    result = subprocess.run([sys.executable, "-c", SUMS], capture_output=True, check=True, env=environment)
    return result.stdout.decode().splitlines()


def test_sums_over_a_long_run_are_equal_with_one_and_two_threads():
    assert sums_with(1) == sums_with(2)
