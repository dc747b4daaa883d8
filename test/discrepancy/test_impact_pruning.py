"""What is no longer needed once other findings stand beside it."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.models.bench_model import Free
from impactscope.discrepancy.impact.search import forward_backward as searching
from impactscope.discrepancy.impact.search import pruning
from impactscope.discrepancy.impact.search.outcome import Found, Outcome, evidence_for

LOAD = 'gravity_load.added_weight'


def wrong_number(prior: tuple[float, float] | None = None) -> Candidate:
    return Candidate(
        label=f'wrong {LOAD}',
        name='wrong_parameter',
        subsystem='parameter',
        free=(Free(LOAD, 0.0, 0.1, -1e3, 1e3, prior=prior),),
        starts=({LOAD: 0.1},),
        amplitudes={LOAD: 0.0},
        parameter=LOAD,
    )


PUSH = Candidate(label='external_push', name='external_push', subsystem='impactor')


PLAIN = SimpleNamespace(effects=())  # a model with nothing beyond the bench


def outcome_with(value: float, std: float) -> SimpleNamespace:
    final = SimpleNamespace(values={LOAD: value}, std=lambda _: std, layout='whole')
    return SimpleNamespace(
        accepted=[PUSH, wrong_number()],
        doubted=set(),
        found=dict.fromkeys((PUSH.label, f'wrong {LOAD}')),
        final=final,
        baseline=SimpleNamespace(model=SimpleNamespace(free=())),
    )


@pytest.mark.parametrize(('value', 'left'), [(0.003, 1), (-0.004, 1), (0.02, 2)])
def test_a_number_that_ends_as_it_was_stated_was_not_wrong(
    monkeypatch: pytest.MonkeyPatch, value: float, left: int
) -> None:
    """A short window needs it; a swap since then has taken what it stood for."""
    outcome = outcome_with(1.0, 0.005)

    def swapped(changed: SimpleNamespace, *_: object) -> None:
        changed.final.values[LOAD] = value

    monkeypatch.setattr(pruning, '_needed', lambda *_: True)
    monkeypatch.setattr(pruning, '_swap', swapped)
    monkeypatch.setattr(pruning, 'with_findings', lambda *_: 'again')
    pruning.prune(outcome, None, 0.1, lambda *_: None)
    assert len(outcome.accepted) == left
    assert outcome.accepted[0] is PUSH
    assert (outcome.final == 'again') == (left == 1)


def test_rivals_are_close_to_a_finding_as_it_was_weighed_beside_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Since then it may have been weighed in a longer window, where it gains far more."""
    load = wrong_number()
    beside, since = (SimpleNamespace(candidate=PUSH, criterion=c) for c in (4.0, -120.0))
    rival = SimpleNamespace(candidate=load, criterion=5.0, fit=SimpleNamespace(values={}))
    outcome = SimpleNamespace(
        accepted=[PUSH],
        found={PUSH.label: since},
        rivals={PUSH.label: [rival]},
        final=SimpleNamespace(values={}, chi_square=1000.0),
    )
    tried = SimpleNamespace(candidate=load, criterion=-118.0)
    monkeypatch.setattr(pruning, '_instead', lambda *_: tried)
    monkeypatch.setattr(pruning, 'at_bottom', lambda item, _: item)
    monkeypatch.setattr(pruning, '_relatives', lambda *_: [])
    pruning._swap(outcome, PUSH, [], beside)
    assert outcome.rivals[PUSH.label] == [tried]
    assert outcome.accepted == [PUSH]


@pytest.mark.parametrize(('apart', 'fitted'), [(1.0, 6), (4.0, 3)])
def test_rivals_that_do_as_well_are_all_fitted(
    monkeypatch: pytest.MonkeyPatch, apart: float, fitted: int
) -> None:
    """Of eight; three of them, if the others are farther behind than one may be by chance."""
    beside = SimpleNamespace(candidate=PUSH, criterion=-50.0)
    rivals = [
        SimpleNamespace(
            candidate=SimpleNamespace(label=f'rival {n}', name='a rival'),
            criterion=-50.0 + n * apart,
            fit=SimpleNamespace(values={}),
        )
        for n in range(1, 9)
    ]
    outcome = SimpleNamespace(
        accepted=[PUSH],
        found={PUSH.label: beside},
        rivals={PUSH.label: rivals},
        final=SimpleNamespace(values={}, chi_square=1000.0),
    )
    by_label = {r.candidate.label: r for r in rivals}
    monkeypatch.setattr(pruning, '_instead', lambda _o, _m, _r, c, _v: by_label[c.label])
    monkeypatch.setattr(pruning, 'at_bottom', lambda item, _: item)
    monkeypatch.setattr(pruning, '_relatives', lambda *_: [])
    pruning._swap(outcome, PUSH, [], beside)
    assert outcome.rivals[PUSH.label] == rivals[:fitted]


@pytest.mark.parametrize(
    ('alone', 'gain', 'tried'), [(False, 732.0, True), (False, 500.0, False), (True, 732.0, False)]
)
def test_a_rival_that_explained_nearly_as_much_is_fitted_beside_what_was_found_later(
    monkeypatch: pytest.MonkeyPatch, alone: bool, gain: float, tried: bool
) -> None:
    """A push met what a coupling left with its start; with that found a weight does as well."""
    weight, coupling = (SimpleNamespace(label=n, name=n) for n in ('gravity_load', 'ac_coupling'))
    beside = SimpleNamespace(candidate=PUSH, criterion=-790.0, gain=808.0)
    fitted = SimpleNamespace(values={})
    rival = SimpleNamespace(candidate=weight, criterion=-725.0, gain=gain, fit=fitted)
    known = SimpleNamespace(candidate=coupling, criterion=-780.0, gain=800.0, fit=fitted)
    rest = [] if alone else [coupling]
    outcome = SimpleNamespace(
        accepted=[PUSH, *rest],
        found={PUSH.label: beside},
        rivals={PUSH.label: [rival] if alone else [known, rival]},
        final=SimpleNamespace(values={}, chi_square=1000.0),
    )
    asked: list[str] = []

    def instead(*given: SimpleNamespace) -> None:
        asked.append(given[3].label)

    monkeypatch.setattr(pruning, '_instead', instead)
    monkeypatch.setattr(pruning, '_relatives', lambda *_: [])
    pruning._swap(outcome, PUSH, rest, beside)
    assert asked == (['gravity_load'] if tried else [])


@pytest.mark.parametrize(
    ('lower', 'behind', 'stays'),
    [
        ({'rival': 20.0}, 15.0, False),  # the rival had stood in a higher minimum
        ({'rival': 20.0, 'mine': 20.0}, 15.0, True),  # and so had the finding
        ({'rival': 20.0}, 50.0, True),  # a rival so far behind is left where it is
        ({'rival': 0.5}, 0.2, True),  # and one that no minimum brings further
    ],
)
def test_rivals_are_compared_from_their_lowest_minima(
    monkeypatch: pytest.MonkeyPatch, lower: dict[str, float], behind: float, stays: bool
) -> None:
    load = wrong_number()
    push = dataclasses.replace(PUSH, free=load.free, amplitudes=load.amplitudes)
    levels = 100.0, 100.0 + behind
    layout = SimpleNamespace(size=1000)
    mine, other = (
        SimpleNamespace(chi_square=c, reduced=1.0, values={}, layout=layout) for c in levels
    )
    found, tried = Found(push, mine, 50.0, 1e-9, -40.0), Found(load, other, 0.0, 1e-9, behind - 40)
    outcome = Outcome(mine, mine, [push])
    outcome.found[push.label], outcome.rivals[push.label] = found, [tried]

    def deeper(fit: SimpleNamespace, _: object) -> SimpleNamespace:
        fallen = lower.get('mine' if fit is mine else 'rival', 0.0)
        level, layout = fit.chi_square - fallen, SimpleNamespace(size=1000)
        return SimpleNamespace(chi_square=level, reduced=1.0, values={}, layout=layout)

    monkeypatch.setattr(pruning, 'lowest', deeper)
    monkeypatch.setattr(pruning, '_instead', lambda *_: tried)
    monkeypatch.setattr(pruning, '_relatives', lambda *_: [])
    pruning._swap(outcome, push, [], found)
    (accepted,) = outcome.accepted
    assert (accepted is push) is stays
    if 'mine' in lower:
        assert outcome.final.chi_square == 80.0
        assert outcome.found[PUSH.label].criterion == -60.0
    if not stays:
        assert outcome.found[load.label].criterion == pytest.approx(behind - 60.0)


@pytest.mark.parametrize(('fallen', 'moved'), [(9.0, False), (15.0, True)])
def test_a_narrow_minimum_that_is_lower_is_not_likelier(
    monkeypatch: pytest.MonkeyPatch, fallen: float, moved: bool
) -> None:
    """Its start is told a hundred times as well, which costs 9.2."""
    start = Free('external_push.start', 0.0, 0.01, 0.0, 0.6)
    force = Free('external_push.force', 5.0, 0.5, -1e3, 1e3)
    push = dataclasses.replace(PUSH, free=(force, start), amplitudes={force.key: 0.0})

    def at(level: float, std: float) -> SimpleNamespace:
        model = SimpleNamespace(free=push.free, index=[force.key, start.key].index)
        known = np.diag([0.01, std**2])
        layout = SimpleNamespace(size=10**7)
        return SimpleNamespace(
            chi_square=level, reduced=1.0, model=model, layout=layout, covariance=lambda: known
        )

    wide, narrow = at(100.0, 0.01), at(100.0 - fallen, 1e-4)
    monkeypatch.setattr(pruning, 'lowest', lambda *_: narrow)
    item = Found(push, wide, 40.0, 1e-9, -20.0)
    best = pruning.at_bottom(item, 200.0)
    assert (best.fit is narrow) is moved
    cost = 2.0 * np.log(100.0)
    assert best.criterion == pytest.approx(-20.0 - fallen + cost if moved else -20.0, abs=0.01)


@pytest.mark.parametrize(
    ('orientation', 'kind', 'behind', 'named'),
    [
        (1.0, 'pendulum', 0.2, 'external_push'),
        (0.0, 'pendulum', 0.2, 'gravity_load'),
        (1.0, 'pendulum', 9.0, 'gravity_load'),
        (1.0, 'robot', 0.2, 'gravity_load'),
    ],
)
def test_a_load_along_the_swing_of_a_pendulum_is_a_push(
    orientation: float, kind: str, behind: float, named: str
) -> None:
    """No weight acts there; standing, on a track, or where the push explains less, it stays."""
    weight = Candidate(label='gravity_load', name='gravity_load', subsystem='impactor')
    blows = [SimpleNamespace(recording=SimpleNamespace(kind=k)) for k in ('tap', kind)]
    data = SimpleNamespace(blows=blows)
    model = SimpleNamespace(constants={'orientation': orientation}, data=data)
    final, other = (SimpleNamespace(model=model, layout='whole') for _ in range(2))
    outcome = Outcome(final, final, [weight])
    outcome.found[weight.label] = Found(weight, final, 50.0, 1e-9, -40.0)
    outcome.rivals[weight.label] = [Found(PUSH, other, 50.0 - behind, 1e-9, -20.0)]
    pruning.no_weight_along(outcome)
    assert [c.name for c in outcome.accepted] == [named]
    assert outcome.found[named].criterion == -40.0
    assert outcome.rivals[named][0].criterion == -20.0
    assert outcome.final is (other if named == 'external_push' else final)


@pytest.mark.parametrize(
    ('fallen', 'alone', 'grown', 'stays'),
    [
        (0.0, 130.0, None, True),
        (60.0, 130.0, None, False),  # its fit had stopped early
        (60.0, 190.0, None, True),  # it explains too little for that to be looked at
        (0.0, 190.0, 95.0, False),  # later contacts had led its fit astray
        (0.0, 190.0, 150.0, True),
    ],
)
def test_one_effect_in_place_of_two_counts_from_its_lowest_minimum(
    monkeypatch: pytest.MonkeyPatch,
    fallen: float,
    alone: float,
    grown: float | None,
    stays: bool,
) -> None:
    """Two wrong numbers leave 100 of the 200 of chi-square; a push alone stopped at more.

    ``grown``: what it leaves if it is followed from the first contacts on.
    """
    first, second = wrong_number(), dataclasses.replace(wrong_number(), label='another number')
    push = dataclasses.replace(first, label=PUSH.label, name='a push', parameter='')
    layout = SimpleNamespace(size=1000)

    def at(level: float) -> SimpleNamespace:
        residuals = np.full(1000, np.sqrt(level / 1000))
        known = {'values': {}, 'model': PLAIN, 'layout': layout}
        return SimpleNamespace(chi_square=level, reduced=1.0, residuals=residuals, **known)

    current, start = at(100.0), at(200.0)
    outcome = Outcome(start, current, [first, second])
    outcome.found = {c.label: Found(c, current, 50.0, 1e-9, -40.0) for c in (first, second)}
    monkeypatch.setattr(searching, 'with_findings', lambda *_: start)
    monkeypatch.setattr(searching, 'other_conventions', lambda _: [])
    monkeypatch.setattr(searching, 'candidates', lambda *_: [push] * 50)
    monkeypatch.setattr(pruning, 'lowest', lambda fit, _: at(fit.chi_square - fallen))
    search = searching.Search(())

    def tried(level: float) -> Found:
        gain = 200.0 - level
        return Found(push, at(level), gain, 1e-9, push.price(gain, at(level)) - gain)

    followed = [] if grown is None else [tried(grown)]
    monkeypatch.setattr(search, '_alone', lambda *_: [tried(alone)])
    monkeypatch.setattr(search, '_from_first_contacts', lambda *_: followed)
    search._simpler(current, outcome)
    assert (outcome.accepted == [first, second]) is stays
    if not stays:
        assert outcome.accepted == [push]
        reached = alone - fallen if grown is None else grown
        assert outcome.found[push.label].fit.chi_square == reached


@pytest.mark.parametrize('lone', [0.0, 60.0])
def test_few_samples_count_no_more_for_several_findings_than_for_one(
    monkeypatch: pytest.MonkeyPatch, lone: float
) -> None:
    """Two leave 100 of 200, one in their place 101.5; either may take ``lone`` of one sample."""
    first, second = wrong_number(), dataclasses.replace(wrong_number(), label='another number')
    push = dataclasses.replace(first, label=PUSH.label, name='a push', parameter='')
    layout = SimpleNamespace(size=1000)

    def at(level: float, peak: float) -> SimpleNamespace:
        residuals = np.full(1000, np.sqrt((level - peak) / 1000))
        residuals[0] = np.sqrt(residuals[0] ** 2 + peak)
        known = {'values': {}, 'model': PLAIN, 'layout': layout}
        return SimpleNamespace(chi_square=level, reduced=1.0, residuals=residuals, **known)

    current, start = at(100.0, 0.0), at(200.0, lone)
    outcome = Outcome(start, current, [first, second])
    outcome.found = {c.label: Found(c, current, 50.0, 1e-9, -40.0) for c in (first, second)}
    monkeypatch.setattr(searching, 'with_findings', lambda *_: start)
    monkeypatch.setattr(searching, 'other_conventions', lambda _: [])
    monkeypatch.setattr(searching, 'candidates', lambda *_: [push] * 2)
    monkeypatch.setattr(pruning, 'lowest', lambda fit, _: fit)
    monkeypatch.setattr(Candidate, 'price', lambda *_: 1.0)
    search = searching.Search(())
    alone = at(101.5, 0.0)
    gain = evidence_for(alone, start)
    tried = Found(push, alone, gain, 1e-9, 1.0 - gain)
    monkeypatch.setattr(search, '_alone', lambda *_: [tried])
    search._simpler(current, outcome)
    assert outcome.accepted == [push]


@pytest.mark.parametrize(('otherwise', 'left'), [(None, 95.0), (70.0, 70.0)])
def test_one_of_two_findings_takes_the_place_of_both_from_another_minimum(
    monkeypatch: pytest.MonkeyPatch, otherwise: float | None, left: float
) -> None:
    """Two leave 100, the second alone 95 elsewhere, ``otherwise`` with names taken otherwise."""
    first, second = wrong_number(), dataclasses.replace(wrong_number(), label='another number')
    layout = SimpleNamespace(size=1000)
    taken = SimpleNamespace(effects=())

    def at(level: float, model: object = PLAIN) -> SimpleNamespace:
        residuals = np.full(1000, np.sqrt(level / 1000))
        return SimpleNamespace(
            chi_square=level, reduced=1.0, layout=layout, residuals=residuals, x=None, model=model
        )

    def refitted(model: object, *_: object, **__: object) -> SimpleNamespace:
        return at(70.0 if model is taken else 95.0, model)

    current, start = at(100.0), at(200.0)
    outcome = Outcome(start, current, [first, second])
    outcome.found = {c.label: Found(c, current, 50.0, 1e-9, -40.0) for c in (first, second)}
    others = [] if otherwise is None else [taken]
    monkeypatch.setattr(searching, 'with_findings', lambda *_: start)
    monkeypatch.setattr(searching, 'candidates', lambda *_: [first, second])
    monkeypatch.setattr(searching, 'other_conventions', lambda _: others)
    monkeypatch.setattr(searching, '_mean', lambda *_: None)
    monkeypatch.setattr(searching, 'fit', refitted)
    search = searching.Search(())
    monkeypatch.setattr(
        search,
        '_alone',
        lambda _s, _c, tried, *_: [
            Found(c, at(95.0), 105.0, 1e-9, c.price(105.0, at(95.0)) - 105.0)
            for c in tried
            if c is second
        ],
    )
    assert search._simpler(current, outcome).chi_square == left
    assert outcome.accepted == [second]


@pytest.mark.parametrize(
    ('first', 'reduced', 'again'), [(900, 1.02, True), (1000, 1.02, False), (900, 3.0, False)]
)
def test_a_weak_effect_of_a_short_window_is_asked_for_again_over_the_whole_one(
    first: int, reduced: float, again: bool
) -> None:
    """What is strong shows by its misfit that it is another; a weak one does not."""
    made = SimpleNamespace(fit=SimpleNamespace(layout=SimpleNamespace(size=first)))
    outcome = SimpleNamespace(accepted=[PUSH], found={PUSH.label: made})
    current = SimpleNamespace(layout=SimpleNamespace(size=1000))
    start = SimpleNamespace(reduced=reduced)
    assert searching.Search._seen_in_part(start, current, outcome) is again


@pytest.mark.parametrize(
    ('deepest', 'shared', 'stays'),
    [
        (104.0, True, False),  # as much as both, but for what the choice of a second one costs
        (130.0, True, True),
        (104.0, False, True),  # what was tried in the place of one only is no rival of both
    ],
)
def test_a_rival_of_two_findings_takes_the_place_of_both(
    monkeypatch: pytest.MonkeyPatch, deepest: float, shared: bool, stays: bool
) -> None:
    """Two wrong numbers beside friction leave 100 of 300; one effect from its second start 104."""
    first, second = wrong_number(), dataclasses.replace(wrong_number(), label='another number')
    friction = Candidate(label='friction', name='coulomb_friction', subsystem='guide')
    push = dataclasses.replace(PUSH, free=first.free, amplitudes=first.amplitudes)
    layout = SimpleNamespace(size=1000)
    none = np.zeros(layout.size)

    def at(level: float, value: float) -> SimpleNamespace:
        values = {LOAD: value}
        more = {'reduced': 1.0, 'model': PLAIN, 'layout': layout, 'residuals': none}
        return SimpleNamespace(chi_square=level, values=values, **more)

    final, without = at(100.0, 0.0), at(300.0, 0.0)
    outcome = Outcome(without, final, [friction, first, second], looks=50)
    outcome.found = {c.label: Found(c, final, 90.0, 1e-9, -80.0) for c in (first, second)}
    tried = [Found(push, at(190.0, value), 10.0, 0.1, 5.0) for value in (1.0, 2.0)]
    outcome.rivals = {first.label: tried[:1], second.label: tried[1:] if shared else []}
    monkeypatch.setattr(pruning, 'with_findings', lambda *_: without)
    monkeypatch.setattr(pruning, 'Screening', lambda _: SimpleNamespace(best=lambda _: []))
    monkeypatch.setattr(pruning, 'at_bottom', lambda item, _: item)

    def fitted(_: object, __: object, rest: list[Candidate], candidate: Candidate, known) -> Found:
        assert rest == [friction]
        level = deepest if known[LOAD] == 2.0 else 250.0
        return Found(candidate, at(level, known[LOAD]), 0.0, 1.0, 0.0)

    monkeypatch.setattr(pruning, '_instead', fitted)
    assert pruning.one_for_two(outcome) is not stays
    assert outcome.accepted == ([friction, first, second] if stays else [friction, push])
    assert outcome.final.chi_square == (100.0 if stays else deepest)


@pytest.mark.parametrize(
    ('gain', 'told', 'ahead'),
    [
        (8.0, 1.0, True),  # far from what chance hardly gives, but nothing else is told of it
        (8.0, 7.0, False),
        (2.5, 1.0, False),  # the plain law is three times as likely from the outset
        (13.0, 30.0, True),  # whatever is told: chance hardly ever gains as much
    ],
)
@pytest.mark.parametrize('fuller_is_rival', [True, False])
def test_a_law_is_weighed_against_its_plain_form_by_what_is_told_of_its_further_numbers(
    monkeypatch: pytest.MonkeyPatch, gain: float, told: float, ahead: bool, fuller_is_rival: bool
) -> None:
    monkeypatch.setattr(Candidate, 'price_beyond_plain', lambda *_: told)
    free = tuple(Free(f'stribeck_friction.{n}', 1.0, 0.1) for n in ('static', 'kinetic', 'speed'))
    plain = Candidate('c', 'coulomb_friction', 'guide', free=free[:1])
    law = Candidate('s', 'stribeck_friction', 'guide', free=free)

    def at(level: float) -> SimpleNamespace:
        known = {'values': {}, 'model': PLAIN, 'layout': SimpleNamespace(size=1)}
        residuals = np.array([np.sqrt(level)])
        return SimpleNamespace(chi_square=level, reduced=1.0, residuals=residuals, **known)

    of_plain, of_law = at(100.0), at(100.0 - gain)
    if fuller_is_rival:
        found = Found(plain, of_plain, 80.0, 1e-9, -70.0)
        worse, cost = pruning._against(law, of_law, found, of_plain)
        assert (worse + cost < 0.0) is ahead
    else:
        found = Found(law, of_law, 80.0, 1e-9, -70.0)
        worse, cost = pruning._against(plain, of_plain, found, of_law)
        assert (worse + cost > 0.0) is ahead
