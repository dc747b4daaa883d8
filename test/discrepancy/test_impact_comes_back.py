"""An impactor that comes back long after the blow: when, tells what pulls it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import Campaign, ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import at_point, fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search import forward_backward
from impactscope.discrepancy.impact.search.forward_backward import _misses_more, _rivals_followed
from impactscope.discrepancy.impact.search.outcome import weigh
from impactscope.discrepancy.impact.search.returns import from_return
from impactscope.physics.pendulum import Orientation
from impactscope.physics.twin.assembly import Effect, implied_effects
from impactscope.physics.twin.bench import PAPER_LAYER, Bench, HammerTap, RobotBlow, Sensor
from impactscope.physics.twin.simulate import simulate_at

RATE, CONTACT = 2500.0, 0.1
HELD = round((CONTACT - 0.05) * RATE)  # samples until an impactor is let go
SPEEDS = (0.06, 0.10, 0.15, 0.12)
MASS = 2.4


def carts(
    seed: int,
    pull: float,
    duration: float,
    noise: float,
    speeds: tuple[float, ...] = SPEEDS,
) -> Campaign:
    """A tap, and carts that something pulls to the plate; the last blow is held out."""
    rng = np.random.default_rng(seed)
    noises = {'force': 0.5, 'acceleration.plate': noise, 'acceleration.impactor': noise}
    layer = {
        'parallel_stiffness': PAPER_LAYER.equilibrium_stiffness,
        'branches': [
            {'stiffness': b.stiffness, 'damping': b.viscosity} for b in PAPER_LAYER.branches
        ],
    }
    entries: list[dict[str, object]] = [{'file': 'tap.mcap', 'kind': 'tap'}]
    blows: list[HammerTap | RobotBlow] = [HammerTap(500.0, 0.0045)]
    for i, speed in enumerate(speeds):
        role = 'hold_out' if i == len(speeds) - 1 else 'fit'
        entry = {'kind': 'robot', 'effective_mass': MASS, 'speed': speed, 'role': role}
        entries.append({'file': f'cart{i}.mcap', **entry})
        blows.append(RobotBlow(MASS, speed * (1.0 + 0.01 * rng.standard_normal()), push_force=0.0))
    samples = {}
    times = np.arange(round(duration * RATE)) / RATE
    for entry, blow in zip(entries, blows, strict=True):
        tapped = isinstance(blow, HammerTap)
        damper = None if tapped else PAPER_LAYER
        bench = Bench(Sensor(), damper=damper, orientation=Orientation.HORIZONTAL)
        pulled = [] if tapped else [Effect('gravity_load', {'force': pull})]
        acting = (*implied_effects(bench, blow), *pulled)
        made = simulate_at(bench, blow, times, mechanisms=acting, contact_time=CONTACT)
        samples[str(entry['file'])] = {
            name: ChannelSamples(
                name,
                'N' if name == 'force' else 'm/s^2',
                RATE,
                0.0,
                made[name] + std * rng.standard_normal(times.size),
            )
            for name, std in noises.items()
            if not (tapped and name == 'acceleration.impactor')
        }
    data = {
        'version': 1,
        'bench': {'kind': 'impact', 'orientation': 'horizontal'},
        'sensor': {'stiffness': {'value': 69000, 'std': 500, 'unit': 'N/m'}, 'moving_mass': None},
        'damper': layer,
        'gain_std': {'force': 0.003, 'acceleration': 0.005},
        'baseline': ['linear_sensor', 'zener_damper', 'unilateral_contact'],
        'recordings': entries,
    }
    return parse_campaign(data, 'carts').with_samples(samples.__getitem__)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('seed', 'pull', 'duration', 'noise'), [(1, 0.25, 1.5, 0.6), (3, 0.3, 1.3, 1.0)]
)
def test_a_weak_pull_that_brings_carts_back(seed, pull, duration, noise):
    answer = explain(carts(seed, pull, duration, noise))
    assert answer.accepted == ('gravity_load',)
    force = answer.findings[0].parameters['force']
    assert abs(force.value - pull) < 4.0 * force.std < 0.1 * pull


@pytest.mark.slow
@pytest.mark.parametrize('seed', [11, 12])
def test_a_return_whose_first_milliseconds_alone_are_recorded(seed):
    campaign = carts(seed, 0.25, CONTACT + 1.053, 0.6, (0.06, 0.15, 0.12))
    recordings = tuple(
        dataclasses.replace(
            r, channels={n: c for n, c in r.channels.items() if n != 'acceleration.impactor'}
        )
        for r in campaign.recordings
    )
    answer = explain(dataclasses.replace(campaign, recordings=recordings))
    # from so little a pull that begins later can hardly be told from one that was always there
    assert answer.accepted in {('gravity_load',), ('external_push',)}
    assert abs(answer.findings[0].parameters['force'].value - 0.25) < 0.02


PUSH = 0.35  # N, about a thirtieth of the pendulum's weight


@pytest.mark.parametrize('seed', [5, 6])
def test_a_return_that_slopes_cannot_meet_is_met_by_the_amount_of_a_pull(make_campaign, seed):
    push = Effect('external_push', {'force': PUSH, 'start': 0.0, 'rise': 0.02})
    made = make_campaign(seed, [push])
    baseline = fit_baseline(baseline_model(made, prepare(made)))
    before = baseline.model.layout(baseline.layout.blows, 0.1)
    sound = fit(baseline.model, before, baseline.x)
    layout = baseline.model.layout(baseline.layout.blows, 0.25)
    assert fit(sound.model, layout, sound.x).reduced > 1000.0
    place = at_point(sound.model, layout, sound.x)
    found = from_return(place, candidates(sound, made.baseline_names))
    assert found[0][1].reduced < 20.0
    assert {c.name for c, _ in found} == {'external_push', 'restoring_force'}
    assert [f.chi_square for _, f in found] == sorted(f.chi_square for _, f in found)


def test_a_return_that_no_bench_repeats_speaks_against_a_fit_without_it(make_campaign):
    push = Effect('external_push', {'force': PUSH, 'start': 0.0, 'rise': 0.02})
    made = make_campaign(5, [push])
    baseline = fit_baseline(baseline_model(made, prepare(made)))
    before = baseline.model.layout(baseline.layout.blows, 0.1)
    sound = fit(baseline.model, before, baseline.x)
    assert not _misses_more(sound, sound)
    # a fit of as few samples, but up to beyond the return: of that it says that none repeats
    later = dataclasses.replace(sound, layout=dataclasses.replace(before, window=0.25))
    assert _misses_more(sound, later)


def test_what_did_as_well_before_a_return_is_followed_over_it(make_campaign, monkeypatch):
    push = Effect('external_push', {'force': PUSH, 'start': 0.0, 'rise': 0.02})
    made = make_campaign(5, [push])
    baseline = fit_baseline(baseline_model(made, prepare(made)))
    blows = baseline.layout.blows
    sound = fit(baseline.model, baseline.model.layout(blows, 0.1), baseline.x)
    without = at_point(sound.model, sound.model.layout(blows, 0.25), sound.x)
    listed = candidates(sound, made.baseline_names)
    rivals = [weigh(c, f, without, len(listed)) for c, f in from_return(without, listed)]
    assert _rivals_followed(without, rivals, len(listed)) == []  # more than noise was left of it
    monkeypatch.setattr(forward_backward, 'QUIET', 20.0)
    followed = _rivals_followed(without, rivals, len(listed))
    assert [f.candidate for f in followed] == [r.candidate for r in rivals[: len(followed)]]
    for again, before in zip(followed, rivals, strict=False):
        assert again.fit.chi_square <= before.fit.chi_square < 0.01 * without.chi_square


@pytest.mark.slow
def test_a_coupling_behind_a_pull_is_found_beside_it():
    corner, noise = 0.05, 0.02
    campaign = carts(7, 0.4, 0.5, noise)
    # AC coupling remembers how the impactor was held and fell, of which no model tells
    rng = np.random.default_rng(8)
    high_pass = signal.butter(1, corner, btype='high', fs=RATE)

    def coupled(channel):
        values = channel.values.copy()
        values[:HELD] = noise * rng.standard_normal(HELD)
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
    for name, key, true in (('ac_coupling', 'corner', corner), ('gravity_load', 'force', 0.4)):
        number = found[name][key]
        assert abs(number.value - true) < 3.0 * number.std < 0.3 * true
