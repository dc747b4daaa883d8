"""AC coupling of an impactor's accelerometer: it remembers a fall that no model tells."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import signal
from test_impact_comes_back import CONTACT, RATE, carts

from impactscope.discrepancy.explain import explain

CORNER, NOISE = 0.05, 0.02
HELD = round((CONTACT - 0.05) * RATE)  # samples until the impactor is let go


@pytest.mark.slow
def test_a_coupling_behind_a_pull_is_found_beside_it():
    campaign = carts(7, 0.4, 0.5, NOISE)
    rng = np.random.default_rng(8)
    high_pass = signal.butter(1, CORNER, btype='high', fs=RATE)

    def coupled(channel):
        values = channel.values.copy()
        values[:HELD] = NOISE * rng.standard_normal(HELD)
        return dataclasses.replace(channel, values=signal.lfilter(*high_pass, values))

    recordings = tuple(
        dataclasses.replace(
            r,
            channels={
                n: coupled(c) if n == 'acceleration.impactor' else c for n, c in r.channels.items()
            },
        )
        for r in campaign.recordings
    )
    answer = explain(dataclasses.replace(campaign, recordings=recordings))
    assert set(answer.accepted) == {'gravity_load', 'ac_coupling'}
    found = {f.name: f.parameters for f in answer.findings}
    for name, key, true in (('ac_coupling', 'corner', CORNER), ('gravity_load', 'force', 0.4)):
        number = found[name][key]
        assert abs(number.value - true) < 3.0 * number.std < 0.3 * true
