"""The page of an answer."""

from __future__ import annotations

import numpy as np

from impactscope.discrepancy.answer import (
    Answer,
    Finding,
    FitFigures,
    FitTable,
    Mismatch,
    ParameterEstimate,
    Region,
    Trace,
)
from impactscope.report.explain_report import render_explanation, write_explanation


def made(name: str = 'hit0.mcap') -> Answer:
    rng = np.random.default_rng(1)
    time = np.arange(2000) / 1e4
    clean = 100 * np.exp(-20 * time) * np.sin(200 * time)
    measured = clean + 0.4 * rng.standard_normal(2000)
    traces = tuple(
        Trace(name, channel, 'N', held, 0.4, time, measured, 0.9 * clean, clean, clean, clean)
        for channel, held in (('force', False), ('acceleration.plate', False))
    )
    finding = Finding(
        'coulomb_friction',
        0.98,
        'guide',
        {'force': ParameterEstimate(1.5, 0.02, 'N')},
        ('stribeck_friction',),
        sentence='Dry friction holds the plate.',
        equation='F sign(v)',
    )
    return Answer(
        'bench <1>',
        'impact',
        Mismatch(True, 1e-12, (Region(name, 'force', 0.01, 0.05, 'loading'),), ('guide',)),
        ('coulomb_friction',),
        (finding,),
        FitTable(FitFigures({'force': 3.0}), FitFigures({'force': 0.4}), {'force': 0.4}),
        next_tests=('Tap harder.',),
        traces=traces,
    )


def test_page_holds_answer_figures_and_tables():
    page = render_explanation(made())
    for words in ('Dry friction holds', 'F sign(v)', 'stribeck friction', 'Tap harder.'):
        assert words in page
    assert page.count('class="figure"') >= 8
    assert 'bench &lt;1&gt;' in page


def test_names_of_recordings_are_escaped():
    assert '<img' not in render_explanation(made('<img src=x>'))


def test_nothing_missing_is_said_first():
    page = render_explanation(Answer('bench', 'impact', Mismatch(False, 1.0)))
    assert 'Nothing is missing' in page
    assert 'Nowhere beyond the noise' in page


def test_page_is_written_whole(tmp_path):
    target = tmp_path / 'answer.html'
    write_explanation(made(), target)
    assert target.read_text(encoding='utf-8') == render_explanation(made())
