"""Define and check the parts of a run in memory: measurements, estimates, references, true motion, events."""

from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.diagnostics import Diagnostic
from baqueano.errors import Invalid
from baqueano.messages import text

LEVELS = ("debug", "info", "warning", "error", "fatal")


def _short_repr(self: Any) -> str:
    """Return the class and the fields of a log, with the shape instead of the content of an array."""
    fields = [
        f"{name}=array {value.shape}" if isinstance(value, np.ndarray) else f"{name}={value!r}"
        for name, value in self._asdict().items()
    ]
    return f"{type(self).__name__}({', '.join(fields)})"


class Channel(NamedTuple):
    """The measurements of a sensor, in order of arrival.

    Attributes
    ----------
    t_ns : ndarray (M,)
        Times of measurement, int64.
    arrival_ns : ndarray (M,)
        Times at which the loop received the measurements, int64; they never decrease.
    z : ndarray (M, m) [SI]
        Measurements, in the sensor's units (SI).

    Examples
    --------
    >>> bq.simulate(bq.load("small"), np.zeros((10, 3))).sensors["imu"].z.shape
    (10, 3)
    """

    t_ns: np.ndarray
    arrival_ns: np.ndarray
    z: np.ndarray

    __repr__ = _short_repr


class EstimateLog(NamedTuple):
    """The estimates of a run.

    Attributes
    ----------
    t_ns : ndarray (N,)
        Times, int64.
    eta : ndarray (N, 3) [m, m, rad]
        Poses in the map.
    nu : ndarray (N, 3) [m/s, m/s, rad/s]
        Velocities in the body frame.
    cov : ndarray (N, 6, 6) [SI, squared]
        Covariances of (η, ν).
    innovation : ndarray (N, m), optional [SI]
        Innovations; NaN if no measurement arrived, None if the estimator does not report them.
    innovation_cov : ndarray (N, m, m), optional [SI, squared]
        Covariances of the innovations.

    Examples
    --------
    >>> EstimateLog(np.array([0]), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 6, 6))).eta
    array([[0., 0., 0.]])
    """

    t_ns: np.ndarray
    eta: np.ndarray
    nu: np.ndarray
    cov: np.ndarray
    innovation: np.ndarray | None = None
    innovation_cov: np.ndarray | None = None

    __repr__ = _short_repr


class ReferenceLog(NamedTuple):
    """The reference poses and velocities of a run.

    Attributes
    ----------
    t_ns : ndarray (N,)
        Times, int64.
    eta : ndarray (N, 3) [m, m, rad]
        Poses in the map.
    nu : ndarray (N, 3) [m/s, m/s, rad/s]
        Velocities in the body frame of the route.
    at_end : ndarray (N,)
        1.0 from the tick at which the guide finished [no unit].

    Examples
    --------
    >>> ReferenceLog(np.array([0]), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1)).at_end
    array([0.])
    """

    t_ns: np.ndarray
    eta: np.ndarray
    nu: np.ndarray
    at_end: np.ndarray

    __repr__ = _short_repr


class TruthLog(NamedTuple):
    """The true motion, from a simulation or a camera. With a camera ν and ν̇ can be NaN.

    Attributes
    ----------
    t_ns : ndarray (K,)
        Times, int64.
    eta : ndarray (K, 3) [m, m, rad]
        Poses in the map.
    nu : ndarray (K, 3) [m/s, m/s, rad/s]
        Velocities in the body frame.
    nu_dot : ndarray (K, 3) [m/s², m/s², rad/s²]
        Rates of change of the body components of ν.

    Examples
    --------
    >>> bq.simulate(bq.load("small"), np.zeros((10, 3))).truth.eta.shape
    (10, 3)
    """

    t_ns: np.ndarray
    eta: np.ndarray
    nu: np.ndarray
    nu_dot: np.ndarray

    __repr__ = _short_repr


class Event(NamedTuple):
    """A message in the log of a run.

    Attributes
    ----------
    t_ns : int
        Time of the event.
    level : str
        One of LEVELS.
    source : str
        The block or command that sent the message.
    text : str
        The message as a sentence, in English.
    diagnostic : Diagnostic or None
        The same message as data; None in old runs, from before diagnostics.

    Examples
    --------
    >>> Event(0, "info", "me", "the battery was full").level
    'info'
    """

    t_ns: int
    level: str
    source: str
    text: str
    diagnostic: Diagnostic | None = None

    @property
    def sentence(self) -> str:
        """Return the message in the current language if it is stored as data, else the English text."""
        return self.text if self.diagnostic is None else text(self.diagnostic)


def checked_times(t_ns: Value, name: str, must_increase: bool = False) -> np.ndarray:
    """Return times as int64 (k,). Raise Invalid if they decrease or, with `must_increase`, do not increase."""
    t = np.asarray(t_ns)
    if t.ndim != 1 or (t.size and t.dtype.kind not in "iu"):
        raise Invalid.of("run.times", name=name, dtype=t.dtype, value=str(t.shape))
    t = np.ascontiguousarray(t, dtype=np.int64)
    steps = np.diff(t)
    is_wrong = steps <= 0 if must_increase else steps < 0
    if is_wrong.any():
        k = int(np.argmax(is_wrong))
        raise Invalid.of(
            "run.times-not-increasing" if must_increase else "run.times-decreasing",
            name=name,
            entry=k,
            t_ns=t[k],
            next_ns=t[k + 1],
        )
    return t


def checked_array(values: object, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return the values as float64. Raise Invalid if their shape differs from `shape`."""
    rows = np.ascontiguousarray(values, dtype=np.float64)
    if rows.shape != shape:
        shape_text = "(" + ", ".join("n" if m < 0 else str(m) for m in shape) + ")"
        raise Invalid.of("run.shape", name=name, value=str(rows.shape), expected=shape_text)
    return rows


def checked_channel(name: str, channel: Channel) -> Channel:
    """Return a channel as arrays. Raise Invalid if a time or a shape is wrong."""
    place_text = f"sensors[{name!r}]"
    arrival = checked_times(channel.arrival_ns, f"{place_text}.arrival_ns")
    t_ns = np.ascontiguousarray(channel.t_ns, dtype=np.int64)
    if t_ns.shape != arrival.shape:
        raise Invalid.of("run.arrivals", channel=place_text, times=len(t_ns), arrivals=len(arrival))
    m = np.shape(channel.z)[1] if np.ndim(channel.z) == 2 else -1
    return Channel(t_ns, arrival, checked_array(channel.z, f"{place_text}.z", (len(arrival), m)))


def _shapes(name: str, k: int, log: Any) -> list[tuple[int, ...] | None]:
    """Return the shapes of the columns of a log, k rows long; None for a column that the log lacks."""
    if name != "estimate":
        return [(k, 3), (k, 3), (k,) if name == "reference" else (k, 3)]
    m = 0 if log.innovation is None else np.shape(log.innovation)[1]
    has_cov = log.innovation is not None and log.innovation_cov is not None
    return [
        (k, 3),
        (k, 3),
        (k, 6, 6),
        None if log.innovation is None else (k, m),
        (k, m, m) if has_cov else None,
    ]


def log_rows(log: Tree, rows: Value) -> Tree:
    """Return a log with these rows, a mask or indices; a column that the log lacks is None."""
    return type(log)(*(None if column is None else column[rows] for column in log))


def checked_log(name: str, log: Any) -> Any:
    """Return a log as arrays, or None for None. Raise Invalid if a time or a shape is wrong."""
    if log is None:
        return None
    t_ns = checked_times(log.t_ns, f"{name}.t_ns")
    rows = zip(log[1:], _shapes(name, len(t_ns), log), log._fields[1:], strict=True)
    return type(log)(
        t_ns,
        *(
            None if shape is None else checked_array(rows, f"{name}.{field}", shape)
            for rows, shape, field in rows
        ),
    )
