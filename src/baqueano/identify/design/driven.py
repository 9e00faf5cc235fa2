"""The composition, driven: what its pieces carry into each other, and what takes the place of those that leave.

A piece ends before the vehicle quite rests, and the composition does not see what that does to the next one. So
the plan is driven once, piece by piece, by vehicles that had no part in its search,
with their noise:

    allowed(x, piece)  ⇔  all under (piece, then no command for COAST_S) inside                           (1)

for the corridor of `Room.margin` and for every single vehicle. A piece that is not allowed waits, and one that
would come later has its turn. Where none of them is allowed either, one of the library takes its place: that
which is worth most beside all the others, then those that end nearer to where they began; last comes the first of
the library, to stand still, which is the rest of what was checked before.
"""

from collections.abc import Callable

import numpy as np

from baqueano.identify.design.belief import Cloud, chosen_state
from baqueano.identify.design.compose import Composer
from baqueano.identify.design.inside import COAST_S, allowed
from baqueano.identify.design.room import Room
from baqueano.vehicles import VehicleState

PRICES = (1.0, 5.0, 25.0)  # times PRICE of compose.py, by which those that are tried are ordered
BEYOND = 4  # the furthest must leave room for its lead over this one: another may go further still
AT_ONCE = 6  # for each of these prices, and pieces driven at once


def driven(
    composer: Composer, commands: Callable[[int], np.ndarray], cloud: Cloud, room: Room, rest: int
) -> np.ndarray:
    """The poses (L, T, 3) of the vehicles of `cloud` along what is then the composition, after `rest` ticks of
    standing still; `commands` gives (T, n) of a piece.  (1)"""
    state, tick, poses = cloud.at(room.start), rest, []
    if rest:
        state, eta = cloud.drive(state, np.zeros((1, rest, commands(0).shape[1])))
        poses.append(eta[0])
    chosen = composer.chosen
    for place in range(len(chosen)):
        later = list(dict.fromkeys(chosen[place:]))
        found = _first(later[:1], commands, cloud, room, state, tick)
        found = found or _of_many(later[1:], commands, cloud, room, state, tick)
        if found:
            chosen.insert(place, chosen.pop(chosen.index(found[0], place)))
        else:
            pose = state.eta[: composer.path.shape[1]]
            others = composer.instead(place, pose, PRICES, AT_ONCE)
            found = _of_many([*others, 0], commands, cloud, room, state, tick)
        if found is None:
            after, eta = cloud.drive(state, commands(0)[None], tick)
            found = 0, after, eta[0]
        chosen[place], state, eta = found
        poses.append(eta)
        tick += eta.shape[1]
    return np.concatenate(poses, axis=1)


def _of_many(
    some: list[int],
    commands: Callable[[int], np.ndarray],
    cloud: Cloud,
    room: Room,
    state: VehicleState,
    tick: int,
) -> tuple[int, VehicleState, np.ndarray] | None:
    """`_first`, a few at a time."""
    for at in range(0, len(some), AT_ONCE):
        found = _first(some[at : at + AT_ONCE], commands, cloud, room, state, tick)
        if found:
            return found
    return None


def _first(
    some: list[int],
    commands: Callable[[int], np.ndarray],
    cloud: Cloud,
    room: Room,
    state: VehicleState,
    tick: int,
) -> tuple[int, VehicleState, np.ndarray] | None:
    """The first of the pieces that is allowed, the cloud after it and its poses (L, T, 3)."""
    u = np.stack([commands(k) for k in some])
    after, during = cloud.drive(state, u, tick)
    coast = np.zeros((len(some), round(COAST_S * cloud.rate_hz), u.shape[2]))
    _, eta = cloud.drive(after, coast, tick + u.shape[1])
    whole = np.concatenate([during, eta], axis=2)
    past = np.sort(np.max(np.abs(whole[..., :2]) - room.free, axis=(2, 3)), axis=1)
    each = 2.0 * past[:, -1] - past[:, -BEYOND] <= 0.0
    fits = np.flatnonzero(each & allowed(whole, room, cloud.rate_hz))
    if not len(fits):
        return None
    k = int(fits[0])
    return some[k], chosen_state(after, k, cloud.size), during[k]
