"""Keep a vehicle at rest before its drive, so that its estimator measures the bias of the gyro.

    u = 0,  η_r = η,  ν_r = 0     for rest_s from the first tick; then the guide and the controller begin  (1)

η: estimated pose; η_r, ν_r: reference; u: command. The recommended filter treats a vehicle as at rest only if its
command is exactly 0. A controller would respond to the noise of the estimate, so it does not run before its guide.
"""

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject
from baqueano.controllers.schedule import DelayedController
from baqueano.guides import GuideSequence, Idle
from baqueano.loop import Blocks

# 1.5 s of it after MIN_REST_S of the filter: a gyro with 0.005 °/s/√Hz then has a bias known to 7e-5 rad/s
REST_S = 2.0


def with_rest(blocks: Blocks, rest_s: float, commands: int) -> Blocks:
    """Return the blocks with a rest of `rest_s` before the drive; for 0 the same blocks.  (1)"""
    if rest_s <= 0.0:
        return blocks
    guide = GuideSequence(Idle(rest_s), blocks.guide)
    return blocks._replace(guide=guide, controller=DelayedController(blocks.controller, rest_s, commands))


def usual_rest_s(sensors: SensorBlocks, start: np.ndarray | None = None) -> float:
    """Return the rest [s] before the drive of a vehicle with these sensors: 0 without a gyro, or if it moves already.

    `start` is the pose (3,), or pose and velocity (6,).
    """
    has_gyro = any(has_field(sensor, "gyro_bias") for sensor in sensors)
    is_moving = start is not None and np.any(np.asarray(start)[3:])
    return REST_S if has_gyro and not is_moving else 0.0


def with_usual_rest(options: JsonObject, sensors: SensorBlocks) -> JsonObject:
    """Return the options of a drive, `rest_s`, `eta` and others, with the usual rest if `rest_s` is None or missing."""
    if options.get("rest_s") is not None:
        return options
    return options | {"rest_s": usual_rest_s(sensors, options.get("eta"))}
