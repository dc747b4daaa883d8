"""Parameters that a fit had to shift away from what is stated of them.

A baseline that may re-tune its numbers can leave as little as the extended model does. What shows
then that something is missing is where its numbers went.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impactscope.discrepancy.impact.findings.estimates import label_of, unit_of
from impactscope.discrepancy.impact.fits.least_squares import Fit

__all__ = ['ShiftedParameter', 'shifted_parameters', 'shifted_parameters_told']

_FAR = 4.0  # standard deviations of what is stated
_NAMED = 3  # in the sentence


@dataclass(frozen=True, slots=True)
class ShiftedParameter:
    """A number whose fitted value what is stated of it all but rules out.

    ``value``, ``stated`` and ``std`` in ``unit``; ``pull`` is their distance over ``std``.
    """

    label: str
    value: float
    stated: float
    std: float
    unit: str

    @property
    def pull(self) -> float:
        """Standard deviations from what is stated, with sign."""
        return (self.value - self.stated) / self.std


def shifted_parameters(fitted: Fit, least: float = _FAR) -> tuple[ShiftedParameter, ...]:
    """Numbers at least ``least`` standard deviations from what is stated, farthest first."""
    model, layout = fitted.model, fitted.layout
    values = fitted.values
    pulls = model.prior_residuals(values, layout)
    names = [b.name for b in model.data.blows]
    found = []
    for j in np.argsort(-np.abs(pulls)):
        number, pull = model.free[j], float(pulls[j])
        if number.prior is None or not abs(pull) >= least:
            continue
        value, std = values[number.key], number.prior[1]
        found.append(
            ShiftedParameter(
                label_of(number, names), value, value - pull * std, std, unit_of(number.key)
            )
        )
    return tuple(found)


def shifted_parameters_told(baseline: Fit, extended: Fit) -> tuple[str, ...]:
    """What the baseline had to bend and the extended model does not, in a sentence."""
    still = {b.label for b in shifted_parameters(extended)}
    bent = [b for b in shifted_parameters(baseline) if b.label not in still]
    if not bent:
        return ()
    more = f' and {len(bent) - _NAMED} more' if len(bent) > _NAMED else ''
    return (
        'The baseline comes as near as the table says only with numbers that contradict what is '
        f'stated: {_listed(bent[:_NAMED])}{more}. With what was found they agree.',
    )


def _listed(bent: Sequence[ShiftedParameter]) -> str:
    return '; '.join(
        f'{b.label} {b.value:.4g} for {b.stated:.4g} ± {b.std:.2g}'
        + ('' if b.unit == '1' else f' {b.unit}')
        for b in bent
    )
