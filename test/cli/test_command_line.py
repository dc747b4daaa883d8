import dataclasses
import json
import re
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope import cli
from impactscope.cli import program
from impactscope.cli.explain import print_answer
from impactscope.configuration import bags_folder
from impactscope.drivers.simulated import write_simulation
from impactscope.recordings import RecordingWriter, open_recording
from impactscope.records import SampleBlock, TestPoint

HAMMER = str(bags_folder() / 'hammer_blow_1.mcap')


def run(capsys, *arguments):
    """Exit code, standard output and standard error, with line breaks folded."""
    code = cli.main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, ' '.join(out.split()), ' '.join(err.split())


@pytest.fixture(scope='module')
def campaigns(tmp_path_factory):
    folder = tmp_path_factory.mktemp('campaigns')
    for name in ('hand_pass', 'hand_fail'):
        write_simulation(name, folder / f'{name}.mcap')
    return folder


def test_help_teaches(capsys):
    code, out, _ = run(capsys, '--help')
    assert code == 0
    for word in ('analyse', 'replay', 'live', 'simulate', 'convert', 'demo', 'Exit codes'):
        assert word in out
    assert 'not a safety function' in out
    for command in (
        *('analyse', 'replay', 'live', 'simulate', 'convert', 'demo', 'info'),
        *('conceal', 'explain'),
    ):
        assert run(capsys, command, '--help')[0] == 0


def test_version(capsys):
    code, out, _ = run(capsys, '--version')
    assert code == 0
    assert re.search(r'impactscope \d+\.\d+\.\d+', out)


@pytest.mark.parametrize(
    ('name', 'verdict', 'exit_code'), [('hand_pass', 'PASS', 0), ('hand_fail', 'FAIL', 1)]
)
def test_exit_code_json_and_report_say_the_verdict(
    capsys, campaigns, tmp_path, name, verdict, exit_code
):
    results, report = tmp_path / 'results.json', tmp_path / 'report.html'
    code, out, _ = run(
        capsys, 'analyse', campaigns / f'{name}.mcap', '--json', results, '--report', report
    )
    assert code == exit_code
    assert f'verdict {verdict}' in out
    content = json.loads(results.read_text(encoding='utf-8'))
    assert content['verdict'] == verdict
    assert content['schema_version'] == 1
    assert len(content['events']) == 3
    assert len(content['sha256']) == 64
    assert verdict in report.read_text(encoding='utf-8')


def test_a_recording_of_no_measuring_device_is_invalid(capsys):
    code, out, _ = run(capsys, 'analyse', HAMMER, '--region', 'hands_fingers')
    assert code == 4
    assert 'Not a PFL measuring device' in out


def test_what_is_not_stated_leaves_it_incomplete(capsys, tmp_path):
    write_simulation('taps', tmp_path / 'taps.mcap')
    code, out, _ = run(capsys, 'analyse', tmp_path / 'taps.mcap')
    assert code == 5
    assert 'body region' in out


@pytest.mark.parametrize(
    ('content', 'words'),
    [(None, 'no recording'), (b'', 'empty'), (b'not a recording at all' * 9, 'recording')],
)
def test_what_is_no_recording_is_refused_in_one_line(capsys, tmp_path, content, words):
    path = tmp_path / 'thing.mcap'
    if content is not None:
        path.write_bytes(content)
    for command in ('analyse', 'info', 'replay'):
        code, _, err = run(capsys, command, path)
        assert code == 3, command
        assert words in err
        assert 'Traceback' not in err


def test_a_torn_recording_gives_what_it_has_and_no_pass(capsys, campaigns, tmp_path):
    whole = (campaigns / 'hand_pass.mcap').read_bytes()
    torn = tmp_path / 'torn.mcap'
    torn.write_bytes(whole[: len(whole) * 6 // 10])
    code, out, _ = run(capsys, 'analyse', torn)
    assert code == 3
    assert 'blow 1' in out
    assert 'verdict INVALID' in out
    assert run(capsys, 'info', torn)[0] == 3


def test_a_recording_without_samples(capsys, tmp_path):
    with RecordingWriter(tmp_path / 'points.mcap') as writer:
        writer.write_test_point(TestPoint(id='a', start_ns=10**18), '/test_point')
    code, _, err = run(capsys, 'analyse', tmp_path / 'points.mcap')
    assert code == 3
    assert 'no samples' in err


def test_values_that_are_no_numbers_never_pass(capsys, campaigns, tmp_path):
    path = tmp_path / 'nan.mcap'
    with (
        open_recording(campaigns / 'hand_pass.mcap') as recording,
        RecordingWriter(path) as writer,
    ):
        for topic, log_ns, record in recording.records():
            if isinstance(record, SampleBlock):
                if record.channel == 'force':
                    values = record.values.copy()
                    values[::50] = np.nan
                    record = dataclasses.replace(record, values=values)
                writer.write_block(record, topic, log_ns)
            else:
                writer.write_test_point(record, topic, log_ns)
    code, out, _ = run(capsys, 'analyse', path)
    assert code in {1, 4, 5}
    assert ' PASS' not in out


def test_wrong_usage(capsys, tmp_path):
    assert run(capsys, 'analyse')[0] == 2
    assert run(capsys, 'dance')[0] == 2
    assert run(capsys, 'analyse', HAMMER, '--input', 'nonsense')[0] == 2
    assert run(capsys, 'simulate', 'no_such_campaign', '-o', tmp_path / 'x.mcap')[0] == 2
    params = tmp_path / 'p.yaml'
    params.write_text('- a list', encoding='utf-8')
    code, _, err = run(capsys, 'analyse', HAMMER, '-p', params)
    assert code == 2
    assert 'no mapping' in err


def test_convert_describes_and_writes(capsys, tmp_path):
    table = tmp_path / 'blow.csv'
    rows = '\n'.join(f'{i / 1000:.3f},{i % 7}' for i in range(3000))
    table.write_text('time,Fz\n' + rows + '\n', encoding='utf-8')
    code, out, _ = run(capsys, 'convert', table)
    assert code == 0
    assert 'Fz' in out
    made = tmp_path / 'blow.mcap'
    code, out, _ = run(
        capsys, 'convert', table, made, '--time-column', 'time:s', '--channel', 'force=Fz:kN'
    )
    assert code == 0
    assert '1000 Hz' in out
    code, out, _ = run(capsys, 'info', made)
    assert code == 0
    assert 'channels: force' in out
    code, _, err = run(
        capsys, 'convert', table, made, '--time-column', 'time:s', '--channel', 'force=Fz:furlong'
    )
    assert code == 2
    assert 'furlong' in err


def test_convert_takes_dates_and_times_without_a_unit(capsys, tmp_path):
    table = tmp_path / 'log.csv'
    rows = [f'2025-11-14T20:07:{i / 10:06.3f},{i % 7}' for i in range(500)]
    table.write_text('#t,Fz\n' + '\n'.join(rows), encoding='utf-8')
    made = tmp_path / 'log.mcap'
    code, out, _ = run(
        capsys, 'convert', table, made, '--time-column', 't', '--channel', 'force=Fz:N'
    )
    assert code == 0
    assert '10 Hz' in out


def test_convert_tells_of_a_column_of_a_lower_rate(capsys, tmp_path):
    table = tmp_path / 'log.csv'
    rows = [f'{i / 10},{i % 7},{i * i if i % 5 == 0 else ""}' for i in range(500)]
    table.write_text('t,Fz,x\n' + '\n'.join(rows), encoding='utf-8')
    channels = ('--channel', 'force=Fz:N', '--channel', 'displacement=x:mm')
    code, out, _ = run(
        capsys, 'convert', table, tmp_path / 'a.mcap', '--time-column', 't', *channels
    )
    assert code == 0
    told = ' '.join(out.split())
    assert 'force, 500 samples each at 10 Hz; displacement, 100 samples each at 2 Hz' in told
    assert "note: 'displacement' has a number on one row in 5 only" in told


def test_columns_said_twice_are_refused(capsys, tmp_path):
    table, mapping = tmp_path / 'blow.csv', tmp_path / 'blow.yaml'
    table.write_text(
        't,Fz\n' + '\n'.join(f'{i / 10},{i % 7}' for i in range(200)), encoding='utf-8'
    )
    mapping.write_text('time: t\nchannels: {force: {column: Fz, unit: N}}\n', encoding='utf-8')
    made = tmp_path / 'blow.mcap'
    code, _, err = run(
        capsys,
        'convert',
        table,
        made,
        '--mapping',
        mapping,
        '--channel',
        'force=Fz:kN',
        '--transpose',
    )
    assert code == 2
    assert '--channel, --transpose beside --mapping' in ' '.join(err.split())
    assert not made.exists()
    assert run(capsys, 'convert', table, made, '--mapping', mapping, '--resample')[0] == 0


def test_help_of_convert_tells_of_the_mapping_file(capsys):
    _, out, _ = run(capsys, 'convert', '--help')
    assert 'docs/convert.md' in out
    assert 'scale: -1' in ' '.join(out.split())


def test_hostile_text_is_shown_as_text(capsys, tmp_path):
    path = tmp_path / 'hostile.mcap'
    channel = '[red]force[/red]<script>alert(1)</script>'
    with RecordingWriter(path, metadata={'provenance': {'[bold]': '[/] [link=x]'}}) as writer:
        for index in range(0, 2000, 20):
            values = np.zeros(20, np.float32)
            block = SampleBlock(channel, '[i]N', 1000.0, 10**18 + index * 10**6, index, values)
            writer.write_block(block, '/samples')
    code, out, _ = run(capsys, 'info', path)
    assert code == 0
    assert '[red]force[/red]' in out
    report = tmp_path / 'report.html'
    assert run(capsys, 'analyse', path, '--report', report)[0] in {4, 5}
    assert '<script>alert' not in report.read_text(encoding='utf-8')


def test_as_a_program():
    done = subprocess.run(
        [sys.executable, '-m', 'impactscope', 'info', HAMMER],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert 'force.hammer' in done.stdout


def test_a_reader_that_goes_changes_neither_verdict_nor_files(campaigns, tmp_path):
    results, passing = tmp_path / 'results.json', campaigns / 'hand_pass.mcap'
    with subprocess.Popen(
        [sys.executable, '-m', 'impactscope', 'analyse', passing, '--json', results],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as running:
        running.stdout.close()
        said = running.stderr.read().decode()
    assert running.returncode == 0
    assert 'Traceback' not in said
    assert json.loads(results.read_text())


def test_conceal_writes_a_campaign_and_says_what_is_wrong(capsys, tmp_path):
    folder = tmp_path / 'practice'
    sizes = ('--blows', '2', '--sample-rate', '1000', '--duration', '0.4')
    code, out, _ = run(capsys, 'conceal', 'zero_drift@force:rate=2', '-o', folder, *sizes)
    assert code == 0
    assert 'impactscope explain' in out
    assert (folder / 'campaign.yaml').exists()
    code, _, err = run(capsys, 'conceal', 'zero_drift:rate=2', '-o', tmp_path / 'no')
    assert code == 2
    assert 'zero_drift@CHANNEL' in err
    assert not (tmp_path / 'no').exists()
    listed = run(capsys, 'conceal', '--list')[1]
    assert 'coulomb_friction' in listed
    assert '…' not in listed  # no formula is cut off


def test_conceal_hides_nothing_on_request(capsys, tmp_path):
    sizes = ('--blows', '2', '--sample-rate', '1000', '--duration', '0.4')
    assert run(capsys, 'conceal', 'none', '-o', tmp_path / 'clean', *sizes)[0] == 0
    assert (tmp_path / 'clean' / 'campaign.yaml').exists()


def test_what_recordings_rule_out_is_told_by_its_name_alone(capsys):
    def finding(name, probability, channel=''):
        size = SimpleNamespace(value=2.5, std=0.1, unit='N')
        return SimpleNamespace(
            name=name,
            probability=probability,
            channel=channel,
            parameters={'force': size},
            confused_with=(),
        )

    print_answer(
        SimpleNamespace(
            summary=lambda: 'Dry friction.',
            accepted=('coulomb_friction',),
            ranking=(
                finding('coulomb_friction', 0.9),
                finding('stribeck_friction', 0.03),
                finding('saturation', 1e-4, 'force'),
                finding('end_stop', 0.0),
            ),
            fit=SimpleNamespace(baseline=SimpleNamespace(rmse={}), extended=None),
            notes=(),
            next_tests=(),
        )
    )
    out = capsys.readouterr().out
    assert 'found coulomb_friction: probability 0.900; force 2.50 ± 0.20 N' in out
    assert 'tried stribeck_friction: probability 0.030; force 2.50 ± 0.20 N' in out
    assert 'ruled out: saturation of force, end_stop' in out
    assert out.count('2.50') == 2


def test_a_campaign_is_checked_without_a_search(capsys, tmp_path):
    code, out, _ = run(capsys, 'explain', bags_folder() / 'pendulum_campaign.yaml', '--check')
    assert code == 0
    assert 'driven, the simulation has linear_sensor' in out
    assert '(hold_out) displacement.angle: -1.4' in out
    assert 'rad, 3.2 s at 1000 Hz, the part from 1.8' in out
    assert 'found' not in out
    (tmp_path / 'campaign.yaml').write_text('version: 1\n', encoding='utf-8')
    code, _, err = run(capsys, 'explain', tmp_path, '--check')
    assert code != 0
    assert 'bench' in err


def test_a_check_marks_channels_that_no_search_looks_at(capsys, tmp_path):
    table, columns = tmp_path / 'd.npz', ['force=F:N', 'displacement.x=x:m', 'voltage=u:V']
    np.savez(table, F=np.sin(np.arange(900.0)), x=np.cos(np.arange(900.0)), u=np.ones(900))
    run(
        capsys,
        'convert',
        table,
        tmp_path / 'd.mcap',
        '--sample-rate',
        '1000',
        *(part for column in columns for part in ('--channel', column)),
    )
    (tmp_path / 'campaign.yaml').write_text(
        'version: 1\nbench: {kind: driven, input: force, outputs: [displacement.x]}\n'
        'baseline: [linear_sensor]\nrecordings: [{file: d.mcap}]\n',
        encoding='utf-8',
    )
    code, out, err = run(capsys, 'explain', tmp_path, '--check')
    assert code == 0, err
    assert out.count('not used') == 1
    assert re.search(r'voltage: [^:]*, not used', ' '.join(out.split()))


@pytest.mark.parametrize(
    ('part', 'output', 'baseline', 'told'),
    [
        ('start: 1.5, end: 2.5', 'angle', 'linear_sensor', ''),
        ('start: 60', 'angle', 'linear_sensor', '60 s; pendulum_swing_01.mcap ends at 5 s'),
        ('start: 4, end: 3', 'angle', 'linear_sensor', 'ends at 3 s, before it starts at 4 s'),
        ('start: 1', 'angel', 'linear_sensor', "no channel 'displacement.angel'; it has disp"),
        ('start: 1', 'angle', 'linear_senser', "'linear_senser', which is not known for a camp"),
    ],
    ids=['a part', 'behind the end', 'backwards', 'no such channel', 'no such mechanism'],
)
def test_a_check_holds_the_recordings_against_the_file(
    capsys, tmp_path, part, output, baseline, told
):
    shutil.copy(bags_folder() / 'pendulum_swing_01.mcap', tmp_path)
    (tmp_path / 'campaign.yaml').write_text(
        'version: 1\n'
        f'bench: {{kind: driven, input: none, outputs: [displacement.{output}]}}\n'
        f'baseline: [{baseline}]\n'
        f'recordings:\n- {{file: pendulum_swing_01.mcap, role: fit, {part}}}\n',
        encoding='utf-8',
    )
    code, out, err = run(capsys, 'explain', tmp_path, '--check')
    assert (code != 0) == bool(told)
    assert told in ' '.join(err.split())
    if not told:
        assert ', 1 s at 1000 Hz, the part from 1.5 to 2.499 s' in ' '.join(out.split())


def _while_it_waits() -> None:
    raise KeyboardInterrupt


def _in_compiled_code() -> None:
    raise SystemError('run returned a result with an exception set') from KeyboardInterrupt()


@pytest.mark.parametrize('place', [_while_it_waits, _in_compiled_code])
def test_interrupted_it_says_so_wherever_it_was(capsys, monkeypatch, place):
    monkeypatch.setattr(program, 'app', lambda *_, **__: place())
    code, _, err = run(capsys, 'explain', 'campaign')
    assert (code, err) == (130, 'interrupted')
