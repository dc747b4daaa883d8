"""From drawing to scoring, with engines that are dummies."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from impactscope.errors import ConfigurationError, InputError
from impactscope.proof.__main__ import main
from impactscope.proof.confusion_picture import confusion_svg
from impactscope.proof.generate import generate
from impactscope.proof.intervals import share
from impactscope.proof.marking import mark
from impactscope.proof.peers import peers, refit, sparse_regression
from impactscope.proof.score import confusion, lines, read_marks, score
from impactscope.proof.sealed import open_sealed, seal
from impactscope.recordings import open_recording
from impactscope.records import SampleBlock

WORDS = (
    'friction', 'truth', 'answer', 'strength', 'category', 'clean', 'single', 'detectab', 'wrong',
)  # fmt: skip
ENGINE = """
import json, sys
folder, out = sys.argv[2], sys.argv[4]
json.dump({'mismatch': {'detected': False, 'subsystems': [], 'regions': []}, 'accepted': [],
           'ranking': [], 'fit': {}, 'unexplained': False}, open(out, 'w'))
"""


@pytest.fixture(scope='module')
def examination(tmp_path_factory) -> tuple[Path, str]:
    output = tmp_path_factory.mktemp('proof')
    kinds = ('clean', 'single')
    return output, generate(output, 8, 2, categories=kinds, classes=False)


def test_a_campaign_says_nothing_of_what_is_hidden(examination):
    output, _ = examination
    for folder in sorted((output / 'campaigns').iterdir()):
        text = (folder / 'campaign.yaml').read_text()
        described = yaml.safe_load(text)
        assert described['version'] == 1
        names = [entry['file'] for entry in described['recordings']]
        assert sorted(p.name for p in folder.glob('*.mcap')) == sorted(names)
        assert any(entry['role'] == 'hold_out' for entry in described['recordings'])
        said = text.lower() + ' '.join(p.name for p in folder.iterdir())
        assert not [w for w in WORDS if w in said]
        raw = b''.join((folder / name).read_bytes().lower() for name in names)
        assert not [w for w in WORDS if w.encode() in raw]


def test_recordings_hold_every_channel_without_gaps(examination):
    output, _ = examination
    path = next((output / 'campaigns' / 'campaign_0000').glob('*.mcap'))
    following: dict[str, tuple[int, int]] = {}
    with open_recording(path) as recording:
        for _, _, block in recording.records(None):
            assert isinstance(block, SampleBlock)
            index, stamp = following.get(block.channel, (0, block.stamp_ns))
            assert block.first_index == index
            assert abs(block.stamp_ns - stamp) <= 1
            ahead = round(block.values.size / block.sample_rate * 1e9)
            following[block.channel] = index + block.values.size, block.stamp_ns + ahead
            assert np.isfinite(block.values).all()
    assert 'force' in following


def test_what_is_there_is_kept_and_another_seed_is_refused(examination):
    output, digest = examination
    before = {p: p.stat().st_mtime_ns for p in output.rglob('*.mcap')}
    again = generate(output, 8, 2, categories=('clean', 'single'), classes=False)
    assert again == digest
    assert before == {p: p.stat().st_mtime_ns for p in output.rglob('*.mcap')}
    with pytest.raises(ConfigurationError):
        generate(output, 9, 2, categories=('clean', 'single'))
    with pytest.raises(ConfigurationError):
        generate(output, 8, 2, categories=('nonsense',))


def test_a_silent_engine_is_right_on_clean_campaigns_alone(examination, tmp_path, capsys):
    output, digest = examination
    engine = tmp_path / 'engine.py'
    engine.write_text(ENGINE)
    command = f'{sys.executable} {engine}'
    arguments = ['--output', str(output), '--engine', command, '--digest', digest]
    assert main(['run', *arguments]) == 0
    assert main(['score', *arguments]) == 0
    said = capsys.readouterr().out
    assert 'finding although nothing is missing' in said
    assert (output / 'score.json').exists()
    marks = {m.category: m for m in read_marks(output, digest)}
    assert not marks['clean'].finding
    if marks['single'].truth:
        assert marks['single'].right_set is False


def test_an_engine_that_fails_is_no_answer(tmp_path):
    (tmp_path / 'campaigns' / 'c').mkdir(parents=True)
    assert main(['run', '--output', str(tmp_path), '--engine', '/nowhere/engine']) == 0
    assert json.loads((tmp_path / 'results' / 'c.run.json').read_text())['code'] == -2


def test_a_broken_seal_is_told(tmp_path):
    digest = seal(tmp_path / 'a.sealed', {'x': 1})
    assert open_sealed(tmp_path / 'a.sealed', digest) == {'x': 1}
    other = seal(tmp_path / 'a.sealed', {'x': 2})
    assert other != digest
    with pytest.raises(InputError):
        open_sealed(tmp_path / 'a.sealed', digest)


def _answer(name='coulomb_friction', size=20.0, family='library', subsystem='guide', **more):
    part = {
        'key': name,
        'name': name,
        'subsystem': subsystem,
        'family': family,
        'parameters': {'force': 2.0},
        'detectability': size,
    }
    kind = {'library': 'single', 'outside': 'outside', 'parameter': 'parameter'}[family]
    return {
        'category': kind,
        'detectability': size,
        'parts': [part],
        'confusable': {},
        'evidence': {'recording_00.mcap': {'force': {'10': 0.75, '50': 0.25}}},
    } | more


def _reply(*names, std=0.2, confused=(), **more):
    return {
        'mismatch': {
            'detected': bool(names),
            'subsystems': ['guide'],
            'regions': [
                {'recording': 'recording_00.mcap', 'channel': 'force', 'start_s': 0.08,
                 'end_s': 0.12},
            ],
        },
        'accepted': list(names),
        'ranking': [
            {'name': n, 'probability': 0.9, 'confused_with': list(confused),
             'parameters': {'force': {'value': 2.1, 'std': std, 'unit': 'N'}}}
            for n in names
        ],
        'fit': {'extended': {'held_out_rmse': {'force': 0.32}}, 'noise_floor': {'force': 0.3}},
        'unexplained': False,
    } | more  # fmt: skip


def test_a_right_answer_is_right_in_every_respect():
    m = mark('c', _answer(), _reply('coulomb_friction'), 3.0)
    assert m.name_first
    assert m.right_set
    assert m.exact_set
    assert m.subsystem
    assert m.evidence_inside == pytest.approx(0.75)
    assert m.parameter_errors == {'coulomb_friction.force': pytest.approx(0.05)}
    assert m.covered == {'coulomb_friction.force': True}
    assert m.held_out_ratio == pytest.approx(0.32 / 0.3)


def test_a_narrow_interval_does_not_cover():
    m = mark('c', _answer(), _reply('coulomb_friction', std=0.01), 3.0)
    assert m.covered == {'coulomb_friction.force': False}


def test_an_excluded_form_of_what_was_accepted_is_not_what_was_told():
    """A ranking goes on behind what was accepted, with other forms of the same name."""
    reply = _reply('coulomb_friction')
    other = {'force': {'value': 0.5, 'std': 0.01, 'unit': 'N'}}
    reply['ranking'].append({'name': 'coulomb_friction', 'parameters': other})
    m = mark('c', _answer(), reply, 3.0)
    assert m.covered == {'coulomb_friction.force': True}


def test_of_several_of_a_name_that_of_the_channel_is_marked():
    hidden = _answer('offset')
    hidden['parts'][0]['parameters']['channel'] = 'acceleration.plate'
    reply = _reply('offset', 'offset')
    for entry, channel in zip(reply['ranking'], ('force', 'acceleration.plate'), strict=True):
        entry['channel'] = channel
    reply['ranking'][0]['parameters'] = {'force': {'value': 9.0, 'std': 0.1, 'unit': 'N'}}
    assert mark('c', hidden, reply, 3.0).covered == {'offset.force': True}


def test_a_false_companion_spoils_the_set_and_not_the_first_name():
    m = mark('c', _answer(), _reply('coulomb_friction', 'mains_hum'), 3.0)
    assert m.name_first
    assert not m.right_set


def test_a_relative_is_the_right_family():
    m = mark('c', _answer('stribeck_friction'), _reply('coulomb_friction'), 3.0)
    assert m.family_first
    assert not m.name_first


def test_a_class_is_right_only_where_the_data_cannot_tell_and_the_answer_says_so():
    hidden = _answer(confusable={'stribeck_friction': 0.4})
    told = _reply('stribeck_friction', confused=['coulomb_friction'])
    assert mark('c', hidden, told, 1.0).right_set
    assert not mark('c', hidden, _reply('stribeck_friction'), 1.0).right_set
    assert not mark('c', _answer(), told, 1.0).right_set


def test_below_one_the_right_answer_is_nothing():
    m = mark('c', _answer(size=0.6), _reply('coulomb_friction'), 1.0)
    assert m.truth == ()
    assert m.finding
    assert m.right_set is None


@pytest.mark.parametrize(('by_all', 'named'), [(73.0, True), (2.0, False)])
def test_what_held_out_recordings_alone_show_may_be_named(by_all, named):
    hidden = _answer()
    stop = hidden['parts'][0] | {'name': 'end_stop', 'subsystem': 'spring'}
    hidden['parts'].append(stop | {'detectability': 0.0, 'by_all': by_all})
    for accepted in (['coulomb_friction', 'end_stop'], ['end_stop', 'coulomb_friction']):
        m = mark('c', hidden, _reply(*accepted), 1.0)
        assert m.truth == ('coulomb_friction',)
        assert m.right_set is named
    assert mark('c', hidden, _reply('coulomb_friction'), 1.0).right_set
    assert not mark('c', hidden, _reply('coulomb_friction', 'offset'), 1.0).right_set
    hidden['parts'] = hidden['parts'][1:]  # alone it is below d' 1, whatever held-out ones show
    assert mark('c', hidden, _reply('end_stop'), 1.0).finding


def test_a_pair_of_which_one_is_faint_is_sorted_by_the_other():
    hidden = _answer(size=0.4)
    hidden['parts'].append(_answer('base_compliance', 30.0, subsystem='fixture')['parts'][0])
    m = mark('c', hidden, _reply('base_compliance'), 1.0)
    assert m.truth == ('base_compliance',)
    assert m.detectability == 30
    assert m.right_set


def test_held_out_error_is_measured_by_the_true_noise():
    m = mark('c', _answer(noise={'force': 0.2}), _reply('coulomb_friction'), 1.0)
    assert m.held_out_ratio == pytest.approx(1.6)


def test_a_stranger_is_to_be_called_unknown():
    hidden = _answer('fractional_damping', family='outside', subsystem='unknown')
    assert mark('c', hidden, _reply(unexplained=True), 1.0).unknown
    assert not mark('c', hidden, _reply('quadratic_damping'), 1.0).unknown


@pytest.mark.parametrize('reply', [{}, {'ranking': [3], 'accepted': None, 'fit': []}, None])
def test_malformed_answers_are_marked_and_not_raised(reply):
    m = mark('c', _answer(), reply, 1.0)
    assert not m.name_first
    assert not m.right_set


def test_score_counts_by_detectability():
    marks = [
        mark('a', _answer(), _reply('coulomb_friction'), 1.0),
        mark('b', _answer(), _reply('mains_hum'), 1.0),
        mark('c', {'category': 'clean', 'detectability': 0.0, 'parts': []}, _reply(), 1.0),
    ]
    result = score(marks)
    found = {(what, where): value for what, where, value in result.shares}
    assert found['right name first', "d' 5 and more"][:2] == (1, 2)
    assert found['finding although nothing is missing', 'clean'][:2] == (0, 1)
    assert result.brier == pytest.approx((0.01 + 0.81) / 2)
    counts = confusion(marks)
    assert counts['coulomb_friction', 'mains_hum'] == 1
    assert counts['nothing', 'nothing'] == 1
    assert confusion_svg(counts).count('answered as') == 3 * 2
    assert any('1/2' in line for line in lines(result))


def test_beside_what_is_right_stands_what_an_ideal_observer_had_right():
    near = _answer(size=40.0)
    near['parts'][0]['differences'] = {'clearance': 1.0, 'mains_hum': 30.0}
    marks = [
        mark('a', near, _reply('clearance'), 1.0),
        mark('b', near, _reply('coulomb_friction'), 1.0),
        mark('c', _answer(), _reply('coulomb_friction'), 1.0),  # it was not looked at
    ]
    assert marks[2].ideal_name is None
    found = {what: row for what, where, *row in score(marks).ideal if '5 and more' in where}
    assert found['right name first'] == [1, pytest.approx(2 * 0.6915, abs=1e-3), 2]
    assert any('ideal observer at most 1.4 of 2' in line for line in lines(score(marks)))
    near['confusable'] = {'clearance': 1.0}
    assert mark('a', near, _reply('clearance'), 1.0).ideal_set > 0.999


def test_score_tells_kinds_of_campaign_and_of_noise_apart():
    clean = {'category': 'clean', 'detectability': 0.0, 'parts': [], 'kind': 'closed_loop'}
    steps = clean | {'colours': {'displacement.axis': {'poles': [], 'step': 0.7}}}
    marks = [
        mark('a', _answer(kind='closed_loop'), _reply('coulomb_friction'), 1.0),
        mark('b', _answer(), _reply('mains_hum'), 1.0),
        mark('c', clean, _reply('mains_hum'), 1.0),
        mark('d', steps, _reply(), 1.0),
    ]
    found = {(what, where): value for what, where, value in score(marks).shares}
    assert found['right, whatever is hidden', 'closed_loop'][:2] == (1, 1)
    assert found['right, whatever is hidden', 'impact'][:2] == (0, 1)
    assert found['right, whatever is hidden', 'white noise'][:2] == (1, 2)
    assert found['finding although nothing is missing', 'closed_loop'][:2] == (1, 2)
    assert found['finding although nothing is missing', 'other noise'][:2] == (0, 1)


@given(st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_intervals_are_exact(case):
    """At each end the tail beyond the count holds exactly 2.5 %."""
    hits, trials = case
    found = share(hits, trials)
    assert found.low <= found.value <= found.high
    if hits:
        assert binom.sf(hits - 1, trials, found.low) == pytest.approx(0.025, rel=1e-6)
    if hits < trials:
        assert binom.cdf(hits, trials, found.high) == pytest.approx(0.025, rel=1e-6)


def test_three_hundred_clean_campaigns_hold_one_per_cent():
    assert share(0, 300).high == pytest.approx(0.0122, abs=1e-4)
    with pytest.raises(ValueError, match='3 hits'):
        share(3, 2)


def test_the_refitted_baseline_finds_a_decay():
    t = np.arange(600) / 2000
    ratio, fit = refit(t, 40 * np.exp(-14 * t) * np.cos(200 * t + 0.4) + 2)[::-1]
    assert fit == pytest.approx(1)
    assert ratio == pytest.approx(14 / np.hypot(14, 200), rel=1e-6)


@pytest.mark.parametrize(('force', 'kept'), [(0.0, set()), (0.02, {'sign v'})])
def test_sparse_regression_keeps_what_is_there(force, kept):
    """Free motions x'' = -w² x - 2 z w v - w² f sign(v), exact between turning points."""
    rate, omega, zeta = 5000.0, 200.0, 0.03
    motions = []
    for height in (1.0, 0.8, 0.5):
        t = np.arange(500) / rate
        fine = 20
        x, v = height, 0.0
        course = np.empty(t.size)
        for i in range(t.size):
            course[i] = x
            for _ in range(fine):
                a = -(omega**2) * (x + force * np.sign(v)) - 2 * zeta * omega * v
                v += a / (rate * fine)
                x += v / (rate * fine)
        motions.append((t, course, rate))
    assert {name for name, _ in sparse_regression(motions)} == kept


def test_peers_look_at_a_campaign(examination):
    output, _ = examination
    view = peers(output / 'campaigns' / 'campaign_0000')
    assert view.recordings >= 1
    assert 0.9 < view.r_squared <= 1


@pytest.mark.parametrize(
    ('told', 'right'),
    [('stiffness', True), ('damper.branches.0.stiffness', True), ('parallel_stiffness', False)],
)
def test_another_number_of_a_like_name_is_not_the_one_that_was_wrong(told, right):
    hidden = _answer('wrong_parameter', family='parameter')
    hidden['parts'][0]['parameters'] = {'name': 'damper.branches.0.stiffness', 'ratio': 0.6}
    reply = _reply('wrong_parameter')
    ratio = {'value': 0.61, 'std': 0.02, 'unit': '1'}
    reply['ranking'][0]['parameters'] = {'name': {'value': told, 'std': None}, 'ratio': ratio}
    m = mark('c', hidden, reply, 1.0)
    assert m.right_set
    assert m.parameter_named is right
    assert m.covered == ({'wrong_parameter.ratio': True} if right else {})
