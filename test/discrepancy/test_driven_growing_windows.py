"""Free swings of many cycles: a frequency that is slightly off has miscounted them."""

import functools
import math

import numpy as np
import pytest

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.fits.growing_windows import (
    fit_over_growing_windows,
    lost_count,
)
from impactscope.discrepancy.driven.fits.simulation_error import fit
from impactscope.discrepancy.driven.systems.linear_baseline import linear_start

RATE = 50.0
SQUARE, VISCOUS, DRY = 37.0, 0.03, 0.05  # 1/s^2, 1/s, rad/s^2
STEP = 2.0 * math.pi / 1200.0  # of the encoder, rad


@functools.cache
def swing(begin, seconds):
    """A pendulum from ``begin`` rad, s after s, shape (n,)."""
    inside = 8
    h = 1.0 / (RATE * inside)
    x, v, out = begin, 0.0, []
    for k in range(int(seconds * RATE) * inside):
        if k % inside == 0:
            out.append(x)
        left = h
        while left > 0.0:
            if v == 0.0 and SQUARE * abs(math.sin(x)) <= DRY:
                break
            way = math.copysign(1.0, v if v != 0.0 else -x)
            further = step(x, v, way, left)
            if way * further[1] >= 0.0:
                x, v = further
                break
            part = left * v / (v - further[1])  # it turns here
            x, v = step(x, v, way, part)[0], 0.0
            left -= part
    return np.array(out)


def step(x, v, way, h):
    """Runge and Kutta's, sliding one way."""

    def rate(angle, speed):
        return -SQUARE * math.sin(angle) - VISCOUS * speed - DRY * way

    a1 = rate(x, v)
    a2 = rate(x + 0.5 * h * v, v + 0.5 * h * a1)
    a3 = rate(x + 0.5 * h * (v + 0.5 * h * a1), v + 0.5 * h * a2)
    a4 = rate(x + h * (v + 0.5 * h * a2), v + h * a3)
    x += h * (v + h * (a1 + a2 + a3) / 6.0)
    return x, v + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0


@functools.cache
def campaign(seconds):
    entries, channels = [], {}
    for i, begin in enumerate((1.6, 1.4, 1.5)):
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        read = STEP * np.rint(swing(begin, seconds) / STEP)
        sampled = ChannelSamples('displacement.pendulum', 'rad', RATE, 0.0, read)
        channels[file] = {'displacement.pendulum': sampled}
    whole = {
        'version': 1,
        'bench': {'kind': 'driven', 'input': 'none', 'outputs': ['displacement.pendulum']},
        'baseline': ['linear_sensor'],
        'recordings': entries,
    }
    return parse_campaign(whole, 'pendulum').with_samples(channels.__getitem__)


def test_the_first_cycles_lead_to_all_of_them():
    begun = linear_start(campaign(80.0), [])
    hangs = next(t for t in begun.model.terms if t.label == 'restoring_force')
    rubs = next(t for t in begun.model.terms if t.label == 'coulomb_friction')
    off = {**begun.linear.values, 'stiffness': 0.6 * SQUARE, 'damping': 0.02}
    direct = fit(begun.model, (hangs, rubs), begun.segments, off)
    assert lost_count(begun.model, direct, begun.segments)
    grown = fit_over_growing_windows(begun.model, (hangs, rubs), begun.segments, off, begun.linear)
    assert not lost_count(begun.model, grown, begun.segments)
    assert grown.values['stiffness'] == pytest.approx(SQUARE, rel=1e-3)
    assert grown.values['coulomb_friction.force'] == pytest.approx(DRY, rel=0.1)


def test_a_pendulum_that_swings_until_it_stops():
    answer = explain_driven(campaign(40.0))
    assert set(answer.accepted) >= {'restoring_force', 'coulomb_friction'}
    assert 'unknown' not in answer.accepted
    table = answer.fit.extended
    assert table.held_out_rmse['displacement.pendulum'] < 4.0 * STEP
