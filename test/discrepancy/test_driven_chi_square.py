"""Chi-square as the judge: what is believed, and what is not whatever it gains."""

from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection import chi_square as module
from impactscope.discrepancy.driven.model_selection.chi_square import (
    BETWEEN,
    NoiseJudge,
    degenerate,
)
from impactscope.discrepancy.driven.model_selection.model_comparison import Gain
from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import key


def test_a_coupling_that_does_not_fade_within_a_recording_is_a_level_of_each():
    terms = channel_terms('acceleration', 'm/s^2', 1000.0, 2.0, 0.1, 50.0, recordings=4)
    (running,) = (t for t in terms if t.name == 'ac_coupling' and t.own)
    (corner,) = running.numbers

    def made(value):
        return SimpleNamespace(terms=(running,), values={key(running, corner): value})

    assert degenerate(made(corner.lower))
    assert not degenerate(made(2.0 * corner.lower))


def test_numbers_that_all_recordings_share_may_be_as_small_as_they_like():
    terms = channel_terms('acceleration', 'm/s^2', 1000.0, 2.0, 0.1, 50.0, recordings=4)
    for term in terms:
        if not term.own:
            values = {key(term, n): n.lower for n in term.numbers}
            assert not degenerate(SimpleNamespace(terms=(term,), values=values))


@pytest.mark.parametrize(
    ('gain', 'numbers', 'believed', 'in_its_place'),
    [
        (8.0, 2, False, False),
        (15.0, 2, False, True),  # chance gives 11.6 in 3 of 1000 cases, the best of sixty 19.8
        (30.0, 2, True, True),
        (10.0, 1, False, True),  # 8.8 and 17
    ],
)
def test_a_law_that_contains_another_one_has_that_one_to_beat(
    monkeypatch, gain, numbers, believed, in_its_place
):
    """No others were looked at in its place; of sixty effects the best gains more by chance."""
    judge = NoiseJudge([])
    plain = SimpleNamespace(terms=(), values={})
    law = SimpleNamespace(terms=(), values={})
    more = Gain(gain, 0.0, False, numbers, 1e4)
    monkeypatch.setattr(judge, 'gain', lambda *_: more)
    monkeypatch.setattr(judge, 'worth', lambda *_: more)
    monkeypatch.setattr(module, 'reduced', lambda *_: 1.0)
    assert judge.better(plain, law) is believed
    assert judge.fuller(plain, law) is in_its_place


def test_what_chance_takes_of_the_noise_is_for_belief_and_not_between_laws():
    """Friction holds a mass against the force's noise, by which it may gain more than usual."""
    segments = [
        SimpleNamespace(
            measured=np.zeros(100),
            held_out=held,
            channel='a',
            whitener=True,
            whitened=lambda residual: residual,
        )
        for held in (False, True)
    ]

    def left(size, label):
        term = SimpleNamespace(label=label, looks=1.0, name=label, own=False, rough=False)
        terms = (term,) if label else ()
        return SimpleNamespace(
            residuals=(np.full(100, size),) * 2,
            terms=terms,
            values={},
            excused=0.0,
            added=len(terms),
            own=0,
        )

    baseline, friction = left(1.0, ''), left(0.8, 'friction')

    def judge(scatter):
        return NoiseJudge(
            segments, lambda made: (4.0, 2.0) if made.terms else (0.0, 0.0), scatter=scatter
        )

    calm, wary = judge(0.0), judge(4.0)
    # 36 less of a hundred squares, and 4 that friction took from the noise on average
    assert calm.gain(baseline, friction).fitted == pytest.approx(36.0 - 4.0)
    assert wary.criterion(friction, baseline) == pytest.approx(calm.criterion(friction, baseline))
    plain, less = calm.worth(baseline, friction), wary.worth(baseline, friction)
    assert plain.fitted - less.fitted == pytest.approx(4.0 * 2.0)
    assert plain.held_out - less.held_out == pytest.approx(4.0 * 2.0 / 2.0)


@pytest.mark.parametrize(
    ('effect', 'name', 'told'),
    [
        (170.0, 'mains_hum', True),  # the filter acts elsewhere
        (50.0, 'mains_hum', False),  # it acts at this line: its error may look like a hum
        (170.0, 'zero_drift', False),  # what has no line of its own goes by the whole
    ],
)
def test_an_error_of_a_filter_is_no_hum_where_the_filter_does_not_act(effect, name, told):
    time = np.arange(4000) / 1000.0
    noise = np.random.default_rng(2).standard_normal(time.size)
    strong, weak = 70.0 * np.sin(2 * np.pi * effect * time), 0.2 * np.sin(2 * np.pi * 50.0 * time)
    segment = Segment(
        'r.mcap',
        'acceleration.processed',
        'm/s^2',
        False,
        0.0,
        1e-3,
        strong + weak + noise,
        np.zeros((1, time.size)),
        noise=1.0,
        whitener=lambda r: r,
    )
    low_pass, added = (
        SimpleNamespace(label=n, name=n, numbers=(), rough=False, own=0, looks=1.0)
        for n in ('low_pass_filter', name)
    )
    judge = NoiseJudge([segment])
    bare = Fit((), {}, {}, (), (strong + weak + noise,), 0)
    small = Fit((low_pass,), {}, {}, (), (weak + noise,), 1)
    large = Fit((low_pass, added), {}, {}, (), (noise,), 3)
    judge.reference = bare
    assert judge.gain(bare, small).fitted * BETWEEN**2 > 800.0
    assert judge.gain(small, large).fitted > 60.0
    assert judge.better(small, large) is told
