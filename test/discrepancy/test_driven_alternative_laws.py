"""What could stand in the place of what was found."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.search.alternative_laws import peak_at_rest, plain_friction
from impactscope.discrepancy.driven.search.joint_fits import Fits, labels_of

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


def law(name, **starts):
    """A law with numbers, by their first values."""
    numbers = tuple(SimpleNamespace(name=n, starts=s) for n, s in starts.items())
    return SimpleNamespace(label=name, name=name, numbers=numbers, stands_with=lambda _: True)


PLAIN = law('coulomb_friction', force=(0.01,))
PEAKED = law(
    'stribeck_friction', kinetic_force=(0.04,), excess_force=(0.04,), speed=(0.001, 0.01, 0.2)
)


class Tried(Fits):
    """Fits that end with what ``ends`` tells of their beginning, which is kept."""

    def __init__(self, known, ends):
        self.model = SimpleNamespace(terms=(PLAIN, PEAKED))
        self.baseline = SimpleNamespace(terms=(), left=90.0)
        self.known = {labels_of(f.terms): f for f in known}
        self.ends, self.began = ends, []

    def misfit(self, made):
        return made.left

    def _fit(self, base, terms, initial, _least):
        self.began.append(initial)
        return SimpleNamespace(terms=terms, left=self.ends(initial))


@pytest.mark.parametrize(('again', 'taken'), [(21.0, True), (90.0, False)])
def test_plain_friction_is_tried_again_where_it_had_stood_still(again, taken):
    """Met before a play beside it was known, it may have stopped where no slope leads on."""
    sizes = {'kinetic_force': 0.1, 'excess_force': 0.8, 'speed': 0.2}
    best = SimpleNamespace(
        terms=(PEAKED,), values={f'stribeck_friction.{k}': v for k, v in sizes.items()}, left=22.0
    )
    stuck = SimpleNamespace(terms=(PLAIN,), left=66.0)
    fits = Tried((best, stuck), lambda _: again)
    judge = SimpleNamespace(fuller=lambda small, large: large.left < small.left)
    found = plain_friction(fits, best, judge)
    assert (found is not best) is taken
    assert fits.began == [{'coulomb_friction.force': pytest.approx(0.5)}]


def test_a_peak_at_rest_is_tried_from_each_of_its_speeds():
    """From one alone it had ended as a friction that fades over the whole range of speeds."""
    best = SimpleNamespace(terms=(PLAIN,), values={'coulomb_friction.force': 2.0}, left=22.0)
    speed = 'stribeck_friction.speed'
    fits = Tried((best,), lambda initial: 11.0 if initial[speed] == 0.01 else 40.0)
    found = peak_at_rest(fits, best, SimpleNamespace(criterion=lambda made, _: made.left))
    assert (found.terms, found.left) == ((PEAKED,), 11.0)
    assert [begin[speed] for begin in fits.began] == [0.001, 0.01, 0.2]
    for begin in fits.began:
        assert begin['stribeck_friction.kinetic_force'] == pytest.approx(1.8)
        assert begin['stribeck_friction.excess_force'] == pytest.approx(0.4)


def test_a_pendulum_in_air_swings_by_its_weight():
    """The cube of the angle is found first, then drag; what is left looks like a soft stop."""
    rng = np.random.default_rng(35)
    rate, noise, stiffness, damping, drag = 50.0, 0.004, 26.5, 0.03, 0.012
    entries, channels = [], {}
    for i, begin in enumerate(((0.9, 0.0), (0.5, 0.4), (1.2, 0.0), (0.7, -0.3))):
        time = np.arange(750) / rate

        def swings(_, y):
            return y[1], -stiffness * np.sin(y[0]) - damping * y[1] - drag * y[1] * abs(y[1])

        swing = solve_ivp(swings, (0.0, time[-1]), begin, t_eval=time, rtol=1e-9, atol=1e-9)
        values = swing.y[0] + noise * rng.standard_normal(time.size)
        file, name = f'r{i}.mcap', 'displacement.angle'
        entries.append({'file': file, 'role': 'hold_out' if i == 3 else 'fit'})
        channels[file] = {name: ChannelSamples(name, 'rad', rate, 0.0, values)}
    bench = {'kind': 'driven', 'input': 'none', 'outputs': ['displacement.angle']}
    whole = {'version': 1, 'bench': bench, 'baseline': ['linear_sensor'], 'recordings': entries}
    answer = explain_driven(parse_campaign(whole, 'pendulum').with_samples(channels.__getitem__))
    assert set(answer.accepted) == {'restoring_force', 'quadratic_damping'}
    found = {f.name: f.parameters for f in answer.findings}
    weight, air = found['restoring_force']['stiffness'], found['quadratic_damping']['coefficient']
    assert abs(weight.value - stiffness) < 4.0 * weight.std
    assert abs(air.value - drag) < 4.0 * air.std
