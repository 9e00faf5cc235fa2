"""Several threads request kernels of one trace at once: each kernel is made once, and the nodes have stable numbers."""

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np

from baqueano.symbolic import scan

THREADS = 4


class Slow(dict):
    """A dict that lets other threads run whenever an entry is stored."""

    def __setitem__(self, key, value):
        time.sleep(0.0)
        super().__setitem__(key, value)


def step(theta, x, u):
    y = x
    for k in range(8):
        y = y + 0.1 * np.tanh(theta[k % 3] * y - u[k % 2]) / (1.0 + y * y)
    return y, y * np.sin(theta[0])


def kernel_of(backend="c"):
    return scan(step, np.zeros(2), np.zeros(2), np.zeros(3), backend=backend)


def test_simultaneous_threads_and_a_single_thread_give_the_same_result():
    u, theta = np.random.default_rng(0).normal(size=(50, 2)), np.array([0.5, -0.3, 1.2])
    reference = kernel_of().sensitivities(u, theta)
    kernel, barrier = kernel_of(), Barrier(THREADS)
    graph = kernel.trace.graph
    graph.nodes = Slow(graph.nodes)

    def sensitivities(_):
        barrier.wait()
        return kernel.sensitivities(u, theta)

    with ThreadPoolExecutor(THREADS) as pool:
        results = list(pool.map(sensitivities, range(THREADS)))
    numbers = [node.index for node in graph.nodes.values()]
    assert len(set(numbers)) == len(numbers)
    assert len(kernel.runners) == 1
    for outputs, slopes in results:
        np.testing.assert_array_equal(outputs, reference[0])
        np.testing.assert_array_equal(slopes, reference[1])
