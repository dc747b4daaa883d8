"""Free decays that somebody held or pushed at first: what a note says of them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.systems.free_decay_start import forced_beginning
from impactscope.discrepancy.driven.systems.linear_baseline import linear_start

RATE, CHANNEL = 100.0, 'displacement.plate'
SQUARE = 40.0  # of the natural frequency, 1/s^2


def swings(force=lambda x, v: 0.0, held=False):
    """Three decays, of which the hand lets go after 0.3 to 0.4 s where they are ``held``."""
    channels, entries = {}, []
    time = np.arange(1000) / RATE
    for i, begin in enumerate((0.5, 0.3, 0.4)):
        until = 0.3 + 0.05 * i

        def rates(t, y, begin=begin, until=until):
            hand = SQUARE * begin * np.clip((until - t) / 0.15, 0.0, 1.0) if held else 0.0
            return y[1], hand - SQUARE * y[0] - 0.15 * y[1] - force(*y)

        made = solve_ivp(
            rates, (0.0, time[-1]), (begin, 0.0), t_eval=time, rtol=1e-8, max_step=0.02
        )
        values = made.y[0] + 2e-4 * np.random.default_rng(i).standard_normal(time.size)
        channels[f'r{i}.mcap'] = {CHANNEL: ChannelSamples(CHANNEL, 'm', RATE, 0.0, values)}
        entries.append({'file': f'r{i}.mcap', 'role': 'hold_out' if i == 2 else 'fit'})
    bench = {'kind': 'driven', 'input': 'none', 'outputs': [CHANNEL]}
    data = {'version': 1, 'bench': bench, 'baseline': ['linear_sensor'], 'recordings': entries}
    return parse_campaign(data).with_samples(channels.__getitem__)


def test_a_hand_that_lets_go_late_is_told_with_when():
    answer = explain_driven(swings(held=True))
    assert 'unknown' in answer.accepted
    (note,) = (n for n in answer.notes if 'held or pushed' in n)
    late = float(note.split('first ')[1].split(' s')[0])
    assert 0.4 <= late < 1.0
    assert 'r0.mcap' in note


@pytest.mark.parametrize(
    'force',
    [
        lambda x, v: 0.0,
        lambda x, v: 60.0 * x**3,
        lambda x, v: 0.8 * abs(v) * v,
        lambda x, v: 0.3 * np.tanh(v / 1e-3),
    ],
    ids=['linear', 'cubic', 'drag', 'friction'],
)
def test_what_goes_with_the_amplitude_is_no_hand(force):
    campaign = swings(force)
    assert forced_beginning(campaign, linear_start(campaign, [])) == ''
