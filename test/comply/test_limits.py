import copy
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.comply.limits import LimitSet
from impactscope.errors import ConfigurationError


def typed_twice():
    """The same figures, typed by someone else from the tables."""
    areas, regions = {}, {}
    for line in (Path(__file__).parent / 'limits_check.csv').read_text().splitlines():
        if line.startswith('#') or not line.strip():
            continue
        cells = line.split(',')
        if len(cells) == 2:
            areas[int(cells[0])] = float(cells[1])
        else:
            regions[cells[0]] = [float(cell) if cell else None for cell in cells[1:]]
    return areas, regions


def test_the_shipped_set_agrees_with_the_figures_typed_independently(iso):
    areas, regions = typed_twice()
    assert (len(areas), len(regions)) == (29, 12)
    assert {a.id: a.quasi_static_pressure / 1e4 for a in iso.areas} == pytest.approx(areas)
    assert set(iso.regions) == set(regions)
    for name, (force, factor, stiffness, mass) in regions.items():
        limits = iso.limits_for(name)
        assert limits.quasi_static_force == force
        assert limits.multiplier == factor
        assert limits.transient_force == (None if factor is None else factor * force)
        assert limits.stiffness == pytest.approx(stiffness * 1e3)
        assert limits.mass == mass


def test_pressure_follows_the_region(iso):
    sternum = next(area for area in iso.areas if area.name == 'sternum')
    assert sternum.transient_pressure == pytest.approx(2.4e6)  # 240 N/cm2
    assert all(area.transient_pressure is None for area in iso.areas_of('face'))
    assert [area.id for area in iso.areas_of('hands_fingers')] == list(range(17, 26))


def test_only_head_and_face_are_forbidden(iso):
    forbidden = {name for name, region in iso.regions.items() if not region.contact_permitted}
    assert forbidden == {'skull_forehead', 'face'}
    assert iso.limits_for('face').multiplier is None


def test_every_value_has_a_source_and_the_label_is_versioned(iso):
    assert iso.label == 'iso_ts_15066_2016 2026-11-20'
    assert 'purchased copy' in iso.description
    for region in iso.regions.values():
        assert all(region.sources[value] for value in ('force', 'stiffness', 'mass', 'energy'))
    assert len(iso.disagreements) == 6


@pytest.mark.parametrize('region', ['hand', '', 'Hands_fingers', '<script>'])
def test_an_unknown_region_is_refused_with_the_known_ones(iso, region):
    with pytest.raises(ConfigurationError, match=r'it has skull_forehead, .*lower_legs'):
        iso.limits_for(region)
    with pytest.raises(ConfigurationError):
        iso.areas_of(region)


def changed(mapping, path, value):
    mapping = copy.deepcopy(mapping)
    *parents, last = path
    place = mapping
    for key in parents:
        place = place[key]
    if value is KeyError:
        del place[last]
    else:
        place[last] = value
    return mapping


HAND = ('regions', 'hands_fingers')


@pytest.mark.parametrize(
    ('path', 'value', 'message'),
    [
        (('name',), KeyError, 'name is missing'),
        (('version',), '', 'version'),
        (('regions',), {}, 'regions is empty'),
        (('regions',), [1], 'a mapping'),
        (('colour',), 'red', "unknown 'colour'"),
        (('units', 'force'), 'kgf', "force is in 'kgf'; known are N"),
        (('units', 'pressure'), KeyError, 'pressure is missing'),
        ((*HAND, 'quasi_static_force'), -140, '-140'),
        ((*HAND, 'quasi_static_force'), True, 'True'),
        ((*HAND, 'quasi_static_force'), '140', "'140'"),
        ((*HAND, 'quasi_static_force'), math.nan, 'nan'),
        ((*HAND, 'stiffness'), math.inf, 'inf'),
        ((*HAND, 'mass'), 0, 'mass is 0'),
        ((*HAND, 'transient_multiplier'), KeyError, 'write null where contact is not permitted'),
        ((*HAND, 'transient_multiplier'), 0.5, 'below the quasi-static'),
        ((*HAND, 'pressure_multiplier'), 0.9, 'pressure_multiplier is 0.9'),
        ((*HAND, 'transient_force'), 300, '300'),
        ((*HAND, 'transient_force'), None, 'None'),
        ((*HAND, 'transient_multipler'), 2, "unknown 'transient_multipler'"),
        ((*HAND, 'sources', 'force'), ['A', 'Z'], "'Z'"),
        ((*HAND, 'sources', 'force'), [], 'a list is needed'),
        ((*HAND, 'sources', 'colour'), ['A'], "unknown 'colour'"),
        (('regions', 'face', 'pressure_multiplier'), 2, 'not permitted'),
        (('areas', 0, 'region'), 'nose', "'nose'"),
        (('areas', 0, 'id'), 2, 'occurs twice'),
        (('areas', 0, 'id'), 1.5, 'whole number'),
        (('areas', 0, 'quasi_static_pressure'), -1, '-1'),
        (('areas',), {'a': 1}, 'a list is needed'),
    ],
)
def test_a_damaged_set_is_refused_with_the_offending_value(iso_mapping, path, value, message):
    with pytest.raises(ConfigurationError, match=message):
        LimitSet.from_mapping(changed(iso_mapping, path, value))


@pytest.mark.parametrize('mapping', [None, [], 'limits', 3])
def test_something_else_than_a_mapping_is_refused(mapping):
    with pytest.raises(ConfigurationError, match='a mapping'):
        LimitSet.from_mapping(mapping)


def test_a_set_without_a_common_multiplier_states_its_transient_forces(iso_mapping):
    mapping = changed(iso_mapping, (*HAND, 'transient_multiplier'), KeyError)
    mapping['regions']['hands_fingers']['transient_force'] = 180
    limits = LimitSet.from_mapping(mapping).limits_for('hands_fingers')
    assert limits.transient_force == 180
    assert limits.multiplier == pytest.approx(180 / 140)


def test_units_are_converted(iso_mapping):
    mapping = copy.deepcopy(iso_mapping)
    mapping['units'] |= {'pressure': 'MPa', 'stiffness': 'N/m'}
    limits = LimitSet.from_mapping(mapping)
    assert limits.limits_for('hands_fingers').stiffness == 75
    assert limits.areas[0].quasi_static_pressure == pytest.approx(130e6)


@given(
    force=st.floats(1e-3, 1e5), factor=st.floats(1, 10), key=st.text(max_size=12), data=st.data()
)
def test_the_transient_limit_is_the_multiple(iso_mapping, force, factor, key, data):
    mapping = changed(iso_mapping, (*HAND, 'quasi_static_force'), force)
    mapping = changed(mapping, (*HAND, 'transient_multiplier'), factor)
    limits = LimitSet.from_mapping(mapping).limits_for('hands_fingers')
    assert limits.transient_force == pytest.approx(force * factor)
    if key not in mapping:
        mapping[key] = data.draw(st.none() | st.integers())
        with pytest.raises(ConfigurationError, match='unknown'):
            LimitSet.from_mapping(mapping)
