"""What one held-out recording alone shows: a stop that only the hardest blow reaches."""

import dataclasses

from impactscope.discrepancy.campaign import Role
from impactscope.discrepancy.explain import explain
from impactscope.physics.twin.assembly import Effect


def holding_out(campaign, *names):
    recordings = tuple(
        dataclasses.replace(r, role=Role.HOLD_OUT if r.file in names else Role.FIT)
        for r in campaign.recordings
    )
    return dataclasses.replace(campaign, recordings=recordings)


def test_a_stop_that_one_held_out_blow_alone_reaches_is_named(make_campaign):
    stop = Effect('end_stop', {'travel': 0.00308, 'stiffness': 30000.0})
    friction = Effect('coulomb_friction', {'force': 0.4})
    campaign = make_campaign(8, [stop, friction])
    reach = {r.file: float(max(abs(r.channels['force'].values))) for r in campaign.recordings}
    assert sorted(name for name in reach if reach[name] > 69000 * 0.00308) == ['hit1.mcap']
    answer = explain(holding_out(campaign, 'hit1.mcap', 'hit2.mcap'))
    assert set(answer.accepted) == {'end_stop', 'coulomb_friction'}
    assert not answer.unexplained
    found = next(f for f in answer.ranking if f.name == 'end_stop')
    travel = found.parameters['travel']
    assert abs(travel.value - 0.00308) < 4 * travel.std < 1e-4
    assert any(n.startswith('hit1.mcap was held out and shows') for n in answer.notes)
    held = {trace.recording for trace in answer.traces if trace.held_out}
    assert held == {'hit2.mcap'}
    for name, noise in answer.fit.noise_floor.items():
        assert answer.fit.extended.held_out_rmse[name] < 1.15 * noise


def test_a_stop_that_the_only_held_out_blow_alone_reaches_is_named(make_campaign):
    stop = Effect('end_stop', {'travel': 0.00308, 'stiffness': 30000.0})
    answer = explain(holding_out(make_campaign(8, [stop]), 'hit1.mcap'))
    assert answer.accepted == ('end_stop',)
    assert not any(trace.held_out for trace in answer.traces)
    assert not answer.fit.extended.held_out_rmse


def test_a_held_out_blow_with_a_wrong_label_is_a_wrong_number(make_campaign):
    campaign = holding_out(make_campaign(5), 'hit1.mcap', 'hit2.mcap')
    mislabelled = tuple(
        dataclasses.replace(r, mass_distance=0.05) if r.file == 'hit2.mcap' else r
        for r in campaign.recordings
    )
    answer = explain(dataclasses.replace(campaign, recordings=mislabelled))
    assert answer.accepted == ('wrong_parameter',)
    assert answer.ranking[0].recording == 'hit2.mcap'
