"""Where a candidate's search begins: as strong as it is, with times of its own."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.candidate import Candidate, stronger
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import projector
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.models.bench_model import Free, ImpactModel
from impactscope.discrepancy.impact.search.screening import Screening
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism
from impactscope.physics.twin.assembly import Effect


def test_a_weaker_effect_keeps_its_times():
    branch = Candidate('branch', 'branch', 'damper', amplitudes={'k': 0.0}, along=('c',))
    assert stronger(branch, {'k': 5e3, 'c': 30.0, 'other': 2.0}, 0.01) == {
        'k': pytest.approx(50.0),
        'c': pytest.approx(0.3),
        'other': 2.0,
    }


@pytest.mark.parametrize('share', [0.05, 0.2, 0.4, 0.47, 0.49])
def test_a_filter_of_samples_is_the_less_likely_the_less_it_does(share: float) -> None:
    """Of cut-offs drawn at will, few have a delay as small: against a histogram of these."""
    filtered = Candidate('f', 'low_pass_filter', 'measurement', sampled={'cutoff': 1e4})
    drawn = np.exp(np.linspace(math.log(1e-3), math.log(0.4999), 4_000_001))
    delays = -np.log(np.tan(math.pi * drawn))  # of the bilinear transform, but for a factor
    at = -math.log(math.tan(math.pi * share))
    step = math.log(drawn[1] / drawn[0])
    density = step * np.count_nonzero(np.abs(delays - at) < 0.01) / 0.02
    assert filtered.doubt_at({'cutoff': share * 1e4}) == pytest.approx(
        -2.0 * math.log(density), abs=0.02
    )


def priced(*stds: float, samples: int = 10**5) -> float:
    """What a push costs of which start and rise are known so well."""
    numbers = (
        Free('push.force', 5.0, 0.5, -1e3, 1e3),
        Free('push.start', 0.0, 0.01, 0.0, 0.6),
        Free('push.rise', 0.01, 0.05, 1e-5, 1.0, logarithmic=True),
        Free('push.dead', 0.01, 0.05, 1e-5, 1.0, logarithmic=True),
    )
    push = Candidate('push', 'push', 'impactor', free=numbers[:3], amplitudes={'push.force': 0.0})
    if not stds[-1]:  # nothing depends on it
        push = Candidate('push', 'push', 'impactor', free=numbers, amplitudes=push.amplitudes)
    known = np.diag(np.square([0.1, *stds]))
    joint = SimpleNamespace(
        model=SimpleNamespace(index=[f.key for f in push.free].index),
        layout=SimpleNamespace(size=samples),
        covariance=lambda: known,
    )
    return push.price(50.0, joint)


def test_what_the_recordings_leave_open_of_a_law_costs_nothing():
    each = math.log(10**5)
    assert priced(1e6, 1e6) == pytest.approx(each, abs=1e-6)  # its strength alone
    assert priced(1e6, 1e6, 0.0) == pytest.approx(each, abs=1e-6)
    width = math.log(1e5) / math.sqrt(12.0)
    assert priced(1e6, 0.3) == pytest.approx(each + math.log1p((width / 0.3) ** 2), abs=1e-6)
    assert priced(1e-3, 0.3) > priced(1e-2, 0.3) > priced(1e-1, 0.3)


def test_a_number_never_costs_more_than_one_that_all_samples_tell():
    assert priced(1e-9, 1e-9) == pytest.approx(3.0 * math.log(10**5))


def test_the_cut_off_of_a_filter_is_its_strength_and_no_shape():
    """How late a channel is costs the same, whether a clock or a filter makes it so."""
    cutoff = Free('filter.cutoff', 300.0, 0.05, 1.0, 1e4, logarithmic=True)
    filtered = Candidate('filter', 'low_pass_filter', 'measurement', free=(cutoff,))
    joint = SimpleNamespace(layout=SimpleNamespace(size=10**5))
    assert filtered.price(50.0, joint) == pytest.approx(math.log(10**5))


@pytest.mark.parametrize(('std', 'told'), [(1e6, 0.0), (0.5, math.log1p(4.0 / 12.0 / 0.25))])
def test_a_further_strength_costs_what_is_told_of_it(std: float, told: float) -> None:
    """Friction of 0.8 N forwards and 1.2 N backwards, whose difference is known so well."""
    sides = tuple(Free(f'friction.{side}', 1.0, 0.1, 0.0, 100.0) for side in ('there', 'back'))
    law = Candidate('law', 'law', 'guide', free=sides, amplitudes={f.key: 0.0 for f in sides})
    joint = SimpleNamespace(
        values=dict(zip((f.key for f in sides), (0.8, 1.2), strict=True)),
        model=SimpleNamespace(index=[f.key for f in sides].index),
        layout=SimpleNamespace(size=10**5),
        covariance=lambda: np.diag([1e-6, std**2]),
    )
    assert law.price_beyond_plain(joint) == pytest.approx(told, abs=1e-6)


def test_what_is_more_than_usual_is_less_likely():
    filtered = Candidate('f', 'low_pass_filter', 'measurement', doubt=2.0, usual={'cutoff': 2e3})
    assert filtered.doubt_at({'cutoff': 500.0}) == 2.0
    assert filtered.doubt_at({'cutoff': 2e4}) == pytest.approx(2.0 + math.log(10.0))


def test_a_weak_further_branch_of_the_layer(make_campaign):
    """It relaxes within milliseconds; a search from a strong one finds seconds."""
    branch = Effect('rate_dependent_damper', {'stiffness': 60.0, 'damping': 0.3})
    answer = explain(make_campaign(31, [branch], rate=5000.0, blows=2))
    assert answer.accepted == ('rate_dependent_damper',)
    found = answer.ranking[0].parameters
    for name, true in (('stiffness', 60.0), ('damping', 0.3)):
        assert abs(found[name].value - true) < 4.0 * found[name].std


def test_a_filter_before_sampling_is_tried_as_weak_as_it_may_be(make_campaign):
    """At half the rate it changes signals by hundreds of times their noise: that tells nothing."""
    campaign = make_campaign(21)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    label = 'low_pass_filter:acceleration.impactor of order 2, zero phase, before sampling'
    (far,) = [c for c in candidates(baseline, ()) if c.label == label]
    best, _ = Screening(baseline).best(far)
    assert best.weak[far.free[0].key] > 2.0 * max(s[far.free[0].key] for s in far.starts)
    assert -5.0 < best.gain < 5.0


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_filter_goes_on_from_where_it_explained_most(make_campaign, monkeypatch, sign):
    """Far weaker it is of another shape: what that would be scaled to tells nothing."""
    campaign = make_campaign(21)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    label = 'low_pass_filter:acceleration.impactor of order 1, zero phase, before sampling'
    (far,) = [c for c in candidates(baseline, ()) if c.label == label]
    key, begun = far.free[0].key, far.starts[0][far.free[0].key]
    basis, rng = projector(baseline.jacobian), np.random.default_rng(1)
    strong, weak = rng.standard_normal((2, baseline.residuals.size))
    strong, weak = (v - basis @ (basis.T @ v) for v in (strong, weak))
    strong, weak = 60.0 * strong / np.linalg.norm(strong), weak / np.linalg.norm(weak)
    weak *= -sign * np.sign(weak @ baseline.residuals)
    missed = dataclasses.replace(
        baseline, residuals=baseline.residuals + strong, slopes=baseline.jacobian
    )

    def filtered(_: Screening, model: ImpactModel, x: np.ndarray) -> np.ndarray:
        effect = begun / model.values(x)[key]
        return missed.residuals - min(1.0, effect**4) * strong + 5.0 * effect**2 * weak

    monkeypatch.setattr(Screening, '_residuals', filtered)
    best = Screening(missed).best(far)[0]
    assert best.gain > 3000.0
    assert best.model.values(best.x)[key] == pytest.approx(begun)


def test_no_place_is_simulated_twice_for_one_trial(make_campaign, monkeypatch):
    """A base of 10 t cannot be made heavier: near the plate's own 33 Hz it stays a strong one."""
    campaign = make_campaign(5, duration=0.3)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    (base,) = [c for c in candidates(baseline, ()) if c.label == 'base_compliance']
    screening, simulated = Screening(baseline), []
    plain = ImpactModel.residuals

    def counted(model: ImpactModel, x, layout):
        simulated.append(x.tobytes())
        return plain(model, x, layout)

    monkeypatch.setattr(ImpactModel, 'residuals', counted)
    for frequency in (25.0, 33.0, 41.0, 200.0):
        simulated.clear()
        screening.peaks(base, [{**base.starts[0], 'base_compliance.frequency': frequency}])
        assert len(simulated) == len(set(simulated)) > 1


def test_a_weight_that_goes_with_the_geometry_has_to_explain_more(make_campaign):
    campaign = make_campaign(5, duration=0.3)
    found = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = {c.label: c for c in candidates(found, ())}
    plain, by_geometry = (listed[f'restoring_force{form}'] for form in ('', ' (by geometry)'))
    assert by_geometry.doubt > plain.doubt
    assert by_geometry.cost == plain.cost


def test_no_number_of_a_mechanism_is_sought_beyond_what_is_credible_for_it(make_campaign):
    campaign = make_campaign(5, duration=0.3)
    found = fit_baseline(baseline_model(campaign, prepare(campaign)))
    limits = [
        (f, p)
        for c in candidates(found, ())
        if c.name in all_mechanisms()
        for p in mechanism(c.name).parameters
        for f in c.free
        if f.key == f'{c.label}.{p.name}'
    ]
    assert len(limits) > 40
    for free, parameter in limits:
        assert parameter.lower <= free.lower <= free.upper <= parameter.upper, free.key
