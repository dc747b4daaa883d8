"""Something unknown beside a finding whose name it does not put in doubt."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.evidence import Thresholds
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact import explain as answers
from impactscope.discrepancy.impact.adequacy.residual_tests import Adequacy
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.physics.twin.assembly import Effect

FRICTION = 4.0  # N: chi-square falls by more than a million


@pytest.fixture(scope='module')
def searched(make_campaign):
    """A campaign with much friction, and what a search comes to in it."""
    campaign = make_campaign(61, [Effect('coulomb_friction', {'force': FRICTION})])
    return campaign, answers._searched(campaign, prepare(campaign), Thresholds(), lambda *_: None)


@pytest.mark.parametrize(
    ('excess', 'accepted'),
    [
        (40.0, ('coulomb_friction', 'unknown')),
        (1e6, ('unknown',)),  # friction that only resembles what it is
        (math.inf, ('unknown',)),
    ],
)
def test_a_slight_rest_stands_beside_what_was_found(searched, monkeypatch, excess, accepted):
    campaign, found = searched
    plain = answers._unexplained

    def with_a_rest(outcome, thresholds):
        outcome.tests = Adequacy({'laws': 1e-6}, {'laws': excess}, 'stiffness that swings')
        return plain(outcome, thresholds)

    monkeypatch.setattr(answers, '_searched', lambda *_: dataclasses.replace(found, notes=[]))
    monkeypatch.setattr(answers, '_unexplained', with_a_rest)
    answer = explain(campaign)
    assert answer.accepted == accepted
    assert answer.unexplained
    assert 'stiffness that swings' in answer.unexplained_description
    friction = next(f for f in answer.ranking if f.name == 'coulomb_friction')
    saved = [b if isinstance(b, str) else b['name'] for b in answer.model['baseline']]
    kept = 'coulomb_friction' in accepted
    assert ('coulomb_friction' in saved) is kept
    assert any('in the place of what is not known' in n for n in answer.notes) is not kept
    assert (friction.probability > 0.5) is kept
    assert friction.probability < 0.7


def test_what_shows_in_the_held_out_recording_alone_stands_beside_what_was_found(make_campaign):
    friction = Effect('coulomb_friction', {'force': 2.0})
    stop = Effect('end_stop', {'travel': 2.2e-3, 'stiffness': 2000.0})
    fitted, deeper = (make_campaign(61, e, blows=2) for e in ([friction], [friction, stop]))
    recordings = (*fitted.recordings[:-1], deeper.recordings[-1])
    answer = explain(dataclasses.replace(fitted, recordings=recordings))
    assert answer.accepted == ('coulomb_friction', 'unknown')
    assert 'held-out recordings are missed' in answer.unexplained_description
    assert 'role: fit' in answer.next_tests[0]
    force = answer.findings[0].parameters['force']
    assert abs(force.value - 2.0) < 3.0 * force.std


def held_out(*sizes):
    """Two held-out recordings of 1000 samples, missed by that many times the noise."""
    spans = {0: slice(0, 1000), 1: slice(1000, 2000)}
    residuals = np.concatenate([np.full(1000, size) for size in sizes])
    layout = SimpleNamespace(blows=(0, 1), blow_spans=spans)
    return SimpleNamespace(residuals=residuals, layout=layout)


@pytest.mark.parametrize(
    ('fitted', 'without', 'left', 'kept'),
    [
        (0.0, (1.0, 6.0), (1.0, 6.0), True),  # evident from stated numbers: nothing changes
        (0.1, (1.05, 6.0), (1.0, 6.0), True),  # the recording that is met gains as expected
        (0.1, (1.0, 6.0), (1.0, 6.0), False),  # and does not
        (0.0, (1.0, 3.0), (1.0, 6.0), False),  # the findings are what misses
        (0.0, (6.0, 6.0), (6.0, 6.0), False),  # none is met
        (0.0, (1.0, 6.0), (1.06, 6.0), False),  # the one that is met gets worse
    ],
)
def test_one_recording_may_show_what_no_other_does(fitted, without, left, kept):
    outcome = SimpleNamespace(
        accepted=['speed loss'],
        baseline=SimpleNamespace(reduced=1.0 + fitted),
        final=SimpleNamespace(reduced=1.0),
        held_out_baseline=held_out(*without),
        held_out_final=held_out(*left),
    )
    assert answers._one_is_another(outcome, 1.2, 9.0) is kept
