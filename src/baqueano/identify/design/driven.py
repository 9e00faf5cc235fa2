"""The composition, driven: what its pieces carry into each other, and what takes the place of those that leave.

A piece ends before the vehicle quite rests, and the composition does not see what that does to the next one. So
the plan is driven once, piece by piece, by vehicles that had no part in its search, with their noise:

    allowed(x, piece)  ⇔  all under (piece, then no command for COAST_S) inside                           (1)

by the rule of inside.py. A piece that is not allowed waits, and one that would come later has its turn. Where none of
them is allowed either, one of the library takes its place: that which is worth most beside all the others, then those
that keep nearer to where they begin; last comes the first of the library, to stand still, which is the rest of what
was checked before.
"""

from collections.abc import Callable

import numpy as np

from baqueano.identify.design.belief import Cloud
from baqueano.identify.design.compose import Composer
from baqueano.identify.design.inside import first_allowed
from baqueano.identify.design.room import Room
from baqueano.vehicles import VehicleState

PRICES = (1.0, 5.0, 25.0)  # in J, for a whole room of reach, by which those that are tried are ordered
TRIED = 6  # for each of these prices, and pieces driven at once


def driven(
    composer: Composer,
    order: list[int],
    commands: Callable[[int], np.ndarray],
    cloud: Cloud,
    room: Room,
    rest: int,
) -> list[int]:
    """The pieces that the vehicles of `cloud` may drive one after the other where those of `order` were meant, after
    `rest` ticks of standing still; `commands` gives (T, n) of a piece.  (1)"""
    state, tick, chosen = cloud.at(room.start), rest, list(order)
    if rest:
        state, _ = cloud.drive(state, np.zeros((rest, commands(0).shape[1])))
    for place in range(len(chosen)):
        at = commands, cloud, room, state, tick
        later = list(dict.fromkeys(chosen[place:]))
        found = _first(later[:1], *at) or _first(later[1:], *at)
        if found:
            chosen.insert(place, chosen.pop(chosen.index(found[0], place)))
        else:
            others = composer.instead(chosen, place, state.eta[: composer.path.shape[1]], PRICES, TRIED)
            found = _first([*others, 0], *at)
        chosen[place], state = found or (0, cloud.drive(state, commands(0), tick)[0])
        tick += len(commands(0))
    return chosen


def _first(
    some: list[int],
    commands: Callable[[int], np.ndarray],
    cloud: Cloud,
    room: Room,
    state: VehicleState,
    tick: int,
) -> tuple[int, VehicleState] | None:
    """The first of the pieces that is allowed, and the cloud after it."""
    for at in range(0, len(some), TRIED):
        us = [commands(k) for k in some[at : at + TRIED]]
        found = first_allowed(cloud, room, state, us, tick)
        if found:
            return some[at + found[0]], found[1]
    return None
