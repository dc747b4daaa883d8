"""Prescribed motions of machines: forms of friction, exact hysteresis, what a motion can tell."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.simulation_error import fit
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge
from impactscope.discrepancy.driven.models.equation_of_motion import yielded
from impactscope.discrepancy.driven.search.beam_search import search
from impactscope.discrepancy.driven.systems.prescribed_motion import (
    force_counts_against,
    linear_prescribed,
    one_speed_told,
)

RATE = 200.0


def device(x, force, *, held_out=False, unit='m'):
    """A recording of a motion and its force."""
    return Cut(
        recording='a',
        channel='force',
        unit='N',
        drive_channel='displacement',
        drive_unit=unit,
        held_out=held_out,
        begin=0.0,
        rate=RATE,
        output=force,
        drive=x,
        noise=math.nan,
    )


def swing(amplitude=0.01, frequency=1.0, middle=0.0, seconds=6.0):
    """Time, position and speed of a sine with a little of its third harmonic."""
    t = (np.arange(round(seconds * RATE)) + 0.37) / RATE  # reversals between the samples
    w = 2.0 * np.pi * frequency
    x = middle + amplitude * (np.sin(w * t) + 0.3 * np.sin(3.1 * w * t))
    v = amplitude * w * (np.cos(w * t) + 0.93 * np.cos(3.1 * w * t))
    return t, x, v


def fitted(cuts, *labels, spring=True, **initial):
    model, segments, linear = linear_prescribed(cuts, spring=spring)
    by_label = {t.label: t for t in model.terms}
    terms = tuple(by_label[name] for name in labels)
    return fit(model, terms, segments, {**linear.values, **initial}, linear.starts)


@given(
    st.floats(-0.02, 0.02),
    st.floats(-0.05, 0.05).filter(lambda d: abs(d) > 1e-6),
    st.floats(1.0, 200.0),
    st.floats(-0.9, 0.9),
)
@settings(max_examples=60, deadline=None)
def test_the_yielding_element_is_integrated_exactly(h, moved, closing, lean):
    leaning = lean * closing
    steps = 20_000
    fine, du, way = h, abs(moved) / steps, math.copysign(1.0, moved)

    def slope(z):
        return way - (closing * z + leaning * way * abs(z))

    for _ in range(steps):
        fine += du * slope(fine + 0.5 * du * slope(fine))
    assert yielded(h, moved, closing, leaning) == pytest.approx(fine, abs=2e-5 * (1 + abs(fine)))


def test_the_element_does_not_blow_up_where_it_yields_within_a_sample():
    assert yielded(0.0, 1.0, 1e6, 0.0) == pytest.approx(1e-6)
    assert yielded(1e-6, -1.0, 1e6, 0.0) == pytest.approx(-1e-6)


def test_friction_that_builds_up_over_a_travel():
    _, x, v = swing()
    h, held = 0.0, []
    travel, strongest = 4e-4, 30.0
    for dx in np.diff(x, prepend=x[0]):
        h = float(np.clip(h + dx / travel, -1.0, 1.0))
        held.append(strongest * h)
    made = fitted(
        [device(x, 2000.0 * x + 50.0 * v + np.array(held))], 'coulomb_friction/presliding'
    )
    assert made.values['coulomb_friction/presliding.force'] == pytest.approx(30.0, rel=0.03)
    assert made.values['coulomb_friction/presliding.presliding'] == pytest.approx(travel, rel=0.1)


def test_friction_that_turns_round_over_a_speed():
    _, x, v = swing()
    force = 1000.0 * x + 20.0 * v + 40.0 * np.tanh(v / 0.01)
    made = fitted([device(x, force)], 'coulomb_friction/turning_speed')
    assert made.values['coulomb_friction/turning_speed.force'] == pytest.approx(40.0, rel=0.03)
    speed = made.values['coulomb_friction/turning_speed.turning_speed']
    assert speed == pytest.approx(0.01, rel=0.1)


def crept(v, travel, speed):
    """Share of such a friction that acts at each sample, by short steps."""
    held, h, steps = [], 0.0, 40
    for i, u in enumerate(np.interp(np.arange(steps * v.size) / steps, np.arange(v.size), v)):
        if i % steps == 0:
            held.append(h)
        level = math.tanh(max(abs(u), 1e-12) / speed)
        h += (u - h * abs(u) / level) / travel / (steps * RATE)
    return np.array(held)


def test_friction_that_builds_up_over_a_travel_towards_what_the_speed_has():
    _, x, v = swing()
    travel, speed = 8e-4, 0.015
    force = 500.0 * x + 20.0 * v + 40.0 * crept(v, travel, speed)
    made = fitted([device(x, force)], 'coulomb_friction/creeping')
    assert made.values['coulomb_friction/creeping.force'] == pytest.approx(40.0, rel=0.03)
    assert made.values['coulomb_friction/creeping.presliding'] == pytest.approx(travel, rel=0.1)
    assert made.values['coulomb_friction/creeping.turning_speed'] == pytest.approx(speed, rel=0.1)


def test_a_law_of_three_numbers_leaves_room_for_a_constant():
    rng = np.random.default_rng(5)
    parts = []
    for amplitude, held_out in ((0.01, False), (0.006, False), (0.008, True)):
        _, x, v = swing(amplitude)
        force = 20.0 * v + 40.0 * crept(v, 8e-4, 0.015) + 9.0 + rng.normal(0.0, 0.3, x.size)
        parts.append(device(x, force, held_out=held_out))
    model, segments, linear = linear_prescribed(parts)
    found = search(model, linear, segments, Judge(segments, len({t.name for t in model.terms})))
    assert {t.label for t in found.best.terms} == {'coulomb_friction/creeping', 'offset'}
    assert found.best.values['offset.value'] == pytest.approx(9.0, abs=0.5)


def test_friction_that_falls_with_the_speed():
    _, x, v = swing(frequency=0.25, seconds=16.0)
    force = 1000.0 * x + 200.0 * v + np.sign(v) * (20.0 + 15.0 * np.exp(-((v / 0.008) ** 2)))
    made = fitted([device(x, force)], 'stribeck_friction')
    assert made.values['stribeck_friction.kinetic_force'] == pytest.approx(20.0, rel=0.1)
    assert made.values['stribeck_friction.excess_force'] == pytest.approx(15.0, rel=0.15)


def test_a_baseline_without_spring_has_none():
    _, x, v = swing()
    model, _, linear = linear_prescribed([device(x, 30.0 * v)], spring=False)
    assert [n.name for n in model.numbers] == ['damping', 'mass']
    assert linear.values['damping'] == pytest.approx(30.0, rel=0.02)
    assert not {'hardening_spring', 'clearance', 'coulomb_friction/series'} & {
        t.label for t in model.terms
    }


def test_a_motion_one_way_cannot_tell_the_ways_apart():
    t = np.arange(1200) / RATE
    one_way, _, _ = linear_prescribed([device(0.01 * t, 5.0 + 0.0 * t)], spring=False)
    assert not {t.name for t in one_way.terms} & {'asymmetric_friction', 'asymmetric_damping'}
    _, x, v = swing()
    both, _, _ = linear_prescribed([device(x, v)])
    assert {'asymmetric_friction', 'asymmetric_damping'} <= {t.name for t in both.terms}


def test_positions_far_from_zero_count_from_their_middle():
    _, x, v = swing(middle=0.7)
    _, segments, linear = linear_prescribed([device(x, 900.0 * (x - 0.7) + 4.0 * v, unit='m')])
    assert np.max(segments[0].drive[0]) == pytest.approx(-np.min(segments[0].drive[0]), rel=1e-6)
    assert linear.values['stiffness'] == pytest.approx(900.0, rel=0.02)


def test_a_hanging_weight_whose_angle_is_prescribed():
    _, x, v = swing(amplitude=1.2, frequency=0.5)
    force = 3.0 * np.sin(x) + 0.1 * v
    linear = fitted([device(x, force, unit='rad')])
    sine = fitted([device(x, force, unit='rad')], 'restoring_force')
    assert sine.values['stiffness'] == pytest.approx(3.0, rel=0.01)
    assert sine.rms(0) < 0.1 * linear.rms(0)


def test_one_speed_each_way_does_not_tell_frictions_apart():
    t = np.arange(2000) / RATE

    def told(*speeds):
        there = [s * 0.05 * signal.sawtooth(2.0 * np.pi * 0.25 * t, 0.5) for s in speeds]
        _, segments, _ = linear_prescribed([device(x, 1e3 * x) for x in there])
        return one_speed_told(segments)

    (note,) = told(1.0)
    assert 'about 0.05' in note
    assert 'several speeds' in note
    assert told(1.0, 2.0) == ()
    assert one_speed_told(linear_prescribed([device(swing()[1], swing()[1])])[1]) == ()


@pytest.mark.parametrize('spring', [0.0, 300.0, 5000.0])
def test_a_force_that_counts_against_the_motion_is_known(spring):
    _, x, v = swing(middle=0.03)
    rng = np.random.default_rng(3)
    force = 40.0 + spring * x + 150.0 * v + 20.0 * np.sign(v) + 0.5 * rng.standard_normal(x.size)
    assert force_counts_against([device(x, -force)])
    assert not force_counts_against([device(x, force)])


def test_a_late_force_and_noise_do_not_count_against_the_motion():
    _, x, v = swing()
    late = 5000.0 * np.roll(x, 3)[10:]
    assert not force_counts_against([device(x[10:], late)])
    noise = np.random.default_rng(4).standard_normal(x.size)
    assert not force_counts_against([device(x, noise)])
    assert not force_counts_against([device(x, 5000.0 * x - 2.0 * v)])
    assert force_counts_against([device(x, -5000.0 * x)])
    assert not force_counts_against([device(x, -5000.0 * x + 150.0 * v)])  # away from its middle
