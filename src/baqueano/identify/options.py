"""Options of a fit, beside its runs, its vehicle file, its parameters and its sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from baqueano.diagnostics import fault
from baqueano.errors import UsageError

COSTS = ("simulation", "innovations")


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """Options of `identify`; the defaults are what most fits need.

    Parameters
    ----------
    fixed : sequence of str
        Paths that stay as the file has them.
    bounds : mapping of str to (float, float)
        Path → lowest and highest value, within those of the field.
    start : mapping of str to float
        Path → where the search begins, else the file's value.
    per_run : sequence of str
        Paths that each run has for itself.
    biases : bool
        Estimate the biases of the IMU run by run; those of a car's gyro come from rest (data/rest.py).
    at_rest : bool
        The runs begin at rest.
    clocks : sequence of str
        Sensors whose stamps may be off by ± 0.25 s, run by run (data/record.py).
    segment_s : float, optional
        Length of segments with a start of their own; 5 s where a pose is used.
    measured : sequence of str
        Measured by hand, "end: 2.31 m, 95 deg" (data/hand_measurements.py).
    sigma : mapping of str to array (m,), optional
        Sensor → standard deviation of its noise; None estimates it.
    speed_noise : bool
        The noise may grow with the speed (residuals/noise_level.py).
    cost : str
        "simulation", or "innovations" with process noise (estimation/prediction_error.py).
    gyro_leads : bool, optional
        The gyro leads the simulation (imu_only.py); None where a car has an IMU alone.
    diagnose : bool
        Test at the end what the model lacks (diagnostics/residual_checks.py): as long as the fit itself.
    backend : str
        "auto", "c", "python" or "numpy".

    Raises
    ------
    UsageError
        For options that contradict each other.

    Examples
    --------
    >>> FitOptions(segment_s=5.0, clocks=("camera",)).changed
    ('clocks', 'segment_s')
    """

    fixed: Sequence[str] = ()
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    start: Mapping[str, Any] = field(default_factory=dict)
    per_run: Sequence[str] = ()
    biases: bool = True
    at_rest: bool = False
    clocks: Sequence[str] = ()
    segment_s: float | None = None
    measured: Sequence[str] = ()
    sigma: Mapping[str, Any] | None = None
    speed_noise: bool = False
    cost: str = "simulation"
    gyro_leads: bool | None = None
    diagnose: bool = True
    backend: str = "auto"

    def __post_init__(self) -> None:
        if self.cost not in COSTS:
            raise UsageError(fault("cost.unknown", found=self.cost, known=COSTS))
        if self.cost == "innovations" and self.clocks:
            raise UsageError(fault("cost.free-clock", "--cost simulation", clocks=self.clocks))
        if self.segment_s is not None and not self.segment_s > 0.0:
            raise UsageError(fault("segment.length", length_s=self.segment_s))
        if self.measured and self.segment_s is not None:
            raise UsageError(fault("tape.cut"))
        for path, (low, high) in self.bounds.items():
            if not low < high:
                raise UsageError(fault("parameter.bounds", path=path, low=low, high=high))

    @property
    def changed(self) -> tuple[str, ...]:
        """Return the names of the options that differ from their defaults."""
        plain = FitOptions()
        both = [(entry.name, getattr(self, entry.name), getattr(plain, entry.name)) for entry in fields(self)]
        return tuple(name for name, value, default in both if value != default and (value or default))
