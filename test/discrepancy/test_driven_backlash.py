"""Play of an axis that no spring holds."""

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.models.backlash import (
    COUPLED,
    backlash_terms,
    follow,
    run_with_backlash,
)

RATE = 1000.0
MASS, DAMPING = 20.0, 60.0


def run(force, gap, share=0.4, contact=(150.0, 0.3), side=0.0, speed=0.0, damping=DAMPING):
    drive = np.repeat(np.asarray(force, float)[:-1, None], 3, axis=1)
    out = np.zeros((len(force), 4))
    play = np.array([gap, share, *contact, side])
    run_with_backlash(np.array([MASS, damping, 0.0]), play, drive, 1.0 / RATE, 0.0, speed, out)
    return out


def test_without_a_gap_both_masses_are_one():
    force = 30.0 * np.ones(2000)
    time = np.arange(2000) / RATE
    lag = MASS / DAMPING
    rigid = 30.0 / DAMPING * (time - lag * (1.0 - np.exp(-time / lag)))
    for side in (0.0, 1.0):
        # the contact gives by share * force over its stiffness
        assert np.max(np.abs(run(force, 0.0, side=side)[:, 0] - rigid)) < 3e-5


def test_inside_the_gap_the_drive_moves_alone():
    gap, share = 0.01, 0.4
    out = run(np.full(60, 8.0), gap, share, damping=0.0)
    time = np.arange(60) / RATE
    alone = 0.5 * 8.0 / (MASS * (1.0 - share)) * time**2
    inside = alone < 0.5 * gap
    assert np.count_nonzero(inside) > 50
    np.testing.assert_allclose(out[inside, 0], alone[inside], rtol=1e-9, atol=1e-15)


def test_a_contact_keeps_the_momentum():
    force = np.zeros(3000)
    force[:40] = 100.0
    drive = run(force, 2e-3, damping=0.0)
    load = run(force, 2e-3, side=1.0, damping=0.0)
    momentum = MASS * (0.6 * drive[:, 1] + 0.4 * load[:, 1])
    np.testing.assert_allclose(momentum[41:], 100.0 * 40 / RATE, rtol=1e-9)
    assert np.ptp(drive[2500:, 0] - load[2500:, 0]) <= 2e-3


def test_an_encoder_behind_a_play():
    x = np.array([0.0, 0.4, 1.0, 3.0, 2.5, 1.5, 0.0])
    out = np.empty(7)
    follow(x, 2.0, out)
    np.testing.assert_allclose(out, [0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 1.0])


def test_candidates_of_play_are_one_effect():
    terms = backlash_terms(0.1, 'm', RATE, frozenset({'coulomb_friction'}))
    assert {t.name for t in terms} == {'clearance', COUPLED}
    assert len({t.label for t in terms}) == len(terms)
    assert not any(a.stands_with(b) for a in terms for b in terms if a is not b)


@pytest.mark.parametrize('side', [0.0, 1.0])
def test_contacts_lose_energy_and_never_gain(side):
    force = np.zeros(4000)
    force[:100] = 50.0
    speed = run(force, 1e-3, side=side)[:, 1]
    assert np.max(np.abs(speed[2000:])) < np.max(np.abs(speed[:500]))


def test_a_load_on_a_belt_is_no_play():
    """Two masses on one spring that never part: not in the library, and told as what it is."""
    rng = np.random.default_rng(25)
    rate, size, noise = 500.0, 3000, 1e-5
    drive, load, stiffness, loss, rail = 3.0, 8.0, 2.2e5, 60.0, 40.0  # the rail damps the cart
    a = np.array([
        [0.0, 1.0, 0.0, 0.0],
        [-stiffness / drive, -loss / drive, stiffness / drive, loss / drive],
        [0.0, 0.0, 0.0, 1.0],
        [stiffness / load, loss / load, -stiffness / load, -(loss + rail) / load],
    ])  # fmt: skip
    b = np.array([[0.0], [1.0 / drive], [0.0], [0.0]])
    fine = 10
    time = np.arange(fine * size) / (fine * rate)
    cart = np.array([[0.0, 0.0, 1.0, 0.0]])
    step = signal.cont2discrete((a, b, cart, np.zeros((1, 1))), time[1], 'foh')
    entries, channels = [], {}
    for i in range(4):
        waves = rng.uniform(1.0, 60.0, 12), rng.uniform(0.0, 2.0 * np.pi, 12)
        force = sum(4.0 * np.sin(2.0 * np.pi * f * time + p) for f, p in zip(*waves, strict=True))
        _, moved, _ = signal.dlsim((*step[:4], time[1]), force[:, None])
        position = moved[::fine, 0] + noise * rng.standard_normal(size)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 3 else 'fit'})
        channels[file] = {
            'force.motor': ChannelSamples('force.motor', 'N', rate, 0.0, force[::fine]),
            'displacement.cart': ChannelSamples('displacement.cart', 'm', rate, 0.0, position),
        }
    whole = {
        'version': 1,
        'bench': {'kind': 'driven', 'input': 'force.motor', 'outputs': ['displacement.cart']},
        'model': {'restoring': 'none'},
        'baseline': ['linear_mass_damper'],
        'recordings': entries,
    }
    answer = explain_driven(parse_campaign(whole, 'belt').with_samples(channels.__getitem__))
    assert answer.accepted == ('unknown',)
    assert answer.unexplained
    assert 'elastic coupling' in answer.unexplained_description
    found = answer.ranking[0].parameters
    belt = np.sqrt(stiffness * (1.0 / drive + 1.0 / load)) / (2.0 * np.pi)
    assert abs(found['frequency'].value - belt) < 0.01 * belt
    assert 'load_share' not in found  # it hangs on which of the two the damping acts on
