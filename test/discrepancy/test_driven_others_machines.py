"""What recordings of machines that others built have taught."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.explain import _left_more
from impactscope.discrepancy.driven.findings.explains_nothing import explains_nothing
from impactscope.discrepancy.driven.findings.ranking import _at_an_end, _one_way
from impactscope.discrepancy.driven.findings.residual_size import _comes_and_goes, _no_machine
from impactscope.discrepancy.driven.models.terms import Number
from impactscope.discrepancy.driven.search.beam_search import _in_plainer_form
from impactscope.discrepancy.driven.systems.linear_baseline import with_rest_at_zero
from impactscope.discrepancy.driven.systems.linear_oscillator import reversed_channels
from impactscope.discrepancy.driven.systems.mass_and_damper import answers_in_time
from impactscope.discrepancy.driven.systems.prescribed_motion import (
    force_counts_against,
    linear_prescribed,
)
from impactscope.recordings.units import to_si

RATE = 200.0


def free(recordings, channel, unit, baseline='linear_sensor'):
    """A campaign of free motions; the last is held out."""
    channels, entries = {}, []
    for i, values in enumerate(recordings):
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == len(recordings) - 1 else 'fit'})
        channels[file] = {channel: ChannelSamples(channel, unit, RATE, 0.0, values)}
    whole = {
        'version': 1,
        'bench': {'kind': 'driven', 'input': 'none', 'outputs': [channel]},
        'baseline': [baseline],
        'recordings': entries,
    }
    return parse_campaign(whole, 'machine').with_samples(channels.__getitem__)


def pendulum(begin, seconds=7.0):
    time = np.arange(int(seconds * RATE)) / RATE
    return solve_ivp(
        lambda _t, y: (y[1], -64.0 * math.sin(y[0]) - 0.06 * y[1]),
        (0.0, float(time[-1])),
        (begin, 0.0),
        t_eval=time,
        rtol=1e-9,
        atol=1e-11,
    ).y


def noise(size, scale, seed):
    return scale * np.random.default_rng(seed).standard_normal(size)


@pytest.mark.slow
@pytest.mark.parametrize('hangs', [0.0, math.pi])
def test_a_wide_swing_goes_with_the_sine_wherever_the_encoder_has_its_zero(hangs):
    begins = (1.6, 1.3, 1.45)
    swings = [pendulum(b)[0] + hangs + noise(1400, 2e-3, i) for i, b in enumerate(begins)]
    answer = explain_driven(free(swings, 'displacement.arm', 'rad'))
    assert answer.accepted == ('restoring_force',)
    assert answer.findings[0].parameters['stiffness'].value == pytest.approx(64.0, rel=2e-3)
    assert any('swings about 3.1' in note for note in answer.notes) == (hangs > 0.0)


def test_the_zero_of_a_speed_that_never_comes_by_zero_is_taken_away():
    speeds = [pendulum(b, 4.0)[1] + 5.0 for b in (0.3, 0.2)]
    campaign = with_rest_at_zero(free(speeds, 'velocity.gyro', 'rad/s'))
    for r, speed in zip(campaign.recordings, speeds, strict=True):
        left = speed - r.channels['velocity.gyro'].values
        assert left == pytest.approx(5.0, abs=0.1)
    assert 'the zero of its sensor' in campaign.notes[0]
    crossing = free([pendulum(b, 4.0)[1] + 0.1 for b in (0.3, 0.2)], 'velocity.gyro', 'rad/s')
    assert with_rest_at_zero(crossing) is crossing


def test_recordings_that_have_no_value_in_common_have_a_zero_each():
    """As when the sensor was moved between them, or is another one."""
    swings = [pendulum(b, 4.0)[0] + at for b, at in ((0.3, 2.0), (0.2, 2.0), (0.02, -0.01))]
    campaign = with_rest_at_zero(free(swings, 'displacement.arm', 'rad'))
    for r, swing, at in zip(campaign.recordings, swings, (2.0, 2.0, -0.01), strict=True):
        left = swing - r.channels['displacement.arm'].values
        assert left == pytest.approx(at, abs=0.01)
    assert [n.partition(' swings')[0] for n in campaign.notes] == [
        'displacement.arm in r2.mcap',
        'displacement.arm in r0.mcap, r1.mcap never comes by zero; it',
    ]


def test_wheels_that_run_down_from_other_speeds_keep_their_zero():
    time = np.arange(800) / RATE
    speeds = [100.0 * np.exp(-0.1 * time), np.maximum(50.0 - 20.0 * time, 0.0)]
    campaign = free(speeds, 'velocity.wheel', 'rad/s', 'linear_mass_damper')
    assert with_rest_at_zero(campaign) is campaign


def rolls(force, mass, damping):
    """Position, m, of a mass without a spring under a force that is held between samples."""
    keep = math.exp(-damping / mass / RATE)
    speed = signal.lfilter([0.0, (1.0 - keep) / damping], [1.0, -keep], force)
    return signal.lfilter([0.5 / RATE, 0.5 / RATE], [1.0, -1.0], speed)


def test_what_rolls_away_under_slow_ramps_keeps_its_sign():
    """In its spectrum the ends of such a motion are all that is seen."""
    time = np.arange(int(20 * RATE)) / RATE
    parts = []
    for sign, shape in ((1.0, 0.25 * time), (-1.0, 0.25 * time), (1.0, np.full(time.size, 7.0))):
        place = rolls(sign * shape, 0.04, 0.37)
        place = place + noise(time.size, 0.01, 3)
        names = 'r', 'displacement.x', 'm', 'force.f', 'N', False
        parts.append(Cut(*names, 0.0, RATE, place, sign * shape, 0.01))
    assert reversed_channels(parts, spring=False) == ()
    left, gain, loss = answers_in_time(parts)[0]
    assert left < 0.01 * sum(float(c.output @ c.output) for c in parts)
    assert loss / gain == pytest.approx(0.37, rel=0.02)


@pytest.mark.slow
def test_a_wheel_that_runs_down_tells_its_friction():
    time = np.arange(int(6.0 * RATE)) / RATE
    drag, dry = 0.1, 1.4

    def angle(speed):
        fall = (1.0 - np.exp(-drag * time)) / drag
        return speed * fall - dry * (time - fall) / drag

    rolls = [angle(w) + noise(time.size, 0.02, i) for i, w in enumerate((28.0, 24.0, 20.0))]
    answer = explain_driven(free(rolls, 'displacement.wheel', 'rad', 'linear_mass_damper'))
    first = answer.findings[0]
    assert {first.name, *first.confused_with} >= {'coulomb_friction', 'offset'}
    amount = first.parameters.get('force') or first.parameters['value']
    assert abs(abs(amount.value) - dry) < 4.0 * amount.std < 0.5 * dry


def test_a_mass_is_never_less_than_none():
    """Ramps one way through a layer that relaxes: by plain regression its mass is negative."""
    time = np.arange(400) / 40.0
    cuts = []
    for speed in (1e-3, 5e-4, 2e-4):
        x = speed * time
        force = 2000.0 * x + 9.0 * (1.0 - np.exp(-x / 1e-3)) - 40.0 * np.gradient(x, 0.025)
        force[:20] += 3.0 * np.exp(-np.arange(20) / 4.0)
        cuts.append(
            Cut('a', 'force.x', 'N', 'displacement.x', 'm', False, 0.0, 40.0, force, x, math.nan)
        )
    model, _, made = linear_prescribed(cuts)
    assert made.values['mass'] >= 0.0
    # and as it never comes back, friction may be a spring that softens
    subject, friction = SimpleNamespace(model=model), SimpleNamespace(name='coulomb_friction')
    assert 'softening_spring' in _one_way(subject, friction)
    assert not _one_way(subject, SimpleNamespace(name='clearance'))
    turned = [
        Cut('a', 'force.x', 'N', 'displacement.x', 'm', False, 0.0, 40.0, -c.output, c.drive, 0.1)
        for c in cuts
    ]
    assert force_counts_against(turned)
    assert not force_counts_against(cuts)


def _left(parts, measured=None):
    left = np.concatenate(parts)
    shown = left if measured is None else measured
    segment = SimpleNamespace(measured=shown, begin=0.0, period=0.01, recording='r.mcap')
    return SimpleNamespace(segments=(segment,)), SimpleNamespace(residuals=(left,))


def test_what_comes_and_goes_is_no_noise():
    quiet, loud = noise(1500, 1.0, 0), noise(500, 6.0, 1)
    assert 'as large from 1' in _comes_and_goes(*_left([quiet, loud]))
    alone = quiet.copy()
    alone[[300, 301, 900]] = 200.0  # samples that stand out
    assert not _comes_and_goes(*_left([alone]))
    assert not _comes_and_goes(*_left([quiet, noise(500, 2.0, 1)]))
    walk = np.cumsum(noise(3000, 1.0, 2))
    assert not _comes_and_goes(*_left([walk]))  # slow noise is alike everywhere in its changes
    # an encoder at rest shows the same value again and again
    resting = np.concatenate([np.zeros(1500), np.rint(noise(500, 1.0, 3))])
    assert not _comes_and_goes(*_left([resting], resting))


def test_a_linear_model_with_impossible_numbers_explains_nothing():
    sound = SimpleNamespace(values={'mass': 2.0, 'damping': -0.1}, std={'mass': 0.1, 'damping': 1})
    assert not _no_machine(sound)
    wrong = SimpleNamespace(values={'mass': 4e4, 'damping': -5e3}, std={'mass': 9, 'damping': 600})
    assert 'damping' in _no_machine(wrong)


def test_a_number_at_the_end_of_what_it_may_be_has_no_uncertainty():
    number = Number('kinetic_force', 'N', (1.0,), 0.5, 0.0)
    assert _at_an_end(5e-3, number)
    assert not _at_an_end(0.1, number)
    assert not _at_an_end(-3.0, Number('value', 'N', (1.0,), 0.5))


def test_the_plain_form_of_the_leader_is_kept_beside_richer_ones():
    def made(*labels, added):
        names = tuple(SimpleNamespace(name=x.split('/')[0], label=x) for x in labels)
        return SimpleNamespace(terms=names, added=added)

    rich, other = made('friction/presliding', added=2), made('friction/speed', added=2)
    plain, offset = made('friction', added=1), made('offset', added=1)
    grown = [rich, other, offset, plain]
    assert _in_plainer_form(grown[:2], grown) == [plain]
    assert _in_plainer_form([rich, plain], grown) == []
    assert _in_plainer_form([offset, rich], [offset, rich]) == []


@pytest.mark.parametrize('unit', ['count', 'counts', 'ticks'])
def test_raw_counts_are_a_unit(unit):
    assert to_si(unit) == ('1', 1.0)


def test_a_force_that_counts_the_other_way_is_turned_and_a_note_says_so():
    """A damper under gas pressure, whose force is stated as pushing against the motion."""
    channels, entries = {}, []
    for i, frequency in enumerate((0.2, 0.5, 0.35)):
        time = np.arange(2000) / RATE
        x = 0.03 + 0.015 * np.sin(2.0 * math.pi * frequency * time)
        v = 0.015 * 2.0 * math.pi * frequency * np.cos(2.0 * math.pi * frequency * time)
        force = 300.0 * v + 15.0 * np.sign(v) - 43.0 + noise(2000, 0.3, i)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        channels[file] = {
            'force': ChannelSamples('force', 'N', RATE, 0.0, -force),
            'displacement': ChannelSamples('displacement', 'm', RATE, 0.0, x),
        }
    bench = {'kind': 'prescribed_motion', 'motion': 'displacement', 'output': 'force'}
    whole = {
        'version': 1,
        'bench': bench,
        'baseline': ['linear_spring_damper'],
        'recordings': entries,
    }
    campaign = parse_campaign(whole, 'damper').with_samples(channels.__getitem__)
    answer = explain_driven(campaign)
    assert set(answer.accepted) == {'coulomb_friction', 'offset'}
    rubs = next(f for f in answer.findings if f.name == 'coulomb_friction')
    assert rubs.parameters['force'].value == pytest.approx(15.0, rel=0.02)
    assert answer.extended_parameters['damping'].value == pytest.approx(300.0, rel=0.05)
    assert any('sign is opposite to that of displacement' in note for note in answer.notes)


def test_an_answer_that_leaves_most_of_its_channel_explains_nothing():
    time = np.arange(400.0)
    said = SimpleNamespace(
        accepted=('unknown',),
        traces=[
            SimpleNamespace(
                held_out=False, measured=5.0 + np.sin(time), extended=0.3 * np.sin(time)
            )
        ],
    )
    assert explains_nothing(said)
    said.traces[0].extended = 5.0 + 0.8 * np.sin(time)
    assert not explains_nothing(said)
    said.traces[0].extended, said.accepted = np.zeros(400), ('unknown', 'offset')
    assert not explains_nothing(said)
    assert not explains_nothing(None)


@pytest.mark.parametrize(
    ('fitted', 'held_out', 'more'), [(0.59, 0.45, True), (0.59, 0.35, False), (0.33, 0.45, False)]
)
def test_an_answer_that_leaves_more_than_a_plainer_one_is_none(fitted, held_out, more):
    """Five effects in slow noise against three that leave less of both recordings."""
    segments = [SimpleNamespace(channel='x', held_out=held) for held in (False, True)]
    made = SimpleNamespace(residuals=(np.full(50, 0.36), np.full(50, 0.35)), terms=('a',) * 3)
    figures = SimpleNamespace(rmse={'x': fitted}, held_out_rmse={'x': held_out})
    fit = SimpleNamespace(extended=figures)
    answer = SimpleNamespace(fit=fit, accepted=('a',) * 5)
    assert _left_more(answer, made, segments) is more
    assert _left_more(SimpleNamespace(fit=fit, accepted=('a',) * 3), made, segments) is more
    assert not _left_more(SimpleNamespace(fit=fit, accepted=('a',) * 2), made, segments)
    assert not _left_more(answer, None, segments)
    assert not _left_more(answer, made, segments[:1])
