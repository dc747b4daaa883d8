"""Files of columns to recordings: units, times, flags, provenance, refusals."""

import contextlib
import json
import math
import zipfile
from pathlib import Path
from time import process_time

import numpy as np
import pytest
import scipy.io
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.campaign_files import read_channels
from impactscope.errors import (
    ConfigurationError,
    ImpactscopeError,
    InputError,
    MissingChannelError,
    RecordingError,
)
from impactscope.recordings import (
    UNITS,
    ColumnMapping,
    ColumnSpec,
    convert,
    describe,
    file_sha256,
    open_recording,
    read_columns,
    read_streams,
    to_si,
)
from impactscope.records import ContactKind, Quality, SampleBlock, TestPoint


def stream(path, channel):
    """Blocks of a channel, and their values in one piece."""
    with open_recording(path) as recording:
        blocks = [
            b
            for b in read_streams(recording)
            if isinstance(b, SampleBlock) and b.channel == channel
        ]
    return blocks, np.concatenate([b.values for b in blocks])


@pytest.fixture
def table():
    """Time s, force kN, acceleration g at 1 kHz."""
    rng = np.random.default_rng(5)
    time = np.arange(250) / 1000.0
    return np.column_stack([time, rng.normal(size=250), rng.normal(size=250)])


def files(table, folder):
    """The same table in every kind of file: path, keys of its columns, options."""
    np.savetxt(folder / 'a.csv', table, delimiter=',', header='t,Fz,a', comments='')
    yield folder / 'a.csv', ('t', 'Fz', 'a'), {}
    np.savetxt(folder / 'b.txt', table, header='made by\nhand', comments='')
    yield folder / 'b.txt', (0, 1, 2), {}
    np.savetxt(folder / 'c.csv', table, delimiter=';', header='1;2\n7', comments='')
    yield folder / 'c.csv', (0, 1, 2), {}
    np.save(folder / 'd.npy', table.T)
    yield folder / 'd.npy', (0, 1, 2), {'transpose': True}
    np.savez(folder / 'e.npz', t=table[:, 0], data=table[:, 1:])
    yield folder / 'e.npz', ('t', 'data[0]', 'data[1]'), {}
    scipy.io.savemat(folder / 'f.mat', {'t': table[:, 0], 'F': table[:, 1:2], 'acc': table[:, 2]})
    yield folder / 'f.mat', ('t', 'F', 'acc'), {}
    (folder / 'g.json').write_text(json.dumps({'data': table.tolist()}))
    yield folder / 'g.json', ('data[0]', 'data[1]', 'data[2]'), {}


def test_a_zero_is_taken_off_before_the_scale_and_turns_are_angles():
    at_rest = ColumnSpec('acceleration.plate', 0, 'g', scale=-1.0, zero=1.0)
    assert at_rest.in_si(np.array([1.0, 2.0])) == pytest.approx([0.0, -9.80665])
    turned = ColumnSpec('displacement.motor', 0, 'turns')
    assert turned.in_si(np.array([0.5])) == pytest.approx([np.pi])


def test_every_kind_of_file_gives_the_same_recording(table, tmp_path):
    for path, (time, force, acceleration), options in files(table, tmp_path):
        mapping = ColumnMapping(
            (
                ColumnSpec('force', force, 'kN', scale=-1.0),
                ColumnSpec('acceleration.plate', acceleration, 'g', frame_id='plate'),
            ),
            time=time,
            start_ns=10**18,
            **options,
        )
        made = convert(path, path.with_suffix('.mcap'), mapping, overwrite=True)
        assert (made.samples, made.sample_rate) == (250, 1000.0)
        assert made.quality is Quality.NONE
        blocks, values = stream(made.path, 'force')
        assert values == pytest.approx(-1000 * table[:, 1], rel=1e-6)
        assert {b.unit for b in blocks} == {'N'}
        assert [b.first_index for b in blocks] == [*range(0, 250, 20), 250]
        assert [b.stamp_ns for b in blocks] == [10**18 + 10**6 * b.first_index for b in blocks]
        assert blocks[-1].is_end
        assert blocks[0].received_ns == blocks[1].stamp_ns
        blocks, values = stream(made.path, 'acceleration.plate')
        assert values == pytest.approx(9.80665 * table[:, 2], rel=1e-6)
        assert blocks[0].frame_id == 'plate'
        assert len(describe(path, transpose=options.get('transpose', False))) == 3


def test_same_input_same_bytes_and_provenance(table, tmp_path):
    np.save(tmp_path / 'a.npy', table)
    mapping = ColumnMapping.from_strings(
        ['force=1:N'], sample_rate=1000.0, provenance={'licence': 'MIT'}
    )
    contents = []
    for name in ('a.mcap', 'b.mcap'):
        convert(tmp_path / 'a.npy', tmp_path / name, mapping)
        contents.append((tmp_path / name).read_bytes())
    assert contents[0] == contents[1]
    with open_recording(tmp_path / 'a.mcap') as recording:
        provenance = recording.info.provenance
    assert provenance['licence'] == 'MIT'
    assert provenance['source_file'] == 'a.npy'
    assert provenance['source_sha256'] == file_sha256(tmp_path / 'a.npy')
    assert provenance['column.force'] == '1 [N]'
    assert 'impactscope' in provenance['converter']
    with pytest.raises(RecordingError, match='exists already'):
        convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', mapping)


def test_flags_of_values_that_cannot_be_trusted(tmp_path):
    values = np.zeros(100)
    values[[25, 45]] = np.nan, 10.0
    values[65] = -10.0
    values[85] = 1e300  # finite, but not as a 32-bit number
    np.save(tmp_path / 'a.npy', values)
    mapping = ColumnMapping(
        (ColumnSpec('force', 0, 'N', range_min=-10.0, range_max=10.0),), sample_rate=1000.0
    )
    made = convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', mapping)
    blocks, found = stream(made.path, 'force')
    clipped, broken = Quality.CLIPPED, Quality.NOT_FINITE
    assert [b.quality for b in blocks] == [
        Quality.NONE, broken, clipped, clipped, clipped | broken, Quality.NONE,
    ]  # fmt: skip
    assert np.isnan(found[25])
    assert np.isinf(found[85])
    assert made.quality == clipped | broken
    assert blocks[0].range_max == 10.0


def test_test_point_goes_along(tmp_path):
    np.save(tmp_path / 'a.npy', np.zeros(10))
    point = TestPoint(id='p', body_region='chest', contact=ContactKind.FREE)
    mapping = ColumnMapping(
        (ColumnSpec('force', 0, 'N'),), sample_rate=10.0, start_ns=10**18, test_point=point
    )
    convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', mapping)
    with open_recording(tmp_path / 'a.mcap') as recording:
        _, log_ns, first = next(recording.records())
    assert (log_ns, first.id, first.start_ns) == (10**18, 'p', 10**18)


@given(
    rate=st.floats(0.5, 2e5),
    count=st.integers(2, 300),
    start=st.floats(-1e3, 1e3),
    jitter=st.floats(0, 0.05),
)
@settings(max_examples=50, deadline=None)
def test_rate_is_found_from_uniform_times(tmp_path_factory, rate, count, start, jitter):
    rng = np.random.default_rng(count)
    folder = tmp_path_factory.mktemp('rate')
    times = start + (np.arange(count) + jitter * rng.uniform(-1, 1, count)) / rate
    np.save(folder / 'a.npy', np.column_stack([times, times]))
    mapping = ColumnMapping((ColumnSpec('x', 1, 's'),), time=0)
    made = convert(folder / 'a.npy', folder / 'a.mcap', mapping, time_tolerance=0.2)
    resolution = 1e-12 * rate * 1e3  # of a double at 1000 s, in sample periods
    allowed = max((2 * jitter + resolution) / (count - 1), 1e-9)  # nine digits are kept
    assert made.sample_rate == pytest.approx(rate, rel=allowed)


def test_times_that_are_not_uniform_are_refused(tmp_path):
    def attempt(times, **options):
        np.save(tmp_path / 'a.npy', np.column_stack([times, np.zeros(len(times))]))
        mapping = ColumnMapping((ColumnSpec('force', 1, 'N'),), time=0, **options)
        convert(tmp_path / 'a.npy', tmp_path / 'b.mcap', mapping)

    uniform = np.arange(100) / 1000.0
    late = uniform.copy()
    late[40] += 0.0005
    with pytest.raises(InputError, match=r'1000 Hz: row 40 comes 0\.0005 s, 0\.5 sample'):
        attempt(late)
    back = uniform.copy()
    back[7] = back[5]
    with pytest.raises(InputError, match='row 7: the time does not advance'):
        attempt(back)
    hole = uniform.copy()
    hole[3] = np.nan
    with pytest.raises(InputError, match=r'row 3: the time is nan; take .*--sample-rate'):
        attempt(hole)
    hole[3], hole[-1] = uniform[3], np.nan
    with pytest.raises(InputError, match='row 99: the time is nan'):
        attempt(hole)  # its number would be lost
    with pytest.raises(InputError, match='not uniform at 999 Hz'):
        attempt(np.arange(2000) / 1000.0, sample_rate=999.0)
    with pytest.raises(InputError, match='not uniform at 1 Hz'):
        attempt(uniform, time_unit='s', sample_rate=1.0)
    assert not (tmp_path / 'b.mcap').exists()
    attempt(uniform * 1000, time_unit='ms', sample_rate=1000.0)


def test_uneven_times_tell_whether_their_rows_may_be_even(tmp_path):
    rng = np.random.default_rng(3)
    even = np.arange(4000) / 1000.0
    bursts = np.sort(even + rng.uniform(0.0, 0.0015, even.size))  # stamped late, in turns
    lossy = even[np.sort(rng.permutation(4000)[:3000])] + 1e-6 * np.arange(3000) ** 1.3
    mapping = ColumnMapping.from_strings(['force=F:N'], time='t')
    for times, may in ((bursts, True), (lossy, False)):
        np.savez(tmp_path / 'u.npz', t=times, F=np.ones(times.size))
        with pytest.raises(
            InputError, match=r'intervals are more than half off the usual'
        ) as told:
            convert(tmp_path / 'u.npz', tmp_path / 'u.mcap', mapping)
        assert ('which they may be' in str(told.value)) == may


def test_columns_that_are_not_there_or_differ_in_length(tmp_path):
    np.savez(tmp_path / 'a.npz', t=np.zeros(5), long=np.zeros(6), wide=np.zeros((5, 2)))
    for key, message in [
        ('x', r"no column 'x'; it has t \(5 rows\), long \(6 rows\), wide\[0\]"),
        ('wide', r"2 columns: name one, as in 'wide\[0\]'"),
        ('wide[2]', 'no column'),
        ('wide[', 'no column'),
        (0, 'no column 0'),
    ]:
        with pytest.raises(MissingChannelError, match=message):
            read_columns(tmp_path / 'a.npz').column(key)
    mapping = ColumnMapping.from_strings(['a=t:N', 'b=long:N'], sample_rate=1.0)
    with pytest.raises(InputError, match=r"'long' of 'a.npz' has 6 rows, column 't' has 5"):
        convert(tmp_path / 'a.npz', tmp_path / 'a.mcap', mapping)


@pytest.mark.parametrize(
    ('name', 'content', 'message'),
    [
        ('a.csv', b'', 'is empty'),
        ('a.csv', b'only,words\nand,more\n', 'no rows of numbers'),
        ('a.csv', b't,F,c\n0,1,5\n1,2\n2,3\n3,4\n', 'line 2: 3 columns instead of 2'),
        ('a.txt', b'it ran for\nreal 3\nuser 2\n', 'no rows of numbers'),
        ('a.csv', b't,F\n0,1\n1,two\n', r"line 3, column 1: 'two' is no number"),
        ('a.csv', b'0,1\n1\n', 'line 2: 1 columns instead of 2'),
        ('a.csv', b'\xff\xfe\x00\x01', 'neither text'),
        ('a.npy', b'\x93NUMPY\x01\x00', 'cannot be read as a table'),
        ('a.npz', b'PK\x03\x04junk', 'cannot be read as a table'),
        ('a.mat', b'MATLAB 5.0 MAT-file' + b' ' * 200, 'a.mat'),
        ('a.mat', b'\x89HDF\r\n\x1a\n', 'save -v7'),
        ('a.json', b'{"a": "b"}', 'no table of numbers'),
        ('a.json', b'{"a": [[1], [2, 3]]}', r'no table of numbers: a \(lists of different'),
    ],
)
def test_files_that_are_no_tables(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        read_columns(tmp_path / name)


@pytest.mark.parametrize('encoding', ['utf-8-sig', 'utf-16', 'gb2312', 'latin-1'])
def test_headings_of_any_encoding(tmp_path, encoding):
    heading = '时间,力' if encoding != 'latin-1' else 'Zeit,Größe'
    rows = '\n'.join(f'{0.1 * i:.1f},{i * i}' for i in range(5))
    (tmp_path / 'a.csv').write_bytes(f'{heading}\n{rows}\n'.encode(encoding))
    file = read_columns(tmp_path / 'a.csv')
    assert file.column(1).tolist() == [0.0, 1.0, 4.0, 9.0, 16.0]
    if encoding != 'gb2312':
        assert file.names == tuple(heading.split(','))


def test_bytes_that_no_text_has(tmp_path):
    (tmp_path / 'a.csv').write_bytes(b'\x80\x02t,F\n0,1\n1,2\n')
    with pytest.raises(RecordingError, match='neither text'):
        read_columns(tmp_path / 'a.csv')


def test_pickles_and_complex_numbers_are_refused(tmp_path):
    np.save(tmp_path / 'a.npy', np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(RecordingError):
        read_columns(tmp_path / 'a.npy')
    np.save(tmp_path / 'b.npy', np.zeros(3, complex))
    with pytest.raises(RecordingError, match='real numbers'):
        read_columns(tmp_path / 'b.npy')
    with pytest.raises(RecordingError, match='cannot be read'):
        read_columns(tmp_path / 'nothing.csv')


def test_missing_fields_become_nan(tmp_path):
    (tmp_path / 'a.csv').write_text('t,F\n0,1\n1,\n2,nan\n')
    column = read_columns(tmp_path / 'a.csv').column('F')
    assert column[0] == 1
    assert np.isnan(column[1:]).all()


@given(
    st.binary(max_size=300), st.sampled_from([b'', b'\x93NUMPY', b'PK\x03\x04', b'{', b'1,2\n'])
)
@settings(max_examples=200, deadline=None)
def test_any_bytes_give_a_table_or_an_error_of_ours(tmp_path_factory, content, head):
    path = tmp_path_factory.mktemp('any') / 'a'
    path.write_bytes(head + content)
    with contextlib.suppress(ImpactscopeError):
        assert read_columns(path).arrays


def test_factors_of_units():
    """Against definitions: standard gravity, the international pound and inch."""
    pound_force = 0.45359237 * 9.80665
    assert to_si('lbf') == ('N', pytest.approx(pound_force, rel=1e-15))
    assert to_si('kip') == ('N', pytest.approx(4448.2216152605, rel=1e-15))
    assert to_si('g') == ('m/s^2', 9.80665)
    assert to_si('inch') == ('m', 0.0254)
    assert to_si('deg') == ('rad', math.pi / 180)
    assert to_si(' m/s² ') == to_si('m/s^2') == ('m/s^2', 1.0)
    for si_unit, _ in UNITS.values():
        assert UNITS[si_unit] == (si_unit, 1.0)
    with pytest.raises(ConfigurationError, match=r"unit 'furlong' is not known; known are N, mN"):
        to_si('furlong')


def test_mapping_from_yaml_and_from_strings(tmp_path):
    (tmp_path / 'm.yaml').write_text(
        'channels:\n'
        '  force.hammer: {column: 1, unit: kN, range_max: 500}\n'
        '  acceleration: {column: acc, unit: g}\n'
        'time: 0\ntime_unit: ms\ntranspose: true\n'
        'provenance: {year: 2024}\n'
        'test_point: {id: p1, body_region: chest, contact: 1, speed: 0.25}\n'
    )
    mapping = ColumnMapping.from_yaml(tmp_path / 'm.yaml')
    first, second = mapping.channels
    assert (first.channel, first.column, first.unit) == ('force.hammer', 1, 'kN')
    assert first.range_max == 500
    parsed = ColumnSpec.parse('acceleration = acc : g')
    assert (parsed.channel, parsed.column, parsed.unit) == ('acceleration', 'acc', 'g')
    assert (second.channel, second.column, second.unit) == ('acceleration', 'acc', 'g')
    assert ColumnSpec.parse('force=12:m/s^2').column == 12
    assert (mapping.time, mapping.time_unit, mapping.transpose) == (0, 'ms', True)
    assert mapping.provenance == {'year': '2024'}
    assert mapping.test_point.speed == 0.25


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('[1, 2', 'cannot be read'),
        ('just text', 'no names and values'),
        ('time: 0', 'needs `channels`'),
        ('channels: {}\ntime: 0', 'without channels'),
        ('channels: {f: {unit: N}}\ntime: 0', "'f' of the mapping names no column"),
        ('channels: {f: {column: 0, unit: N}}', 'neither a time column nor a sample rate'),
        ('channels: {f: {column: 0, unit: N}}\nsample_rate: -1', 'sample_rate is -1'),
        ('channels: {f: {column: 0, unit: N}}\nsample_rate: fast', 'wrong kind'),
        ('channels: {f: {column: 0, unit: N}}\ntime: 1\ntime_unit: N', 'no unit of time'),
        ('channels: {f: {column: 0, unit: N}}\ntime: 1\nrate: 5', "unknown 'rate'; known are"),
        ('channels: {f: {column: 0, unit: stone}}\ntime: 1', "unit 'stone' is not known"),
        ('channels: {f: {column: 0, gain: 2}}\ntime: 1', "unknown 'gain'"),
        ('channels: {f: {column: 0, scale: 0}}\ntime: 1', 'scale is 0'),
        ('channels: {f: {column: 0, zero: .nan}}\ntime: 1', 'zero is nan'),
        ('channels: {f: {column: 0}}\ntime: 1\ntest_point: {name: x}', "unknown 'name'"),
        ('channels: {f: {column: 0}}\ntime: 1\nstart_ns: -1', 'start_ns is -1'),
    ],
)
def test_mappings_that_do_not_hold_together(tmp_path, text, message):
    (tmp_path / 'm.yaml').write_text(text)
    with pytest.raises(ConfigurationError, match=message):
        ColumnMapping.from_yaml(tmp_path / 'm.yaml')


def test_strings_that_are_no_mapping():
    for text in ('force', 'force=1', 'force=:N', '=1:N'):
        with pytest.raises(ConfigurationError):
            ColumnSpec.parse(text)
    with pytest.raises(ConfigurationError, match="'a' is mapped more than once"):
        ColumnMapping.from_strings(['a=0:N', 'a=1:N'], sample_rate=1.0)


def test_a_decimal_comma_beside_another_delimiter(tmp_path):
    file = tmp_path / 'a.csv'
    file.write_text('t;x\n0;-68\n0,01;-56,5\n0,02;-42\n', encoding='utf-8')
    read = read_columns(file)
    assert read.names == ('t', 'x')
    np.testing.assert_allclose(read.column('x'), [-68.0, -56.5, -42.0])
    np.testing.assert_allclose(read.column('t'), [0.0, 0.01, 0.02])


def test_a_comma_stays_a_delimiter_where_another_only_stands_in_text(tmp_path):
    file = tmp_path / 'a.csv'
    file.write_text('0.0,1.5\n0.1,2.5\n', encoding='utf-8')
    assert read_columns(file).arrays[''].shape == (2, 2)


def test_structures_of_matlab_are_named_with_their_fields(tmp_path):
    inner = {'Acc': np.arange(12.0).reshape(2, 6), 'Time': np.arange(6.0), 'note': 'made by hand'}
    scipy.io.savemat(tmp_path / 'a.mat', {'Fe': {'Out': inner}})
    read = read_columns(tmp_path / 'a.mat')
    np.testing.assert_array_equal(read.column('Fe.Out.Time'), np.arange(6.0))
    turned = read_columns(tmp_path / 'a.mat', transpose=True)
    np.testing.assert_array_equal(turned.column('Fe.Out.Acc[1]'), np.arange(6.0, 12.0))


def test_a_lying_table_is_described_in_one_line(tmp_path):
    np.save(tmp_path / 'a.npy', np.zeros((2, 5000)))
    assert describe(tmp_path / 'a.npy') == [
        'the table: 5000 columns of 2 rows; transposed 2 columns of 5000'
    ]


def test_uneven_times_are_refused_with_what_helps_and_resampled_where_asked(tmp_path):
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.0008, 0.0012, 4000))
    time[100] = time[99]  # a repeated stamp
    keep = (time < 1.0) | (time > 1.05)  # a gap
    value = np.sin(2 * np.pi * 5.0 * time)
    np.savetxt(tmp_path / 'a.csv', np.column_stack([time, value])[keep], delimiter=',')
    spec = (ColumnSpec('angle', 1, 'rad'),)
    with pytest.raises(InputError, match=r'resample.*in bursts, give sample_rate'):
        convert(tmp_path / 'a.csv', tmp_path / 'a.mcap', ColumnMapping(spec, time=0))
    mapping = ColumnMapping(spec, time=0, sample_rate=1000.0, resample=True)
    made = convert(tmp_path / 'a.csv', tmp_path / 'a.mcap', mapping)
    assert made.sample_rate == 1000.0
    assert Quality.NOT_FINITE in made.quality
    values = stream(tmp_path / 'a.mcap', 'angle')[1]
    at = time[0] + np.arange(values.size) / 1000.0
    lost = ~np.isfinite(values)
    inside = (at > 1.002) & (at < 1.048)
    assert lost[inside].all()
    assert not lost[(at < 0.998) | (at > 1.053)].any()
    error = values[~lost] - np.sin(2 * np.pi * 5.0 * at[~lost])
    assert np.max(np.abs(error)) < 2e-3


def test_resampling_needs_times():
    with pytest.raises(ConfigurationError, match='time column'):
        ColumnMapping((ColumnSpec('a', 0, 'V'),), sample_rate=10.0, resample=True)


def test_columns_of_different_length_are_not_cut_to_their_common_tail(tmp_path):
    file = tmp_path / 'pasted.txt'
    head = [f'{k}\t{k}\t{k}\t{k}' for k in range(60)]
    file.write_text('\n'.join([*head, *(f'{k}\t{k}' for k in range(200))]), encoding='utf-8')
    with pytest.raises(RecordingError, match=r'lines 1 to 60 are rows of 4 numbers'):
        read_columns(file)
    assert read_columns(file, skip_rows=60).arrays[''].shape == (200, 2)


def test_structures_and_cells_of_matlab_are_read_and_the_rest_is_told(tmp_path):
    kind = [('Name', object), ('Data', object)]
    channels = np.array([('"speed"', np.arange(5.0)), ('"duty"', -np.arange(5.0))], dtype=kind)
    cells = np.empty(2, dtype=object)
    cells[:] = [np.arange(3.0), np.ones((4, 2))]
    cube = np.zeros((2, 3, 4))
    file = tmp_path / 'd.mat'
    scipy.io.savemat(file, {'Y': channels, 'runs': cells, 'cube': cube, 'note': 'text'})
    found = read_columns(file)
    np.testing.assert_array_equal(found.column('Y.speed.Data'), np.arange(5.0))
    np.testing.assert_array_equal(found.column('Y.duty.Data'), -np.arange(5.0))
    np.testing.assert_array_equal(found.column('runs{0}'), np.arange(3.0))
    np.testing.assert_array_equal(found.column('runs{1}[1]'), np.ones(4))
    assert describe(file)[-1] == 'passed over: cube (3 dimensions of float64)'
    assert not any('note' in line for line in describe(file))
    scipy.io.savemat(file, {'cube': cube})
    with pytest.raises(RecordingError, match='no numeric variables: cube'):
        read_columns(file)


@pytest.mark.parametrize('rule', ['-----', '=== ===', '+---+---+', '# ----------'])
def test_headings_stand_above_a_rule_too(tmp_path, rule):
    rows = '\n'.join(f'{0.01 * k:.2f}, {k}' for k in range(50))
    (tmp_path / 'a.txt').write_text(f'logger 7\nTime, Angle(deg)\n{rule}\n{rows}\n')
    mapping = ColumnMapping((ColumnSpec('angle', 'Angle(deg)', 'deg'),), time='Time')
    made = convert(tmp_path / 'a.txt', tmp_path / 'a.mcap', mapping)
    assert (made.samples, made.sample_rate) == (50, 100.0)


STAMPED = [  # heading, a row of a date and time and a number: all at 50 Hz
    ('stamp,F', '{date} {clock}{s:06.3f},{x}'),
    ('stamp;F', '{date} {clock}{s:06.3f};{x},0'),
    ('stamp\tF', '{date}T{clock}{s:06.3f}Z\t{x}'),
    ('"stamp","F"', '"{date}T{clock}{s:06.3f}+01:00","{x}"'),
    ('stamp F', '{date} {clock}{s:06.3f} {x}'),
    ('# stamp,F', '{date} {clock}{s:09.6f},{x}'),
    ('stamp,F', '{clock}{s:06.3f},{x}'),
    ('stamp F', '{clock}{s:06.3f} {x}'),
]


@pytest.mark.parametrize('key', [0, 'stamp'])
@pytest.mark.parametrize(('heading', 'row'), STAMPED)
def test_dates_and_times_are_seconds_from_the_first(tmp_path, heading, row, key):
    def clock(k):
        return f'23:{58 + k // 3000}:' if k < 6000 else '00:00:'

    rows = [
        row.format(
            date='2025-11-14' if k < 6000 else '2025-11-15', clock=clock(k), s=k % 3000 / 50, x=k
        )
        for k in range(6100)
    ]
    if ';' in heading:
        rows = [line.replace('.', ',') for line in rows]
    file = tmp_path / 'a.csv'
    file.write_text('\n'.join(['logger 7', heading, *rows]), encoding='utf-8')
    mapping = ColumnMapping((ColumnSpec('force', 'F', 'N'),), time=key)
    made = convert(file, tmp_path / 'a.mcap', mapping)
    assert (made.samples, made.sample_rate) == (6100, 50.0)
    assert stream(made.path, 'force')[1].tolist() == list(range(6100))
    assert read_columns(file).column(key)[-1] == pytest.approx(6099 / 50, abs=1e-9)
    first, second = describe(file)
    assert first == "0 'stamp' (6100 rows, dates and times as s from the first)"
    assert second == "1 'F' (6100 rows)"


def test_dates_and_times_in_the_head_of_numbers_stay_there(tmp_path):
    file = tmp_path / 'a.csv'
    file.write_text('2025-11-14 20:07:10\n1.0\n2.0\n3.0\n', encoding='utf-8')
    assert read_columns(file).column(0).tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        ('2025-11-14 20:07:61,1', "line 3, column 0: '2025-11-14 20:07:61' is no date and time"),
        ('7.5,1', "line 3, column 0: '7.5' is no date and time"),
        ('2025-11-14 20:07:11Z,1', 'one has a time zone, one has none'),
        ('20:07:11,1', "line 3, column 0: '20:07:11' is no date and time"),
    ],
)
def test_dates_and_times_that_are_none(tmp_path, rows, message):
    file = tmp_path / 'a.csv'
    good = [f'2025-11-14 20:07:{s},1' for s in range(20, 30)]
    file.write_text('\n'.join(['t,F', '2025-11-14 20:07:10,1', rows, *good]), encoding='utf-8')
    with pytest.raises(RecordingError, match=message):
        read_columns(file)


def test_other_dates_are_named(tmp_path):
    file = tmp_path / 'a.csv'
    file.write_text('t,F\n1.5.2025 20:07,1\n2.5.2025 20:07,2\n', encoding='utf-8')
    read = read_columns(file)
    assert read.column('F').tolist() == [1.0, 2.0]
    with pytest.raises(MissingChannelError, match=r"'t' .*'1\.5\.2025 20:07' in line 2, neither"):
        read.seconds('t', 's')


def test_a_missing_date_and_time_is_refused_with_its_row(tmp_path):
    file = tmp_path / 'a.csv'
    file.write_text(
        't,F\n2025-11-14 20:07:10,1\n,2\n2025-11-14 20:07:12,3\n2025-11-14 20:07:13,3\n',
        encoding='utf-8',
    )
    mapping = ColumnMapping((ColumnSpec('force', 1, 'N'),), time='t')
    with pytest.raises(InputError, match='row 1: the time is nan'):
        convert(file, tmp_path / 'a.mcap', mapping)
    mapping = ColumnMapping((ColumnSpec('force', 1, 'N'),), time='t', time_unit='ms')
    with pytest.raises(InputError, match=r"dates and times, which are read in s; .*'ms'"):
        convert(file, tmp_path / 'a.mcap', mapping)


def test_many_numbers_are_read_quickly(tmp_path):
    file = tmp_path / 'a.csv'
    np.savetxt(file, np.column_stack([np.arange(1e5) / 1e3] * 2), delimiter=',', fmt='%.4f')
    began = process_time()
    assert read_columns(file).arrays[''].shape == (100_000, 2)
    assert process_time() - began < 5.0


@pytest.mark.parametrize(
    ('member', 'message'),
    [
        ('xl/workbook.xml', "'a.xlsx' is an Excel workbook: save its sheet as CSV"),
        ('content.xml', 'is an OpenDocument workbook: save its sheet as CSV'),
        ('blow.csv', "is a ZIP archive and 'blow.csv' in it no NumPy array: unpack it"),
    ],
)
def test_workbooks_and_archives_are_told_by_their_content(tmp_path, member, message):
    with zipfile.ZipFile(tmp_path / 'a.xlsx', 'w') as archive:
        archive.writestr(member, '1,2')
    with pytest.raises(RecordingError, match=message):
        read_columns(tmp_path / 'a.xlsx')


def test_an_old_workbook_is_told_by_its_content(tmp_path):
    (tmp_path / 'a.xls').write_bytes(bytes.fromhex('d0cf11e0a1b11ae1') + bytes(600))
    with pytest.raises(RecordingError, match=r'is an Excel workbook \(\.xls\) .* save it as CSV'):
        read_columns(tmp_path / 'a.xls')


@pytest.mark.parametrize('resample', [False, True])
def test_times_that_run_backwards_are_refused_with_what_helps(tmp_path, resample):
    times = np.arange(100) / 1000.0
    times[40:] -= 0.01
    np.save(tmp_path / 'a.npy', np.column_stack([times, times]))
    specs = (ColumnSpec('force', 1, 'N'),)
    with pytest.raises(
        InputError,
        match=r"'a.npy'.* row 40: the time .* \(0\.039 s, then 0\.03 s\); .*--sample-rate",
    ):
        mapping = ColumnMapping(specs, time=0, resample=resample)
        convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', mapping)
    made = convert(
        tmp_path / 'a.npy', tmp_path / 'a.mcap', ColumnMapping(specs, sample_rate=1000.0)
    )
    assert made.samples == 100


@pytest.mark.parametrize(
    ('heading', 'delimiter', 'keys'),
    [
        ('#t,F', ',', ('t', '#t', 0)),
        ('# t F', ' ', ('t', '# t', 0)),
        ('% t;F', ';', ('t', '% t', 0)),
        ('#,F', ',', ('#', 0)),
    ],
)
def test_the_mark_of_a_comment_is_no_part_of_a_heading(tmp_path, heading, delimiter, keys):
    file = tmp_path / 'a.csv'
    rows = [delimiter.join((f'{0.1 * i:.1f}', str(i * i))) for i in range(5)]
    file.write_text('\n'.join([heading, *rows]), encoding='utf-8')
    read = read_columns(file)
    assert read.names == (keys[0], 'F')
    for key in keys:
        np.testing.assert_allclose(read.column(key), 0.1 * np.arange(5))


def test_a_mapping_takes_the_names_of_the_command_line():
    channels = {'force': {'column': 'F', 'unit': 'N'}}
    for key, value, time_and_unit in [
        ('time', 't', ('t', 's')),
        ('time_column', 't', ('t', 's')),
        ('time-column', 0, (0, 's')),
        ('time-column', '0:ms', (0, 'ms')),
        ('time_column', 'Time (s):us', ('Time (s)', 'us')),
    ]:
        mapping = ColumnMapping.from_mapping({'channels': channels, key: value})
        assert (mapping.time, mapping.time_unit) == time_and_unit
    mapping = ColumnMapping.from_mapping({'channels': channels, 'sample-rate': 5.0})
    assert mapping.sample_rate == 5.0
    with pytest.raises(ConfigurationError, match='names `time` and `time_column`'):
        ColumnMapping.from_mapping({'channels': channels, 'time': 0, 'time-column': 0})


def test_the_mapping_file_of_the_docs_is_one():
    page = Path(__file__).parents[2] / 'docs/convert.md'
    example = page.read_text(encoding='utf-8').split('```yaml\n')[1].split('```')[0]
    mapping = ColumnMapping.from_mapping(yaml.safe_load(example))
    assert (mapping.time, mapping.time_unit) == ('t', 'ms')
    assert [spec.scale for spec in mapping.channels] == [-1.0, 1.0]


def two_rates(slow, first=3, step=4, count=400, rate=100.0):
    """A table with a column at a rate and one with a number on every step-th row only."""
    time = 5.0 + np.arange(count) / rate
    force = np.sin(3.0 * time)
    position = np.full(count, np.nan)
    position[first::step] = slow(time[first::step])
    return np.column_stack([time, force, position])


TWO_RATES = (ColumnSpec('force', 1, 'N'), ColumnSpec('displacement', 2, 'm'))


@pytest.mark.parametrize('resample', [False, True])
def test_a_column_with_a_number_on_every_fourth_row_has_a_rate_of_its_own(tmp_path, resample):
    table = two_rates(np.cos)
    table[203, 2] = np.nan  # lost, and at a row where one is to be
    np.save(tmp_path / 'a.npy', table)
    mapping = ColumnMapping(TWO_RATES, time=0, resample=resample, start_ns=10**18)
    made = convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', mapping)
    assert (made.channels, made.rates, made.counts) == (
        ('force', 'displacement'), (100.0, 25.0), (400, 100),
    )  # fmt: skip
    assert (made.sample_rate, made.samples) == (100.0, 400)
    assert made.notes[0] == (
        "'displacement' has a number on one row in 4 only: it is written at 25 Hz"
    )
    channels = read_channels(made.path)
    assert channels['force'].sample_rate == 100.0
    slow = channels['displacement']
    assert (slow.sample_rate, slow.values.size) == (25.0, 100)
    assert slow.start == pytest.approx(0.03, abs=1e-9)
    known = np.arange(100) != 50
    np.testing.assert_allclose(slow.values[known], np.cos(5.0 + slow.time[known]), atol=1e-6)
    if not resample:
        assert np.isnan(slow.values[50])
        assert made.notes[1] == "'displacement': 1 of 100 samples are no numbers"
        assert made.quality is Quality.NOT_FINITE


def test_a_sample_rate_is_that_of_the_rows(tmp_path):
    np.save(tmp_path / 'a.npy', two_rates(np.cos))
    made = convert(
        tmp_path / 'a.npy', tmp_path / 'a.mcap', ColumnMapping(TWO_RATES, sample_rate=200.0)
    )
    assert made.rates == (200.0, 50.0)


def test_blocks_of_two_rates_stand_in_the_order_of_their_times(tmp_path):
    np.save(tmp_path / 'a.npy', two_rates(np.cos))
    made = convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', ColumnMapping(TWO_RATES, time=0))
    with open_recording(made.path) as recording:
        blocks = [b for b in read_streams(recording) if isinstance(b, SampleBlock)]
    received = [b.received_ns for b in blocks if not b.is_end]
    assert received == sorted(received)
    assert sum(b.is_end for b in blocks) == 2


def test_numbers_on_uneven_rows_are_told_and_get_a_rate_by_themselves(tmp_path):
    table = two_rates(np.cos)
    rows = np.cumsum(np.random.default_rng(2).integers(11, 14, 30))
    table[:, 2] = np.nan
    table[rows, 2] = np.cos(table[rows, 0])
    np.save(tmp_path / 'a.npy', table)
    made = convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', ColumnMapping(TWO_RATES, time=0))
    assert made.counts == (400, 400)
    assert len(made.notes) == 1
    assert "'displacement': 370 of 400 samples are no numbers; its numbers" in made.notes[0]
    assert 'by itself with --resample' in made.notes[0]
    alone = ColumnMapping(TWO_RATES[1:], time=0, resample=True)
    made = convert(tmp_path / 'a.npy', tmp_path / 'b.mcap', alone)
    slow = read_channels(made.path)['displacement']
    assert made.sample_rate == pytest.approx(100.0 / 12, rel=1e-5)
    first = table[rows[0], 0]
    assert (
        np.max(
            np.abs(slow.values - np.cos(first + np.arange(slow.values.size) / slow.sample_rate))
        )
        < 0.01
    )


@pytest.mark.parametrize('rows', [range(0, 28, 4), [*range(0, 80, 8), 399], range(400)])
def test_few_or_scattered_numbers_make_no_rate(tmp_path, rows):
    table = two_rates(np.cos)
    table[:, 2] = np.nan
    table[list(rows), 2] = 1.0
    np.save(tmp_path / 'a.npy', table)
    made = convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', ColumnMapping(TWO_RATES, time=0))
    assert made.rates == (100.0, 100.0)


def test_a_column_that_ends_early_is_told_without_another_remedy(tmp_path):
    table = two_rates(np.cos, first=0, step=1)
    table[100:, 2] = np.nan
    np.save(tmp_path / 'a.npy', table)
    made = convert(tmp_path / 'a.npy', tmp_path / 'a.mcap', ColumnMapping(TWO_RATES, time=0))
    assert made.notes == ("'displacement': 300 of 400 samples are no numbers",)


def test_a_decimal_comma_before_a_tab_at_the_end(tmp_path):
    file = tmp_path / 'a.txt'
    file.write_text('\n'.join(f'{k},5\t' for k in range(20)), encoding='utf-8')
    assert read_columns(file).column(0).tolist() == [k + 0.5 for k in range(20)]


LABVIEW = """LabVIEW Measurement\t
Separator\tTab
***End_of_Header***\t
\t
Channels\t2\t\t\t
Samples\t30\t30\t\t
Delta_X\t1.000000E-2\t1.000000E-2\t\t
***End_of_Header***\t\t\t
X_Value\tAcceleration\tLoad\tComment
"""


@pytest.mark.parametrize('comment', ['\tSpecimen 9', '\t7.5', '', '\t'])
def test_text_of_labview_keeps_its_headings_and_its_first_row(tmp_path, comment):
    rows = [f'{k / 100:.6f}\t{k * k}\t{-k}' for k in range(30)]
    rows[0] += comment
    file = tmp_path / 'a.lvm'
    file.write_text(LABVIEW + '\r\n'.join([*rows, '']), encoding='utf-8')
    read = read_columns(file)
    np.testing.assert_allclose(read.column('X_Value'), np.arange(30) / 100)
    np.testing.assert_allclose(read.column('Load'), -np.arange(30))
    assert read.first_row == 10
    assert describe(file)[:3] == [
        "0 'X_Value' (30 rows)", "1 'Acceleration' (30 rows)", "2 'Load' (30 rows)"
    ]  # fmt: skip
    if 'Specimen' in comment:
        told = "text such as 'Specimen 9' in line 10"
        assert describe(file)[3] == f"passed over: 3 'Comment' ({told})"
        with pytest.raises(MissingChannelError, match=told):
            read.column('Comment')


@pytest.mark.parametrize('delimiter', [',', ';'])
@pytest.mark.parametrize('headings', [['state', 't', 'F', 'note'], None])
def test_columns_of_text_beside_numbers_are_passed_over(tmp_path, delimiter, headings):
    point = ',' if delimiter == ';' else '.'
    rows = [
        ['on', f'{k / 10:.1f}'.replace('.', point), str(k), 'begin' if k == 2 else '']
        for k in range(200)
    ]
    file = tmp_path / 'a.csv'
    lines = [*([headings] if headings else []), *rows]
    file.write_text('\n'.join(delimiter.join(line) for line in lines), encoding='utf-8')
    read = read_columns(file)
    np.testing.assert_allclose(read.column(1), np.arange(200) / 10)
    np.testing.assert_allclose(read.column('F' if headings else 2), np.arange(200))
    first = 2 if headings else 1
    assert [line.split(' (')[1] for line in describe(file)[2:]] == [
        f"text such as 'on' in line {first})",
        f"text such as 'begin' in line {first + 2})",
    ]
    assert len(describe(file)) == 4


def test_names_before_numbers_in_a_header_are_no_column_of_text(tmp_path):
    file = tmp_path / 'a.csv'
    header = [f'key {k},{k}' for k in range(60)]
    file.write_text('\n'.join([*header, 'x,F', '0,1', '0.1,2', '0.2,4']), encoding='utf-8')
    read = read_columns(file)
    assert read.names == ('x', 'F')
    assert read.column('F').tolist() == [1.0, 2.0, 4.0]
    assert not read.texts


def test_a_row_with_text_below_the_headings_is_refused_not_lost(tmp_path):
    file = tmp_path / 'a.csv'
    rows = [f'{k},{k}' for k in range(2, 20)]
    file.write_text('\n'.join(['t,F', '0,off', '1,off', *rows]), encoding='utf-8')
    with pytest.raises(RecordingError, match=r"line 2, column 1: 'off' .*skip 3 lines"):
        read_columns(file)
    read = read_columns(file, skip_rows=3)
    assert read.column('t').tolist() == list(range(2, 20))


def test_headings_are_found_above_rows_that_are_skipped(tmp_path):
    file = tmp_path / 'a.csv'
    file.write_text('\n'.join(['t,F', *(f'{k},{k * k}' for k in range(20))]), encoding='utf-8')
    assert read_columns(file, skip_rows=5).column('F').tolist() == [k * k for k in range(4, 20)]


def test_a_list_of_objects_in_json_is_a_table(tmp_path):
    file = tmp_path / 'a.json'
    entries = [
        {'t': 0.0, 'f': 1, 'on': True, 'imu': {'a': [1, 2]}, 'state': 'idle'},
        {'t': 0.1, 'on': False, 'imu': {'a': [3, 4]}, 'state': None},
        {'t': 0.2, 'f': None, 'late': 5},
    ]
    entries[2]['imu'] = {'a': [5, 6]}
    file.write_text(json.dumps(entries), encoding='utf-8')
    read = read_columns(file)
    assert read.names == ('t', 'f', 'on', 'imu.a[0]', 'imu.a[1]', 'late')
    np.testing.assert_array_equal(read.column('f'), [1.0, np.nan, np.nan])
    np.testing.assert_array_equal(read.column('late'), [np.nan, np.nan, 5.0])
    np.testing.assert_array_equal(read.column('on'), [1.0, 0.0, np.nan])
    np.testing.assert_array_equal(read.column('imu.a[1]'), [2.0, 4.0, 6.0])
    assert describe(file)[0] == "0 't' (3 rows)"
    assert describe(file)[-1] == "passed over: state (text such as 'idle')"
    file.write_text(json.dumps({'gain': 16, 'entries': entries}), encoding='utf-8')
    np.testing.assert_array_equal(read_columns(file).column('entries.t'), [0.0, 0.1, 0.2])
    file.write_text(json.dumps([{'a': 'x'}, {'a': 'y'}]), encoding='utf-8')
    with pytest.raises(RecordingError, match=r"no table of numbers: a \(text such as 'x'\)"):
        read_columns(file)


def test_an_array_of_three_dimensions_is_refused_with_what_helps(tmp_path):
    np.save(tmp_path / 'a.npy', np.zeros((3, 4, 5)))
    with pytest.raises(RecordingError, match=r'array\[0\]\) of 4 x 5, or .* reshape'):
        read_columns(tmp_path / 'a.npy')
    np.savez(tmp_path / 'a.npz', blows=np.zeros((3, 4, 5)))
    with pytest.raises(RecordingError, match=r'blows\[0\]\) of 4 x 5'):
        read_columns(tmp_path / 'a.npz')


def test_text_is_gone_where_rows_are_channels(tmp_path):
    file = tmp_path / 'a.csv'
    file.write_text('\n'.join(f'row{k},{k},{2 * k}' for k in range(20)), encoding='utf-8')
    read = read_columns(file, transpose=True)
    assert read.column(3).tolist() == [3.0, 6.0]


@pytest.mark.parametrize('heading', ['', 't,F\n'])
@pytest.mark.parametrize(('odd', 'told'), [(1, 'its first time is'), (3, 'the first 3 of its')])
def test_a_first_time_out_of_step_is_left_out_with_its_row(tmp_path, heading, odd, told):
    times = np.arange(200) / 100.0
    times[:odd] -= 7.0 + np.arange(odd)[::-1] ** 2  # stamps from before the clock was set
    rows = '\n'.join(f'{t:.3f},{k}' for k, t in enumerate(times))
    file = tmp_path / 'a.csv'
    file.write_text(heading + rows, encoding='utf-8')
    spec = (ColumnSpec('force', 'F' if heading else 1, 'N'),)
    lines = odd + bool(heading)
    message = rf"'a\.csv': {told}.* out of step, .* even at 100 Hz: .*--skip-rows {lines} "
    key = 't' if heading else 0
    with pytest.raises(InputError, match=message) as refused:
        convert(file, tmp_path / 'a.mcap', ColumnMapping(spec, time=key))
    assert '--resample' not in str(refused.value)
    made = convert(file, tmp_path / 'a.mcap', ColumnMapping(spec, time=key, skip_rows=lines))
    assert (made.samples, made.sample_rate) == (200 - odd, 100.0)
    np.save(tmp_path / 'a.npy', np.column_stack([times, times]))
    mapping = ColumnMapping((ColumnSpec('force', 1, 'N'),), time=0)
    with pytest.raises(
        InputError, match=r'out of step.* leave .* rows? out$|leave so many rows out$'
    ):
        convert(tmp_path / 'a.npy', tmp_path / 'b.mcap', mapping)


@pytest.mark.parametrize('uneven', [False, True])
def test_a_shorter_run_beside_a_longer_one_ends_where_it_ends(tmp_path, uneven):
    """Two runs side by side, each with its times; the cells below the shorter are empty."""
    rows = ['t1,x1,t2,x2']
    for i in range(40):
        short = f'{i / 100 + 0.003 * uneven * (i % 2)},{i}' if i < 25 else ','
        rows.append(f'{i / 100},{-i},{short}')
    (tmp_path / 'runs.csv').write_text('\n'.join(rows) + '\n')
    mapping = ColumnMapping((ColumnSpec('force', 'x2', 'N'),), time='t2', resample=uneven)
    done = convert(tmp_path / 'runs.csv', tmp_path / 'b.mcap', mapping)
    assert done.counts[0] == pytest.approx(25, abs=1)
    assert done.notes == ('15 rows at the end hold no time and no number: left out',)
    values = read_channels(tmp_path / 'b.mcap')['force'].values
    assert np.isfinite(values).all()
    assert values[-1] == pytest.approx(24.0, abs=0.5)
