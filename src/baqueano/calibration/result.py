"""Define the result of a calibration: numbers with error bars, the verdict, and the changed vehicle file.

Only a scale that the run determines changes the vehicle file. A scale below 0 is refused: the channel has the wrong
sign.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.errors import UsageError
from baqueano.messages import verdict_line
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.parameter import parameters
from baqueano.symbolic import value_at_path

if TYPE_CHECKING:
    from baqueano.runs.run import Run
    from baqueano.vehicle_file import VehicleFile

MAX_OFFSET_S, GRID_S = 0.5, 0.01  # largest clock offset, and step of the grid
MAX_HALF_INTERVAL, MAX_CLOCK_HALF_S = 0.02, 0.02  # of a scale: a larger half interval gives a warning
# half interval of a scale above which the run does not determine it; noise at rest gives 0.4
MAX_UNKNOWN = 0.2


class CalibratedNumber(NamedTuple):
    """One calibrated number."""

    name: str  # a path of the vehicle file, or clock.truth, mark.…
    value: float
    std: float
    half_width: float  # of the 95 % interval
    unit: str
    file_value: float | None  # value in the vehicle file
    words: str  # description

    @property
    def is_scale(self) -> bool:
        """Return True for the scale of a sensor."""
        return self.name.endswith("scale")

    @property
    def is_determined(self) -> bool:
        """Return True if the run determines this number, as a scale."""
        return bool(self.half_width < MAX_UNKNOWN * abs(self.value))


def sensor_axis_warnings(run: "Run") -> tuple[Diagnostic, ...]:
    """Return the warnings of the import that gravity shows other axes than the map. A scale does not show them,
    because turns on a mark do not show a direction. A gyro of the wrong sign turns in the wrong direction.
    """
    warnings = [event.diagnostic for event in run.events if event.diagnostic is not None]
    causes = [warning.figures.get("cause") for warning in warnings]
    return tuple(
        warning
        for warning, cause in zip(warnings, causes, strict=True)
        if isinstance(cause, Diagnostic) and cause.code == "recording.not-level"
    )


@dataclass(frozen=True, repr=False)
class Calibration(Result):
    """Calibration of the sensors of a run against a truth."""

    run: str
    numbers: tuple[CalibratedNumber, ...]
    residuals: dict[str, float]  # root mean square residual of the windows, by equation: rad, m
    usable_text: str = N_("the true poses determine each estimated number")  # text without reasons against it
    # of the import: the gyro measures another axis, or its opposite
    axis_warnings: tuple[Diagnostic, ...] = ()

    def value(self, name: str) -> float:
        """Return the value of the calibrated number `name`. Raise KeyError for an unknown name."""
        return {entry.name: entry.value for entry in self.numbers}[name]

    @property
    def reasons(self) -> tuple[Diagnostic, ...]:
        """Return the reasons why the verdict is not USABLE."""
        reasons = list(self.axis_warnings)
        for item in self.numbers:
            if item.is_scale and not item.is_determined:
                severity = Severity.WARNING if self._usable_sensors else Severity.ERROR
                reasons.append(note("calibration.not-determined", severity, "", item.name))
            elif item.is_scale and item.value < 0.0:
                reasons.append(note("calibration.inverted", Severity.ERROR, "", item.name, scale=item.value))
            elif item.is_scale and not item.half_width < MAX_HALF_INTERVAL * item.value:
                code = "calibration.turn-more" if "gyro" in item.name else "calibration.drive-further"
                percent = 100 * item.half_width / item.value
                reasons.append(note(code, Severity.WARNING, "", item.name, percent=percent))
            if item.name == "clock.truth" and not item.half_width < MAX_CLOCK_HALF_S:
                reasons.append(
                    note("calibration.loose-clock", Severity.WARNING, half_ms=1e3 * item.half_width)
                )
            if item.name == "clock.truth" and abs(item.value) > MAX_OFFSET_S - GRID_S:
                reasons.append(note("calibration.clock-at-end", Severity.WARNING, offset_s=item.value))
        return tuple(reasons)

    @property
    def verdict(self) -> Verdict:
        """Return REFUSED if a sensor is inverted or the run determines no scale, WARN with other reasons."""
        return Verdict.of(self.reasons)

    @property
    def _usable_sensors(self) -> set[str]:
        """Return the paths of the sensors whose scale the run determines."""
        return {x.name.rpartition(".")[0] for x in self.numbers if x.is_scale and x.is_determined}

    def rows(self) -> list[TableRow]:
        """Return one flat row per number."""
        return [{
            "name": entry.name, "value": entry.value, "std": entry.std, "low": entry.value - entry.half_width,
            "high": entry.value + entry.half_width, "unit": entry.unit, "file_value": entry.file_value,
            "text": entry.words,
        } for entry in self.numbers]  # fmt: skip

    def table(self) -> str:
        """Return the table as text."""
        rows = (
            [entry.name, f"{number(round(entry.value, 4) + 0.0):.4f}", f"± {number(entry.half_width):.2g}",
             "" if entry.file_value is None else f"{number(entry.file_value):.4g}", entry.unit, entry.words]
            for entry in self.numbers
        )  # fmt: skip
        lines = text_table("<>>><<", ["", _("value"), "± 95 %", _("file"), _("unit"), ""], *rows)
        return "\n".join([*lines, verdict_line(self.verdict, self.reasons, _(self.usable_text))])

    def mount(self, vehicle_file: "VehicleFile") -> tuple[dict[str, float], dict[str, float]]:
        """Return position, angle and clock offset of the mark, and the half widths of their 95 % intervals. The keys
        are the keys of a map (runs/maps/mount.py). Raise UsageError if the run shows none of them."""
        origin = getattr(vehicle_file.vehicle, "rear_axle_m", 0.0)  # of a car: to the axle without slip
        names = {"clock.truth": "shift_s", "mark.x_m": "lever_arm_m[0]", "mark.y_m": "lever_arm_m[1]",
                 "mark.heading_rad": "heading_rad"}  # fmt: skip
        usable_numbers = [
            entry for entry in self.numbers if entry.name in names and np.isfinite(entry.half_width)
        ]
        if not usable_numbers:
            raise UsageError.of("truth.no-mark", run=self.run)
        values = {
            names[entry.name]: entry.value - origin * (entry.name == "mark.x_m") for entry in usable_numbers
        }
        return values, {names[entry.name]: entry.half_width for entry in usable_numbers}

    @checked_call("calibration.updated_file(robot)")
    def updated_file(self, vehicle_file: "VehicleFile") -> "VehicleFile":
        """Return the file with the scales that the run determines and their errors, the bias of the gyro, and their
        origin; the unchanged file if the calibration is refused."""
        if self.verdict == Verdict.REFUSED:
            return vehicle_file
        from baqueano.vehicle_file import Provenance
        from baqueano.vehicle_file.file import today

        own_numbers = [
            entry for entry in self.numbers if entry.name.rpartition(".")[0] in self._usable_sensors
        ]
        values = {entry.name: entry.value for entry in own_numbers}
        origins = {
            entry.name: Provenance(self.run, today(), entry.std, self.verdict) for entry in own_numbers
        }
        for entry in own_numbers:
            if (path := scale_std_path(vehicle_file, entry.name)) is not None:
                values[path] = entry.std / entry.value
        return vehicle_file.with_values(values, origins)


def scale_std_path(vehicle_file: "VehicleFile", path: str) -> str | None:
    """Return the key of a scale's standard deviation ("sensors.imu.gyro_scale_std"), or None without one."""
    owner, _, field = path.rpartition(".")
    block_field = dict(parameters(value_at_path(vehicle_file, owner)))[field]
    return f"{owner}.{block_field.std}" if block_field.std and not block_field.walk else None
