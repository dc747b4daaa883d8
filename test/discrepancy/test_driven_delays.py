"""Filters and clocks: where a search begins, what is one class, what a form leaves open."""

import dataclasses
import math
from collections import defaultdict
from types import SimpleNamespace

import pytest

from impactscope.discrepancy.answer import ParameterEstimate
from impactscope.discrepancy.driven.findings.ranking import (
    _among_forms,
    _bends_no_further,
    _confused,
    _no_surer,
    _one_form_each,
    _other_delay,
)
from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.search.joint_fits import _looked_at
from impactscope.discrepancy.driven.search.noise_limited_search import _form_of_delay, _whole_clock
from impactscope.discrepancy.driven.search.screening import Prospect, _near


@dataclasses.dataclass(frozen=True)
class Term:
    """As much of an effect as a class is told from."""

    name: str
    form: str = ''
    channel: str = 'force'

    @property
    def label(self):
        return f'{self.name}/{self.form}'

    @property
    def told_name(self):
        return self.name

    @property
    def numbers(self):
        return (SimpleNamespace(name='cutoff'),)


@dataclasses.dataclass(frozen=True, eq=False)
class Made:
    """A fit with its chi-square."""

    terms: tuple[Term, ...]
    chi_square: float
    values: dict[str, float] = dataclasses.field(default_factory=dict)


class Judge:
    """Chi-square alone."""

    def gain(self, small, large):
        return SimpleNamespace(fitted=small.chi_square - large.chi_square)

    def criterion(self, made, reference):
        return made.chi_square - reference.chi_square


FRICTION = Term('coulomb_friction')


def subject(best, *rivals):
    outcome = SimpleNamespace(best=best, rivals=rivals, baseline=Made((), 9000.0))
    return SimpleNamespace(outcome=outcome, judge=Judge())


def with_cutoff(form, chi_square, cutoff, beside=()):
    term = Term('low_pass_filter', form)
    return Made((term, *beside), chi_square, {f'{term.label}.cutoff': cutoff})


@pytest.mark.parametrize('beside', [(), (FRICTION,)])
@pytest.mark.parametrize(
    ('clock', 'alike'),
    [(1007.0, True), (1013.0, False), (990.0, True)],  # 9, and 1e-4 of 8000, decide nothing
)
def test_a_slight_difference_does_not_tell_a_filter_from_a_clock(clock, alike, beside):
    best = with_cutoff('causal-1', 1000.0, 475.0, beside)
    rival = Made((Term('clock_error'), *beside), clock)
    s = subject(best, rival)
    if beside:
        s.outcome.rivals += (Made(beside, 9000.0),)
    fits = [best, *s.outcome.rivals]
    assert _other_delay(s, best.terms[0], fits) == (('clock_error',) if alike else ())
    assert _other_delay(s, FRICTION, fits) == ()


def test_a_clock_of_another_channel_is_no_rival():
    best = with_cutoff('causal-1', 1000.0, 475.0)
    s = subject(best, Made((Term('clock_error', channel='input'),), 1000.0))
    assert _other_delay(s, best.terms[0], [best, *s.outcome.rivals]) == ()


def test_what_the_form_leaves_open_of_a_cutoff():
    best = with_cutoff('causal-1', 1000.0, 475.0)
    assert _among_forms(subject(best), best.terms[0], best) == 0.0
    rivals = with_cutoff('analogue-2', 1000.0, 775.0), with_cutoff('causal-2', 1100.0, 2000.0)
    aside = with_cutoff('causal-3', 900.0, 4000.0, (FRICTION,))  # more than the filter
    found = _among_forms(subject(best, *rivals, aside), best.terms[0], best)
    assert found == pytest.approx(math.sqrt(0.5) * 300.0, rel=1e-6)


def test_filters_without_delay_are_looked_for_in_two_orders():
    found = [t.label for t in channel_terms('c', 'N', 1e3, 1.0, 0.1, 1.0) if _looked_at(t)]
    filters = {label for label in found if label.startswith('low_pass')}
    assert filters == {
        f'low_pass_filter/{x}'
        for x in (
            'causal-2',
            'zero-1',
            'zero-2',
            'analogue-2',
            'analogue_zero-1',
            'analogue_zero-2',
        )
    }


def test_a_start_that_spoils_more_than_its_shape_may_bring_comes_last():
    term = next(iter(channel_terms('c', 'N', 1e3, 1.0, 0.1, 1.0)))
    strong = Prospect(term, {}, gain=1000.0, as_is=-1e6)
    weak = Prospect(term, {}, gain=40.0, as_is=-20.0)
    right = Prospect(term, {}, gain=30.0, as_is=25.0)
    assert sorted([strong, right, weak], key=_near, reverse=True) == [right, weak, strong]


def test_an_amount_is_no_surer_than_that_there_is_any():
    amount = ParameterEstimate(2.0, 0.01, 'N')
    assert _no_surer(amount, 25.0) == ParameterEstimate(2.0, 0.4, 'N')
    assert _no_surer(amount, 1e6) == amount


@pytest.mark.parametrize(('by_gain', 'stays'), [(20.0, False), (500.0, True)])
def test_a_gain_beside_a_far_stronger_delay_is_its_form(by_gain, stays):
    """By how much a filter far above the signal weakens it hangs on its form."""
    delay = Term('low_pass_filter')
    gain = SimpleNamespace(name='wrong_parameter', label='gain', own=False)
    both = SimpleNamespace(terms=(delay, gain))
    fits = SimpleNamespace(
        without=lambda _, rest: SimpleNamespace(terms=rest), polish=lambda made: made
    )
    judge = SimpleNamespace(
        gain=lambda less, more: _shared(by_gain if gain not in less.terms else 10_000.0)
    )
    assert (_form_of_delay(fits, both, judge) is both) is stays


def _shared(gain):
    return SimpleNamespace(fitted=0.5 * gain, held_out=0.5 * gain)


def clock(form, *numbers):
    return SimpleNamespace(
        name='clock_error',
        label=f'clock_error/{form}',
        channel='force',
        numbers=tuple(SimpleNamespace(name=n) for n in numbers),
    )


@pytest.mark.parametrize(('behind', 'both'), [(3.0, True), (9.0, False)])
def test_a_clock_that_may_be_late_or_slow_is_told_by_both(behind, both):
    """Its offset alone would say that the rate is right, to the last digit."""
    late, slow, whole = clock('late', 'offset'), clock('slow', 'drift'), clock('whole', 'o', 'd')
    made = {
        frozenset({t.label}): SimpleNamespace(terms=(t,), criterion=c, added=len(t.numbers))
        for t, c in ((late, -40.0), (slow, -40.0 + behind), (whole, -33.0))
    }
    best = made[frozenset({late.label})]
    fits = SimpleNamespace(
        model=SimpleNamespace(terms=(late, slow, whole)),
        known=made,
        baseline=None,
        make=lambda _, terms, __: made[frozenset(t.label for t in terms)],
        polish=lambda fit: fit,
    )
    judge = SimpleNamespace(criterion=lambda f, _: f.criterion, better=lambda _, __: True)
    told = _whole_clock(fits, best, judge)
    assert told.terms == ((whole,) if both else (late,))


def test_a_chosen_name_is_as_likely_as_its_likeliest_form():
    rated, plain = (
        Made((Term('clock_error', form),), c) for form, c in (('rate', 20.0), ('', 13.4))
    )
    first, second = (
        Made((Term('low_pass_filter', form),), c) for form, c in (('1', 14.0), ('2', 13.5))
    )
    judge = SimpleNamespace(criterion=lambda made, _: made.chi_square)
    subject = SimpleNamespace(judge=judge, outcome=SimpleNamespace(baseline=None))
    judged = _one_form_each(subject, [rated, plain, first, second])
    assert list(judged.items()) == [(rated, 13.4), (second, 13.5)]


def test_states_of_single_recordings_make_no_rival_the_richer_one():
    """A filter has one number and states where each recording begins and ends."""
    judge = SimpleNamespace(
        thresholds=SimpleNamespace(confusable=0.02),
        gain=lambda *_: SimpleNamespace(total=0.0),
    )

    known = defaultdict(float)

    def made(name, shared, own):
        return SimpleNamespace(
            terms=(Term(name),), added=shared + own, own=own, values=known, std=known
        )

    best = made('base_compliance', 3, 0)
    filtered, gap = made('low_pass_filter', 1, 10), made('clearance', 4, 0)
    subject = SimpleNamespace(judge=judge, case='a case', outcome=SimpleNamespace(best=best))
    names, weights = {'base_compliance'}, (0.7, 0.2, 0.1)
    found = _confused(subject, 'base_compliance', names, (best, filtered, gap), weights)
    assert found == ('low_pass_filter',)
    # of what is far less likely nothing is said
    found = _confused(subject, 'base_compliance', names, (best, filtered), (0.99, 0.01))
    assert found == ()


@pytest.mark.parametrize(
    ('name', 'amounts', 'gain', 'is_open'),
    [
        ('stribeck_friction', ('kinetic_force',), 3.0, True),
        ('stribeck_friction', ('kinetic_force',), 30.0, False),  # its shape is seen
        ('stribeck_friction', ('kinetic_force', 'speed'), 3.0, False),  # amounts alone
        ('hysteresis', ('kinetic_force',), 3.0, False),  # another law
    ],
)
def test_a_shape_of_which_nothing_is_seen_has_any_numbers(name, amounts, gain, is_open):
    numbers = tuple(SimpleNamespace(name=n) for n in ('kinetic_force', 'speed'))
    term = SimpleNamespace(name=name, numbers=numbers, amounts=amounts)
    subject = SimpleNamespace(
        outcome=SimpleNamespace(best=SimpleNamespace(terms=(Term('coulomb_friction'),))),
        judge=SimpleNamespace(gain=lambda best, made: SimpleNamespace(fitted=gain)),
    )
    assert _bends_no_further(subject, term, None) is is_open
