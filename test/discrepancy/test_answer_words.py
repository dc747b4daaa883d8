"""What an answer says of several channels, and in which order."""

import numpy as np

from impactscope.discrepancy.answer import Answer, Finding, Mismatch
from impactscope.discrepancy.impact.explain import with_direct

STEPS = [
    Finding('quantisation', 0.99, 'measurement', channel=c, sentence='The channel has steps.')
    for c in ('force', 'acceleration.plate')
]
FRICTION = Finding('coulomb_friction', 0.9, 'guide', sentence='Dry friction opposes the motion.')
RIVAL = Finding('quadratic_damping', 0.05, 'guide')


def test_steps_stand_behind_what_moves_the_bench_and_a_cut_off_channel_before_it():
    clipped = Finding('saturation', 0.99, 'measurement', channel='force')
    ranking, found = with_direct(
        [FRICTION, RIVAL], ['coulomb_friction'], [*STEPS[:1], clipped, *STEPS[1:]]
    )
    assert found == ['saturation', 'coulomb_friction', 'quantisation', 'quantisation']
    assert [f.name for f in ranking] == [*found, 'quadratic_damping']


def test_a_sentence_is_said_once_with_its_channels():
    found = ('coulomb_friction', 'quantisation', 'quantisation')
    answer = Answer('x', 'impact', Mismatch(True, 0.0), found, (FRICTION, *STEPS))
    assert answer.summary() == (
        'Dry friction opposes the motion. The channel has steps (force, acceleration.plate).'
    )
    told = answer.to_json()
    assert told['accepted'] == ['coulomb_friction', 'quantisation']
    assert len(told['ranking']) == 3
    assert np.isfinite(told['ranking'][0]['probability'])
