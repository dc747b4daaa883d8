"""A push that lasts beyond the impact."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.PUSH_FORCE] = values['force']
    vector[at.PUSH_START] = values['start']
    vector[at.PUSH_RISE] = values['rise']
    vector[at.PUSH_HOLD] = values['hold']
    vector[at.PUSH_FALL] = values['fall']


MECHANISM = Mechanism(
    name='external_push',
    subsystem=Subsystem.IMPACTOR,
    sentence='Something pushes on after the impact: a robot that does not stop at once.',
    equation='F rising linearly from start, held, then falling',
    parameters=(
        Parameter('force', 'N', -1000.0, 1000.0, (5.0, 50.0), absent=0.0, logarithmic=False),
        Parameter('start', 's', 0.0, 10.0, (0.0, 0.02), default=0.0, logarithmic=False),
        Parameter('rise', 's', 1e-5, 10.0, (0.01, 0.1), default=0.01),
        Parameter('hold', 's', 0.0, 1e6, (0.3,), default=1e6),
        Parameter('fall', 's', 1e-5, 10.0, (0.1,), default=0.1),
    ),
    source='ISO/TS 15066 clamping: transient contact followed by quasi-static contact',
    test='force after the first peak: it stays up, or is longer than the mass explains',
    enter=_enter,
    needs=frozenset({'impactor'}),
    kin=('gravity_load', 'restoring_force'),
    alone_in=('robot',),
)
