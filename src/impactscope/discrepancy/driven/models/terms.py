"""A candidate effect as the search sees it: its numbers, its words, what it excludes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ['Number', 'Term', 'key']


@dataclass(frozen=True, slots=True)
class Number:
    """One unknown, in SI units.

    ``starts``: values from which a fit sets out. ``scale``: a change that matters, by which the
    optimiser measures.
    """

    name: str
    unit: str
    starts: tuple[float, ...]
    scale: float
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True, slots=True)
class Term:
    """One effect that may be missing.

    ``name`` is that of the vocabulary; ``variant`` tells forms of the same effect apart.
    ``excludes``: names of effects that cannot stand beside it because they say the same.
    ``fixed``: what is entered beside the fitted numbers. ``restart``: values of the baseline's
    numbers to set out from, where the effect gives them another meaning. ``output``: it acts in
    the measuring chain of the output. ``amounts``: numbers that say how much of it there
    is; with a stroke before one, the less of it the larger that is. ``own``: numbers that
    the recordings have of their own, in all, which are found with every prediction. ``looks``:
    independent places in which it is looked for. ``rough``: single events make its slopes so rough
    that a start is improved without them first. ``listed``: whether others know its name; what
    is not is told as unknown.
    """

    name: str
    subsystem: str
    sentence: str
    equation: str
    source: str
    test: str
    numbers: tuple[Number, ...] = ()
    variant: str = ''
    excludes: frozenset[str] = frozenset()
    fixed: Mapping[str, float] | None = None
    channel: str = ''
    restart: Mapping[str, float] | None = None
    output: bool = False
    amounts: tuple[str, ...] = ()
    own: int = 0
    looks: float = 1.0
    rough: bool = False
    listed: bool = True

    @property
    def label(self) -> str:
        """Name and variant, unique among the candidates of a search."""
        return f'{self.name}/{self.variant}' if self.variant else self.name

    @property
    def told_name(self) -> str:
        """Name in the vocabulary that others know."""
        return self.name if self.listed else 'unknown'

    def stands_with(self, other: Term) -> bool:
        """Whether both may be in one model."""
        if self.name == other.name:
            return False
        return other.name not in self.excludes and self.name not in other.excludes


def key(term: Term, number: Number) -> str:
    """Name of a term's number among all numbers of a model."""
    return f'{term.label}.{number.name}'
