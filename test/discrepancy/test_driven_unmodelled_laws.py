"""Laws beyond the vocabulary, and lines in the spectrum of what is left."""

from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.driven.adequacy import unmodelled_laws as module
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import (
    LOOKS,
    Group,
    UnmodelledLaw,
    _of_many,
    unmodelled_laws,
    verdict,
)
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Number
from impactscope.discrepancy.driven.noise.spectral_whitening import stepped, whitening

SAMPLES, PERIOD, STEP = 4000, 1e-3, 1e-3


NO_TERMS = SimpleNamespace(terms=())


def left(size):
    """What two recordings of a coarse encoder leave that hunts at 31 Hz at rest."""
    rng = np.random.default_rng(2)
    time = PERIOD * np.arange(SAMPLES)
    hunting = [size * np.sin(2.0 * np.pi * 31.0 * time + phase) for phase in (0.3, 2.0)]
    return [x + 0.3 * STEP * rng.standard_normal(SAMPLES) for x in hunting]


def lines(residuals, filters):
    return beside(residuals, filters, ())


def beside(residuals, filters, laws):
    segments = [
        Segment(f'r{i}', 'x', 'm', False, 0.0, PERIOD, r, np.zeros(0), whitener=f)
        for i, (r, f) in enumerate(zip(residuals, filters, strict=True))
    ]
    none = np.zeros(0)
    made = Fit((), {}, {}, (none, none), tuple(residuals), 0)
    model = SimpleNamespace(numbers=(), terms=(), starts=lambda _: (), drifts=True)
    return unmodelled_laws(lambda *_: iter(laws), model, made, segments)


def test_a_line_in_the_spectrum_is_told():
    white = whitening(np.full(1025, (0.3 * STEP) ** 2))
    strongest = lines(left(0.2 * STEP), [white, white])[0]
    assert strongest.law.startswith('a line at 31')
    assert strongest.p_value < 1e-6


@pytest.mark.parametrize('coarse', [0, 1])
def test_no_line_is_sought_where_an_encoder_steps(coarse):
    """At rest it goes to and fro between two readings: a line of its own rounding."""
    residuals = left(0.2 * STEP)
    white = whitening(np.full(1025, (0.3 * STEP) ** 2))
    steps = stepped(STEP * np.rint(residuals[coarse] / STEP), 0.4 * STEP, STEP)
    assert steps is not None
    assert lines(residuals, [steps, white] if coarse == 0 else [white, steps]) == []


@pytest.mark.parametrize(('levels', 'differ'), [((0.1, 0.1), False), ((0.1, -0.1), True)])
def test_what_is_alike_in_all_recordings_does_not_differ_between_them(levels, differ):
    """One of them that a held-out recording contradicts is nothing of which each has its own."""
    rng = np.random.default_rng(3)
    white = whitening(np.full(1025, 1.0))
    ones = np.ones(SAMPLES)
    rows = [np.kron(unit, ones) for unit in np.eye(2)]
    law = Group('an offset that differs between recordings', rows, differs=True)
    found = beside([x + rng.standard_normal(SAMPLES) for x in levels], [white, white], [law])
    assert any(f.law == law.law for f in found) is differ


def test_few_samples_do_not_make_a_law():
    residual = np.zeros(1000)
    residual[500] = 8.0  # a sample in which friction turned round
    assert _of_many(residual, residual) == pytest.approx(4.0)
    residual[:] = 0.3
    assert _of_many(residual, residual) == pytest.approx(90.0)


def test_a_law_that_was_sought_among_more_pays_for_them():
    few, many = (UnmodelledLaw('swings', 30.0, 2, looks=k) for k in (LOOKS, 10 * LOOKS))
    assert many.p_value == pytest.approx(10.0 * few.p_value, rel=0.01)
    assert many.worth == pytest.approx(few.worth - 2.0 * np.log(10.0))


def fitted(labels, numbers, damping=0.1):
    """A fit with effects of these labels and that many numbers of theirs, one a damping ratio."""
    ratio = Number('damping_ratio', '1', (0.05,), 0.01, 0.0, 0.3)
    terms = tuple(
        SimpleNamespace(label=label, rough=False, name=label, numbers=(ratio,)) for label in labels
    )
    values = {f'{label}.damping_ratio': damping for label in labels}
    return Fit(terms, values, {}, (np.zeros(0),), (np.zeros(0),), numbers)


def decided(monkeypatch, gains, gain, labels, numbers, damping=0.1):
    """Verdict where a law gains this much alone and beside what has the labels and gains."""
    names = 'what seems to be at work', 'what is left'
    alone, beside = (UnmodelledLaw(n, x, 1) for n, x in zip(names, gains, strict=True))
    none, best = fitted((), 0), fitted(labels, numbers, damping)
    monkeypatch.setattr(
        module,
        'unmodelled_laws',
        lambda _laws, _model, made, _: [alone if made is none else beside],
    )
    segments = [SimpleNamespace(held_out=False)]
    return verdict(None, NO_TERMS, none, best, (gain, gain), segments)


@pytest.mark.parametrize(('tried', 'left'), [(50, True), (LOOKS, False)])
def test_the_best_of_few_laws_need_not_be_as_good_as_that_of_many(monkeypatch, tried, left):
    """A chain has fifty laws beyond the library, an axis hundreds."""
    law = UnmodelledLaw('an echo', 19.0, 1, tried=tried)
    monkeypatch.setattr(module, 'unmodelled_laws', lambda *_: [law])
    none = fitted((), 0)
    model = SimpleNamespace(terms=())
    said = verdict(None, model, none, none, (0.0, 0.0), [SimpleNamespace(held_out=False)])
    assert said.left is left


@pytest.mark.parametrize(('known', 'left'), [((), True), (('rate_dependent_damper',), False)])
def test_what_the_search_has_not_believed_is_nothing_unknown(monkeypatch, known, left):
    """A mechanism of the library is held to the search's own threshold, which is stricter."""
    law = UnmodelledLaw('a force that relaxes', 26.0, 1, case_of='rate_dependent_damper')
    weak = UnmodelledLaw('a stiffness that swings', 4.0, 2)
    monkeypatch.setattr(module, 'unmodelled_laws', lambda *_: [law, weak])
    none = fitted((), 0)
    model = SimpleNamespace(terms=[SimpleNamespace(name=name) for name in known])
    said = verdict(None, model, none, none, (0.0, 0.0), [SimpleNamespace(held_out=False)])
    assert said.left is left


def test_one_law_as_good_as_two_effects_is_the_likelier_one(monkeypatch):
    """Each of two was chosen among many; a single one must be far behind."""
    said = decided(monkeypatch, (410.0, 5.0), 420.0, ('base_compliance', 'clock_error'), 4)
    assert said.left
    assert said.instead
    assert said.probability > 0.9
    alone = decided(monkeypatch, (410.0, 5.0), 412.0, ('hysteresis',), 2)
    assert not alone.left


@pytest.mark.parametrize(('gain', 'instead'), [(7.0, False), (70.0, True)])
def test_a_law_that_nothing_shows_is_not_in_the_place_of_what_held_out_recordings_show(
    monkeypatch, gain, instead
):
    """A saturation that one held-out recording alone reaches explains nothing of the others.

    Its limit is then at the end of what the others leave open.
    """
    said = decided(monkeypatch, (gain, gain), 0.4, ('saturation',), 1, damping=0.2999999)
    assert said.instead is instead
    assert said.left is instead


@pytest.mark.parametrize(('damping', 'instead'), [(0.1, False), (0.0, False), (0.2999999, True)])
def test_a_finding_at_the_end_of_what_is_credible_is_not_the_likelier_one(
    monkeypatch, damping, instead
):
    """A damping of fractional order looks like a base that creeps."""
    said = decided(monkeypatch, (49.0, 5.0), 49.0, ('base_compliance',), 3, damping)
    assert said.instead is instead


@pytest.mark.parametrize(
    ('others', 'instead'),
    [
        ({'a further mode at 12 Hz': 409.5, 'a further mode at 6.2 Hz': 380.0}, True),
        ({'a further mode at 12 Hz': 409.5, 'a further mode at 6.2 Hz': 406.0}, False),
        ({'a line at 3 Hz': 409.0}, True),
    ],
)
def test_a_resonance_that_may_be_anywhere_is_not_the_law_of_two_effects(
    monkeypatch, others, instead
):
    """Above all motion it is a stiffness and a delay, whichever frequency it is given."""
    mode = UnmodelledLaw('a further mode at 10.9 Hz', 410.0, 1)
    listed = [mode, *(UnmodelledLaw(name, gain, 1) for name, gain in others.items())]
    none, best = fitted((), 0), fitted(('restoring_force', 'clock_error'), 4)
    left = UnmodelledLaw('a stiffness that swings', 5.0, 2)
    monkeypatch.setattr(module, 'unmodelled_laws', lambda *a: listed if a[2] is none else [left])
    segments = [SimpleNamespace(held_out=False)]
    said = verdict(None, NO_TERMS, none, best, (420.0, 420.0), segments)
    assert said.instead is instead
    assert said.left is instead


def test_two_effects_that_tell_more_than_a_law_stay(monkeypatch):
    said = decided(monkeypatch, (410.0, 5.0), 450.0, ('base_compliance', 'clock_error'), 4)
    assert not said.left


@pytest.mark.parametrize('found', ['rate_dependent_damper', 'low_pass_filter'])
@pytest.mark.parametrize(('case_of', 'instead'), [('', True), ('rate_dependent_damper', False)])
def test_a_mechanism_with_one_number_held_is_no_law_in_its_place(
    monkeypatch, case_of, instead, found
):
    """A rate that was tried may be the true one: its law has one number fewer.

    So it has where the search took a delay, which does the same, for the likelier one.
    """
    law = UnmodelledLaw('a force that relaxes', 2000.0, 1, case_of=case_of)
    other = UnmodelledLaw('a stiffness that swings', 2.0, 8)
    none, best = fitted((), 0), fitted((found,), 4)
    model = SimpleNamespace(terms=[SimpleNamespace(name='rate_dependent_damper')])
    monkeypatch.setattr(
        module,
        'unmodelled_laws',
        lambda _laws, _model, made, _: [law, other] if made is none else [other],
    )
    segments = [SimpleNamespace(held_out=False)]
    said = verdict(None, model, none, best, (2002.0, 2002.0), segments)
    assert said.instead is instead


@pytest.mark.parametrize(('beside', 'instead'), [(30.0, True), (95.0, False)])
def test_a_law_stands_beside_what_explains_far_more_with_it(monkeypatch, beside, instead):
    """Friction that fades: the fading alone looks better than the friction alone."""
    said = decided(monkeypatch, (600.0, beside), 570.0, ('coulomb_friction',), 1)
    assert said.left
    assert said.instead is instead


@pytest.mark.parametrize(('sought', 'tried'), [(0, 2), (100, 102), (5000, LOOKS)])
def test_a_law_counts_those_that_were_tried_and_those_of_which_it_is_the_best(sought, tried):
    rng = np.random.default_rng(4)
    white = whitening(np.full(1025, 1.0))
    law = Group('a stiffness that swings', [rng.standard_normal(2 * SAMPLES)], sought=sought)
    found = beside([rng.standard_normal(SAMPLES) for _ in range(2)], [white, white], [law])
    assert next(f for f in found if f.law == law.law).among_tried.looks == tried
