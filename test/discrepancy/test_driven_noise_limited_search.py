"""Plates under a measured hammer, where noise is all that the right model leaves."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven, noise_limited
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import UnmodelledLaw, equivalent_gain
from impactscope.discrepancy.driven.findings.effect_and_law import leaves_noise
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.chi_square import PRICE, NoiseJudge
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.search.beam_search import Outcome
from impactscope.discrepancy.driven.search.other_minima import foretelling
from impactscope.discrepancy.time_limit import time_limited

RATE, SAMPLES, NOISE = 4000.0, 2000, 0.1
MASS, DAMPING, STIFFNESS = 1.6, 12.0, 1.6 * (2 * math.pi * 34.0) ** 2
FINE = 16  # steps of the reference in a sample


def force_at(time, blows):
    total = np.zeros(time.size)
    for begin, length, peak, power in blows:
        share = (time - begin) / length
        inside = (share > 0) & (share < 1)
        total[inside] += peak * np.sin(np.pi * share[inside]) ** power
    return total


def accelerations(blows, law, stiffness=None):
    """Central differences at many steps a sample: another integrator than the one examined.

    ``stiffness``: N/m at each of these steps, where it is not the same.
    """
    dt = 1.0 / (RATE * FINE)
    spring = np.full(SAMPLES * FINE, STIFFNESS) if stiffness is None else stiffness
    force = force_at(dt * np.arange(SAMPLES * FINE), blows)
    x = v = 0.0
    out = np.empty(SAMPLES)
    half = 0.5 * dt
    for i, u in enumerate(force):
        a = (u - spring[i] * x - DAMPING * v - law(x, v)) / MASS
        if i % FINE == 0:
            out[i // FINE] = a
        middle = v + half * a
        x = x + dt * middle
        ahead = min(i + 1, force.size - 1)
        pull = spring[ahead] * x + DAMPING * middle + law(x, middle)
        v = middle + half * (force[ahead] - pull) / MASS
    return out


def made(seed, law=lambda _x, _v: 0.0, chain=lambda y: y, sensor=None, laws=None, springs=None):
    """Four recordings of one or two blows, the last held out; ``springs``: see above, of each."""
    rng = np.random.default_rng(seed)
    entries, channels = [], {}
    time = np.arange(SAMPLES) / RATE
    for i in range(4):
        blows = [(0.06, rng.uniform(5e-3, 9e-3), rng.uniform(30, 120), 1.6)]
        if i % 2:
            blows.append((0.32, rng.uniform(5e-3, 9e-3), rng.uniform(20, 60), 2.0))
        own = law if laws is None else laws[i]
        output = chain(accelerations(blows, own, None if springs is None else springs[i]))
        output = output + NOISE * rng.standard_normal(SAMPLES)
        force = force_at(time, blows) + 0.01 * rng.standard_normal(SAMPLES)
        file = f'blow{i}.mcap'
        entries.append({'file': file, 'kind': 'driven', 'role': 'hold_out' if i == 3 else 'fit'})
        channels[file] = {
            'force.hammer': ChannelSamples('force.hammer', 'N', RATE, 0.0, force),
            'acceleration.plate': ChannelSamples('acceleration.plate', 'm/s^2', RATE, 0.0, output),
        }
    bench = {'kind': 'driven', 'input': 'force.hammer', 'outputs': ['acceleration.plate']}
    data = {
        'version': 1,
        'bench': bench,
        'model': {'modes': 1},
        'baseline': ['linear_sensor'],
        'sensor': sensor or {},
        'recordings': entries,
    }
    return parse_campaign(data).with_samples(channels.__getitem__)


def test_nothing():
    answer = explain_driven(made(1))
    assert answer.accepted == ()
    assert answer.mismatch.p_value > 3e-3
    for name, true in (('mass', MASS), ('damping', DAMPING), ('stiffness', STIFFNESS)):
        found = answer.baseline_parameters[name]
        assert abs(found.value - true) < 4 * found.std


def test_weak_dry_friction_is_found_with_its_size():
    """A hundredth of a newton: invisible in any plot, thirty times what chance would give."""

    def law(_x, v):
        return 0.02 * np.sign(v)

    answer = explain_driven(made(2, law))
    assert answer.accepted == ('coulomb_friction',)
    found = answer.ranking[0].parameters['force']
    assert abs(found.value - 0.02) < 4 * found.std
    assert answer.mismatch.p_value < 1e-6
    assert answer.mismatch.regions
    held_out = answer.fit.extended.held_out_rmse['acceleration.plate']
    assert held_out < 1.1 * NOISE


def test_ac_coupling_of_the_output_is_no_asymmetric_spring():
    b, a = signal.butter(1, 0.15, btype='high', fs=RATE)
    answer = explain_driven(made(3, chain=lambda y: signal.lfilter(b, a, y)))
    assert answer.accepted == ('ac_coupling',)
    assert answer.ranking[0].channel == 'acceleration.plate'
    corner = answer.ranking[0].parameters['corner']
    assert abs(corner.value - 0.15) < 4 * corner.std


def test_a_cubic_spring_is_found_in_a_channel_that_drifts_far():
    """The drift alone leaves many times the noise, and slow modes explain most of it."""
    ramp = 8.0 * np.arange(SAMPLES) / RATE

    def law(x, _v):
        return 4e7 * x**3

    answer = explain_driven(made(4, law, chain=lambda y: y + ramp))
    assert set(answer.accepted) == {'hardening_spring', 'zero_drift'}
    found = {f.name: f.parameters for f in answer.ranking}
    for name, number, true in (('hardening_spring', 'cubic', 4e7), ('zero_drift', 'rate', 8.0)):
        told = found[name][number]
        assert abs(told.value - true) < 4 * told.std


def test_a_strong_filter_is_no_further_mode():
    """What it leaves is far from noise, and a mode as damped as the filter explains most of it."""
    sections = signal.butter(2, 250.0, fs=RATE, output='sos')
    answer = explain_driven(made(6, chain=lambda y: signal.sosfilt(sections, y)))
    assert answer.accepted == ('low_pass_filter',)
    cutoff = answer.ranking[0].parameters['cutoff']
    assert abs(cutoff.value - 250.0) < 4 * cutoff.std


def test_stiffness_that_differs_between_recordings_is_unknown():
    laws = [lambda x, _v, s=s: s * STIFFNESS * x for s in (0.0, 5e-4, -5e-4, 0.0)]
    answer = explain_driven(made(4, laws=laws))
    assert answer.accepted == ('unknown',)
    assert answer.unexplained
    assert 'recordings' in answer.summary()


def test_stiffness_that_swings_does_not_wait_for_recordings_to_begin():
    time = np.arange(SAMPLES * FINE) / (RATE * FINE)
    turn = 2.0 * np.pi * 13.0 * time
    springs = [STIFFNESS * (1.0 + 1e-3 * np.cos(turn + at)) for at in (0.4, 2.6, 4.4, 1.0)]
    answer = explain_driven(made(12, springs=springs))
    assert answer.accepted == ('unknown',)
    assert 'swings at' in answer.unexplained_description


def test_a_wrong_stated_mass_is_a_parameter():
    answer = explain_driven(
        made(5, sensor={'moving_mass': {'value': 0.9 * MASS, 'std': 0.005 * MASS}})
    )
    assert answer.accepted == ('wrong_parameter',)
    ratio = answer.ranking[0].parameters['ratio']
    assert ratio.value == pytest.approx(1 / 0.9, rel=0.01)
    assert answer.model['sensor']['moving_mass']['value'] == pytest.approx(MASS, rel=0.01)


def test_several_numbers_are_worth_one():
    """As unlikely by chance; nothing changes for one."""
    assert equivalent_gain(20.0, 1) == 20.0
    assert equivalent_gain(20.0, 4) < 20.0
    assert UnmodelledLaw('', 20.0, 4).p_value > UnmodelledLaw('', 20.0, 1).p_value
    far = [equivalent_gain(g, 5) for g in (1000.0, 1290.0, 1310.0, 5000.0)]
    assert far == sorted(far)


@pytest.mark.parametrize(
    'law',
    [
        lambda _x, v: 6.0 * max(v, 0.0) ** 2,
        lambda _x, v: -6.0 * min(v, 0.0) ** 2,
        lambda x, v: -300.0 * min(x, 0.0) * np.sign(v),
    ],
    ids=['inwards', 'outwards', 'friction to one side'],
)
def test_what_acts_one_way_is_neither_a_coupling_nor_a_yielding_base(law):
    assert explain_driven(made(10, law)).accepted == ('unknown',)


def test_uneven_friction_beside_an_offset_of_the_accelerometer():
    """A load that stays is in uneven friction; an accelerometer shows none of it as an offset."""

    def rubs(_x, v):
        return (0.2 if v > 0.0 else 0.8) * np.tanh(v / 1e-4)

    answer = explain_driven(made(21, rubs, lambda y: y + 0.05))
    assert set(answer.accepted) == {'asymmetric_friction', 'offset'}
    found = next(f for f in answer.ranking if f.name == 'asymmetric_friction').parameters
    assert found['force_forward'].value == pytest.approx(0.2, rel=0.1)
    assert found['force_backward'].value == pytest.approx(0.8, rel=0.1)


@pytest.mark.parametrize(
    ('deeper', 'told', 'kept'),
    [
        (1.7, -3000.0, ['other']),  # as deep, and held-out recordings are missed by far
        (1.7, -20.0, ['made', 'other']),  # missed as noise does it
        (50.0, -3000.0, ['made', 'other']),  # deeper by far than what foretells them
        (1.7, math.nan, ['other']),  # a simulation that ran off
    ],
)
def test_of_minima_as_deep_held_out_recordings_tell_which_it_is(deeper, told, kept):
    """A frame of 10 Hz bends two fitted moves of an axis as one of 14 Hz does."""
    made, other = (
        SimpleNamespace(label=label, residuals=(np.zeros(1),)) for label in ('made', 'other')
    )
    squares = {id(made): 100.0, id(other): 100.0 + deeper}
    judge = SimpleNamespace(
        segments=[SimpleNamespace(held_out=False)],
        chi_squares=lambda f: (squares[id(f)],),
        gain=lambda _small, large: SimpleNamespace(held_out=told if large is made else 0.0),
    )
    assert [f.label for f in foretelling(judge, [made, other])] == kept


@pytest.mark.parametrize(
    ('rival', 'numbers', 'chosen'),
    [
        (-517.0, 5, 'base'),  # behind what was chosen, ahead of where that ends
        (-512.0, 5, 'play'),  # behind that end as well
        (-523.0, 5, 'play'),  # ahead of what was chosen, which another rule has preferred
        (-517.0, 7, 'play'),  # richer
    ],
)
def test_a_rival_is_asked_again_where_a_deeper_minimum_is_foretold_worse(
    monkeypatch, rival, numbers, chosen
):
    def made(name, criterion, added=6):
        return SimpleNamespace(name=name, level=criterion, added=added, terms=(name,))

    before, lower = made('play', -521.0), made('play', -515.0)
    other, nothing = made('base', rival, numbers), SimpleNamespace(level=0.0, terms=())
    judge = SimpleNamespace(criterion=lambda f, _: f.level, better=lambda *_: True)
    monkeypatch.setattr(
        noise_limited, '_lowest', lambda _case, fit, _: lower if fit is before else fit
    )
    monkeypatch.setattr(noise_limited, '_held_against_laws', lambda _case, o: o.best.name)
    outcome = Outcome(nothing, before, (other,), True)
    found, said = noise_limited._with_other_minima(SimpleNamespace(judge=judge), outcome, 'play')
    assert found.best.name == said == chosen  # a verdict is of what is told
    assert {f.name for f in (found.best, *found.rivals)} == {'play', 'base'}


@pytest.mark.parametrize('loud', [0.9, 0.97, 1.0, 1.08, 1.3])
def test_noise_that_was_taken_for_another_level_is_as_likely_as_if_it_had_been_known(loud):
    """Slow noise would win else: its level is judged by what is left."""
    count = 20_000
    left = 0.1 * np.random.default_rng(3).standard_normal(count)
    taken = 0.1 * loud
    segments = [
        Segment(
            'r.mcap',
            'acceleration.plate',
            'm/s^2',
            False,
            0.0,
            1.0 / RATE,
            left,
            np.zeros((1, count)),
            noise=taken,
            whitener=lambda r: r / taken,
        )
    ]
    bare = Fit((), {}, {}, (), (left,), 0)
    case = SimpleNamespace(judge=NoiseJudge(segments), segments=segments)
    nothing = SimpleNamespace(left=False)
    misfit = noise_limited._misfit(case, Outcome(bare, bare, (), believed=False), nothing)
    known = float(np.sum((left / 0.1) ** 2)) - count * math.log(loud**2)
    assert misfit == pytest.approx(known, abs=PRICE + 2.0)


@pytest.mark.parametrize(('taken', 'noise'), [(1.0, True), (0.97, True), (0.9, False)])
def test_what_a_law_leaves_is_noise_to_within_what_its_level_is_known(taken, noise):
    """A level that is read from few parts of a spectrum errs by more than chi-square scatters."""
    count = 20_000
    left = np.random.default_rng(5).standard_normal(count)
    law = UnmodelledLaw('a law', 300.0, 1, np.ones(count))
    segment = SimpleNamespace(held_out=False, measured=left)
    judge = SimpleNamespace(
        segments=[segment],
        chi_squares=lambda _: (float(np.sum((left / taken) ** 2)) + 300.0,),
    )
    assert leaves_noise(SimpleNamespace(judge=judge), None, law) is noise


@pytest.mark.parametrize(('stands', 'searches'), [(True, 1), (False, 2)])
def test_a_finding_has_to_stand_in_the_noise_that_it_leaves_even_without_time(
    monkeypatch, stands, searches
):
    """Noise judged with something else in it makes a finding of what is none."""
    term = SimpleNamespace(label='offset')
    bare, found = SimpleNamespace(terms=()), SimpleNamespace(terms=(term,), values={}, starts=())
    judge = SimpleNamespace(better=lambda _small, _large: stands)
    anew = SimpleNamespace(
        model=SimpleNamespace(drifts=True), judge=judge, segments=(), baseline=bare
    )
    answer = SimpleNamespace(accepted=('offset',), notes=())
    searched = []

    def exact(_campaign, case, *_args, **_kwargs):
        searched.append(case)
        best = found if len(searched) == 1 else bare
        return SimpleNamespace(answer=answer, outcome=SimpleNamespace(best=best))

    for name, value in {
        '_exact': exact,
        '_alike': lambda one, other: one is other,
        '_errs': lambda _answer: False,
        'reduced': lambda *_: 1.0,
        'with_known': lambda *_: bare,
        'fit': lambda *_: found,
    }.items():
        monkeypatch.setattr(noise_limited, name, value)
    first = SimpleNamespace(model=anew.model, judge=judge)
    with time_limited(0.0) as limit:
        made = noise_limited._repeated(None, first, lambda *_: anew, (), lambda *_: None)
    assert len(searched) == searches
    assert bool(limit.left_out) is stands  # what was done is not told as left out
    assert made.outcome.best is (found if stands else bare)
