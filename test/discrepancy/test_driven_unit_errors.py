"""One recording in another unit than it says."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.findings.unit_errors import FACTORS, with_right_units

RATE, MOTION, FORCE = 200.0, 'displacement.rod', 'force.rod'
POUND = 4.4482216


def strokes(factors, friction=0.0, held_out=None, noise_as_well=True):
    """A spring and damper at several speeds, whose forces are ``factors`` times as large."""
    entries, channels = [], {}
    for i, factor in enumerate(factors):
        rng = np.random.default_rng(i)
        t = np.arange(2000) / RATE
        w = 2.0 * math.pi * (0.4 + 0.23 * i)
        x = 0.01 * (np.sin(w * t + i) + 0.4 * np.sin(2.3 * w * t))
        v = 0.01 * w * (np.cos(w * t + i) + 0.92 * np.cos(2.3 * w * t))
        noise = 0.2 * rng.standard_normal(t.size)
        force = 3000.0 * x + 400.0 * v + friction * np.sign(v)
        force = factor * (force + noise) if noise_as_well else factor * force + noise
        file = f'r{i}.mcap'
        role = 'hold_out' if i == (len(factors) - 1 if held_out is None else held_out) else 'fit'
        entries.append({'file': file, 'role': role})
        channels[file] = {
            MOTION: ChannelSamples(MOTION, 'm', RATE, 0.0, x),
            FORCE: ChannelSamples(FORCE, 'N', RATE, 0.0, force),
        }
    whole = {
        'version': 1,
        'bench': {'kind': 'prescribed_motion', 'motion': MOTION, 'output': FORCE},
        'baseline': ['linear_spring_damper'],
        'recordings': entries,
    }
    return parse_campaign(whole, 'damper').with_samples(channels.__getitem__)


@pytest.mark.parametrize('noise_as_well', [True, False])
def test_a_recording_in_pounds_is_named_and_the_rest_explained(noise_as_well):
    given = strokes((1.0, 1.0, 1.0 / POUND, 1.0, 1.0), 12.0, noise_as_well=noise_as_well)
    answer = explain_driven(given)
    assert answer.accepted == ('wrong_parameter', 'coulomb_friction')
    wrong, friction = answer.findings
    assert wrong.recording == 'r2.mcap'
    assert wrong.channel == FORCE
    assert wrong.parameters['ratio'].value == pytest.approx(POUND, rel=0.04)
    assert 'pounds-force' in wrong.sentence
    assert friction.parameters['force'].value == pytest.approx(12.0, rel=0.02)
    assert answer.mismatch.regions[0].recording == 'r2.mcap'
    assert ('set right here' in answer.notes[-1]) is noise_as_well


@given(
    st.sampled_from([s**way for s, _ in FACTORS for way in (1.0, -1.0)]),
    st.integers(0, 3),
)
@settings(max_examples=12, deadline=None)
def test_any_factor_of_units_in_any_recording_is_set_right(factor, which):
    factors = [factor if i == which else 1.0 for i in range(4)]
    campaign = strokes(factors)
    right, (wrong,) = with_right_units(campaign)
    assert wrong.recording == f'r{which}.mcap'
    for r, clean in zip(right.recordings, strokes([1.0] * 4).recordings, strict=True):
        assert r.channels[FORCE].values == pytest.approx(clean.channels[FORCE].values, rel=1e-3)


@pytest.mark.parametrize(
    'factors',
    [
        (1.0, 1.0, 1.0, 1.0),
        (1.0, 1.0, 1.9, 1.0),  # no units differ by that: another device, say
        (1.0, 2.1, POUND, 1.0),  # the others do not agree
        (1.0, POUND, 1.0),  # one against one
    ],
)
def test_what_is_not_plainly_a_unit_is_left_alone(factors):
    campaign = strokes(factors)
    assert with_right_units(campaign) == (campaign, ())


def test_friction_that_is_much_less_at_high_speed_is_no_unit():
    campaign = strokes((1.0, 1.0, 1.0, 1.0), friction=400.0)
    assert with_right_units(campaign) == (campaign, ())
