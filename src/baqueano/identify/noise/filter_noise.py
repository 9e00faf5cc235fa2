"""Noise of the recommended filter: the misfit of the model and the noise of the sensors, two numbers of two sources.

    J(q) = Σ_t ½ (log |S_t| + ρ(y_tᵀ S_t⁻¹ y_t)),   q = log (σ_d, T, walk of ν, σ of wheels and poses)    (1)
    σ² of an inertial number = that at rest; of a run without rest ⅙ (1.48 median |r_{k+1} − 2 r_k + r_{k−1}|)²,
    for a gyro at most GYRO_MOST²; of one that corrects nothing while it drives, that of the residuals      (2)

y and S are the innovations of the filter over the log (augmented_ekf.py), ρ as in most_likely.py. What no number that
corrects can show stays as it is in the file: with a gyro alone, the misfit of the speed. In (2) r are the residuals of
the fit; second differences leave out what a model does not foresee, which is slow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.augmented_state import FORWARD, TURNING, Layout, layout
from baqueano.identify.answer.channel_units import channel_unit
from baqueano.identify.noise.most_likely import TICKS, example_of, log_det_and_square, ticks_of, valley
from baqueano.identify.solve.huber import MAD
from baqueano.runs.run import Run
from baqueano.signals import Tick
from baqueano.symbolic import get, put, scan

if TYPE_CHECKING:
    from baqueano.identify.answer.result import Fit

SLOW_S = 0.3  # what fades faster is the walk of ν: a misfit and the floor are two numbers
OF_FORWARD = (
    ("disturbance_std[0]", 1e-4, 1e2),
    ("disturbance_fade_s[0]", SLOW_S, 30.0),
    ("velocity_walk_std[0]", 1e-4, 10.0),
)
OF_TURNING = (
    ("disturbance_std[1]", 1e-4, 1e3),
    ("disturbance_fade_s[1]", SLOW_S, 30.0),
    ("velocity_walk_std[2]", 1e-4, 30.0),
)
FAR = 6.0  # ρ is a square up to here: what no model foresaw has long tails, and they are not the sensor's
GYRO_MOST = 0.01  # rad/s, white noise at rest of any gyro of this kind by its data sheet; beyond it, the vehicle turned
WIDE = 5.0  # of the logarithm of a sensor's σ, to both sides of the file's
FEWEST = 30  # residuals for (2)


class Free(NamedTuple):
    """A number of the filter that the likelihood finds."""

    path: str
    low: float
    high: float
    power: float  # of what stands at `path`: 2 for a variance


def filter_noise(
    fit: "Fit",
    runs: Sequence[Run],
    q: Mapping[str, np.ndarray],
    rest: Mapping[str, np.ndarray | None],
    backend: str,
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the fields of the filter of the fitted file, and Q of the sensors that it uses; `q` and `rest` are
    their covariances by the residuals of the fit."""
    own = fit.file.estimator()
    its = layout(own)
    inertial = {one.sensor for one in its.biases}
    sensors = own.sensors
    for name in its.names:
        sensor = getattr(fit.blocks.sensors, name, getattr(sensors, name))
        known = q.get(name)
        still = _at_rest(fit, name, rest.get(name)) if name in inertial else None
        if known is not None and still is not None:
            known = np.diag(
                np.where(_corrects(its, name, sensor.size), np.diagonal(still), np.diagonal(known))
            )
        sensor = replace(
            sensor, measurement_noise_cov=sensor.cov if known is None else np.diag(np.diagonal(known))
        )
        sensors = sensors._replace(**{name: sensor})
    ekf = replace(own, vehicle=fit.blocks.model, sensors=sensors)
    free = _free(ekf, inertial)
    kernel = scan(_likelihood(ekf, free), ekf.init(), example_of(ekf), np.zeros(len(free)), backend=backend)
    ticks = [ticks_of(run, ekf, TICKS.get(kernel.backend, 600) // len(runs)) for run in runs]

    def cost(x: np.ndarray) -> float:
        total = sum(float(kernel.cost(one, x)) for one in ticks)
        return total if np.isfinite(total) else np.inf

    low, high = (np.log([getattr(one, side) for one in free]) for side in ("low", "high"))
    start = np.clip([np.log(get(ekf, one.path)) / one.power for one in free], low, high)
    x = valley(cost, start, low, high) if free else start
    for value, one in zip(x, free, strict=True):
        ekf = put(ekf, one.path, float(np.exp(one.power * value)))
    fields = ("disturbance_std", "disturbance_fade_s", "velocity_walk_std")
    values = {name: np.array(getattr(ekf, name), dtype=float) for name in fields}
    return values, {name: getattr(ekf.sensors, name).cov for name in its.names}


def _corrects(its: Layout, name: str, size: int) -> np.ndarray:
    """(m,) whether a number of a sensor corrects while the vehicle drives."""
    numbers = [(one, i) for one, rows in zip(its.names, its.at, strict=True) for i in rows]
    moving = {number for number, E in zip(numbers, its.moving, strict=True) if np.any(E > 0.0)}
    return np.array([(name, i) in moving for i in range(size)])


def _free(ekf: AugmentedEkf, inertial: set[str]) -> list[Free]:
    """The numbers that some measurement shows."""
    its = layout(ekf)
    out = []
    for entries, paths in ((FORWARD[:1], OF_FORWARD), (TURNING[2:3], OF_TURNING)):
        if np.any(its.moving[:, list(entries)]):
            out += [Free(*one, 1.0) for one in paths]
    for name, rows in zip(its.names, its.at, strict=True):
        for i in () if name in inertial else rows:
            sd = float(np.sqrt(getattr(ekf.sensors, name).cov[i, i]))
            out.append(
                Free(
                    f"sensors.{name}.measurement_noise_cov[{i},{i}]",
                    sd * np.exp(-WIDE),
                    sd * np.exp(WIDE),
                    2.0,
                )
            )
    return out


def _likelihood(ekf: AugmentedEkf, free: Sequence[Free]) -> Any:
    """The step of a scan whose parameters are the logarithms of what is free; of the numbers that correct.  (1)"""
    corrects = np.any(layout(ekf).moving > 0.0, axis=1)

    def step(x: np.ndarray, belief: Any, tick: Tick) -> tuple[Any, Any]:
        trial = ekf
        for k, one in enumerate(free):
            trial = put(trial, one.path, np.exp(one.power * x[k]))
        belief, estimate = trial.row(belief, tick)
        y, S = estimate.innovation, estimate.innovation_cov
        assert y is not None
        assert S is not None
        has = np.where(corrects & np.isfinite(y), 1.0, 0.0)
        log_det, square = log_det_and_square(
            S * has[:, None] * has[None, :] + np.diag(1.0 - has), np.where(has > 0.0, y, 0.0)
        )
        m = np.maximum(np.sum(has), 1.0)
        far = FAR * np.sqrt(m)
        d = np.sqrt(np.maximum(square, 1e-12))
        return belief, 0.5 * (log_det + np.where(d < far, square, 2.0 * far * d - far**2))

    return step


def _at_rest(fit: "Fit", name: str, rest: np.ndarray | None) -> np.ndarray | None:
    """Q (m, m) of an inertial sensor; None where its residuals are too few.  (2)"""
    if rest is not None:
        return rest
    variance = []
    for entry in range(getattr(fit.file.sensors, name).size):
        steps = [
            np.diff(r[np.isfinite(r)], 2)
            for r in (c.measured - c.predicted for c in fit.channels if c.sensor == name and c.entry == entry)
        ]
        every = np.concatenate([np.zeros(0), *steps])
        if len(every) < FEWEST:
            return None
        unit, white = channel_unit(fit.file, name, entry), (MAD * float(np.median(np.abs(every)))) ** 2 / 6.0
        variance.append(min(white, GYRO_MOST**2) if unit == "rad/s" else white)
    return np.diag(variance) if min(variance) > 0.0 else None
