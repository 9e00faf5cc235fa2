"""The back end is chosen once and is available as an attribute; a broken compiler is not an error."""

import subprocess
import sys

import numpy as np
import pytest

from baqueano.symbolic import backends, compile_block, function, scan
from baqueano.symbolic.c_code.compile import find_compiler


def double(x):
    return 2.0 * x + np.pi


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """Use an empty cache, so that no kernel of another test is loaded or stored."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(backends, "_report_log", set())
    monkeypatch.delenv("BAQUEANO_BACKEND", raising=False)


def test_the_environment_variable_selects_the_default_back_end(monkeypatch):
    monkeypatch.setenv("BAQUEANO_BACKEND", "python")
    assert function(double, 1.0).backend == "python"
    assert function(double, 1.0, backend="numpy").backend == "numpy"
    monkeypatch.setenv("BAQUEANO_BACKEND", "numpy")
    assert scan(lambda c, x: (c, x), 0.0, 0.0).backend == "numpy"
    monkeypatch.setenv("BAQUEANO_BACKEND", "")
    assert function(double, 1.0).backend in ("c", "python")


def test_without_a_compiler_python_is_used_without_a_message(cache, monkeypatch, capfd):
    monkeypatch.delenv("BAQUEANO_CC", raising=False)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert function(double, 1.0)(1.0) == 2.0 + np.pi
    assert function(double, 1.0).backend == "python"
    assert capfd.readouterr().err == ""


def test_a_compiler_that_fails_is_reported_once_and_python_is_used(cache, monkeypatch, capfd):
    monkeypatch.setenv("BAQUEANO_CC", "false" if sys.platform != "win32" else "where")
    for _ in range(2):
        kernel = scan(lambda c, x: (c + x, c), 0.0, 0.0)
        assert kernel.run(np.ones(3))[0] == 3.0
        assert kernel.backend == "python"
    errors = capfd.readouterr().err
    assert errors.count("baqueano: Python is used instead of C") == 1


def test_a_compiler_failure_of_a_requested_c_back_end_is_an_error(cache, monkeypatch):
    monkeypatch.setenv("BAQUEANO_CC", "false")
    with pytest.raises(RuntimeError):
        function(double, 1.0, backend="c")


@pytest.mark.skipif(not find_compiler().compiler, reason="no C compiler")
def test_python_runs_a_kernel_that_the_compiler_refuses(cache, monkeypatch, capfd):
    monkeypatch.setattr("baqueano.symbolic.c_code.c.header", lambda *args: "this is not C")
    block = compile_block(type("Block", (), {"step": staticmethod(lambda c, x: (c, double(x)))})())
    assert block.step(0.0, 1.0) == (0.0, 2.0 + np.pi)
    assert block.backend == "python"
    assert "cannot compile the code" in capfd.readouterr().err


def test_importing_the_symbolic_package_loads_no_heavy_library():
    code = (
        "import sys, numpy; before = set(sys.modules); import baqueano.symbolic; "
        "print(sorted({'scipy', 'casadi', 'ctypes', 'subprocess', 'jax'} & (set(sys.modules) - before)))"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"
