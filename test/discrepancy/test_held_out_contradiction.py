"""When held-out recordings contradict a finding, or speak for another one."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.evidence import Thresholds
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.explain import _met_together
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline, held_out_fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search import held_out
from impactscope.discrepancy.impact.search.outcome import Found, Outcome


def candidate_of(name):
    number = SimpleNamespace(key=f'{name}.force')
    return SimpleNamespace(
        label=name,
        name=name,
        free=(number,),
        effects=(),
        constants={},
        cost=1,
        channel='',
        hum_amplitude=lambda joint: None,
    )


def found_of(candidate, criterion, refused=False, size=100):
    model = SimpleNamespace(data=SimpleNamespace(held_out=()), free=candidate.free, effects=())
    layout = SimpleNamespace(size=size)
    fit = SimpleNamespace(chi_square=100.0, reduced=1.0, model=model, layout=layout)
    return Found(candidate, fit, -criterion, 0.0, criterion, refused)


def outcome_of(gained):
    """A finding that lowers chi-square of the fitted recordings by ``gained``."""
    model = SimpleNamespace(data=SimpleNamespace(held_out=()), free=(), effects=())
    layout = SimpleNamespace(size=100)
    friction = candidate_of('coulomb_friction')
    return Outcome(
        baseline=SimpleNamespace(chi_square=100.0 + gained, model=model, layout=layout),
        final=SimpleNamespace(chi_square=100.0, reduced=1.0, model=model, layout=layout),
        accepted=[friction],
        found={'coulomb_friction': found_of(friction, -40.0)},
        window=1.0,
    )


def formed(name, label, chi_square):
    candidate = SimpleNamespace(
        label=label,
        name=name,
        free=(),
        cost=1,
        channel='force',
        price=lambda gain, joint: 9.0,
        doubt_at=lambda values: 0.0,
    )
    form = found_of(candidate, -40.0)
    form.fit.chi_square, form.fit.values = chi_square, {}
    return form


@pytest.mark.parametrize(
    ('gained', 'worse', 'stands'),
    [
        (50.0, 8.0, True),  # chance
        (50.0, 20.0, False),
        (1000.0, 20.0, True),  # not quite right beside another effect that is missing
        (1000.0, 60.0, False),
        (-5.0, 9.5, False),  # what gains nothing has nothing allowed
    ],
)
def test_a_finding_stands_unless_predictions_get_worse(monkeypatch, gained, worse, stands):
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    monkeypatch.setattr(held_out, 'further_misfit', lambda *_: worse)
    outcome = outcome_of(gained)
    held_out.check_held_out(outcome, Thresholds(), 3)
    assert bool(outcome.accepted) is stands
    assert (outcome.final is outcome.baseline) is not stands
    assert any('contradict' in note for note in outcome.notes) is not stands


@pytest.mark.parametrize(
    ('behind', 'of_rival', 'stands'), [(1.7, 1.0, True), (1.7, 15.0, False), (12.0, 1.0, False)]
)
def test_a_rival_that_is_not_contradicted_takes_the_place_of_what_is(
    monkeypatch, behind, of_rival, stands
):
    """Of two wrong numbers that the fitted recordings do not tell apart those held out may."""
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    outcome = outcome_of(50.0)
    rival = found_of(candidate_of('hysteresis'), behind - 40.0)
    outcome.rivals['coulomb_friction'] = [rival]

    def further(before, after):
        misfit = {id(outcome.baseline): 0.0, id(rival.fit): of_rival}
        return misfit.get(id(after[0]), 16.0) - misfit.get(id(before[0]), 16.0)

    monkeypatch.setattr(held_out, 'further_misfit', further)
    held_out.check_held_out(outcome, Thresholds(), 3)
    assert [c.label for c in outcome.accepted] == (['hysteresis'] if stands else [])
    if stands:  # weighed once
        assert outcome.found['hysteresis'].criterion == pytest.approx(behind - 40.0 - 15.0)


@pytest.mark.parametrize(
    ('behind', 'worse', 'takes_its_place'),
    [
        (1.0, -5.0, True),
        (1.0, -0.5, False),
        (1.0, 5.0, False),
        (-1.0, 0.0, True),  # found to fit better after all
        (50.0, -60.0, False),  # too far behind to be looked at
    ],
)
def test_what_predicts_better_takes_the_place_of_what_explains_as_much(
    monkeypatch, behind, worse, takes_its_place
):
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    outcome = outcome_of(50.0)
    mine, rival = outcome.accepted[0], found_of(candidate_of('hysteresis'), behind - 40.0)
    outcome.rivals['coulomb_friction'] = [rival]

    def further(_before, after):
        return worse if after[0] is rival.fit else 0.0

    monkeypatch.setattr(held_out, 'further_misfit', further)
    held_out.check_held_out(outcome, Thresholds(), 3)
    assert (outcome.accepted == [rival.candidate]) is takes_its_place
    (best,) = outcome.accepted
    others = outcome.rivals[best.label]
    assert [f.candidate for f in others] == [mine if takes_its_place else rival.candidate]
    if takes_its_place:
        assert outcome.final is rival.fit
        assert outcome.found[best.label].criterion == behind - 40.0 + worse
    elif behind < 10.0:
        assert math.isclose(others[0].criterion, behind - 40.0 + worse)


@pytest.mark.parametrize(
    ('struck', 'behind', 'takes_its_place'),
    [
        (('tap', 'robot'), 12.0, True),
        (('tap', 'robot'), 30.0, False),
        (('robot', 'pendulum'), 12.0, False),
        (('drop',), 1.0, False),
    ],
)
def test_a_robot_pushes_before_it_weighs(monkeypatch, struck, behind, takes_its_place):
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    blows = [SimpleNamespace(recording=SimpleNamespace(kind=kind)) for kind in struck]
    weight = found_of(candidate_of('gravity_load'), -40.0)
    push = found_of(candidate_of('external_push'), behind - 40.0)
    for found in (weight, push):
        found.fit.model.data = SimpleNamespace(held_out=(), blows=blows)
    outcome = Outcome(weight.fit, weight.fit, [weight.candidate])
    outcome.found['gravity_load'], outcome.rivals['gravity_load'] = weight, [push]
    outcome.held_out_final = SimpleNamespace(reduced=1.0)
    held_out._by_what_strikes(outcome)
    assert (outcome.accepted == [push.candidate]) is takes_its_place
    (best,) = outcome.accepted
    assert outcome.found[best.label].criterion < outcome.rivals[best.label][0].criterion


@pytest.mark.parametrize(
    ('unforeseen', 'left', 'together', 'takes_its_place'),
    [
        (3.0, 1.2, 60.0, True),  # contradicted: a rival far behind is heard
        (3.0, 1.2, 101.0, False),  # with all recordings it is no likelier
        (3.0, 2.5, 60.0, False),  # nor does it make good what is missed
        (1.1, 2.5, 60.0, False),  # amplified only: one far behind is not looked at
    ],
)
def test_where_recordings_are_missed_rivals_are_fitted_to_all(
    monkeypatch, unforeseen, left, together, takes_its_place
):
    mine, rival = formed('wrong_parameter', 'rod', 100.0), formed('hysteresis', 'loop', 130.0)
    rival = dataclasses.replace(rival, criterion=-10.0)
    missed = SimpleNamespace(reduced=4.0, layout=SimpleNamespace(size=200))
    outcome = Outcome(mine.fit, mine.fit, [mine.candidate])
    outcome.found['rod'], outcome.rivals['rod'] = mine, [rival]
    outcome.held_out_final = missed
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: missed)
    monkeypatch.setattr(
        held_out, 'prediction_misfit', lambda f, _: unforeseen if f is mine.fit else left
    )
    monkeypatch.setattr(
        held_out,
        'fit_together',
        lambda f, *_: SimpleNamespace(
            chi_square=together if f is rival.fit else 100.0, values=f.values
        ),
    )
    held_out._weigh_rivals(outcome, Thresholds())
    assert (outcome.accepted == [rival.candidate]) is takes_its_place
    if takes_its_place:
        assert outcome.found['loop'].criterion == -80.0  # 40 likelier than what it replaces


def test_a_name_is_chosen_with_what_held_out_recordings_tell(monkeypatch):
    """They had preferred a drift; by the fitted ones alone an offset had it again."""
    offset, drift = formed('offset', 'offset', 100.0), formed('zero_drift', 'drift', 101.0)
    drift.fit.layout, drift.fit.model = offset.fit.layout, offset.fit.model
    outcome = Outcome(offset.fit, offset.fit, [offset.candidate])
    outcome.found['offset'], outcome.rivals['offset'] = offset, [drift]
    outcome.held_out_final = SimpleNamespace(reduced=1.0)
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    monkeypatch.setattr(held_out, 'further_misfit', lambda *_: -4.0)
    held_out._weigh_rivals(outcome, Thresholds())
    held_out._by_name(outcome)
    assert [c.label for c in outcome.accepted] == ['drift']
    assert outcome.found['drift'].held_out == -4.0


def test_where_recordings_are_missed_many_rivals_are_weighed(monkeypatch):
    """What is not weighed as the finding was is told as unlikely, whatever it explains."""
    mine = formed('wrong_parameter', 'rod', 100.0)
    rivals = [formed('wrong_parameter', f'number {n}', 100.0) for n in range(5)]
    missed = SimpleNamespace(reduced=4.0, layout=SimpleNamespace(size=200))
    outcome = Outcome(mine.fit, mine.fit, [mine.candidate])
    outcome.found['rod'], outcome.rivals['rod'] = mine, rivals
    outcome.held_out_final = missed
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: missed)
    monkeypatch.setattr(
        held_out, 'prediction_misfit', lambda f, _: 3.0 if f is outcome.final else 1.0
    )
    together = {id(mine.fit): 1000.0}
    monkeypatch.setattr(
        held_out,
        'fit_together',
        lambda f, *_: SimpleNamespace(chi_square=together.get(id(f), 100.0), values={}),
    )
    outcome.final = SimpleNamespace(**vars(mine.fit))
    together[id(outcome.final)] = 1000.0
    held_out._weigh_rivals(outcome, Thresholds())
    assert outcome.accepted[0].label.startswith('number')
    told = [outcome.found[outcome.accepted[0].label], *outcome.rivals[outcome.accepted[0].label]]
    assert sorted(f.criterion for f in told) == [-940.0] * 5 + [-40.0]


@pytest.mark.parametrize('bad', [{'refused': True}, {'size': 50}])
def test_what_cannot_be_compared_takes_no_place(monkeypatch, bad):
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    outcome = outcome_of(50.0)
    rival = found_of(candidate_of('hysteresis'), -41.0, **bad)
    outcome.rivals['coulomb_friction'] = [rival]
    monkeypatch.setattr(
        held_out, 'further_misfit', lambda _, after: -9.0 if after[0] is rival.fit else 0.0
    )
    held_out.check_held_out(outcome, Thresholds(), 3)
    assert [c.label for c in outcome.accepted] == ['coulomb_friction']


@pytest.mark.parametrize(
    ('number', 'order', 'takes_its_place'),
    [
        (None, 1.0, True),
        ('clock.drift', 1.0, False),  # the clock beside it ran at another rate when it was made
        (None, 2.0, False),  # the filter beside it was of another order
    ],
)
def test_a_rival_stands_beside_what_is_accepted_now(number, order, takes_its_place):
    """Its fit would tell numbers that no finding has any more."""
    outcome = outcome_of(50.0)
    beside = candidate_of('low_pass_filter')
    beside.constants = {'low_pass_filter.order': 1.0}
    outcome.accepted.insert(0, beside)
    outcome.final.model = SimpleNamespace(free=(*beside.free, *outcome.accepted[1].free))
    rival = found_of(candidate_of('hysteresis'), -41.0)
    more = () if number is None else (SimpleNamespace(key=number),)
    rival.fit.model.free = (*beside.free, *rival.candidate.free, *more)
    rival.fit.model.constants = {'low_pass_filter.order': order}
    assert held_out._in_its_place(outcome, rival) is takes_its_place


@pytest.mark.parametrize(
    ('name', 'beside', 'confirmed'),
    [
        ('hysteresis', (), True),
        ('hysteresis', ('swapped.force',), False),  # a fit with what has been swapped since
        ('coulomb_friction', (), False),  # a finding already
    ],
)
def test_fits_confirm_what_they_have_beside_what_is_accepted(monkeypatch, name, beside, confirmed):
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    outcome = outcome_of(50.0)
    item = found_of(candidate_of(name), -40.0)
    item.fit.model.free += tuple(SimpleNamespace(key=key) for key in beside)
    outcome.last = [item]
    monkeypatch.setattr(
        held_out, 'further_misfit', lambda _, after: -9.0 if after[0] is item.fit else 0.0
    )
    monkeypatch.setattr(held_out, 'drop_idle', lambda *_: None)
    held_out.check_held_out(outcome, Thresholds(), 3)
    labels = [c.label for c in outcome.accepted]
    assert labels == ['coulomb_friction', *(['hysteresis'] if confirmed else [])]
    assert set(labels) <= set(outcome.found)


@pytest.mark.parametrize(('left', 'confirmed'), [(8.0, True), (-2.0, False), (None, False)])
def test_where_contacts_amplify_a_fit_to_all_has_to_bear_out(monkeypatch, left, confirmed):
    """A prediction that is missed by far is met in proportion by luck: 157 of chi-square once."""
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=2.6))
    monkeypatch.setattr(held_out, 'further_misfit', lambda *_: -157.0)
    outcome = outcome_of(50.0)
    item = found_of(candidate_of('hysteresis'), -10.0)
    item = dataclasses.replace(item, gain=15.0)
    item.fit.chi_square = outcome.final.chi_square - 15.0
    outcome.last, outcome.held_out_final = [item], SimpleNamespace(reduced=2.6)

    def together(own, _predicted, _candidates):
        if own is not item.fit:
            return SimpleNamespace(chi_square=1000.0)
        return None if left is None else SimpleNamespace(chi_square=1000.0 - 15.0 - left)

    monkeypatch.setattr(held_out, 'fit_together', together)
    held_out._confirm(outcome, Thresholds(), 3)
    assert ('hysteresis' in {c.label for c in outcome.accepted}) is confirmed


def test_what_held_out_recordings_confirm_may_make_an_earlier_finding_idle(monkeypatch):
    outcome = outcome_of(50.0)
    item = found_of(candidate_of('hysteresis'), -40.0)
    outcome.last = [item]
    alone = SimpleNamespace(**vars(item.fit))
    predicted = {id(alone): SimpleNamespace(reduced=1.1)}

    def drop(changed, *_):
        changed.accepted = changed.accepted[1:]
        changed.final = alone

    monkeypatch.setattr(held_out, 'drop_idle', drop)
    monkeypatch.setattr(
        held_out,
        'held_out_fit',
        lambda fit, *_: predicted.get(id(fit), SimpleNamespace(reduced=1.0)),
    )
    monkeypatch.setattr(
        held_out, 'further_misfit', lambda _, after: -9.0 if after[0] is item.fit else 0.0
    )
    held_out.check_held_out(outcome, Thresholds(), 3)
    assert [c.label for c in outcome.accepted] == ['hysteresis']
    assert outcome.held_out_final is predicted[id(alone)]
    assert outcome.found['hysteresis'].criterion == -49.0  # with what these recordings gave


def test_rivals_of_what_is_confirmed_are_weighed_beside_it(monkeypatch):
    """What the held-out recordings give is told of the rival, too, until it is predicted."""
    outcome = outcome_of(50.0)
    outcome.accepted, outcome.found = [], {}
    push, spring = formed('push', 'push', 100.0), formed('spring', 'spring', 101.0)
    push = dataclasses.replace(push, gain=12.0, criterion=-12.0)
    outcome.last = [push, dataclasses.replace(spring, gain=11.0, criterion=-11.0)]
    related = found_of(candidate_of('relative'), -9.0)
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    monkeypatch.setattr(
        held_out,
        'further_misfit',
        lambda before, after: (after[0] is push.fit) * -9.0 + (before[0] is push.fit) * 20.0,
    )
    monkeypatch.setattr(held_out, 'chance_of', lambda *_: 1e-4)

    def join(changed, candidate):
        changed.rivals[candidate.label].append(related)

    monkeypatch.setattr(held_out, 'join_relatives', join)
    monkeypatch.setattr(held_out, '_by_name', lambda _: None)
    held_out.check_held_out(outcome, Thresholds(), 3)
    assert [c.label for c in outcome.accepted] == ['push']
    assert outcome.found['push'].criterion == -21.0
    rivals = {f.candidate.label: f for f in outcome.rivals['push']}
    criteria = {label: f.criterion for label, f in rivals.items()}
    assert criteria == {'spring': -20.0 + 20.0, 'relative': -9.0}
    assert rivals['spring'].gain == 20.0  # which tells what explains as much


def test_a_finding_that_another_replaces_goes_as_it_was_fitted_last(monkeypatch):
    """Else its fit is of the window in which it was found, and cannot take its place again."""
    push, weight = formed('external_push', 'push', 100.0), formed('weight', 'weight', 101.0)
    final = SimpleNamespace(**vars(push.fit))
    push.fit.layout = SimpleNamespace(size=50)  # a shorter window
    outcome = Outcome(final, final, [push.candidate])
    outcome.found['push'] = dataclasses.replace(push, criterion=-41.0)
    outcome.rivals['push'] = [weight]
    outcome.held_out_final = SimpleNamespace(reduced=1.0)
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    monkeypatch.setattr(held_out, 'further_misfit', lambda *_: -9.0)
    held_out._weigh_rivals(outcome, Thresholds())
    assert [c.label for c in outcome.accepted] == ['weight']
    (rival,) = outcome.rivals['weight']
    assert rival.fit is final


@pytest.mark.parametrize('orientation', [1.0, 0.0])
def test_what_held_out_recordings_prefer_is_no_weight_along_the_swing(monkeypatch, orientation):
    push, weight = formed('external_push', 'push', 100.0), formed('gravity_load', 'weight', 101.0)
    blow = SimpleNamespace(recording=SimpleNamespace(kind='pendulum'))
    for form in (push, weight):
        form.fit.model.constants = {'orientation': orientation}
        form.fit.model.data = SimpleNamespace(held_out=(), blows=[blow])
        form.fit.layout, form.candidate.channel = push.fit.layout, ''
    outcome = Outcome(weight.fit, weight.fit, [weight.candidate])
    outcome.found['weight'], outcome.rivals['weight'] = weight, [push]
    predicted = {id(push.fit): SimpleNamespace(reduced=1.0, chi_square=90.0)}
    monkeypatch.setattr(
        held_out,
        'held_out_fit',
        lambda f, *_: predicted.get(id(f), SimpleNamespace(reduced=1.0, chi_square=80.0)),
    )
    monkeypatch.setattr(held_out, 'further_misfit', lambda *_: 0.0)
    held_out.check_held_out(outcome, Thresholds(), 3)
    pushed = orientation > 0.5
    assert [c.label for c in outcome.accepted] == (['push'] if pushed else ['weight'])
    assert (outcome.held_out_final is predicted[id(push.fit)]) is pushed


def test_a_richer_law_than_what_is_confirmed_is_weighed_against_it(monkeypatch):
    """As independent candidates both paid for all samples, and so twice for the law's second."""
    outcome = outcome_of(50.0)
    outcome.accepted, outcome.found = [], {}
    plain = formed('coulomb_friction', 'even', 100.0)
    fuller = formed('asymmetric_friction', 'uneven', 100.0)
    for form, cost in ((plain, 1), (fuller, 2)):
        form.candidate.channel, form.candidate.cost = '', cost
        form.candidate.price_beyond_plain = lambda joint: 1.0
        form.fit.residuals = np.zeros(100)
    outcome.last = [
        dataclasses.replace(plain, gain=16.0, criterion=-7.0),
        dataclasses.replace(fuller, gain=16.0, criterion=2.0),
    ]
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    monkeypatch.setattr(
        held_out, 'further_misfit', lambda _, after: -9.0 * (after[0] is plain.fit)
    )
    monkeypatch.setattr(held_out, 'chance_of', lambda *_: 1e-4)
    outcome.held_out_final = SimpleNamespace(reduced=1.0)
    held_out._confirm(outcome, Thresholds(), 3)
    (rival,) = outcome.rivals['even']
    assert rival.gain == outcome.found['even'].gain == 25.0
    assert rival.criterion == pytest.approx(-16.0 + 1.0 + 2.0 * math.log(3.0))


def test_what_one_set_of_numbers_meets_is_not_missing(make_campaign):
    """A prediction that bounces amplify may miss; a reading 20 % off is met by none."""
    campaign = make_campaign(20)
    data = prepare(campaign)
    baseline = fit_baseline(baseline_model(campaign, data))
    held = held_out_fit(baseline, data.held_out)
    outcome = Outcome(baseline, baseline, [])
    assert _met_together(outcome, held, 1.2)
    blows = list(held.model.data.blows)
    for i in data.held_out:
        channels = dict(blows[i].channels)
        means = 1.2 * channels['force'].means
        channels['force'] = dataclasses.replace(channels['force'], means=means)
        blows[i] = dataclasses.replace(blows[i], channels=channels)
    bent = dataclasses.replace(held.model.data, blows=tuple(blows))
    model = dataclasses.replace(held.model, data=bent)
    assert not _met_together(outcome, dataclasses.replace(held, model=model), 1.2)


@pytest.mark.parametrize(
    ('orders', 'name'),
    [
        ([101.0, 101.1, 104.0], 'low_pass_filter'),  # together likelier than a clock
        ([101.0], 'clock_error'),
        ([108.0, 108.0, 108.0], 'clock_error'),
    ],
)
def test_forms_of_one_name_count_together(monkeypatch, orders, name):
    clock = formed('clock_error', 'clock', 100.0)
    filters = [formed('low_pass_filter', f'order {n}', c) for n, c in enumerate(orders)]
    outcome = Outcome(clock.fit, clock.fit, [clock.candidate])
    outcome.found['clock'] = clock
    elsewhere = found_of(candidate_of('gravity_load'), -99.0)  # told by other means
    # what it was weighed to be in another fit says nothing
    filters = [dataclasses.replace(f, criterion=-200.0) for f in filters]
    outcome.rivals['clock'] = [elsewhere, *filters]
    outcome.held_out_final = clock.fit
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: clock.fit)
    held_out._by_name(outcome)
    (accepted,) = outcome.accepted
    assert accepted.name == name
    if name == 'low_pass_filter':
        assert accepted.label == 'order 0'
        assert outcome.final is filters[0].fit
        assert 'clock' in {f.candidate.label for f in outcome.rivals['order 0']}


@pytest.mark.parametrize(
    ('behind', 'name'),
    [
        ([0.2, 0.3, 1.4], 'wrong_parameter'),
        ([0.2], 'rate_dependent_damper'),
        ([6.0, 6.0, 6.0], 'rate_dependent_damper'),
    ],
)
def test_numbers_of_which_any_may_be_wrong_count_together(monkeypatch, behind, name):
    """A branch that does what each does is no physics that was left out."""
    branch = dataclasses.replace(formed('rate_dependent_damper', 'branch', 100.0), criterion=-50.0)
    numbers = [
        dataclasses.replace(formed('wrong_parameter', f'number {n}', 100.0), criterion=-50.0 + c)
        for n, c in enumerate(behind)
    ]
    for form in (branch, *numbers):
        form.candidate.channel = ''
    outcome = Outcome(branch.fit, branch.fit, [branch.candidate])
    outcome.found['branch'], outcome.rivals['branch'] = branch, numbers
    outcome.held_out_final = branch.fit
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: branch.fit)
    held_out._by_name(outcome)
    (accepted,) = outcome.accepted
    assert accepted.name == name
