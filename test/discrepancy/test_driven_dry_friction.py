"""Dry friction of a plate: where its motion turns, the acceleration jumps."""

import dataclasses
import math

import numpy as np
import pytest

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.fits.friction_jumps import beside_turns, steady_slope
from impactscope.discrepancy.driven.fits.linearisation import linearised
from impactscope.discrepancy.driven.fits.simulation_error import Fit, fit
from impactscope.discrepancy.driven.fits.weighted_residuals import numbers_of
from impactscope.discrepancy.driven.model_selection.chi_square import BETWEEN, NoiseJudge, slight
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes, mechanical_terms
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel, inside_samples
from impactscope.discrepancy.driven.models.terms import Number
from impactscope.discrepancy.driven.noise.spectral_whitening import whitening
from impactscope.discrepancy.driven.search.joint_fits import measured_by

RATE, SAMPLES, NOISE, FORCE_NOISE = 4000.0, 4000, 0.08, 0.2
TRUE = {'mass': 1.7, 'damping': 20.0, 'stiffness': 1.7 * (2.0 * math.pi * 30.0) ** 2}
FORWARD, BACKWARD = 2.2, 0.7  # N
SCALES = {'mass': 1.7, 'damping': 20.0, 'stiffness': 6e4}


def model():
    numbers = tuple(Number(k, '', (v,), v, 1e-6 * v) for k, v in SCALES.items())
    sizes = Sizes(1e-3, 0.2, 150.0, 6e4, 'N', 'm')
    terms = mechanical_terms(sizes, spring=True, driven=True, angle=False)
    return OscillatorModel(numbers, terms, False, 1e-3, 0.2)


PLATE = model()
UNEVEN = next(t for t in PLATE.terms if t.label == 'asymmetric_friction')
SIZES = {
    'asymmetric_friction.force_forward': FORWARD,
    'asymmetric_friction.force_backward': BACKWARD,
}


def struck(seed, count=3, force_noise=FORCE_NOISE):
    """Recordings of two blows each, as (force, acceleration) with noise of both."""
    rng = np.random.default_rng(seed)
    time = np.arange(SAMPLES) / RATE
    found = []
    for _ in range(count):
        force = np.zeros(SAMPLES)
        for begin in (rng.uniform(0.1, 0.15), rng.uniform(0.5, 0.55)):
            share = np.clip((time - begin) / rng.uniform(4e-3, 8e-3), 0.0, 1.0)
            force += rng.uniform(80.0, 300.0) * np.sin(np.pi * share) ** 2
        true = segment(force, np.zeros(SAMPLES))
        y = PLATE.predict({**TRUE, **SIZES}, (UNEVEN,), np.zeros(0), true)
        felt = force + force_noise * rng.standard_normal(SAMPLES)
        found.append((felt, y + NOISE * rng.standard_normal(SAMPLES)))
    return found


def segment(force, output, name='r.mcap'):
    return Segment(
        name,
        'acceleration.plate',
        'm/s^2',
        False,
        0.0,
        1.0 / RATE,
        output,
        inside_samples(force, 1, held=False),
        derivative=2,
        noise=NOISE,
        whitener=whitening(np.full(2, NOISE**2)),
    )


def segments(seed):
    made = []
    for i, (force, output) in enumerate(struck(seed, force_noise=0.0)):
        made.append(segment(force, output, f'r{i}.mcap'))
    return made


@pytest.mark.parametrize('share', [-0.8, 0.0, 0.9])
def test_a_fit_finds_both_forces_from_anywhere(share):
    """Walls of jumps stood in its way, and uncertainties were a hundredth of the errors."""
    recordings = segments(1)
    mean = 0.5 * (FORWARD + BACKWARD)
    begin = {
        **{k: 1.02 * v for k, v in TRUE.items()},
        'asymmetric_friction.force_forward': mean * (1.0 + share),
        'asymmetric_friction.force_backward': mean * (1.0 - share),
    }
    found = fit(PLATE, (UNEVEN,), recordings, begin, tolerance=1e-6)
    for name, true in {**TRUE, **SIZES}.items():
        assert abs(found.values[name] - true) < 4.0 * found.std[name]
    assert found.std['asymmetric_friction.force_forward'] < 0.1


def test_slopes_have_no_jumps():
    """Mass, damper, spring and friction that are all larger only make the answer smaller."""
    recordings = segments(2)
    values = {**TRUE, **SIZES}
    made = fit(PLATE, (UNEVEN,), recordings, values, evaluations=1)
    slopes = linearised(PLATE, made, recordings).slopes
    larger = np.array([values[k] / n.scale for k, n in numbers_of(PLATE, (UNEVEN,))])
    louder = slopes @ larger
    signal = np.concatenate([s.measured for s in recordings]) / NOISE
    assert np.linalg.norm(louder) < 1.5 * np.linalg.norm(signal)


def test_the_steadier_side_is_the_slope():
    found = steady_slope([np.array([1.0, 50.0, -3.0]), np.array([1.1, 2.0, 4.0])])
    np.testing.assert_allclose(found, [1.0, 2.0, 0.0])
    np.testing.assert_allclose(steady_slope([np.array([3.0])]), [3.0])


def test_a_sample_beside_a_turn_may_lie_on_either_side():
    speed = np.array([3.0, 2.0, 1.0, -1.0, -2.0, -3.0, -4.0])
    predicted = np.array([0.0, 0.0, 0.0, 5.0, 5.0, 5.0, 5.0])
    left = np.zeros(7)
    left[2], left[4] = 5.1, 5.0  # the first turned a sample earlier; the second is off by itself
    found = beside_turns(left, predicted, speed, 1.0)
    np.testing.assert_allclose(found, [0.0, 0.0, 0.1, 0.0, 5.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(beside_turns(left, predicted, speed, 6.0), left)


def test_an_amount_that_starts_from_next_to_nothing_has_its_uncertainty():
    """Measured by its start it passed for a number that is not seen: known without error."""
    recordings = segments(4)
    begin = {**TRUE, **SIZES}
    usual = fit(PLATE, (UNEVEN,), recordings, begin, tolerance=1e-6)
    tiny = dataclasses.replace(UNEVEN.numbers[0], scale=1e-7)
    term = dataclasses.replace(UNEVEN, numbers=(tiny, *UNEVEN.numbers[1:]))
    found = fit(PLATE, (term,), recordings, begin, tolerance=1e-6)
    for name, std in usual.std.items():
        assert found.std[name] == pytest.approx(std, rel=0.2)


def test_a_law_of_several_amounts_is_measured_by_the_largest():
    term = dataclasses.replace(UNEVEN, amounts=('force_forward', 'force_backward'))
    first, last = (f'asymmetric_friction.{n}' for n in term.amounts)
    assert [n.scale for n in measured_by(term, {first: 1e-6, last: -0.5}).numbers] == [0.5, 0.5]
    assert measured_by(term, {}).numbers == term.numbers


@pytest.mark.parametrize('force', [FORWARD, 0.05 * FORWARD])
def test_small_jumps_must_gain_more(force):
    """Where turns fall between samples counts by whole jumps, unless these are taken as such."""
    recordings = segments(5)
    plain = next(t for t in PLATE.terms if t.label == 'coulomb_friction')
    judge = NoiseJudge(recordings)
    shift = tuple(s.measured for s in recordings)
    judge.reference = Fit((), TRUE, {}, (), shift, 0)
    noise = tuple(NOISE * np.random.default_rng(1).standard_normal(SAMPLES) for _ in recordings)
    made = Fit((plain,), {**TRUE, 'coulomb_friction.force': force}, {}, (), noise, 1)
    share = judge.beside(made) / judge.gain(judge.reference, made).fitted
    assert share == pytest.approx(slight(made) if force == FORWARD else BETWEEN**2)


def campaign(recordings):
    entries, channels = [], {}
    for i, (force, output) in enumerate(recordings):
        file = f'blow{i}.mcap'
        role = 'hold_out' if i == len(recordings) - 1 else 'fit'
        entries.append({'file': file, 'role': role})
        channels[file] = {
            'force.hammer': ChannelSamples('force.hammer', 'N', RATE, 0.0, force),
            'acceleration.plate': ChannelSamples('acceleration.plate', 'm/s^2', RATE, 0.0, output),
        }
    bench = {'kind': 'driven', 'input': 'force.hammer', 'outputs': ['acceleration.plate']}
    data = {'version': 1, 'bench': bench, 'model': {'modes': 1}, 'baseline': ['linear_sensor']}
    return parse_campaign({**data, 'recordings': entries}).with_samples(channels.__getitem__)


def test_strong_friction_that_differs_by_direction_is_found_with_its_size():
    """The errors of the linear law were taken for recordings that begin in motion."""
    answer = explain_driven(campaign(struck(3, 4)))
    assert answer.accepted == ('asymmetric_friction',)
    found = answer.ranking[0].parameters
    for name, true in (('force_forward', FORWARD), ('force_backward', BACKWARD)):
        assert abs(found[name].value - true) < 4.0 * found[name].std
