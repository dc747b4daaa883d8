"""Static tests from files: known constants come back, bad files are refused with the reason."""

import json
import math
import struct
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from rich.console import Console

from impactscope.characterise import main, read_static_test
from impactscope.characterise.further_tests import rank_for_impact
from impactscope.errors import (
    ConfigurationError,
    InputError,
    MissingChannelError,
    RecordingError,
)
from impactscope.estimate.damper_test import analyse_cycles
from impactscope.physics.damper_layer import DamperLayer, MaxwellBranch, cyclic_ramp
from impactscope.recordings import ColumnMapping, ColumnSpec, RecordingWriter, convert
from impactscope.records import Estimate, Quality, SampleBlock

MAPPING = ColumnMapping.from_strings(['force=2:N', 'displacement.crosshead=1:mm'], time=0)
STIFFNESS = 42e3  # N/m
LAYER = DamperLayer(25e3, (MaxwellBranch(14e3, 90e3),))


def spring(cycles=2, noise=0.3, seed=1):
    time, u = cyclic_ramp((3e-3,) * cycles, 1e-4, 20.0)
    rng = np.random.default_rng(seed)
    return time, u, STIFFNESS * u + noise * rng.standard_normal(u.size)


def damper(noise=0.3, seed=2, speed=2e-4):
    time, u = cyclic_ramp((1e-3, 2e-3, 3e-3), speed, 20.0)
    force = LAYER.response(time, u, unilateral=True).force
    return time, u, force + noise * np.random.default_rng(seed).standard_normal(u.size)


def write_csv(path, time, u, force):
    table = np.column_stack([time, 1e3 * u, force])
    np.savetxt(path, table, delimiter=',', header='time,crosshead,load', comments='')
    return path


def silent(tmp_path):
    return Console(file=(tmp_path / 'out.txt').open('w'), width=120)


def run(kind, tmp_path, file, **options):
    """Exit code, JSON and printed text of one call."""
    console = Console(record=True, width=140, file=(tmp_path / 'out.txt').open('w'))
    target = tmp_path / 'result.json'
    code = main(kind, file, console, json_file=target, **options)
    return code, json.loads(target.read_text(encoding='utf-8')), console.export_text()


# --- known constants ---------------------------------------------------------------------------


def test_spring_comes_back_within_its_uncertainty(tmp_path):
    file = write_csv(tmp_path / 'spring.csv', *spring())
    code, found, text = run('spring', tmp_path, file, mapping=MAPPING)
    assert code == 0
    k = found['stiffness']
    assert abs(k['value'] - STIFFNESS) < 2 * k['std']
    assert k['std'] < 0.01 * STIFFNESS
    assert found['hysteresis'] < 0.01
    assert found['linearity_error'] < 0.01
    assert '42.0' in text


def test_spring_uncertainty_is_that_of_the_fit_where_the_machine_is_perfect(tmp_path):
    """Over many tests the error is as often within U (k = 2) as it should be."""
    inside = 0
    for seed in range(40):
        file = write_csv(tmp_path / 'spring.csv', *spring(1, 2.0, seed))
        _, found, _ = run(
            'spring', tmp_path, file, mapping=MAPPING, force_uncertainty=0.0,
            displacement_uncertainty=0.0,
        )  # fmt: skip
        k = found['stiffness']
        inside += abs(k['value'] - STIFFNESS) < 2 * k['std']
    assert inside >= 32  # 95 % of 40 is 38; fewer than 32 has a chance below 1e-4


def test_moving_mass_follows_from_the_sensors_frequency(tmp_path):
    file = write_csv(tmp_path / 'spring.csv', *spring())
    _, found, _ = run(
        'spring', tmp_path, file, mapping=MAPPING, frequency=Estimate(25.0, 0.05)
    )  # fmt: skip
    mass = found['moving_mass']
    assert mass['value'] == pytest.approx(STIFFNESS / (2 * math.pi * 25.0) ** 2, rel=0.01)
    stiffness = found['stiffness']['std'] / found['stiffness']['value']
    assert mass['std'] / mass['value'] == pytest.approx(math.hypot(stiffness, 0.004), rel=1e-6)


def test_damper_comes_back_within_its_uncertainty(tmp_path):
    file = write_csv(tmp_path / 'damper.csv', *damper())
    code, found, text = run('damper', tmp_path, file, mapping=MAPPING)
    assert code == 0
    branch = found['branches'][0]
    for estimate, true in (
        (found['equilibrium_stiffness'], 25e3),
        (branch['stiffness'], 14e3),
        (branch['viscosity'], 90e3),
    ):
        assert abs(estimate['value'] - true) < 2 * estimate['std']
        assert estimate['std'] < 0.02 * true
    assert found['rmse'] == pytest.approx(0.3, rel=0.1)
    assert np.shape(found['correlation']) == (3, 3)
    assert found['correlation_of'] == ['k2', 'k1', 'c1']
    assert 'one rate' in text


def test_relaxation_time_is_calibrated(tmp_path):
    """A gain of the machine does not enter the relaxation time: noise alone must explain it."""
    true, inside = 90 / 14, 0
    for seed in range(25):
        result = analyse_cycles(*damper(1.0, seed))
        estimate = result.branches[0].relaxation_time
        inside += abs(estimate.value - true) < 2 * estimate.std
    assert inside >= 19


def test_recording_and_columns_give_the_same(tmp_path):
    file = write_csv(tmp_path / 'damper.csv', *damper())
    convert(file, tmp_path / 'damper.mcap', MAPPING)
    _, by_columns, _ = run('damper', tmp_path, file, mapping=MAPPING)
    _, by_recording, _ = run('damper', tmp_path, tmp_path / 'damper.mcap')
    for key in ('equilibrium_stiffness', 'branches'):
        a, b = by_columns[key], by_recording[key]
        if isinstance(a, list):
            a, b = a[0]['viscosity'], b[0]['viscosity']
        assert a['value'] == pytest.approx(b['value'], rel=1e-4)  # recordings hold float32


def stamped(stamp_ns, doubles):
    """A stamped standard message of doubles, CDR, little endian."""
    frame = b'machine\x00'
    head = struct.pack('<4xiII', *divmod(stamp_ns, 10**9), len(frame))
    data = head.replace(b'\0' * 4, b'\0\1\0\0', 1) + frame
    return data + bytes(-(len(data) - 4) % 8) + struct.pack(f'<{len(doubles)}d', *doubles)


def write_topics(path, time, u, force):
    """A recording with one message a sample, as any ROS driver of a machine writes it."""
    with RecordingWriter(path) as writer:
        for t, x, f in zip(time, u, force, strict=True):
            ns = 10**18 + round(1e9 * t)
            load, place = stamped(ns, [0, 0, f, 0, 0, 0]), stamped(ns, [0, 0, x])
            writer.write('/machine/load', 'geometry_msgs/msg/WrenchStamped', load, ns)
            writer.write('/machine/crosshead', 'geometry_msgs/msg/PointStamped', place, ns)
    return path


TOPICS = (
    'wrench /machine/load force.z force',
    'point /machine/crosshead point.z displacement.crosshead',
)


def test_topics_with_one_sample_a_message_are_read_by_name(tmp_path):
    file = write_topics(tmp_path / 'topics.mcap', *spring())
    code, found, _ = run('spring', tmp_path, file, inputs=TOPICS)
    assert code == 0
    table = write_csv(tmp_path / 'spring.csv', *spring())
    _, other, _ = run('spring', tmp_path, table, mapping=MAPPING)
    assert found['stiffness']['value'] == pytest.approx(other['stiffness']['value'], rel=1e-4)


def test_dates_and_times_are_read_in_s_and_in_no_other_unit(tmp_path):
    time, u, force = spring()
    plain = read_static_test(write_csv(tmp_path / 'spring.csv', time, u, force), mapping=MAPPING)
    start = datetime(2025, 11, 14, tzinfo=UTC)
    rows = [
        f'{(start + timedelta(seconds=t)).isoformat()},{1e3 * x},{f}'
        for t, x, f in zip(time, u, force, strict=True)
    ]
    file = tmp_path / 'dated.csv'
    file.write_text('time,crosshead,load\n' + '\n'.join(rows), encoding='utf-8')
    dated = read_static_test(file, mapping=MAPPING)
    assert np.allclose(dated.time, plain.time, atol=2e-6)
    with pytest.raises(InputError, match=r"dates and times, which are read in s; .*'ms'"):
        read_static_test(file, mapping=replace(MAPPING, time_unit='ms'))


def test_a_topic_that_is_not_named_or_not_there_is_said(tmp_path):
    file = write_topics(tmp_path / 'topics.mcap', *spring())
    with pytest.raises(MissingChannelError, match=r'--input .point TOPIC point\.z'):
        main('spring', file, silent(tmp_path))
    with pytest.raises(MissingChannelError, match='/elsewhere'):
        main(
            'spring',
            file,
            silent(tmp_path),
            inputs=(TOPICS[0], 'point /elsewhere point.z displacement.crosshead'),
        )
    with pytest.raises(ConfigurationError, match='no topics'):
        table = write_csv(tmp_path / 'spring.csv', *spring())
        main('spring', table, silent(tmp_path), mapping=MAPPING, inputs=TOPICS)


def test_reversed_signs_are_turned_round_and_said(tmp_path):
    time, u, force = spring()
    file = write_csv(tmp_path / 'spring.csv', time, -u, -force)
    code, found, text = run('spring', tmp_path, file, mapping=MAPPING)
    assert code == 0
    assert found['stiffness']['value'] == pytest.approx(STIFFNESS, rel=0.01)
    assert 'turned round' in text
    assert any('turned round' in note for note in found['source']['notes'])


def test_channels_of_different_rates_are_put_on_one_base(tmp_path):
    _, u, force = spring(noise=0.0)
    path = tmp_path / 'two_rates.mcap'
    with RecordingWriter(path) as writer:
        for channel, unit, rate, values in (
            ('force', 'N', 20.0, force),
            ('displacement.crosshead', 'm', 10.0, u[::2]),
        ):
            writer.write_block(
                SampleBlock(channel, unit, rate, 10**18, 0, values.astype(np.float32))
            )
    test = read_static_test(path)
    inside = (test.displacement > 1e-4) & (test.displacement < 2.9e-3)
    ratio = test.force[inside] / test.displacement[inside]
    assert np.allclose(ratio, STIFFNESS, rtol=1e-5)


def test_gap_before_the_touch_is_seen_and_taken_off(tmp_path):
    time, u = cyclic_ramp((1.5e-3, 3e-3), 2e-4, 20.0)
    force = LAYER.response(time, np.maximum(u - 5e-4, 0.0), unilateral=True).force
    file = write_csv(tmp_path / 'gap.csv', time, u, force)
    _, _, text = run('damper', tmp_path, file, mapping=MAPPING)
    assert '--touch' in text
    _, found, text = run('damper', tmp_path, file, mapping=MAPPING, touch=5e-4)
    assert found['equilibrium_stiffness']['value'] == pytest.approx(25e3, rel=1e-3)
    with pytest.raises(InputError, match='never reaches the touch'):
        main('damper', file, silent(tmp_path), mapping=MAPPING, touch=1.0)


# --- what one rate does not tell ---------------------------------------------------------------


def test_slow_ramps_leave_a_quick_branch_open_and_an_impact_test_tells_it():
    time, u, force = damper(noise=0.2)
    found = analyse_cycles(time, u, force)
    ranked = rank_for_impact(found, time, u)
    best, worst = ranked[0], ranked[-1]
    assert best.quick_branch < 0.05
    assert worst.quick_branch > 0.5
    assert 'ms' in best.name or 'Hz' in best.name
    assert [item.quick_branch for item in ranked] == sorted(i.quick_branch for i in ranked)


def test_a_test_at_impact_rate_gets_no_warning(tmp_path):
    layer = DamperLayer(25e3, (MaxwellBranch(14e3, 140.0),))  # relaxes in 10 ms
    time, u = cyclic_ramp((2e-3,) * 3, 0.05, 5000.0)
    force = layer.response(time, u, unilateral=True).force
    force += 0.2 * np.random.default_rng(3).standard_normal(u.size)
    file = write_csv(tmp_path / 'quick.csv', time, u, force)
    code, found, text = run('damper', tmp_path, file, mapping=MAPPING)
    assert code == 0
    assert found['warning'] == ''
    assert 'one rate' not in text


# --- data that cannot tell ---------------------------------------------------------------------


def test_pure_noise_is_unusable_not_a_number(tmp_path):
    rng = np.random.default_rng(5)
    time, u, _ = spring()
    file = write_csv(tmp_path / 'noise.csv', time, u, rng.standard_normal(u.size))
    for kind in ('spring', 'damper'):
        code, found, text = run(kind, tmp_path, file, mapping=MAPPING)
        assert code == 4
        assert found['valid'] is False
        assert found['reason'] in text.replace('\n', ' ')


def test_metres_taken_for_millimetres_are_noticed(tmp_path):
    file = write_csv(tmp_path / 'spring.csv', *spring())
    wrong = ColumnMapping.from_strings(['force=2:mN', 'displacement.crosshead=1:m'], time=0)
    code, found, _ = run('spring', tmp_path, file, mapping=wrong)
    assert code == 4
    assert 'units' in found['reason']


def test_missing_numbers_are_left_out_and_counted(tmp_path):
    time, u, force = spring()
    force[100:110] = np.nan
    file = write_csv(tmp_path / 'spring.csv', time, u, force)
    code, found, _ = run('spring', tmp_path, file, mapping=MAPPING)
    assert code == 0
    assert any('10 rows' in note for note in found['source']['notes'])


def test_clipped_samples_are_left_out(tmp_path):
    _, u, force = spring(noise=0.0)
    path = tmp_path / 'clipped.mcap'
    with RecordingWriter(path) as writer:
        for channel, unit, values, limit in (
            ('force', 'N', np.minimum(force, 100.0), 100.0),
            ('displacement.crosshead', 'm', u, math.nan),
        ):
            quality = Quality.CLIPPED if math.isfinite(limit) else Quality.NONE
            writer.write_block(
                SampleBlock(
                    channel, unit, 20.0, 10**18, 0, values.astype(np.float32), quality=quality,
                    range_max=limit,
                )
            )  # fmt: skip
    test = read_static_test(path)
    assert test.force.max() < 100.0
    assert any('clipped' in note for note in test.notes)
    code, found, _ = run('spring', tmp_path, path)
    assert code == 0
    assert found['stiffness']['value'] == pytest.approx(STIFFNESS, rel=0.01)


# --- files that are refused --------------------------------------------------------------------


def test_columns_need_a_mapping(tmp_path):
    file = write_csv(tmp_path / 'spring.csv', *spring())
    with pytest.raises(ConfigurationError, match='--channel force'):
        main('spring', file, silent(tmp_path))


def test_a_recording_needs_none(tmp_path):
    file = write_csv(tmp_path / 'spring.csv', *spring())
    convert(file, tmp_path / 'spring.mcap', MAPPING)
    with pytest.raises(ConfigurationError, match='no column mapping'):
        main('spring', tmp_path / 'spring.mcap', silent(tmp_path), mapping=MAPPING)


def test_a_channel_that_is_not_there_is_named(tmp_path):
    file = write_csv(tmp_path / 'spring.csv', *spring())
    with pytest.raises(MissingChannelError, match='load'):
        main('spring', file, silent(tmp_path), mapping=MAPPING, force='load')
    convert(file, tmp_path / 'spring.mcap', MAPPING)
    with pytest.raises(MissingChannelError, match='load'):
        main('spring', tmp_path / 'spring.mcap', silent(tmp_path), force='load')
    far = ColumnMapping.from_strings(['force=7:N', 'displacement.crosshead=1:mm'], time=0)
    with pytest.raises(MissingChannelError, match='column 7'):
        main('spring', file, silent(tmp_path), mapping=far)


def test_a_wrong_unit_is_named(tmp_path):
    file = write_csv(tmp_path / 'spring.csv', *spring())
    wrong = ColumnMapping.from_strings(['force=2:V', 'displacement.crosshead=1:mm'], time=0)
    with pytest.raises(ConfigurationError, match="'V'"):
        main('spring', file, silent(tmp_path), mapping=wrong)
    convert(file, tmp_path / 'volts.mcap', wrong)
    with pytest.raises(ConfigurationError, match="'V'"):
        main('spring', tmp_path / 'volts.mcap', silent(tmp_path))


def test_time_that_runs_back_is_refused(tmp_path):
    time, u, force = spring()
    time[50] = time[40]
    file = write_csv(tmp_path / 'spring.csv', time, u, force)
    with pytest.raises(InputError, match='does not advance'):
        main('spring', file, silent(tmp_path), mapping=MAPPING)


def test_too_few_samples_are_refused(tmp_path):
    file = write_csv(tmp_path / 'short.csv', *(v[:9] for v in spring()))
    with pytest.raises(InputError, match='9 samples'):
        main('spring', file, silent(tmp_path), mapping=MAPPING)


@pytest.mark.parametrize('still', ['force', 'displacement'])
def test_a_channel_that_does_not_vary_is_refused(tmp_path, still):
    time, u, force = spring()
    if still == 'force':
        force = np.full(u.size, 3.0)
    else:
        u = np.full(u.size, 1e-3)
    file = write_csv(tmp_path / 'still.csv', time, u, force)
    with pytest.raises(InputError, match=f'{still} does not vary'):
        main('damper', file, silent(tmp_path), mapping=MAPPING)


def test_a_file_that_is_no_recording_is_refused(tmp_path):
    bad = tmp_path / 'bad.mcap'
    bad.write_bytes(b'not a recording')
    with pytest.raises(RecordingError):
        main('spring', bad, silent(tmp_path))
    with pytest.raises(RecordingError):
        main('spring', tmp_path / 'nowhere.mcap', silent(tmp_path))
    with pytest.raises(RecordingError):
        main('spring', tmp_path / 'nowhere.csv', silent(tmp_path), mapping=MAPPING)


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        ({'force_uncertainty': -0.1}, 'force uncertainty'),
        ({'displacement_uncertainty': math.nan}, 'displacement uncertainty'),
        ({'tolerance': 0.0}, 'tolerance'),
        ({'touch': math.inf}, 'touch'),
        ({'branches': 7}, 'branches'),
        ({'frequency': Estimate(-1.0, 0.1)}, 'frequency'),
    ],
)
def test_values_out_of_range_are_refused(tmp_path, options, words):
    file = write_csv(tmp_path / 'spring.csv', *spring())
    with pytest.raises(ConfigurationError, match=words):
        main('spring', file, silent(tmp_path), mapping=MAPPING, **options)


# --- pages -------------------------------------------------------------------------------------


@pytest.mark.parametrize('kind', ['spring', 'damper'])
def test_pages_are_written_and_escape_the_files_name(tmp_path, kind):
    name = '<img src=x onerror=1>.csv'
    file = write_csv(tmp_path / name, *(spring() if kind == 'spring' else damper()))
    page = tmp_path / 'page.html'
    assert main(kind, file, silent(tmp_path), mapping=MAPPING, report=page) == 0
    text = page.read_text(encoding='utf-8')
    assert '<img' not in text
    assert '&lt;img' in text
    assert 'N/mm' in text


@pytest.mark.parametrize('kind', ['spring', 'damper'])
def test_a_page_of_an_unusable_test_says_why_and_names_no_constant(tmp_path, kind):
    time, u, _ = spring()
    noise = np.random.default_rng(4).standard_normal(u.size)
    file = write_csv(tmp_path / 'noise.csv', time, u, noise)
    page = tmp_path / 'page.html'
    assert main(kind, file, silent(tmp_path), mapping=MAPPING, report=page) == 4
    text = page.read_text(encoding='utf-8')
    assert 'Unusable' in text
    assert '<caption>Constants' not in text


def test_a_reversed_sign_in_the_mapping_works_too(tmp_path):
    time, u, force = spring()
    file = write_csv(tmp_path / 'spring.csv', time, u, -force)
    mapping = ColumnMapping(
        (ColumnSpec('force', 2, 'N', scale=-1.0), ColumnSpec('displacement.crosshead', 1, 'mm')),
        time=0,
    )
    code, found, _ = run('spring', tmp_path, file, mapping=mapping)
    assert code == 0
    assert found['stiffness']['value'] == pytest.approx(STIFFNESS, rel=0.01)
