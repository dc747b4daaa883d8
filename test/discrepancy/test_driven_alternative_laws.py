"""What could stand in the place of what was found."""

import numpy as np
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven

RATE, SAMPLES, NOISE = 1000.0, 4000, 0.3
CHANNELS = 'force.before', 'force.after'


def test_a_coupling_beside_an_offset():
    """What a coupling may still hold of the time before looks like an offset, or a drift."""
    rng = np.random.default_rng(7)
    b, a = signal.butter(1, 0.09, btype='high', fs=RATE)
    entries, channels = [], {}
    for i in range(6):
        time = np.arange(SAMPLES) / RATE
        pushes = rng.uniform(20.0, 60.0) * np.exp(-(((time - rng.uniform(1.0, 1.6)) / 0.4) ** 2))
        wave = 4.0 * np.sin(2.0 * np.pi * rng.uniform(1.0, 3.0) * time + rng.uniform(0.0, 6.0))
        before = pushes + wave
        after = signal.lfilter(b, a, before) - 0.08
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i > 3 else 'fit'})
        pair = before + 0.02 * NOISE * rng.standard_normal(SAMPLES), after
        channels[file] = {
            c: ChannelSamples(c, 'N', RATE, 0.0, np.asarray(values, np.float32).astype(float))
            for c, values in zip(
                CHANNELS, (pair[0], pair[1] + NOISE * rng.standard_normal(SAMPLES)), strict=True
            )
        }
    bench = {'kind': 'chain', 'input': CHANNELS[0], 'output': CHANNELS[1]}
    whole = {'version': 1, 'bench': bench, 'baseline': [], 'recordings': entries}
    answer = explain_driven(parse_campaign(whole, 'coupled').with_samples(channels.__getitem__))
    assert set(answer.accepted) == {'ac_coupling', 'offset'}
    numbers = {f.name: f.parameters for f in answer.findings}
    corner, level = numbers['ac_coupling']['corner'], numbers['offset']['value']
    assert abs(corner.value - 0.09) < 4.0 * corner.std < 0.02
    assert abs(level.value + 0.08) < 4.0 * level.std < 0.08
