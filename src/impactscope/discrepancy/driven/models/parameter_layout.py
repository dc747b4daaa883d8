"""Where each parameter of the oscillator stands in its vector. SI units.

Equation of motion, with u the input force (or whatever drives the system)::

    m a = u + u0 - c v - d |v| - c2 |v| v - R(x) - friction(v) - s h
    R(x) = k w + k2 w^2 + k3 w^3 + end stops,  w = x outside the gap (or sin(x - x0))
    h'   = v - g |v| h - d v |h|

On a base that gives way x and v are relative to it, and the force on the mass, but for u and u0,
acts on the base.
"""

from __future__ import annotations

from typing import Final

__all__ = ['SIZE']

MASS: Final = 0
DAMPING: Final = 1
STIFFNESS: Final = 2
SQUARE: Final = 3  # k2
CUBIC: Final = 4  # k3
QUADRATIC_DAMPING: Final = 5
KINETIC_FORWARD: Final = 6  # N while sliding towards +x
KINETIC_BACKWARD: Final = 7
STATIC_EXCESS: Final = 8  # by how much friction at rest is above that while sliding
STRIBECK_SPEED: Final = 9
GAP: Final = 10  # whole width
STOP_TRAVEL: Final = 11
STOP_STIFFNESS: Final = 12
HYSTERESIS_STIFFNESS: Final = 13  # s
HYSTERESIS_CLOSING: Final = 14  # g
HYSTERESIS_LEANING: Final = 15  # d
INPUT_OFFSET: Final = 16  # u0
SINE: Final = 17  # 1: R acts on sin(x)
SKEW_DAMPING: Final = 18  # d: c + d forwards, c - d backwards
SHARE: Final = 19  # of the stiffness that yields, in place of s, g, d: see oscillator_model.py
YIELD: Final = 20  # elongation at which it slips
STOP_ONE_WAY: Final = 21  # 1: the stop is there for x > 0 alone
BASE_MASS: Final = 22  # 0: the base is rigid
BASE_DAMPING: Final = 23
BASE_STIFFNESS: Final = 24
BASE_FREQUENCY: Final = 25  # Hz, and damping ratio: in place of damping and stiffness
BASE_RATIO: Final = 26
SINE_ZERO: Final = 27  # rad: R acts on sin(x - x0)
WEIGHT_SINE: Final = 28  # beside R: s sin(x) + c cos(x), the weight of a link on its joint
WEIGHT_COSINE: Final = 29
BASE_REACTS: Final = 30  # 1: the force acts between the base and the mass, as a drive's does
SIZE: Final = 31
