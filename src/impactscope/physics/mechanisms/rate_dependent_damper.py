"""A further Maxwell branch of the layer."""

from __future__ import annotations

from impactscope.errors import ConfigurationError
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    if values['stiffness'] == 0:
        return
    count = int(vector[at.BRANCHES])
    if count == at.MAX_BRANCHES:
        raise ConfigurationError(
            f'rate_dependent_damper: the layer has {count} branches already, no more fit'
        )
    vector[at.BRANCH + 2 * count] = values['stiffness']
    vector[at.BRANCH + 2 * count + 1] = values['damping']
    vector[at.BRANCHES] = count + 1


MECHANISM = Mechanism(
    name='rate_dependent_damper',
    subsystem=Subsystem.DAMPER,
    sentence=(
        'The damper layer relaxes at a rate that the model lacks: a further spring '
        'and dashpot in series act in it.'
    ),
    equation="f = k_b (u - z), c_b z' = f",
    parameters=(
        Parameter('stiffness', 'N/m', 0.0, 1e7, (5e3, 3e4), absent=0.0),
        Parameter('damping', 'N s/m', 1e-4, 1e8, (30.0, 300.0, 3e4), with_strength=True),
    ),
    source='generalised Maxwell model; paper eq. 11 to 14',
    test='blows at several speeds with the damper, and compression tests at several rates',
    enter=_enter,
    needs=frozenset({'damper'}),
    kin=('stiffening_damper',),
)
