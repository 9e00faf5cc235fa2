"""What looks wrong in an imported recording: the sensors, the commands and the truth are held against each
other.

    truth: Δψ/Δt, Δ(x, y)/Δt · (cos ψ, sin ψ)   gyro: ω_z   odometer: v   a_x ≈ v̇, a_y ≈ v ω_z        (1)
    wheels: (left + right)/2 for v, and right − left ∝ ω_z (left_and_right.py)

Means over windows of 0.2 s or four samples; a relation counts from a correlation of 0.7 and 50 windows on. An
error contradicts the map: the import ends with the line to write, or goes on when the map lists it under
`accept`.
"""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from baqueano.errors import FileError
from baqueano.geometry import wrap
from baqueano.runs.diagnostics.correlation import CLEAR, ENOUGH, NONE, relation
from baqueano.runs.diagnostics.doubt import Doubt
from baqueano.runs.diagnostics.left_and_right import sides
from baqueano.runs.diagnostics.plausible import FASTEST_M_S, FASTEST_RAD_S, commands, plausible
from baqueano.runs.diagnostics.repeated_readings import are_held, repeats
from baqueano.runs.run import Channel, Run, TruthLog
from baqueano.signals import NANOSECONDS, STANDARD_GRAVITY

if TYPE_CHECKING:
    from baqueano.runs.maps.columns import ColumnMap, Entry

WINDOW_S = 0.2
CLOCK_S, APART_S = 0.25, 0.02  # how far apart two clocks are looked for, and from where that is told
SI = {"speed": "m/s", "angular rate": "rad/s", "acceleration": "m/s^2"}
LONG = 10.0  # times as long as others: the vehicle stands
DEGREES = 180.0 / np.pi
NEAR = np.log(1.8)  # of a ratio that correlated noise makes smaller
RATIOS = {
    "speed": {3.6: "km/h", 1e3: "mm/s", 1e2: "cm/s", 2.23694: "mph"},
    "angular rate": {57.29578: "deg/s", 1e3: "mrad/s", 9.549297: "rpm"},
    "acceleration": {1 / 9.80665: "g", 1e3: "mm/s^2", 1e2: "cm/s^2", 101.97: "mg"},
}


def judged(found: list[Doubt], m: "ColumnMap") -> tuple[Doubt, ...]:
    """The doubts, with accepted errors as warnings. FileError if an error is left."""
    left = [d for d in found if d.level == "error" and d.code not in m.accept]
    if left:
        cures = [d.cure for d in left]
        lines = " ".join(
            f"{d.said if d.cure not in cures[k + 1 :] else d.text}." for k, d in enumerate(left)
        )  # a cure of several stands after the last
        codes = ", ".join(f'"{code}"' for code in sorted({*m.accept, *(d.code for d in left)}))
        raise FileError(
            f"{m.path.name} does not fit its recording: {lines} If it is right as it is, write at the top "
            "of the map: "
            f"accept = [{codes}]"
        )
    return tuple(
        d._replace(level="warning", text=f"{d.text} (accepted by the map)") if d.level == "error" else d
        for d in found
    )


def look(run: Run, m: "ColumnMap") -> list[Doubt]:
    """All doubts about a run."""
    found: list[Doubt] = []
    for name, channel in run.sensors.items():
        found += _alone(f"sensors.{name}", channel.t_ns, channel.z, slow=m.sensors[name].kind == "battery")
        found += plausible(m.sensors[name], channel, run)
    found += commands(run, m)
    motion = _Motion(run, m)
    if run.truth is not None:
        found += _alone("truth", run.truth.t_ns, run.truth.eta)
        found += _truth(run.truth)
    turning = motion.sides()
    opposed = run.truth is None and any(d.code == "inverted" for d in turning)
    found += turning + motion.gyro() + motion.speed() + motion.accelerometer(opposed) + motion.steering()
    return found


def _alone(key: str, t_ns: np.ndarray, z: np.ndarray, slow: bool = False) -> Iterator[Doubt]:
    """A signal by itself: constant, held; one that is `slow` by nature may repeat."""
    z = z[:, np.isfinite(z).any(axis=0)]
    if len(z) < 10 or not z.shape[1]:
        return
    still = np.ptp(z, axis=0) == 0.0
    for i in np.flatnonzero(still):
        yield Doubt(
            "constant", "warning", None, f"[{key}] number {i}: {z[0, i]:g} in all {len(z)} rows; is it wired?"
        )
    if slow:
        return
    lasting = np.concatenate([np.zeros(0, int), *(repeats(column).lasting for column in z[:, ~still].T)])
    if are_held(lasting):
        every = float(np.mean(lasting[lasting < LONG * np.median(lasting)]))
        share = 1.0 - 1.0 / every
        text = (
            f"[{key}]: {share:.0%} of the rows repeat the one before: held, new about every {every:.1f} rows"
        )
        cure = 'for the new ones alone write new_when = "COLUMN" (one that changes with each) in [files.…]'
        yield Doubt("held samples", "warning", int(t_ns[0]), f"{text}; {cure}", cure)


def _truth(truth: TruthLog) -> Iterator[Doubt]:
    """The course, from two positions, against the heading."""
    t = (truth.t_ns - truth.t_ns[0]) / NANOSECONDS
    dt = np.diff(t)
    step = np.diff(truth.eta[:, :2], axis=0)
    speed = np.hypot(step[:, 0], step[:, 1]) / dt
    if np.quantile(speed, 0.9) > FASTEST_M_S:
        text = f"[truth] eta: positions change by {np.quantile(speed, 0.9):.3g} m/s"
        yield Doubt("unit", "error", None, text, 'perhaps unit = "mm"')
        return
    rate = np.abs(wrap(np.diff(truth.eta[:, 2]))) / dt
    if np.quantile(rate, 0.9) > FASTEST_RAD_S:
        text = f"[truth] eta[2]: the heading changes by {np.quantile(rate, 0.9):.3g} rad/s"
        yield Doubt("unit", "error", None, text, 'perhaps unit = "deg"')
        return
    far = _every(truth.eta[:, :2], 0.05)
    d = np.diff(truth.eta[far, :2], axis=0)
    if len(d) < ENOUGH:
        return
    course = np.arctan2(d[:, 1], d[:, 0])
    heading = truth.eta[far[:-1], 2] + 0.5 * wrap(np.diff(truth.eta[far, 2]))
    # Forward and backward count alike: angles are doubled.
    same, mirrored = (np.mean(np.exp(2j * (course + sign * heading))) for sign in (-1.0, 1.0))
    if abs(mirrored) > CLEAR and abs(same) < 0.5:
        seen = f"agreement {abs(same):.2f}, mirrored {abs(mirrored):.2f}"
        text = f"[truth] eta: course and heading turn opposite ways ({seen})"
        yield Doubt(
            "mirrored", "error", None, text, "x and y are swapped, or one of y and yaw needs scale = -1.0"
        )
    elif abs(same) > CLEAR and abs(0.5 * np.angle(same)) > 0.35:
        off = 0.5 * np.angle(same)
        degrees = f"{np.degrees(off):.0f}° (or {np.degrees(off) + 180:.0f}°)"
        text = f"[truth] eta[2]: the vehicle moves {degrees} beside its heading"
        yield Doubt(
            "heading offset",
            "error",
            None,
            text,
            f"write offset = {off:.3f} for the yaw, or {wrap(off + np.pi):.3f} if it drove backward",
        )


def _every(xy: np.ndarray, distance_m: float) -> np.ndarray:
    """Indices of positions that lie at least that far apart along the way."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    return np.unique(np.searchsorted(way, np.arange(0.0, way[-1], distance_m)))


class _Motion:
    """Rates, speeds and accelerations of (1), each as means over the same windows."""

    def __init__(self, run: Run, m: "ColumnMap") -> None:
        self.run, self.m = run, m
        self.imu = self._first("imu")
        self.odometer = self._first("odometer") or self._wheels()
        spans = [
            (c.t_ns[0], c.t_ns[-1], np.median(np.diff(c.t_ns))) for c in self._logs() if len(c.t_ns) > 10
        ]
        start, end = (max(s[0] for s in spans), min(s[1] for s in spans)) if spans else (0, 0)
        self.half_s = 0.5 * max(WINDOW_S, *(4.0 * s[2] / NANOSECONDS for s in spans)) if spans else 1.0
        self.origin = int(start)
        length = (end - start) / NANOSECONDS
        self.t = (
            np.arange(self.half_s, length - self.half_s, self.half_s)
            if length > 4 * self.half_s
            else np.zeros(0)
        )

    def _first(self, *kinds: str) -> tuple[str, Channel] | None:
        return next(((n, self.run.sensors[n]) for n, s in self.m.sensors.items() if s.kind in kinds), None)

    def _wheels(self) -> tuple[str, Channel] | None:
        """The speed that is the mean of two wheels'."""
        found = self._first("wheels", "encoders")
        if found is None:
            return None
        name, channel = found
        return name, channel._replace(z=np.mean(channel.z, axis=1, keepdims=True))

    def _logs(self) -> list[Channel | TruthLog]:
        sensors = [found[1] for found in (self.imu, self.odometer) if found]
        return [*sensors, self.run.truth] if self.run.truth is not None else list(sensors)

    def _mean(self, t_ns: np.ndarray, values: np.ndarray) -> np.ndarray:
        """By area between the very ends of the windows, as `_change` takes a slope: v̇ and a_x are then of one span."""
        t = (t_ns - self.origin) / NANOSECONDS
        area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t))])
        return self._change(t, area)

    def _change(self, t: np.ndarray, values: np.ndarray) -> np.ndarray:
        high, low = (np.interp(self.t + s * self.half_s, t, values) for s in (1.0, -1.0))
        return (high - low) / (2.0 * self.half_s)

    def _z(self, sensor: tuple[str, Channel] | None, i: int) -> np.ndarray | None:
        return None if sensor is None else self._mean(sensor[1].t_ns, sensor[1].z[:, i])

    def _true_rate(self, late_s: float = 0.0) -> np.ndarray | None:
        truth = self.run.truth
        if truth is None:
            return None
        t = (truth.t_ns - self.origin) / NANOSECONDS + late_s
        return self._change(t, np.unwrap(truth.eta[:, 2]))

    def _true_speed(self, late_s: float = 0.0) -> np.ndarray | None:
        truth = self.run.truth
        if truth is None:
            return None
        t = (truth.t_ns - self.origin) / NANOSECONDS + late_s
        psi = np.interp(self.t, t, np.unwrap(truth.eta[:, 2]))
        x, y = (self._change(t, truth.eta[:, i]) for i in (0, 1))
        return x * np.cos(psi) + y * np.sin(psi)

    def _v_dot(self) -> np.ndarray | None:
        if self.odometer is not None:
            t = (self.odometer[1].t_ns - self.origin) / NANOSECONDS
            return self._change(t, self.odometer[1].z[:, 0])
        v = self._true_speed()
        return None if v is None or len(v) < 3 else np.gradient(v, self.half_s)

    def gyro(self) -> list[Doubt]:
        return self._same(self.imu, 2, self._true_rate, "angular rate", 0.05)

    def speed(self) -> list[Doubt]:
        return self._same(self.odometer, 0, self._true_speed, "speed", 0.05)

    def _same(
        self,
        sensor: tuple[str, Channel] | None,
        i: int,
        true_of: Callable[[float], np.ndarray | None],
        measures: str,
        least: float,
    ) -> list[Doubt]:
        """A sensor against the truth of the same thing: clock, sign, unit, scale."""
        z, true = self._z(sensor, i), true_of(0.0)
        if sensor is None or z is None or true is None or len(z) < ENOUGH or not np.std(true) > least:
            return []  # a NaN is what nothing measured
        if not np.isfinite(z).all():
            return []
        late_s, found = self._late(sensor, i, z, true_of)
        shown = true_of(late_s)
        return found + self._scaled(sensor, i, z, true if shown is None else shown, measures)

    def _late(
        self,
        sensor: tuple[str, Channel],
        i: int,
        z: np.ndarray,
        true_of: Callable[[float], np.ndarray | None],
    ) -> tuple[float, list[Doubt]]:
        """Return the shift of the stamps of the truth with which it agrees best with the sensor, and a doubt about them
        where that halves the residual: two clocks that are apart make a slope too small."""
        lags = np.linspace(-CLOCK_S, CLOCK_S, 51)
        trues = [true_of(float(lag)) for lag in lags]
        r = np.array([0.0 if true is None else relation(true, z)[1] for true in trues])
        k = int(np.argmax(np.abs(r) - 1e-4 * np.abs(lags)))
        before, late_s = r[len(lags) // 2], float(lags[k])
        if abs(late_s) < APART_S or not 1.0 - r[k] ** 2 < 0.5 * (1.0 - before**2) or abs(r[k]) < CLEAR:
            return late_s if abs(r[k]) > CLEAR else 0.0, []
        truth = self.m.truth
        key, spec = self.m.sensors[sensor[0]].entries[i].key, self.m.files[truth.file] if truth else None
        said = f"[truth] goes with {key} best {1e3 * abs(late_s):.0f} ms {'later' if late_s > 0.0 else 'earlier'}"
        text = f"{said} (correlation {before:.3f}, then {r[k]:.3f})"
        cure = f"write shift_s = {spec.shift_s + late_s:.3g} in [files.{spec.name}]" if spec else ""
        return late_s, [Doubt("clock", "info", None, text, cure)]

    def _scaled(
        self, sensor: tuple[str, Channel], i: int, z: np.ndarray, true: np.ndarray, measures: str
    ) -> list[Doubt]:
        """Sign, unit and scale of a sensor whose windows z (W,) show what `true` (W,) is."""
        entry = self.m.sensors[sensor[0]].entries[i]
        slope, r = relation(true, z)
        said = f"{entry.key} is {slope:.3g} times what [truth] says (correlation {r:.2f})"
        if r < -CLEAR:
            return [Doubt("inverted", "error", None, said, f"write scale = {-entry.scale:g} for it")]
        if r < CLEAR:
            if np.all(sensor[1].z[:, i] >= 0.0) and relation(np.abs(true), z)[1] > CLEAR:
                return [
                    Doubt(
                        "no sign",
                        "info",
                        None,
                        f"{entry.key} is never negative: the sensor does not know the way",
                    )
                ]
            return [Doubt("unrelated", "warning", None, said)] if abs(r) < NONE else []
        if 0.8 < slope < 1.25:
            return [] if abs(slope - 1.0) < 0.02 else [Doubt("scale", "info", None, said)]
        for ratio, name in RATIOS[measures].items():
            for factor, guess in ((ratio, name), (1.0 / ratio, None)):
                if 0.85 < slope / factor < 1.18:
                    cure = f'write unit = "{guess}"' if guess else _too_small(entry, measures, ratio)
                    return [Doubt("unit", "error", None, said, cure)]
        return [Doubt("scale", "error", None, said, "check its unit and scale")]

    def sides(self) -> list[Doubt]:
        """Left and right wheel against the truth, or else the gyro."""
        wheels, rate, imu, felt = self._first("wheels", "encoders"), self._true_rate(), None, 0.0
        if rate is None and self.imu is not None:
            rate, imu = self._z(self.imu, 2), self.m.sensors[self.imu[0]].entries
        if wheels is None or rate is None:
            return []
        left, right = (self._mean(wheels[1].t_ns, wheels[1].z[:, i]) for i in (0, 1))
        if self.imu is not None and imu is not None:
            a_y = self._mean(self.imu[1].t_ns, self.imu[1].z[:, 1])
            felt = relation(0.5 * (left + right) * rate, a_y)[1] if np.isfinite(a_y).all() else 0.0
        return sides(f"[sensors.{wheels[0]}]", right - left, rate, imu, felt)

    def accelerometer(self, opposed: bool) -> list[Doubt]:
        """a_y against v ω, a_x against v̇: swapped, inverted, in g. What a_y says of a turning that is `opposed` to the
        wheels' is told there."""
        v = self._z(self.odometer, 0)
        source = "[truth]" if v is None or self.odometer is None else f"[sensors.{self.odometer[0]}]"
        v = self._true_speed() if v is None else v
        rate, v_dot = self._true_rate(), self._v_dot()
        rate = self._z(self.imu, 2) if rate is None else rate
        if self.imu is None or v is None or rate is None or v_dot is None or len(v) < ENOUGH:
            return []
        a = [self._z(self.imu, i) for i in (0, 1)]
        felt = v * rate
        entries = self.m.sensors[self.imu[0]].entries
        if a[0] is None or a[1] is None or np.isnan(a[0] + a[1]).any():
            return []
        if not max(np.std(felt), np.std(a[1])) > 0.2:
            return []
        along, across = relation(felt, a[0]), relation(felt, a[1])
        if abs(along[1]) > CLEAR and abs(across[1]) < NONE:
            seen = f"(correlation {along[1]:.2f}), {entries[1].key} does not ({across[1]:.2f})"
            text = f"{entries[0].key} follows v·ω {seen}"
            return [Doubt("swapped", "error", None, text, "swap the columns of a_x and a_y")]
        found = []
        for entry, (slope, r) in ((entries[1], across), (entries[0], relation(v_dot, a[0]))):
            said = f"{entry.key} is {slope:.3g} times what speed and turning give (correlation {r:.2f})"
            if r < -CLEAR:
                if entry is not entries[1] or not opposed:
                    cure = f"write scale = {-entry.scale:g} for it"
                    found.append(Doubt("inverted", "error", None, said, cure))
            elif r > CLEAR and not 0.4 < slope < 2.5:
                turned = entries[2] if entry is entries[1] and self.run.truth is None else None
                found.append(Doubt("unit", "error", None, said, _cure_of(slope, entry, turned, source)))
        return found

    def steering(self) -> list[Doubt]:
        """Of two commands, the one that is called steering must be the one that turns."""
        which = [i for i, n in enumerate(self.m.names) if "steer" in n.lower() or "servo" in n.lower()]
        rate = self._z(self.imu, 2)
        rate = self._true_rate() if rate is None else rate
        v = self._z(self.odometer, 0)
        v = self._true_speed() if v is None else v
        if len(self.m.names) != 2 or len(which) != 1 or rate is None or v is None or len(v) < ENOUGH:
            return []
        u = [self._mean(self.run.t_ns, self.run.applied[:, i]) for i in (which[0], 1 - which[0])]
        (_, steer), (_, drive) = (relation(one * v, rate) for one in u)
        names = self.m.names[which[0]], self.m.names[1 - which[0]]
        used = np.std(u[0]) > 0.05 and np.std(rate) > 0.2
        if abs(drive) > CLEAR and abs(steer) < NONE and used:
            seen = f"(correlation {drive:.2f}), {names[0]} does not ({steer:.2f})"
            text = f"command {names[1]} turns the vehicle {seen}"
            return [Doubt("swapped", "error", None, text, "swap the columns of [command] u")]
        if steer < -CLEAR and used:
            text = f"positive {names[0]} turns right (correlation {steer:.2f}): its gain will be negative"
            return [Doubt("sign", "info", None, text)]
        return []


def _too_small(entry: "Entry", measures: str, ratio: float) -> str:
    """The line to write for a number that is `ratio` times too small."""
    if entry.unit != SI[measures]:
        return f'perhaps unit = "{SI[measures]}"'
    return f'"{entry.unit}" is too small by {ratio:.4g}; is it SI?'


def _cure_of(slope: float, entry: "Entry", gyro: "Entry | None", source: str) -> str:
    """The line to write where an accelerometer is `slope` times what it should be, by that `gyro` or by none,
    and by the speed of `source`."""
    meant = {ratio: f'unit = "{name}"' for ratio, name in RATIOS["acceleration"].items()}
    if entry.unit == "g":
        meant = {STANDARD_GRAVITY: 'unit = "m/s^2"'}
    if gyro is not None and gyro.unit == "deg/s":
        meant[DEGREES] = f'unit = "rad/s" for {gyro.key}'
    elif gyro is not None:
        meant[1.0 / DEGREES] = f'unit = "deg/s" for {gyro.key}'
        both = f'unit = "deg/s" for {gyro.key} and unit = "g" for {entry.key}'
        meant[1.0 / DEGREES / STANDARD_GRAVITY] = both
    off, line = min((abs(np.log(slope / ratio)), line) for ratio, line in meant.items())
    return f"write {line}" if off < NEAR else f"check its unit and scale, and those of the speed, {source}"
