"""Modes of the bench: contact open or closed, plate stuck or sliding, and what follows which.

Compiled; a mode ends where one of its guards crosses zero, see :mod:`.integrator`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.physics.mechanisms.compiled import compiled
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.equations import (
    UNTRACKED,
    spring_region,
    stick_force,
    stick_reserves,
)

__all__ = ['LEAST_SPEED', 'SLOWEST', 'catch', 'change_mode', 'guide_after', 'slip_direction']

Array = NDArray[np.float64]

LEAST_SPEED = 1e-12
"""m/s; below this a sliding plate counts as not having turned."""
SLOWEST = 1e-3
"""m/s; a contact that begins more slowly loses as if it began at this speed."""


@compiled
def slip_direction(par: Array, y: Array, t: float, contact: int) -> int:
    """Way in which a stuck plate gives, from a state in which sticking asks for too much."""
    forward, backward = stick_reserves(par, stick_force(par, y, t, contact))
    return 1 if forward < backward else -1


@compiled
def guide_after(par: Array, t: float, y: Array, contact: int, tracked: bool) -> int:
    """Guide's mode for a state: stuck, or the direction in which the plate slides."""
    if not tracked:
        return UNTRACKED
    speed = y[at.V] - y[at.VB]
    if speed > LEAST_SPEED:
        return 1
    if speed < -LEAST_SPEED:
        return -1
    if min(stick_reserves(par, stick_force(par, y, t, contact))) >= 0.0:
        return 0
    return slip_direction(par, y, t, contact)


@compiled
def catch(par: Array, y: Array) -> None:
    """The impactor is held: its kinetic energy, and what its arm stores, are gone."""
    y[at.LOST] += 0.5 * par[at.IMPACTOR_MASS] * y[at.VP] ** 2
    y[at.VP] = 0.0
    if par[at.SECOND_MASS] > 0.0:
        y[at.LOST] += 0.5 * par[at.SECOND_MASS] * y[at.VQ] ** 2
        y[at.VQ] = 0.0


@compiled
def change_mode(
    par: Array,
    t: float,
    y: Array,
    modes: tuple[int, int, int],
    which: int,
    slips_to: int,
    tracked: bool,
) -> tuple[int, int, int, int]:
    """Modes of contact, guide and spring after guard ``which`` ended one, and the event's kind.

    A contact whose loss goes by its own speed enters that in ``par``.
    """
    contact, guide, region = modes
    if which == 0:
        if contact == at.OPEN:
            contact, kind = at.CLOSED, at.CONTACT_BEGINS
            if par[at.LOSS_BY_SPEED] > 0.0:
                approach = max(y[at.VP] - y[at.V], SLOWEST)
                par[at.CONTACT_LOSS] = par[at.LOSS_BY_SPEED] / approach
        else:
            contact, kind = at.OPEN, at.CONTACT_ENDS
            if t >= par[at.CATCH_TIME]:
                catch(par, y)
                contact = at.GONE
    elif which == 1:
        if guide == 0:
            guide, kind = slips_to, at.SLIPS
        else:
            y[at.V] = y[at.VB]
            guide = guide_after(par, t, y, contact, tracked)
            kind = at.STICKS if guide == 0 else at.REVERSES
    else:
        kind = at.SPRING_REGION
        onward = math.copysign(1e-12, y[at.V] - y[at.VB])
        region = spring_region(par, y[at.X] - y[at.B] + onward)
    if which != 1 and guide == 0:
        # a force that jumps with the mode may set a stuck plate moving
        guide = guide_after(par, t, y, contact, tracked)
    return contact, guide, region, kind
