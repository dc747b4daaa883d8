"""Backlash on an axis that no spring holds: before its load, or before the encoder.

Two masses with a gap between them: inside the gap the driven one moves alone, at its ends a stiff
contact with damping pushes and never pulls (Nordin and Gutman, Controlling mechanical systems with
backlash, Automatica 38 (2002)). Or an encoder behind a gear, which follows once the gap is taken
up: the play operator (Krasnosel'skii and Pokrovskii, Systems with Hysteresis (1989)). Or no gap at
all: a load on a belt or a shaft that pushes and pulls.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.compiled import compiled, law
from impactscope.discrepancy.driven.models.terms import Number, Term

__all__ = ['BACKLASH', 'COUPLED', 'NONE', 'backlash_terms', 'follow', 'run_with_backlash']

Array = NDArray[np.float64]

BACKLASH: Final = frozenset({'clearance/drive', 'clearance/load', 'clearance/encoder'})
COUPLED: Final = 'elastic_coupling'  # the two masses without a gap; of no library
GAPS = (3e-5, 1e-3, 1e-2)  # of the range of motion
SHARES = (0.2, 0.35, 0.5, 0.65)
NONE = -1.0  # in place of a gap, where there is none
STIFF = (50.0, 120.0)  # Hz, of the contact, to set out from
ANGLE = 0.25  # rad of the contact's oscillation in a sub-step
MOST_STEPS = 40


def backlash_terms(
    position: float, unit: str, rate: float, excludes: frozenset[str]
) -> tuple[Term, ...]:
    """Candidates.

    Args:
        position: largest.
        unit: of positions.
        rate: samples a second.
        excludes: names of laws that cannot be simulated beside them.
    """
    gaps = tuple(g * position for g in GAPS)
    gap = Number('gap', unit, gaps, gaps[0], 0.0, position)
    # wide scales: single contacts make narrow differences rough
    share = Number('load_share', '1', SHARES, 5.0, 0.02, 0.98)
    found = []
    for variant, where in (('drive', 'on the side of the drive'), ('load', 'on the load')):
        found.append(
            Term(
                'clearance',
                'guide',
                f'There is play between the drive and its load; the encoder is {where}.',
                'two masses; contact force k (|d| - gap/2) + c d/dt |d| beyond half the gap',
                'Nordin and Gutman, Automatica 38 (2002)',
                'small slow movements with reversals, with a second encoder on the load',
                (
                    gap,
                    share,
                    Number('contact_frequency', 'Hz', STIFF, 500.0, 5.0, 0.4 * rate),
                    Number('contact_damping_ratio', '1', (0.3,), 5.0, 0.0, 2.0),
                ),
                variant=variant,
                excludes=excludes,
                amounts=('gap',),
                rough=True,
            )
        )
    found.append(  # with the encoder on the drive it is a base that gives way
        Term(
            COUPLED,
            'unknown',
            'The drive moves its load through an elastic coupling, a belt or a shaft; of play '
            'between them nothing is seen. That is not in the library.',
            'two masses; coupling force k d + c d/dt d',
            'Nordin and Gutman, Automatica 38 (2002), without their gap',
            'the same movements with a second encoder on the drive',
            (
                dataclasses.replace(share, scale=0.05),
                Number('frequency', 'Hz', STIFF, 5.0, 5.0, 0.4 * rate),
                Number('damping_ratio', '1', (0.05,), 0.01, 0.0, 1.0),
            ),
            excludes=excludes | {'clearance', 'base_compliance'},
            listed=False,
        )
    )
    found.append(
        Term(
            'clearance',
            'guide',
            'There is play before the encoder: it follows once the gap is taken up.',
            'y stays while |x - y| < gap/2, then follows',
            "Krasnosel'skii and Pokrovskii, Systems with Hysteresis (1989)",
            'small slow movements with reversals',
            (gap,),
            variant='encoder',
            amounts=('gap',),
        )
    )
    return tuple(found)


@compiled
def follow(x: Array, gap: float, out: Array) -> None:
    """What an encoder behind a play of ``gap`` reads, shape (n,); from the middle of the play."""
    y = x[0]
    half = 0.5 * gap
    for i in range(x.size):
        y = min(max(y, x[i] - half), x[i] + half)
        out[i] = y


@law
def _contact(d: float, r: float, half: float, stiffness: float, damping: float) -> float:
    """Force between the masses at a distance ``d`` that grows at ``r``."""
    if half < 0.0:
        return stiffness * d + damping * r
    if d > half:
        return max(stiffness * (d - half) + damping * r, 0.0)
    if d < -half:
        return min(stiffness * (d + half) + damping * r, 0.0)
    return 0.0


@compiled
def run_with_backlash(
    p: Array, play: Array, u: Array, dt: float, x: float, v: float, out: Array
) -> None:
    """Simulate an axis with its load; Runge and Kutta's method of order 4.

    Args:
        p: mass of both, viscous damping of the drive, constant force beside the input.
        play: gap (negative: none, and they never part), share of the load, contact's natural
            frequency (Hz, of the reduced mass) and damping ratio, 1 where the encoder is on the
            load.
        u: input inside each sampling period, shape (n - 1, 2 s + 1).
        dt: sampling period, s.
        x: position at the first sample; the load is in the middle of the play.
        v: speed of both.
        out: position, speed and acceleration of the side with the encoder, shape (n, 4); filled.
    """
    half = 0.5 * play[0]
    load = play[1] * p[0]
    drive = p[0] - load
    reduced = drive * load / p[0]
    omega = 2.0 * math.pi * play[2]
    stiffness = reduced * omega**2
    damping = 2.0 * play[3] * reduced * omega
    n = out.shape[0]
    most = u.shape[1] - 1
    steps = min(max(math.ceil(omega * dt / ANGLE), 1), MOST_STEPS)
    h = dt / steps
    z, w = x, v  # of the load
    far = play[4] > 0.5
    for i in range(n):
        row = min(i, n - 2)
        force = u[row, most if i == n - 1 else 0] + p[2]
        pull = _contact(x - z, v - w, half, stiffness, damping)
        out[i, 0] = z if far else x
        out[i, 1] = w if far else v
        out[i, 2] = pull / load if far else (force - p[1] * v - pull) / drive
        out[i, 3] = 0.0
        if i == n - 1:
            break
        for j in range(steps):
            middle = u[i, min(int((j + 0.5) / steps * most + 0.5), most)] + p[2]
            q1 = _contact(x - z, v - w, half, stiffness, damping)
            a1, b1 = (middle - p[1] * v - q1) / drive, q1 / load
            v2, w2 = v + 0.5 * h * a1, w + 0.5 * h * b1
            q2 = _contact(x - z + 0.5 * h * (v - w), v2 - w2, half, stiffness, damping)
            a2, b2 = (middle - p[1] * v2 - q2) / drive, q2 / load
            v3, w3 = v + 0.5 * h * a2, w + 0.5 * h * b2
            q3 = _contact(x - z + 0.5 * h * (v2 - w2), v3 - w3, half, stiffness, damping)
            a3, b3 = (middle - p[1] * v3 - q3) / drive, q3 / load
            v4, w4 = v + h * a3, w + h * b3
            q4 = _contact(x - z + h * (v3 - w3), v4 - w4, half, stiffness, damping)
            a4, b4 = (middle - p[1] * v4 - q4) / drive, q4 / load
            x += h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0
            z += h * (w + 2.0 * w2 + 2.0 * w3 + w4) / 6.0
            v += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
            w += h * (b1 + 2.0 * b2 + 2.0 * b3 + b4) / 6.0
