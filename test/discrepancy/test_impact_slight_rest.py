"""Something unknown beside a strong finding: a slight rest does not take its name away."""

import math

import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact import explain as answers
from impactscope.discrepancy.impact.adequacy.residual_tests import Adequacy
from impactscope.physics.twin.assembly import Effect

FRICTION = 4.0  # N: chi-square falls by more than a million


@pytest.mark.parametrize(
    ('excess', 'accepted'),
    [
        (40.0, ('coulomb_friction', 'unknown')),
        (1e6, ('unknown',)),  # friction that only resembles what it is
        (math.inf, ('unknown',)),
    ],
)
def test_a_slight_rest_stands_beside_what_was_found(make_campaign, monkeypatch, excess, accepted):
    plain = answers._unexplained

    def with_a_rest(outcome, thresholds):
        outcome.tests = Adequacy({'laws': 1e-6}, {'laws': excess}, 'stiffness that swings')
        return plain(outcome, thresholds)

    monkeypatch.setattr(answers, '_unexplained', with_a_rest)
    answer = explain(make_campaign(61, [Effect('coulomb_friction', {'force': FRICTION})]))
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
