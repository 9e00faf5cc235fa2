"""The examples in docstrings run and give the documented output. An emulated device replaces the hardware that they
use."""

import ast
import doctest
import importlib
import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy
import pytest

import baqueano
from tests.emulated import rig

SOURCE = Path(baqueano.__file__).parent
TEXTS = {
    ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts).removesuffix(".__init__"): text
    for path in sorted(SOURCE.rglob("*.py"))
    if ">>> " in (text := path.read_text(encoding="utf-8"))
}
HAVE_ONE = """
    compare.front: compare
    drive.first_drive: first_drive
    drive.mission: Mission pack perform
    drive.tasks: experiment repeat teach
    drive.replay: replay
    design.plan: design_plan
    design.containment: contain_in_room
    routes.room: vehicle_room
    identify.fit: identify
    calibration.at_rest: allan_deviation measure_at_rest
    identify.noise.covariances: measure_noise
    validation.noise_comparison: compare_noise
    simulate.excitation: excitation
    robot.emulated: emulate_vehicle
    robot.imu.driver: open_imu
    robot.uno.link: Uno
    door.remote: connect
    robot.uno.serial_port: open_uno
    project.folder: new
    report.pages.result_page: report
    vehicle_file.block_check: check
    runs.importing.recordings: import_run
    runs.container.reader: read_run
    runs.container.writer: RunWriter write_run
    simulate.closed_loop: simulate_loop
    simulate.many: simulate_many
    simulate.open_loop: simulate
    tune.gains: tune
    guides.shapes: sinuous_circle
    vehicle_file.text.override: override
    vehicle_file.file: load
    worlds.robot: Robot
"""
NAMES = [
    (f"baqueano.{module.strip()}", name)
    for module, _, names in (line.partition(":") for line in HAVE_ONE.strip().splitlines())
    for name in names.split()
]
MOST = 4  # statements of an example, beside its imports


@pytest.mark.parametrize("module", TEXTS)
def test_the_examples_of_a_module_run_with_the_documented_output(module, request, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    texts = []
    with HARDWARE.get(module, none)(request, monkeypatch):
        for example in examples_of(module):
            doctest.DocTestRunner().run(example, out=texts.append)
    assert not texts, "".join(texts)


@pytest.mark.parametrize(("module", "name"), NAMES)
def test_each_public_function_has_a_short_example(module, name):
    (example,) = [candidate for candidate in examples_of(module) if candidate.name == f"{module}.{name}"]
    lines = [line.source for line in example.examples if not line.source.startswith(("import ", "from "))]
    assert 0 < len(lines) <= MOST, "".join(lines)


def test_every_docstring_example_is_executed():
    skipped_modules = [module for module, text in TEXTS.items() if "doctest:" in text]
    assert not skipped_modules, "an example that does not run may be wrong"
    for module, text in TEXTS.items():
        assert sum(len(candidate.examples) for candidate in examples_of(module)) == text.count(">>> "), module


def examples_of(module: str) -> list[doctest.DocTest]:
    """Return the docstrings with examples of a module; they run with the names of this module, np and bq."""
    names = {"np": numpy, "bq": baqueano, **vars(importlib.import_module(module))}
    parse = doctest.DocTestParser().get_doctest
    return [parse(text, names, name, module, line) for name, text, line in docstrings_with_examples(module)]


@cache
def docstrings_with_examples(module: str) -> list[tuple[str, str, int]]:
    """Return name, docstring and line of the definitions of a module that have an example."""
    return [entry for entry in docstrings(ast.parse(TEXTS[module]), module) if ">>> " in entry[1]]


def docstrings(node: ast.AST, name: str) -> Iterator[tuple[str, str, int]]:
    """Return (qualified name, docstring, line) of the definitions below a node."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            if text := ast.get_docstring(child):
                yield f"{name}.{child.name}", text, child.lineno
            yield from docstrings(child, f"{name}.{child.name}")


@contextmanager
def none(request, monkeypatch):
    """Use no hardware."""
    yield


@contextmanager
def an_imu_on_the_bus(request, monkeypatch):
    """Let an emulated MPU-6050 answer at /dev/i2c-1."""
    pytest.importorskip("smbus2", reason="I2C needs Linux and smbus2")
    from baqueano.robot.imu import driver as imu, mpu6050
    from tests.emulated.i2c_ioctl import connect
    from tests.emulated.mpu import EmulatedBus, MpuEmulator

    bus = Path("i2c-1")
    bus.touch()
    chip = MpuEmulator(now_ns=time.monotonic_ns, start_ns=time.monotonic_ns())
    connect(monkeypatch, {str(bus): EmulatedBus({0x68: chip}, lambda ns: None)})
    buses = {"/dev/i2c-1": str(bus)}
    monkeypatch.setattr(imu, "find_chip", lambda path, addresses: mpu6050.find_chip(buses[path], addresses))
    yield


def with_emulator(request) -> rig.Built:
    """Return firmware and emulator; a test that lacks them is skipped by name, or fails if CI is set."""
    if (lacking := rig.missing()) and not os.environ.get("CI"):
        pytest.skip(f"{request.node.name}: sudo apt-get install {' '.join(lacking)}")
    return rig.build(Path(request.config.cache.mkdir("emulated")))


@contextmanager
def an_uno_on_the_line(request, monkeypatch):
    """Let the emulated firmware answer at the only serial line."""
    build = with_emulator(request)
    from baqueano.robot.uno import serial_port
    from tests.emulated.realtime import on_pty

    with on_pty(build) as live:
        monkeypatch.setattr(serial_port, "BY_ID", live.path)
        yield


@contextmanager
def an_emulated_vehicle(request, monkeypatch):
    """Check that simavr is installed; undo afterwards what `emulated` replaces at the bus."""
    with_emulator(request)
    import fcntl

    import smbus2.smbus2

    for module in (fcntl, smbus2.smbus2):
        monkeypatch.setattr(module, "ioctl", module.ioctl)
    yield


@contextmanager
def a_service_on_this_vehicle(request, monkeypatch):
    """Provide a door at which a READY vehicle answers, with one run in its folder."""
    if sys.platform == "win32":
        pytest.skip("this system has no sockets in files")
    import tempfile

    from baqueano.door import remote
    from baqueano.door.operator import Operator
    from baqueano.door.sockets import Door

    folder = Path(tempfile.mkdtemp())  # a socket's path may have 104 letters on some systems
    (folder / "0001-experiment.mcap").touch()
    door, stop = Door(folder / "door", Operator(), folder), threading.Event()

    def broadcast_state() -> None:
        while not stop.wait(0.02):
            door.broadcast({"type": "state", "state": "READY"})

    telling = threading.Thread(target=broadcast_state)
    telling.start()
    monkeypatch.setattr(remote, "SOCKET", door.path)
    try:
        yield
    finally:
        stop.set()
        telling.join()
        door.close()
        shutil.rmtree(folder)


HARDWARE = {
    "baqueano.robot.emulated": an_emulated_vehicle,
    "baqueano.robot.imu.driver": an_imu_on_the_bus,
    "baqueano.robot.uno.link": an_uno_on_the_line,
    "baqueano.door.remote": a_service_on_this_vehicle,
    "baqueano.robot.uno.serial_port": an_uno_on_the_line,
}
