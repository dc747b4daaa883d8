"""One printed number of the paper beside the number that this package computes."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Any

from impactscope.errors import InputError

__all__ = ['Basis', 'PaperRow', 'Standing', 'row']


class Basis(enum.Enum):
    """Where a computed value comes from."""

    GIVEN = 'given'  # an input of the paper: the value that this package works with
    EQUATION = 'equation'  # a closed form
    SIMULATED = 'simulated'  # an estimate from a recording that the twin made


class Standing(enum.Enum):
    """How a computed value stands to the printed one."""

    HOLDS = 'holds'  # equal to the last printed digit
    DIFFERS = 'differs'
    RECORDING = 'depends on the recording'  # noise or chance decide; ours is simulated
    NOT_PRINTED = 'not printed'  # the paper gives no number; ours stands alone


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One line of the table. ``difference`` is computed minus paper, in ``unit``."""

    id: str
    section: str
    quantity: str
    unit: str
    paper: float | None
    computed: float
    remark: str
    basis: Basis
    printed: str  # the paper's digits; empty where it prints none
    tolerance: float  # what a difference must exceed to count
    comparable: bool  # False: the value depends on a recording that is not public

    @property
    def difference(self) -> float | None:
        """Computed minus paper, in ``unit``; None where nothing is printed."""
        return None if self.paper is None else self.computed - self.paper

    @property
    def relative_difference(self) -> float | None:
        """Difference over the printed value; None where there is none or it is zero."""
        difference = self.difference
        return difference / self.paper if difference is not None and self.paper else None

    @property
    def standing(self) -> Standing:
        """Whether the computed value confirms the printed one."""
        if self.difference is None:
            return Standing.NOT_PRINTED
        if not self.comparable:
            return Standing.RECORDING
        # a rounding error of the last digit must not decide
        inside = abs(self.difference) <= self.tolerance * (1 + 1e-9)
        return Standing.HOLDS if inside else Standing.DIFFERS

    def to_json(self) -> dict[str, Any]:
        """As plain JSON values."""
        return {
            'id': self.id,
            'section': self.section,
            'quantity': self.quantity,
            'unit': self.unit,
            'paper': self.paper,
            'computed': self.computed,
            'difference': self.difference,
            'remark': self.remark,
            'basis': self.basis.value,
            'standing': self.standing.value,
        }


def row(
    identity: str,
    quantity: str,
    unit: str,
    printed: str,
    computed: float,
    remark: str = '',
    *,
    basis: Basis = Basis.EQUATION,
    tolerance: float | None = None,
    comparable: bool = True,
) -> PaperRow:
    """Build a row; ``identity`` is ``section:name``, ``printed`` the paper's digits or ''.

    Without ``tolerance`` half a unit of the last printed digit is granted; a given value must
    agree. Where it is noise or chance that makes the printed value, ``comparable`` is False. The
    remark of a simulated row says so. Raises InputError for a computed value that is
    not finite or an identity without section.
    """
    section, colon, name = identity.partition(':')
    if not (section and colon and name):
        raise InputError(f'row {identity!r} is not named section:name')
    if not math.isfinite(computed):
        raise InputError(f'row {identity!r}: the computed value is {computed!r}')
    if basis is Basis.SIMULATED and 'simulated' not in remark:
        remark = f'simulated: {remark}' if remark else 'simulated'
    paper = float(printed) if printed else None
    if tolerance is None:
        decimals = len(printed.partition('.')[2])
        tolerance = 1e-9 if basis is Basis.GIVEN else 0.5 * 10.0**-decimals
    return PaperRow(
        identity,
        section,
        quantity,
        unit,
        paper,
        float(computed),
        remark,
        basis,
        printed,
        tolerance,
        comparable,
    )
