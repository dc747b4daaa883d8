"""One thing that can be concealed, and how such things are described."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .measurement import noise_free
from .scenario import STRIKES, Scenario

__all__ = [
    'DRY_FRICTIONS',
    'Aux',
    'Effect',
    'always',
    'axial',
    'bench_effect',
    'largest',
    'mechanical',
    'sprung',
    'struck',
    'swung',
    'with_layer',
]

DRY_FRICTIONS = ('coulomb_friction', 'asymmetric_friction', 'stribeck_friction')
"""Laws of one kind: the first is what is left where the others' further numbers tell nothing."""

Aux = Mapping[str, float | str]
Drawn = dict[str, float | str]
Setup = Callable[[np.random.Generator, Scenario], Drawn]
Shapes = Callable[[Scenario], Sequence[Drawn]]
Recipe = Mapping[str, float | str]


def always(_scenario: Scenario) -> bool:
    """Fits every campaign."""
    return True


def mechanical(scenario: Scenario) -> bool:
    """Whether anything moves in this campaign."""
    return scenario.kind != 'chain'


def axial(scenario: Scenario) -> bool:
    """Whether this is an axis in closed loop, which has no spring."""
    return scenario.kind == 'closed_loop'


def sprung(scenario: Scenario) -> bool:
    """Whether something moves against a spring."""
    return mechanical(scenario) and not axial(scenario)


def struck(scenario: Scenario) -> bool:
    """Whether an impactor strikes in this campaign."""
    return any(b.kind in STRIKES for b in scenario.blows)


def swung(scenario: Scenario) -> bool:
    """Whether the impactor is the pendulum."""
    return any(b.kind == 'pendulum' for b in scenario.blows)


def with_layer(scenario: Scenario) -> bool:
    """Whether it strikes a damper layer."""
    return struck(scenario) and scenario.layer is not None


def _unchanged(scenario: Scenario) -> Scenario:
    return scenario


def _nothing(_rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {}


def _none(_scenario: Scenario) -> Sequence[Drawn]:
    return ()


@dataclass(frozen=True)
class Effect:
    """One thing that can be concealed; strength 0 is its absence."""

    name: str  # in the answers
    subsystem: str
    apply: Callable[[Scenario, float, Aux], Scenario]
    low: float  # strengths among which the wanted d' is sought
    high: float
    parameters: Callable[[float, Aux], Drawn]
    setup: Setup = _nothing  # what is drawn beside the strength
    shapes: Shapes = _none  # what is tried as a look-alike; none: what is drawn
    fits: Callable[[Scenario], bool] = always
    prepare: Callable[[Scenario], Scenario] = _unchanged  # what the baseline lacks
    variant: str = ''  # tells effects of the same name apart
    family: str = 'library'  # library, parameter, label, outside, or look-alike: never drawn
    tunable: bool = True

    @property
    def key(self) -> str:
        """Unique name."""
        return f'{self.name}:{self.variant}' if self.variant else self.name


def largest(scenario: Scenario, channel: str) -> float:
    """Largest size of a channel's values in the campaign, in its unit."""
    return max(float(np.abs(noise_free(b, scenario)[channel]).max()) for b in scenario.blows)


def cooked(recipe: Recipe, strength: float, aux: Aux) -> dict[str, float]:
    """Values of a recipe: a number times the strength, 'strength * name', or 'name' as drawn."""
    values = {}
    for key, term in recipe.items():
        if not isinstance(term, str):
            values[key] = term * strength
        elif term.startswith('strength * '):
            values[key] = strength * float(aux[term.removeprefix('strength * ')])
        else:
            values[key] = float(aux[term])
    return values


def bench_effect(
    name: str,
    subsystem: str,
    fields: Recipe,
    parameters: Recipe,
    span: tuple[float, float],
    *,
    setup: Setup = _nothing,
    shapes: Shapes = _none,
    fits: Callable[[Scenario], bool] = mechanical,
    family: str = 'library',
    variant: str = '',
) -> Effect:
    """An effect that lives in fields of the bench.

    Args:
        name: in the vocabulary of answers.
        subsystem: likewise.
        fields: what it sets, as a recipe of :func:`cooked`.
        parameters: what the answer tells of it, as a recipe.
        span: least and largest strength.
        setup: draws what stands in the recipes by name.
        shapes: such draws that stand for all of them, where it may look like something else.
        fits: which campaigns it can be concealed in.
        family: library, outside or look-alike.
        variant: tells it apart from others of the same name.
    """

    def apply(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
        change = cooked(fields, strength, aux)
        return scenario.with_bench(lambda _: change)

    def told(strength: float, aux: Aux) -> Drawn:
        return {**cooked(parameters, strength, aux)}

    return Effect(
        name,
        subsystem,
        apply,
        *span,
        told,
        setup=setup,
        shapes=shapes,
        fits=fits,
        family=family,
        variant=variant,
    )
