import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from impactscope.errors import InputError
from impactscope.proof import draw as proof_draw
from impactscope.proof.bench import BENCH, Pulse
from impactscope.proof.conditions import draw_scenario
from impactscope.proof.detectability import Companion, Freedom, samples
from impactscope.proof.draw import (
    CONFUSABLE,
    by_all,
    differences,
    draw,
    look_alikes,
    solve_strength,
)
from impactscope.proof.effects import EFFECTS, effect
from impactscope.proof.measurement import input_channel, measure, noise_free
from impactscope.proof.scenario import Blow, Chain, Scenario


def taps(count: int = 2) -> Scenario:
    """Taps on the bare plate, force and plate acceleration at 1 kHz."""
    blows = tuple(
        Blow('tap', BENCH, 0.1, 0.5, pulses=(Pulse(0.0, 0.004, 200.0 + 80 * i, 2.0),))
        for i in range(count)
    )
    names = ('force', 'acceleration.plate')
    return Scenario(
        'impact',
        'vertical',
        blows,
        dict.fromkeys(names, 1000.0),
        {'force': 0.3, 'acceleration.plate': 0.1},
        {n: Chain() for n in names},
        ('linear_sensor',),
        gain_std={'force': 0.003, 'acceleration.plate': 0.005},
    )


@pytest.fixture(scope='module')
def freedom() -> Freedom:
    return Freedom(taps())


def recorded(blow: Blow, scenario: Scenario) -> dict[str, np.ndarray]:
    """The responses, and what a controller commands against an effect to hide it."""
    responses = noise_free(blow, scenario)
    if blow.kind == 'closed_loop':
        responses['force.drive'] = input_channel(blow, blow.law.rate)
    return responses


@pytest.fixture(scope='module')
def drawn() -> list[Scenario]:
    rng = np.random.default_rng(11)
    kinds = ['impact'] * 12 + ['chain'] * 3 + ['closed_loop'] * 6 + ['prescribed']
    return [draw_scenario(rng, kind) for kind in kinds]


def test_nothing_is_not_detectable(freedom):
    assert freedom.detectability(taps()) == 0


def test_a_step_that_no_bench_follows_is_taken_shorter(monkeypatch):
    freedom = Freedom(taps())
    heavier = replace(
        taps(), blows=tuple(replace(b, bench=BENCH._replace(mass=3.0)) for b in taps().blows)
    )
    wanted = freedom.detectability(heavier)
    left = Freedom._left
    steps = []

    def refused_at_first(self, target, at):
        steps.append(at)
        if len(steps) == 2:
            raise InputError('the motion could not be followed')
        return left(self, target, at)

    monkeypatch.setattr(Freedom, '_left', refused_at_first)
    assert Freedom(taps()).detectability(heavier) == pytest.approx(wanted, rel=0.02, abs=0.05)
    assert len(steps) > 3


@pytest.mark.parametrize('name', ['mass', 'damping'])
def test_what_the_baseline_may_tune_freely_is_not_detectable(freedom, name):
    turned = taps().with_bench(lambda b: {name: getattr(b.bench, name) * 1.002})
    plain = math.sqrt(
        sum(
            float(np.sum((a - b) ** 2))
            for a, b in zip(samples(turned), freedom.reference, strict=True)
        )
    )
    assert plain > 5
    assert freedom.detectability(turned) < 0.05


def test_known_numbers_cost_what_is_known_of_them(freedom):
    """A gain off by one standard deviation is worth at most a d' of 1."""
    turned = taps().with_chain('force', gain=1.003)
    assert 0 < freedom.detectability(turned) <= 1.0001


def test_an_offset_stands_alone(freedom):
    """No knob of the baseline is a constant before the blow: nearly sqrt(n) * offset / noise."""
    turned = taps().with_chain('force', offset=0.3)
    count = sum(1000 * b.duration - 6 for b in taps().blows)  # without the tap itself
    assert freedom.detectability(turned) == pytest.approx(math.sqrt(count), rel=0.03)


def test_more_recordings_show_more():
    change = effect('hardening_spring')
    sizes = [Freedom(taps(n)).detectability(change.apply(taps(n), 3e8, {})) for n in (1, 2, 4)]
    assert sizes[0] < sizes[1] < sizes[2]


@pytest.mark.parametrize('key', ['coulomb_friction', 'clearance'])
def test_no_other_optimiser_hides_an_effect_better(key):
    """The same freedom, spelled out here and left to a general least-squares solver."""
    clean = taps(1)
    chosen = effect(key)
    truth = chosen.apply(clean, {'coulomb_friction': 2.0, 'clearance': 2e-5}[key], {})
    target = np.concatenate(samples(truth))

    def residual(knobs):
        k, m, c, force, plate, tap, start = knobs
        turned = clean.with_bench(
            lambda b: {
                'stiffness': b.bench.stiffness * (1 + k),
                'mass': b.bench.mass * (1 + m),
                'damping': b.bench.damping * (1 + c),
            }
        )
        turned = turned.with_chain('force', gain=1 + force)
        turned = turned.with_chain('acceleration.plate', gain=1 + plate)
        blow = turned.blows[0]
        pulses = tuple(p._replace(peak=p.peak * (1 + tap)) for p in blow.pulses)
        moved = replace(blow, start=blow.start + 1e-3 * start, pulses=pulses)
        turned = replace(turned, blows=(moved,))
        left = target - np.concatenate(samples(turned, clean))
        return np.append(left, [k / (500 / 69e3), force / 0.003, plate / 0.005])

    best = least_squares(residual, np.zeros(7), diff_step=1e-5, x_scale=1e-2, xtol=1e-12)
    least = math.sqrt(2 * best.cost)
    assert least > 20
    assert Freedom(clean).detectability(truth) == pytest.approx(least, rel=0.02)


@pytest.mark.parametrize('key', ['coulomb_friction', 'hardening_spring', 'clock_error', 'offset'])
@pytest.mark.parametrize('wanted', [0.5, 40.0])
def test_strength_gives_the_wanted_size(freedom, key, wanted):
    rng = np.random.default_rng(3)
    chosen = effect(key)
    aux = chosen.setup(rng, freedom.baseline)
    strength, size = solve_strength(freedom, chosen, aux, wanted)
    assert size == pytest.approx(wanted, rel=0.1)
    again = freedom.detectability(chosen.apply(freedom.baseline, strength, aux))
    assert again == pytest.approx(size, rel=1e-6)


def test_nearly_even_friction_cannot_be_told_from_even_friction(freedom):
    uneven = effect('asymmetric_friction')
    strength, size = solve_strength(freedom, uneven, {'ratio': 1.02}, 20.0)
    truth = uneven.apply(freedom.baseline, strength, {'ratio': 1.02})
    found = differences(np.random.default_rng(0), freedom, truth, {uneven.key})
    near = look_alikes(found, size)
    assert near['coulomb_friction'] < 0.05 * size
    assert 'mains_hum' not in near
    assert 'hardening_spring' not in near


def _drawn(monkeypatch, seed):
    """What is hidden, and what is asked about what it differs from."""
    asked = {}
    with monkeypatch.context() as now:
        now.setattr(proof_draw, 'differences', lambda *a, **k: asked.update(a=a, k=k) or {})
        return draw(np.random.default_rng(seed)), asked


def test_a_friction_that_bounces_amplify_is_compared_at_the_strength_it_has(monkeypatch):
    """Linear re-tuning calls it ten times as strong as it is: it looked like nothing else."""
    hidden, asked = _drawn(monkeypatch, [251541647281852, 87])
    assert [p.name for p in hidden.parts] == ['asymmetric_friction']
    monkeypatch.setattr(proof_draw, 'EFFECTS', [effect('coulomb_friction')])
    size = hidden.detectability
    bent = differences(*asked['a'], **{**asked['k'], 'kin': ()})
    assert look_alikes(bent, size) == {}
    near = look_alikes(differences(*asked['a'], **asked['k']), size)
    assert near['coulomb_friction'] < CONFUSABLE


def test_what_differs_by_the_moment_of_a_contact_alone_is_no_difference(monkeypatch):
    """A filter of the force and a late clock of all others: both re-tuned, they are one.

    Each re-tuned for itself, they differed by 6.1 where a stiff contact begins.
    """
    hidden, asked = _drawn(monkeypatch, [76490907501156, 19])
    assert [p.name for p in hidden.parts] == ['clock_error']
    monkeypatch.setattr(proof_draw, 'EFFECTS', [effect('low_pass_filter')])
    assert differences(*asked['a'], **asked['k'])['low_pass_filter'] < 0.5


def test_a_further_branch_of_a_layer_looks_like_a_wrong_dashpot(monkeypatch):
    """The layer's own branch relaxes within seconds: both lose a little over the contact."""
    hidden, asked = _drawn(monkeypatch, [139395941784305, 32])
    assert [p.name for p in hidden.parts] == ['rate_dependent_damper']
    wrong = effect('wrong_parameter:damper.branches.0.damping')
    monkeypatch.setattr(proof_draw, 'EFFECTS', [wrong])
    found = differences(*asked['a'], **asked['k'])
    near = look_alikes(found, hidden.detectability)['wrong_parameter']
    assert 1.0 < near < CONFUSABLE < hidden.detectability


def test_a_look_alike_has_its_other_numbers_re_tuned_too(monkeypatch):
    """A pull back is much like a push of another course: as drawn it left more than half."""
    asked = []
    with monkeypatch.context() as now:
        now.setattr(proof_draw, 'differences', lambda *a, **k: asked.append((a, k)) or {})
        hidden = draw(np.random.default_rng([30660093306955, 91]))
    place = [p.name for p in hidden.parts].index('restoring_force')
    monkeypatch.setattr(proof_draw, 'EFFECTS', [effect('external_push')])
    arguments, options = asked[place]
    found = differences(*arguments, **options)
    assert 'external_push' in look_alikes(found, hidden.parts[place].detectability)


def test_a_filter_is_looked_at_in_all_its_kinds(monkeypatch):
    """One without a delay hides much of what a base does that gives way under an axis."""
    hidden, asked = _drawn(monkeypatch, [989504272422, 54])
    assert [p.name for p in hidden.parts] == ['base_compliance']
    monkeypatch.setattr(proof_draw, 'EFFECTS', [effect('low_pass_filter')])
    found = differences(*asked['a'], **asked['k'])
    assert found['low_pass_filter'] < 0.5 * hidden.detectability


def test_looking_for_look_alikes_changes_no_recording():
    left = []
    for classes in (True, False):
        rng = np.random.default_rng(7)
        assert draw(rng, category='single', kind='chain', classes=classes).detectability > 1
        left.append(rng.standard_normal())
    assert left[0] == left[1]


def test_nothing_left_looks_like_nothing(freedom):
    chosen = effect('coulomb_friction')
    rng = np.random.default_rng(0)
    assert differences(rng, freedom, freedom.baseline, {chosen.key}) == {}


@pytest.mark.parametrize('key', [e.key for e in EFFECTS if e.family != 'label'])
def test_every_effect_changes_a_campaign_and_its_parameters_are_told(key, drawn):
    chosen = effect(key)
    rng = np.random.default_rng(11)
    scenario = next(s for s in drawn if chosen.fits(s))
    scenario = chosen.prepare(replace(scenario, blows=(scenario.blows[0], scenario.blows[-1])))
    aux = chosen.setup(rng, scenario)
    strength = chosen.high / 10 if chosen.tunable else 1.0
    turned = chosen.apply(scenario, strength, aux)
    assert turned.channels == scenario.channels
    if chosen.name == 'quantisation':  # behind the noise
        a, b = (measure(s.blows[-1], s, np.random.default_rng(1)) for s in (turned, scenario))
    else:
        a, b = (
            {f'{i}{n}': v for i, blow in enumerate(s.blows) for n, v in recorded(blow, s).items()}
            for s in (turned, scenario)
        )
    assert max(float(np.abs(a[n] - b[n]).max()) for n in a) > 1e-3
    assert all(
        math.isfinite(v)
        for v in chosen.parameters(strength, aux).values()
        if isinstance(v, int | float)
    )


def test_a_drawn_campaign_is_a_function_of_its_seed():
    a, b = (draw(np.random.default_rng(5), category='clean') for _ in range(2))
    assert a.truth == b.truth
    assert a.truth != draw(np.random.default_rng(6), category='clean').truth


@pytest.mark.parametrize('seed', [0, 2, 5])
def test_a_number_off_within_its_tolerance_is_hidden_behind_many_contacts(seed):
    """Linear re-tuning misses the way there; the fit must not."""
    scenario = draw_scenario(np.random.default_rng(seed))
    turned = scenario.with_bench(lambda b: {'stiffness': b.bench.stiffness * 1.003})
    allowed = 0.003 / (scenario.sensor.stiffness_std / scenario.sensor.stiffness)
    assert Freedom(scenario).detectability(turned) <= 1.02 * allowed


def test_a_step_as_promised_may_end_in_a_hollow_that_later_bounces_make():
    stated = draw(np.random.default_rng([183319450760704, 39]), classes=False).stated
    slower = effect('impact_speed_loss').apply(stated, 0.002355, {})
    assert Freedom(stated).detectability(slower) < 1.2  # angles within 0.1 degree are as slow


def test_beside_a_companion_its_strength_is_one_more_number_to_tune():
    scenario = taps(2)
    change = effect('hardening_spring')
    both = Freedom(scenario, Companion(lambda s, by: change.apply(s, 3e8 * by[0], {})))
    assert both.detectability(change.apply(scenario, 3.3e8, {})) < 0.05
    assert both.detectability(change.apply(scenario, -3e8, {})) > 5


def test_of_a_companion_other_numbers_may_be_tuned():
    """Where a spring begins to stiffen, as well as by how much."""
    scenario, stop = taps(2), effect('end_stop')
    reach = max(float(np.max(noise_free(b, scenario)['force'])) for b in scenario.blows)
    travel = 0.5 * reach / BENCH.stiffness

    def stopped(by):
        return stop.apply(scenario, 2e3 * by[0], {'travel': travel * by[1]})

    tuned = Freedom(scenario, Companion(lambda _, by: stopped(by), 2))
    fixed = Freedom(scenario, Companion(lambda _, by: stopped((by[0], 1.0))))
    truth = stopped((1.1, 0.9))
    assert tuned.detectability(truth) < 0.1
    assert fixed.detectability(truth) > 1.0


def test_beside_two_companions_both_strengths_are_tuned():
    scenario = taps(2)
    spring, rub = effect('hardening_spring'), effect('coulomb_friction')
    beside = Freedom(scenario, Companion(lambda s, by: spring.apply(s, 3e8 * by[0], {})))
    both = beside.beside(Companion(lambda s, by: rub.apply(s, 0.02 * by[0], {})))
    truth = rub.apply(spring.apply(scenario, 3.3e8, {}), 0.022, {})
    assert both.detectability(truth) < 0.1
    assert beside.detectability(truth) > 5 * both.detectability(truth)


def test_a_look_alike_of_either_sign_is_found():
    """A fast low pass only delays; a clock offset does the same, whichever sign was drawn."""
    scenario = draw_scenario(np.random.default_rng(7), 'driven')
    freedom = Freedom(scenario)
    aux = {'channel': 'acceleration.plate', 'order': 2, 'zero_phase': 0}
    chosen = effect('low_pass_filter')
    truth = chosen.apply(scenario, 1 / 12e3, aux)
    size = freedom.detectability(truth)
    assert size > 5
    for seed in range(3):
        near = differences(np.random.default_rng(seed), freedom, truth, {chosen.key})
        assert near['clock_error'] < 0.1 * size


def test_a_stop_that_only_a_held_out_tap_reaches_is_seen_by_all_recordings():
    soft, hard = taps().blows
    baseline = replace(taps(), blows=(soft, replace(hard, role='hold_out')))
    reach = [
        float(np.max(noise_free(b, baseline)['force'])) / BENCH.stiffness for b in taps().blows
    ]
    stop = {'stop_stiffness': 2e4, 'stop_travel': 0.5 * sum(reach)}
    truth = baseline.with_bench(lambda blow: stop)
    size = Freedom(baseline).detectability(truth)
    assert size < 1e-6
    assert by_all(size, baseline, truth) > 5
    assert by_all(size, baseline, baseline) < 1e-6
    assert by_all(1.0, baseline, truth) == 0.0  # is seen anyway
