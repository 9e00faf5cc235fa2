"""Pack signals into messages: a method for each recorded signal.

`put(topic, arrival_ns, data, t_ns, spare)` receives each message.
`spare` is True if the message can be computed again from other messages.
"""

import json
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from baqueano.runs.container.messages import imu_values, pose_values
from baqueano.runs.logs import LEVELS, Event

if TYPE_CHECKING:
    from baqueano.runs.container.run_file import RunFile

PutMessage = Callable[[int, int, bytes, int, bool], None]


class Packing:
    """A packer of recorded signals. It packs each signal for a file, and passes it to `write_bytes`."""

    def __init__(self, run_file: "RunFile", write: PutMessage) -> None:
        self.file, self.write_bytes = run_file, write

    def command(self, stage: str, t_ns: int, u: object) -> None:
        """Pack the command `u` (n,). An "applied" command was used in the interval that ends at `t_ns`; a
        "requested" or "sent" command belongs to the time `t_ns`.
        """
        values = np.asarray(u, dtype=float).tolist()
        topic = self.file.command(stage, len(values))
        self.write_bytes(topic.id, t_ns, topic.pack(t_ns, len(values), *values), t_ns, False)

    def sensor(self, name: str, t_ns: int, arrival_ns: int, z: object) -> None:
        """Pack the measurement `z` (m,) of a sensor."""
        values = np.asarray(z, dtype=float).tolist()
        topic, imu = self.file.sensor(name, len(values))
        data = topic.pack(t_ns, *imu_values(values)) if imu else topic.pack(t_ns, len(values), *values)
        self.write_bytes(topic.id, arrival_ns, data, t_ns, False)

    def estimate(
        self,
        t_ns: int,
        eta: ArrayLike,
        nu: ArrayLike,
        cov: ArrayLike,
        innovation: ArrayLike,
        innovation_cov: ArrayLike,
    ) -> None:
        """Pack pose (3,), velocity (3,) and covariance (6, 6); `innovation` is None if it is not reported."""
        pose = np.asarray(eta, dtype=float).tolist()
        values = [*pose, *np.asarray(nu, dtype=float).tolist(), *np.asarray(cov).ravel().tolist()]
        if innovation is None:
            topic = self.file.estimate(None, has_cov=True)
            data = topic.pack(t_ns, *values, 0, 0, 0)
        else:
            z = np.asarray(innovation, dtype=float).tolist()
            S = [] if innovation_cov is None else np.asarray(innovation_cov).ravel().tolist()
            topic = self.file.estimate(len(z), has_cov=innovation_cov is not None)
            data = topic.pack(t_ns, *values, len(z), len(z), *z, len(S), *S)
        self.write_bytes(topic.id, t_ns, data, t_ns, True)
        self._pose("/estimate/pose", t_ns, pose)

    def reference(self, t_ns: int, eta: object, nu: object, at_end: float) -> None:
        """Pack the reference pose and velocity."""
        topic, pose = self.file.fixed_topic("/reference"), np.asarray(eta, dtype=float).tolist()
        values = [*pose, *np.asarray(nu, dtype=float).tolist(), float(at_end)]
        self.write_bytes(topic.id, t_ns, topic.pack(t_ns, *values), t_ns, True)
        self._pose("/reference/pose", t_ns, pose)

    def truth(self, t_ns: int, eta: object, nu: object, nu_dot: object) -> None:
        """Pack the true pose, velocity and acceleration."""
        topic, pose = self.file.fixed_topic("/truth"), np.asarray(eta, dtype=float).tolist()
        velocities = [x for vector in (nu, nu_dot) for x in np.asarray(vector, dtype=float).tolist()]
        self.write_bytes(topic.id, t_ns, topic.pack(t_ns, *pose, *velocities), t_ns, False)
        self._pose("/truth/pose", t_ns, pose)

    def event(self, event: Event) -> None:
        """Pack an event: a message for the user."""
        topic = self.file.fixed_topic("/events")
        level = 10 + 10 * LEVELS.index(event.level)
        message = event.diagnostic
        data = ("", "") if message is None else (str(message.code), json.dumps(message.to_json()))
        payload = topic.pack(event.t_ns, level, event.source, event.text, *data)
        self.write_bytes(topic.id, event.t_ns, payload, event.t_ns, False)

    def _pose(self, name: str, t_ns: int, eta: list[float]) -> None:
        topic = self.file.fixed_topic(name)
        self.write_bytes(topic.id, t_ns, topic.pack(t_ns, *pose_values(eta)), t_ns, True)
