"""The page of an answer: what the simulation leaves out, shown against the recordings."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from impactscope.discrepancy.answer import Answer, Finding, ParameterEstimate, Region, Trace
from impactscope.records import Estimate
from impactscope.report.explain_figures import overlay_figures, residual_spectra, state_maps
from impactscope.report.numbers import format_estimate, format_number, readable_estimate
from impactscope.report.page import render_page, write_page
from impactscope.version import __version__

__all__ = ['render_explanation', 'write_explanation']

MOST_REGIONS = 14
MOST_RECORDINGS = 4


@dataclass(frozen=True, slots=True)
class _Finding:
    title: str
    sentence: str
    equation: str
    parameters: tuple[tuple[str, str, str, str], ...]
    sure: str


@dataclass(frozen=True, slots=True)
class _Overlay:
    title: str
    anchor: str
    figures: tuple[Markup, ...]


def render_explanation(answer: Answer) -> str:
    """One self-contained HTML page for an answer; the same answer gives the same page."""
    chosen = _chosen_recordings(answer)
    overlays = [
        _Overlay(
            f'{name}{" (held out)" if traces[0].held_out else ""}',
            f'recording-{n}',
            tuple(f for t in traces for f in overlay_figures(t, answer.mismatch.regions)),
        )
        for n, (name, traces) in enumerate(chosen)
    ]
    detected = answer.mismatch.detected
    return render_page(
        'explain.html.j2',
        title=f'What the simulation leaves out: {answer.campaign}',
        answer=answer,
        verdict=_verdict(answer),
        findings=[_finding(f) for f in answer.findings],
        figures=_table(answer),
        regions=[_region(r) for r in answer.mismatch.regions[:MOST_REGIONS]],
        more_regions=max(0, len(answer.mismatch.regions) - MOST_REGIONS),
        pictures=[(o.title, o.anchor) for o in overlays],
        overlays=overlays,
        spectra=residual_spectra(answer.traces) if detected else [],
        maps=state_maps(answer.traces) if detected else [],
        ranking=[_ranked(f) for f in answer.ranking],
        numbers=_numbers(answer),
        facts=[
            ('Kind of campaign', answer.kind),
            ('The simulation has', ', '.join(answer.baseline) or 'nothing stated'),
            ('Chance of such evidence where nothing is missing', _small(answer.mismatch.p_value)),
            ('Time taken', f'{format_number(answer.duration_s, 3)} s'),
        ],
        version=__version__,
    )


def write_explanation(answer: Answer, path: str | os.PathLike[str]) -> None:
    """Write :func:`render_explanation` to ``path``; the file appears whole or not at all."""
    write_page(render_explanation(answer), Path(path))


def _verdict(answer: Answer) -> str:
    if not answer.mismatch.detected:
        return 'Nothing is missing.'
    if answer.unexplained and set(answer.accepted) - {'unknown'}:
        return 'Something is missing, and not all of it is known here.'
    if answer.unexplained:
        return 'Not known here.'
    if set(answer.accepted) <= {'wrong_parameter'}:
        return 'A number of the simulation is wrong.'
    return 'Something is missing.'


def _words(name: str) -> str:
    return name.replace('_', ' ')


def _small(p_value: float) -> str:
    return 'below 1e-9' if p_value < 1e-9 else format_number(p_value, 2)


def _finding(finding: Finding) -> _Finding:
    place = ' '.join(p for p in (finding.channel, finding.recording) if p)
    words = _words(finding.name)
    title = words[:1].upper() + words[1:] + (f', {place}' if place else '')
    rows = []
    for name, item in finding.parameters.items():
        if isinstance(item.value, str):
            rows.append((_words(name), item.value, '', ''))
        else:
            rows.append((_words(name), *readable_estimate(item.value, item.std, item.unit)))
    sure = f'Probability {finding.probability:.3g}'
    if finding.confused_with:
        others = ', '.join(_words(name) for name in finding.confused_with)
        sure += f'; these recordings cannot exclude: {others}'
    if finding.source:
        sure += f'. Source: {finding.source}'
    return _Finding(title, finding.sentence, finding.equation, tuple(rows), sure + '.')


def _table(answer: Answer) -> list[tuple[str, ...]]:
    table = answer.fit
    names = dict.fromkeys([*table.noise_floor, *table.extended.rmse])

    def cell(values: object, name: str) -> str:
        value = values.get(name, math.nan) if hasattr(values, 'get') else math.nan
        return format_number(value, 4) if math.isfinite(value) else '-'

    columns = (
        table.noise_floor,
        table.baseline.rmse,
        table.extended.rmse,
        table.baseline.held_out_rmse,
        table.extended.held_out_rmse,
    )
    return [(name, *(cell(column, name) for column in columns)) for name in names]


def _region(region: Region) -> tuple[str, ...]:
    band = '-'
    if region.band_hz is not None:
        band = ' to '.join(_frequency(f) for f in region.band_hz)
    return (
        region.recording,
        region.channel,
        _words(region.phase) or '-',
        f'{region.start_s:z.4f} to {region.end_s:z.4f}',
        band,
        format_number(region.ratio, 3),
        _state(region.state),
    )


def _state(words: str) -> str:
    """What a residual goes with, and by how much, for a narrow column."""
    share, goes, law = words.partition(' of the residual goes with ')
    return f'{law.removeprefix("its ")}, {share}' if goes else words or '-'


def _frequency(value: float) -> str:
    """Whole hertz; of slow ones three digits."""
    return f'{value:.0f}' if value >= 100.0 or value == 0.0 else f'{value:.3g}'


def _ranked(finding: Finding) -> tuple[str, ...]:
    parameters = ', '.join(
        f'{_words(name)} {item.value if isinstance(item.value, str) else f"{item.value:.4g}"}'
        for name, item in finding.parameters.items()
    )
    return (
        _words(finding.name),
        ' '.join(p for p in (finding.channel, finding.recording) if p) or finding.subsystem,
        f'{finding.probability:.3g}',
        format_number(finding.evidence, 4) if math.isfinite(finding.evidence) else '-',
        parameters,
        ', '.join(_words(name) for name in finding.confused_with) or '-',
    )


def _numbers(answer: Answer) -> list[tuple[str, tuple[str, str], tuple[str, str], str]]:
    before, after = answer.baseline_parameters, answer.extended_parameters

    def cell(item: ParameterEstimate | None) -> tuple[str, str]:
        if item is None or isinstance(item.value, str):
            return '-', ''
        return format_estimate(Estimate(item.value, item.std))

    rows = []
    for name in dict.fromkeys([*before, *after]):
        known = after.get(name) or before.get(name)
        unit = known.unit if known is not None else ''
        rows.append((name, cell(before.get(name)), cell(after.get(name)), unit))
    return rows


def _chosen_recordings(answer: Answer) -> list[tuple[str, list[Trace]]]:
    """Recordings that show most: those with the largest misfit, and one that was held out."""
    found: dict[str, list[Trace]] = {}
    for trace in answer.traces:
        found.setdefault(trace.recording, []).append(trace)

    def misfit(traces: Sequence[Trace]) -> float:
        return max(
            (
                float(((t.measured - t.baseline) ** 2).mean()) / max(t.noise_std, 1e-300) ** 2
                for t in traces
                if t.time.size
            ),
            default=0.0,
        )

    ordered = sorted(found.items(), key=lambda item: -misfit(item[1]))
    fitted = [item for item in ordered if not item[1][0].held_out][: MOST_RECORDINGS - 1]
    held_out = [item for item in ordered if item[1][0].held_out][:1]
    return fitted + held_out
