"""Options of a fit, in addition to its runs, vehicle file, parameters and sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from baqueano.contracts.calls import checked_call
from baqueano.errors import UsageError

COSTS = ("simulation", "innovations")


@checked_call("bq.FitOptions(segment_s=5.0)")
@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """Options of `identify`; the defaults suit most fits.

    Parameters
    ----------
    fixed : sequence of str
        Paths that keep their values in the file.
    bounds : mapping of str to (float, float)
        Path → lowest and highest value [unit of the field], within its bounds.
    start : mapping of str to float
        Path → start of the search [unit of the field]; default: the file's value.
    per_run : sequence of str
        Paths that are estimated for each run separately.
    biases : bool
        Estimate the biases of the IMU run by run; the bias of a car's gyro is measured at rest.
    at_rest : bool
        The runs begin at rest.
    clocks : sequence of str
        Sensors whose clock offset, up to ± 0.25 s, is estimated for each run.
    segment_s : float, optional
        Length of segments with their own start; default: 5 s if a pose is used, else whole runs.
    measured : sequence of str
        Measurements made by hand, such as "end: 2.31 m, 95 deg": docs/identification.md.
    sigma : mapping of str to array (m,), optional
        Sensor → standard deviation of its noise; None estimates it.
    speed_noise : bool
        The noise can grow with the speed.
    cost : str
        "simulation", or "innovations" with process noise: docs/derivations/one_likelihood.md.
    gyro_leads : bool, optional
        The gyro gives the simulated yaw rate; None: only for a car with an IMU as its only sensor.
    diagnose : bool
        Test at the end for effects that the model lacks; it takes as long as the
        fit.
    backend : str
        "auto", "c", "python" or "numpy".

    Raises
    ------
    UsageError
        For options that contradict each other, an unknown cost, a `segment_s` of 0 or below, or empty bounds.

    Examples
    --------
    >>> FitOptions(segment_s=5.0, clocks=("camera",)).non_defaults
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
            raise UsageError.of("cost.unknown", value=self.cost, valid=COSTS)
        if self.cost == "innovations" and self.clocks:
            raise UsageError.of("cost.free-clock", "--cost simulation", clocks=self.clocks)
        if self.segment_s is not None and not self.segment_s > 0.0:
            raise UsageError.of("segment.length", length_s=self.segment_s)
        if self.measured and self.segment_s is not None:
            raise UsageError.of("tape.cut")
        for path, (low, high) in self.bounds.items():
            if not low < high:
                raise UsageError.of("parameter.bounds", path=path, low=low, high=high)

    @property
    def non_defaults(self) -> tuple[str, ...]:
        """Return the names of the options that differ from their defaults."""
        defaults = FitOptions()
        values = [
            (entry.name, getattr(self, entry.name), getattr(defaults, entry.name)) for entry in fields(self)
        ]
        return tuple(name for name, value, default in values if value != default and (value or default))
