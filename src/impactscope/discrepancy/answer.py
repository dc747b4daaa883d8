"""The answer to a campaign: what differs, what is missing, how sure, and what to measure next.

``Answer.to_json`` gives the answer as plain data for a file; ``docs/explain.md`` describes the
form. SI units; times in s after a recording's first sample.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    'ANSWER_VERSION',
    'Answer',
    'Finding',
    'FitFigures',
    'FitTable',
    'Mismatch',
    'ParameterEstimate',
    'Region',
    'Trace',
    'held_out_alone',
    'numbers_left_open',
    'stand_ins_told',
    'suspects',
]

ANSWER_VERSION = 1
"""Version of the JSON form; raised when a field changes its meaning or goes away."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Region:
    """A place where recordings and baseline differ beyond the noise."""

    recording: str
    channel: str
    start_s: float
    end_s: float
    phase: str = ''  # as in the vocabulary: onset, loading, ..., rest
    band_hz: tuple[float, float] | None = None
    p_value: float = math.nan  # before the control of false discoveries
    ratio: float = math.nan  # rms of the residual over that of the noise
    state: str = ''  # a sentence: with what state the residual goes


@dataclass(frozen=True, slots=True)
class Mismatch:
    """Whether, where and in which subsystems recordings and baseline differ."""

    detected: bool
    p_value: float  # chance of evidence this strong where nothing is missing
    regions: tuple[Region, ...] = ()
    subsystems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """A parameter's value with its standard uncertainty; text where the unit is ``text``."""

    value: float | str
    std: float
    unit: str


@dataclass(frozen=True, slots=True)
class Finding:
    """One explanation in the ranking; accepted or not."""

    name: str  # as in the vocabulary of mechanisms
    probability: float
    subsystem: str = ''
    parameters: Mapping[str, ParameterEstimate] = field(default_factory=dict)
    confused_with: tuple[str, ...] = ()
    channel: str = ''  # of an effect of the measuring chain
    recording: str = ''  # of an effect of one recording alone, such as a wrong label
    sentence: str = ''
    equation: str = ''
    source: str = ''
    evidence: float = math.nan  # fall of chi-square against the model without it
    held_out_gain: float = math.nan  # fall of chi-square on held-out recordings


@dataclass(frozen=True, slots=True)
class FitFigures:
    """How well a model fits: RMSE by channel, in the channel's unit."""

    rmse: Mapping[str, float] = field(default_factory=dict)
    held_out_rmse: Mapping[str, float] = field(default_factory=dict)
    reduced_chi_square: float = math.nan
    held_out_reduced_chi_square: float = math.nan


@dataclass(frozen=True, slots=True)
class FitTable:
    """Before and after, beside the noise."""

    baseline: FitFigures = FitFigures()
    extended: FitFigures = FitFigures()
    noise_floor: Mapping[str, float] = field(default_factory=dict)

    @property
    def loses(self) -> bool:
        """Whether the extended model predicts what was held out worse than the baseline."""
        return (
            self.extended.held_out_reduced_chi_square > self.baseline.held_out_reduced_chi_square
        )


def stand_ins_told(names: Iterable[str]) -> tuple[str, ...]:
    """The note that some effects only stand in for an unknown one; none where there are none."""
    told = ', '.join(dict.fromkeys(names))
    if not told:
        return ()
    return (f'The extended model has {told} in the place of what is not known: no finding.',)


def suspects(findings: Sequence[Finding], relative: float) -> list[Finding]:
    """Explanations of which none is accepted, each with the others that might be meant as well.

    ``relative``: to the probability of the one, from which the other is not excluded in its place.
    """
    told = []
    for one in findings:
        least = relative * one.probability
        others = [f.name for f in findings if f.name != one.name and f.probability >= least]
        names = dict.fromkeys((*one.confused_with, *others))
        told.append(dataclasses.replace(one, confused_with=tuple(names)))
    return told


def numbers_left_open(finding: Finding) -> Finding:
    """A law that explains no more than a plainer one which it contains: any numbers would do.

    How sharply one of its minima bends says nothing of how far its numbers may go.
    """
    open_to_all = {
        name: dataclasses.replace(item, std=math.nan) for name, item in finding.parameters.items()
    }
    return dataclasses.replace(finding, parameters=open_to_all)


def held_out_alone(table: FitTable, ratio: float) -> tuple[str, ...]:
    """The test that follows where only what was held out is missed; none elsewhere.

    ``ratio``: reduced chi-square above which a recording is missed.
    """
    after = table.extended
    if not after.reduced_chi_square <= ratio < after.held_out_reduced_chi_square:
        return ()
    return (
        'What is missing shows only in recordings that were held out: fit these, too '
        '(role: fit), and hold out others.',
    )


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """Measured and simulated samples of one channel of one recording; arrays (n_samples,).

    They feed the page and stand in no JSON. ``velocity`` and ``displacement`` are the plate's
    (or the moving mass') as the extended model has them; empty where there are none.
    """

    recording: str
    channel: str
    unit: str
    held_out: bool
    noise_std: float
    time: Array
    measured: Array
    baseline: Array
    extended: Array
    displacement: Array = field(default_factory=lambda: np.zeros(0))
    velocity: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """Everything that is said of a campaign."""

    campaign: str
    kind: str
    mismatch: Mismatch
    accepted: tuple[str, ...] = ()
    ranking: tuple[Finding, ...] = ()
    fit: FitTable = FitTable()
    unexplained: bool = False
    unexplained_description: str = ''
    next_tests: tuple[str, ...] = ()
    baseline: tuple[str, ...] = ()
    baseline_parameters: Mapping[str, ParameterEstimate] = field(default_factory=dict)
    extended_parameters: Mapping[str, ParameterEstimate] = field(default_factory=dict)
    model: Mapping[str, Any] = field(default_factory=dict)  # the extended model, to be saved
    notes: tuple[str, ...] = ()  # what could not be answered, and why
    duration_s: float = math.nan
    traces: tuple[Trace, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The accepted findings, in the order of acceptance."""
        left = list(self.ranking)
        found = []
        for name in self.accepted:
            match = next((f for f in left if f.name == name), None)
            if match is not None:
                left.remove(match)
                found.append(match)
        return tuple(found)

    def summary(self) -> str:
        """The answer in a sentence or two."""
        if not self.mismatch.detected:
            return 'Nothing is missing: the baseline explains the recordings to their noise.'
        where: dict[str, list[str]] = {}
        for finding in self.findings:
            if finding.name != 'unknown':
                channels = where.setdefault(finding.sentence or finding.name, [])
                channels += [finding.channel] if finding.channel else []
        text = ' '.join(_with_channels(s, channels) for s, channels in where.items())
        if self.unexplained:
            rest = self.unexplained_description or 'Something is missing that is not known here.'
            text = f'{text} {rest}' if text else rest
        elif set(self.accepted) == {'wrong_parameter'}:
            text = f'No physics is missing, but a number of the simulation is wrong. {text}'
        return text

    def to_json(self) -> dict[str, Any]:
        """Plain data, ready for ``json.dumps``: non-finite numbers become None."""
        return {
            'version': ANSWER_VERSION,
            'campaign': self.campaign,
            'kind': self.kind,
            'summary': self.summary(),
            'mismatch': {
                'detected': self.mismatch.detected,
                'p_value': _number(self.mismatch.p_value),
                'regions': [_region(r) for r in self.mismatch.regions],
                'subsystems': list(self.mismatch.subsystems),
            },
            'accepted': list(dict.fromkeys(self.accepted)),
            'ranking': [_finding(f) for f in self.ranking],
            'fit': {
                'baseline': _figures(self.fit.baseline),
                'extended': _figures(self.fit.extended),
                'noise_floor': _numbers(self.fit.noise_floor),
            },
            'unexplained': self.unexplained,
            'unexplained_description': self.unexplained_description,
            'next_tests': list(self.next_tests),
            'baseline': list(self.baseline),
            'baseline_parameters': _parameters(self.baseline_parameters),
            'extended_parameters': _parameters(self.extended_parameters),
            'model': _plain(self.model),
            'notes': list(self.notes),
            'duration_s': _number(self.duration_s),
        }


def _number(value: float) -> float | None:
    value = float(value)
    return value if math.isfinite(value) else None


def _numbers(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: _number(value) for name, value in values.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return _number(float(value))
    return value


def _parameters(values: Mapping[str, ParameterEstimate]) -> dict[str, Any]:
    return {
        name: {'value': _plain(item.value), 'std': _number(item.std), 'unit': item.unit}
        for name, item in values.items()
    }


def _with_channels(sentence: str, channels: Sequence[str]) -> str:
    """A sentence that says in which channels it is so, where it does not already."""
    told = ', '.join(c for c in dict.fromkeys(channels) if c not in sentence)
    return f'{sentence.removesuffix(".")} ({told}).' if told else sentence


def _region(region: Region) -> dict[str, Any]:
    return {
        'recording': region.recording,
        'channel': region.channel,
        'start_s': _number(region.start_s),
        'end_s': _number(region.end_s),
        'phase': region.phase,
        'band_hz': None if region.band_hz is None else [_number(f) for f in region.band_hz],
        'p_value': _number(region.p_value),
        'ratio': _number(region.ratio),
        'state': region.state,
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        'name': finding.name,
        'probability': _number(finding.probability),
        'parameters': _parameters(finding.parameters),
        'confused_with': list(finding.confused_with),
        'subsystem': finding.subsystem,
        'channel': finding.channel,
        'recording': finding.recording,
        'sentence': finding.sentence,
        'equation': finding.equation,
        'source': finding.source,
        'evidence': _number(finding.evidence),
        'held_out_gain': _number(finding.held_out_gain),
    }


def _figures(figures: FitFigures) -> dict[str, Any]:
    return {
        'rmse': _numbers(figures.rmse),
        'held_out_rmse': _numbers(figures.held_out_rmse),
        'reduced_chi_square': _number(figures.reduced_chi_square),
        'held_out_reduced_chi_square': _number(figures.held_out_reduced_chi_square),
    }
