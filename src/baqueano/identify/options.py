"""Options of a fit, beside its runs, its vehicle file, its parameters and its sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from baqueano.diagnostics import fault
from baqueano.errors import UsageError

COSTS = ("simulation", "innovations")


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """Options of `identify`; the defaults are what most fits need. UsageError for those that contradict each other.

    >>> FitOptions(segment_s=5.0, clocks=("camera",)).changed
    ('clocks', 'segment_s')
    """

    # parameters
    fixed: Sequence[str] = ()  # paths that stay as the file has them
    bounds: Mapping[str, tuple[float, float]] = field(
        default_factory=dict
    )  # path → (low, high), within the field's
    start: Mapping[str, Any] = field(
        default_factory=dict
    )  # path → where the search begins, else the file's value
    per_run: Sequence[str] = ()  # paths that each run has for itself
    biases: bool = True  # of the IMU, estimated run by run; of a car the gyro's is that at rest (rest.py)
    # data
    at_rest: bool = False  # the runs begin at rest
    clocks: Sequence[str] = ()  # sensors whose stamps may be off by ± 0.25 s, run by run (data/record.py)
    segment_s: float | None = None  # length of segments with a start of their own; poses: 5 s unasked
    measured: Sequence[str] = ()  # by hand: "end: 2.31 m, 95 deg" (hand_measurements.py)
    # noise and cost
    sigma: Mapping[str, Any] | None = None  # sensor → (m,) std of its noise; None: estimated
    speed_noise: bool = False  # the noise may grow with the speed (noise_level.py)
    cost: str = "simulation"  # or "innovations", with the floor's noise (prediction_error.py)
    gyro_leads: bool | None = None  # the simulation (imu_only.py); None: of a car with an IMU alone
    # the rest
    diagnose: bool = (
        True  # ask at the end what the model lacks (residual_checks.py): as long as the fit itself
    )
    backend: str = "auto"  # or "c", "python", "numpy"

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
        both = [(one.name, getattr(self, one.name), getattr(plain, one.name)) for one in fields(self)]
        return tuple(name for name, mine, default in both if mine != default and (mine or default))
