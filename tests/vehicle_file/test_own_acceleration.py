"""A vehicle of the user whose acceleration is unusable is refused with the reason, or named by its check."""

import sys
from pathlib import Path

import numpy as np
import pytest

import baqueano as bq
from baqueano.drive.session import drive_stop_reason
from baqueano.errors import FileError, UsageError
from tests.codes import refused

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def with_body(tmp_path):
    """Return a function that writes the servo axis with another body of nu_dot, and returns its vehicle file."""

    def write(body):
        source = (EXAMPLES / "servo_axis.py").read_text(encoding="utf-8")
        head = source[: source.index("        v = nu[0]")]
        (tmp_path / "servo_axis.py").write_text(f"{head}        {body}\n", encoding="utf-8")
        text = (EXAMPLES / "servo_axis.toml").read_text(encoding="utf-8")
        (tmp_path / "axis.toml").write_text(text, encoding="utf-8")
        return tmp_path / "axis.toml"

    return write


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("return [effort[0] - nu[0], 0.0, 0.0]", "vehicle.acceleration"),
        ("return effort[0] - nu[0]", "vehicle.acceleration"),
        ("return np.array([effort[0] - nu[0], 0.0])", "vehicle.acceleration"),
        ("return np.array([effort[0] - 1j * nu[0], 0.0, 0.0])", "vehicle.acceleration"),
        ("return np.array([effort[0] - nu[0] / nu[0], 0.0, 0.0])", "vehicle.acceleration"),
        ("return {}['drag']", "vehicle.not-built"),
        ("while True: pass", "vehicle.not-built"),
    ],
)
def test_an_acceleration_that_is_not_a_real_array_of_three_is_refused(with_body, body, code, monkeypatch):
    monkeypatch.setattr("baqueano.vehicle_file.plausibility.HANG_S", 0.3)
    with refused(code, FileError):
        bq.load(with_body(body), allow_blocks=True)


class Twice:
    commands = 3

    def init(self):
        return None

    def step(self, state, u, dt_s, noise):
        return state, u


def test_a_class_becomes_the_model_only_if_it_has_the_members_of_a_vehicle(monkeypatch):
    monkeypatch.setattr(sys.modules["__main__"], "Twice", Twice, raising=False)
    small = bq.load("small")
    with refused("vehicle.lacks-members", FileError):
        small.with_values({"model.kind": "__main__:Twice"})
    with refused("block.cell-class-unknown", FileError):
        small.with_values({"model.kind": "__main__:Thrice"})
    with refused("block.not-a-block", UsageError):
        small.with_values({"model.kind": int})
    assert small.with_values({"controller.kind": bq.controllers.Lqr}).value("controller.kind") == "lqr"


def test_a_class_becomes_a_further_sensor_also_of_the_simulated_vehicle(monkeypatch):
    tacho = type("Tacho", (bq.sensors.Odometer,), {"__module__": "__main__"})
    monkeypatch.setattr(sys.modules["__main__"], "Tacho", tacho, raising=False)
    for kind in ("wheels", tacho):
        values = {"sensors.other.kind": kind, "sensors.other.noise_std": 0.02, "simulation.truth": "small"}
        file = bq.load("small").with_values(values | {"estimator.use": ["imu", "other"]})
        for truth in (None, bq.load("small")):
            run = bq.experiment(file, np.zeros((20, 3)), truth=truth)
            assert len(run.sensors["other"].z) > 0
            assert not [event for event in run.events if event.level == "error"]


def test_a_new_kind_keeps_the_tables_that_its_block_has():
    small = bq.load("small")
    assert small.with_values({"model.kind": "planar"}).text == small.text
    rolling = {"model.kind": "kinematic", "model.velocity_matrix": 0.5 * np.eye(3)}
    model = small.with_values(rolling).data["model"]
    assert "drivetrain" in model
    assert "friction" not in model


def test_the_check_names_an_acceleration_that_cannot_be_compiled(with_body):
    vehicle = bq.load(
        with_body("return np.array([effort[0] - nu[0] * (2.0 if nu[0] > 0.0 else 3.0), 0.0, 0.0])"), True
    )
    (finding,) = bq.check(vehicle.vehicle, vehicle).findings
    assert (finding.code, finding.figures["cause"].code) == ("check.must-compile", "trace.decides")


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_a_drive_whose_model_becomes_nan_ends_with_a_run_and_a_reason(with_body):
    vehicle = bq.load(
        with_body("return np.array([-effort[0] - np.sqrt(nu[0]), 0.0, 0.0])"), allow_blocks=True
    )
    run = bq.experiment(vehicle, np.full((1000, 1), 5.0))
    assert len(run.t_ns) > 1000
    assert drive_stop_reason(run).code == "block.returned"
