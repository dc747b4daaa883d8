"""A campaign from its description, the parsed ``campaign.yaml``: every entry is checked.

SI units; a quantity may state another unit of its kind and is converted.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from impactscope.discrepancy.campaign import (
    DEFAULT_ANGLE_STD_DEG,
    DEFAULT_STD,
    BaselineItem,
    Campaign,
    CampaignKind,
    CampaignRecording,
    Quantity,
    Role,
)
from impactscope.errors import ConfigurationError
from impactscope.physics.pendulum import STANDARD_GRAVITY, Orientation

__all__ = ['parse_campaign', 'unit_factor']

CAMPAIGN_VERSION = 1
# A layer of which nothing is stated: one branch beside a spring, both to be estimated.
UNKNOWN_LAYER = {'parallel_stiffness': None, 'branches': [{'stiffness': None, 'damping': None}]}
BLOW_KINDS = ('tap', 'pendulum', 'robot', 'drop')
_ON_EARTH = (9.75, 9.85)  # m/s^2, from high mountains near the equator to the poles
DESCRIPTIONS = ('name', 'title', 'description', 'notes', 'date', 'model', 'serial')  # not read

# Of what a campaign states, not of channels: there g is gravity and stiffness no channel.
_UNITS = {  # unit: (of which quantity, factor to it)
    'N/m': ('N/m', 1.0),
    'kN/m': ('N/m', 1e3),
    'N/mm': ('N/m', 1e3),
    'N s/m': ('N s/m', 1.0),
    'Ns/m': ('N s/m', 1.0),
    'N*s/m': ('N s/m', 1.0),
    'N·s/m': ('N s/m', 1.0),
    'kg/s': ('N s/m', 1.0),
    'N s/mm': ('N s/m', 1e3),
    'kg': ('kg', 1.0),
    'g': ('kg', 1e-3),
    'm': ('m', 1.0),
    'cm': ('m', 1e-2),
    'mm': ('m', 1e-3),
    'm/s': ('m/s', 1.0),
    'mm/s': ('m/s', 1e-3),
    'deg': ('deg', 1.0),
    'rad': ('deg', math.degrees(1.0)),
    '1': ('1', 1.0),
    '%': ('1', 1e-2),
}
_UNIT_OF = {
    'stiffness': 'N/m',
    'parallel_stiffness': 'N/m',
    'damping': 'N s/m',
    'moving_mass': 'kg',
    'rod_mass': 'kg',
    'effective_mass': 'kg',
    'damping_ratio': '1',
    'rod_length': 'm',
    'contact_distance': 'm',
    'mass_distance': 'm',
    'drop_height': 'm',
    'speed': 'm/s',
    'release_angle_deg': 'deg',
}


def parse_campaign(data: Any, name: str = 'campaign') -> Campaign:
    """A campaign from the parsed ``campaign.yaml``, without samples.

    Raises ConfigurationError for what is wrong or of the wrong type; what is merely absent
    leaves a note where an answer is still possible without it.
    """
    top = _Mapping(data, name)
    version = top.take('version')
    if version != CAMPAIGN_VERSION:
        raise ConfigurationError(
            f'{name}: version is {version!r}; this software reads version {CAMPAIGN_VERSION}'
        )
    bench = top.mapping('bench')
    kind_text = bench.data.get('kind')
    try:
        kind = CampaignKind(kind_text)
    except ValueError:
        known = ', '.join(k.value for k in CampaignKind)
        raise ConfigurationError(
            f'{name}: bench.kind is {kind_text!r}; it must be one of {known}'
        ) from None
    notes: list[str] = []
    _check_roles(bench, kind)
    orientation = _orientation(bench, kind, notes)
    sensor = _quantities(top.mapping('sensor', optional=True))
    damper = _damper(top.take('damper', None), name)
    pendulum_map = top.mapping('pendulum', optional=True)
    angle_std = _positive(
        pendulum_map.take('release_angle_std_deg', DEFAULT_ANGLE_STD_DEG),
        f'{name}: pendulum.release_angle_std_deg',
    )
    pendulum = _quantities(pendulum_map)
    baseline = _baseline(top.take('baseline', []), name)
    recordings = _recordings(top.take('recordings', None), kind, name, notes)
    if kind is CampaignKind.IMPACT:
        if damper is None and any(item.name == 'zener_damper' for item in baseline):
            damper = _damper(UNKNOWN_LAYER, name)
            notes.append(
                'No damper layer is described: its stiffnesses and its damping are estimated.'
            )
        _note_what_is_missing(recordings, pendulum, notes)
        if damper is None and any(e.get('damper') is True for e in top.data['recordings']):
            notes.append('Blows are marked as on a damper, but no damper is described.')
    result = Campaign(
        name=name,
        kind=kind,
        recordings=recordings,
        baseline=baseline,
        orientation=orientation,
        gravity=_gravity(bench),
        sensor=sensor,
        damper=damper,
        pendulum=pendulum,
        release_angle_std_deg=angle_std,
        gain_std=_floats(top.mapping('gain_std', optional=True)),
        noise_std=_floats(top.mapping('noise_std', optional=True)),
        bench=dict(bench.data),
        model=dict(top.mapping('model', optional=True).data),
        notes=tuple(notes),
    )
    top.refuse_rest()
    return result


# --- parts of the file ---------------------------------------------------------------------------


class _Mapping:
    """A mapping of the file that remembers which of its entries were read."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, Mapping):
            raise ConfigurationError(f'{where} must be a mapping, not {type(data).__name__}')
        self.data: Mapping[str, Any] = data
        self.where = where
        self._read: set[str] = set()

    def take(self, key: str, *default: Any) -> Any:
        self._read.add(key)
        if key not in self.data and not default:
            raise ConfigurationError(f'{self.where}: {key!r} is missing')
        return self.data.get(key, *default)

    def mapping(self, key: str, *, optional: bool = False) -> _Mapping:
        value = self.take(key, None) if optional else self.take(key)
        return _Mapping({} if optional and value is None else value, f'{self.where}: {key}')

    def refuse_rest(self) -> None:
        unread = set(self.data) - self._read - set(DESCRIPTIONS)
        rest = sorted(str(key) for key in unread)
        if rest:
            raise ConfigurationError(f'{self.where}: {rest[0]!r} is not known here')


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigurationError(f'{where} is {value!r}; it must be a finite number')
    return float(value)


def _positive(value: Any, where: str) -> float:
    number = _number(value, where)
    if number < 0:
        raise ConfigurationError(f'{where} is {number!r}; it must not be negative')
    return number


def _quantity(value: Any, where: str) -> Quantity:
    if value is None:
        return Quantity()
    if isinstance(value, Mapping):
        item = _Mapping(value, where)
        factor = unit_factor(item.take('unit', None), where)
        given = item.take('value')
        std = _positive(item.take('std', 0.0), f'{where}.std')
        item.refuse_rest()
        if given is None:
            return Quantity()
        return Quantity(factor * _number(given, f'{where}.value'), factor * std)
    return Quantity(_number(value, where))


def unit_factor(unit: Any, where: str) -> float:
    """Factor from a stated unit (None: SI) to that of the quantity which ``where`` ends with.

    Raises ConfigurationError for a unit that is not known or of another kind.
    """
    wanted = _UNIT_OF.get(where.rsplit('.', 1)[-1], '')
    if unit is None or not wanted:
        return 1.0
    of, factor = _UNITS.get(str(unit).strip(), ('', 1.0))
    if of != wanted:
        known = ', '.join(name for name, (of, _) in _UNITS.items() if of == wanted)
        raise ConfigurationError(f'{where}.unit is {unit!r}; it must be one of {known}')
    return factor


def _quantities(mapping: _Mapping) -> dict[str, Quantity]:
    found = {}
    for key, value in mapping.data.items():
        if not str(key).endswith('_std_deg') and key not in DESCRIPTIONS:
            found[str(key)] = _quantity(value, f'{mapping.where}.{key}')
    return found


def _floats(mapping: _Mapping) -> dict[str, float]:
    return {str(k): _positive(v, f'{mapping.where}.{k}') for k, v in mapping.data.items()}


def _check_roles(bench: _Mapping, kind: CampaignKind) -> None:
    needed = {
        CampaignKind.DRIVEN: ('input', 'outputs'),
        CampaignKind.PRESCRIBED_MOTION: ('motion', 'output'),
        CampaignKind.CHAIN: ('input', 'output'),
        CampaignKind.IMPACT: (),
    }[kind]
    for key in needed:
        value = bench.take(key)
        names = value if key == 'outputs' else [value]
        if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
            raise ConfigurationError(
                f'{bench.where}.{key} is {value!r}; it must name '
                f'{"channels" if key == "outputs" else "a channel"}'
            )


def _gravity(bench: _Mapping) -> float:
    """The acceleration of free fall of the site; on the ground it is between these everywhere."""
    where = f'{bench.where}.gravity'
    value = _number(bench.data.get('gravity', STANDARD_GRAVITY), where)
    low, high = _ON_EARTH
    if not low < value < high:
        raise ConfigurationError(
            f'{where} is {value:g}; it must be in m/s^2, between {low:g} and {high:g}'
        )
    return value


def _orientation(bench: _Mapping, kind: CampaignKind, notes: list[str]) -> Orientation | None:
    value = bench.data.get('orientation')
    if value is None:
        if kind is CampaignKind.IMPACT:
            notes.append(
                'The bench states no orientation: vertical is presumed, so that the weight of '
                'the pendulum rests on the plate.'
            )
        return None
    try:
        return Orientation(value)
    except ValueError:
        raise ConfigurationError(
            f"{bench.where}.orientation is {value!r}; it must be 'vertical' or 'horizontal'"
        ) from None


def _damper(data: Any, name: str) -> Mapping[str, Any] | None:
    if data is None:
        return None
    damper = _Mapping(data, f'{name}: damper')
    where = damper.where
    parallel = _quantity(damper.take('parallel_stiffness'), f'{where}.parallel_stiffness')
    branches = []
    listed = damper.take('branches', [])
    if not isinstance(listed, list):
        raise ConfigurationError(f'{where}.branches must be a list')
    for i, entry in enumerate(listed):
        branch = _Mapping(entry, f'{where}.branches[{i}]')
        branches.append(
            {
                key: _quantity(branch.take(key), f'{branch.where}.{key}')
                for key in ('stiffness', 'damping')
            }
        )
        branch.refuse_rest()
    damper.refuse_rest()
    return {'parallel_stiffness': parallel, 'branches': branches}


def _baseline(data: Any, name: str) -> tuple[BaselineItem, ...]:
    if not isinstance(data, list):
        raise ConfigurationError(f'{name}: baseline must be a list of names')
    items = []
    for entry in data:
        if isinstance(entry, str):
            items.append(BaselineItem(entry))
            continue
        mapping = _Mapping(entry, f'{name}: baseline entry')
        item = mapping.take('name')
        values = {
            key: _number(value, f'{name}: baseline {item}.{key}')
            for key, value in mapping.mapping('values', optional=True).data.items()
        }
        items.append(BaselineItem(str(item), values, str(mapping.take('channel', ''))))
        mapping.refuse_rest()
    return tuple(items)


_RECORDING_NUMBERS = (
    'mass_distance',
    'release_angle_deg',
    'effective_mass',
    'speed',
    'drop_height',
    'start',
    'end',
)


def _recordings(
    data: Any, kind: CampaignKind, name: str, notes: list[str]
) -> tuple[CampaignRecording, ...]:
    if not isinstance(data, list) or not data:
        raise ConfigurationError(f'{name}: recordings must be a list of at least one recording')
    found = []
    for i, entry in enumerate(data):
        item = _Mapping(entry, f'{name}: recordings[{i}]')
        file = item.take('file')
        if not isinstance(file, str) or not file:
            raise ConfigurationError(f'{item.where}.file is {file!r}; it must be a file name')
        blow = item.take('kind', '')
        if kind is CampaignKind.IMPACT and blow not in BLOW_KINDS:
            raise ConfigurationError(
                f'{item.where}.kind is {blow!r}; it must be one of {", ".join(BLOW_KINDS)}'
            )
        role = item.take('role', 'fit')
        if role not in ('fit', 'hold_out'):
            raise ConfigurationError(
                f"{item.where}.role is {role!r}; it must be 'fit' or 'hold_out'"
            )
        quantities = {
            key: _quantity(item.take(key, None), f'{item.where}.{key}')
            for key in _RECORDING_NUMBERS
        }
        numbers = {key: q.value for key, q in quantities.items() if q.known}
        if numbers.get('start', -math.inf) >= numbers.get('end', math.inf):
            raise ConfigurationError(
                f'{item.where} ends at {numbers["end"]:g} s, before it starts at '
                f'{numbers["start"]:g} s'
            )
        std = {key: quantities[key].std for key in DEFAULT_STD if quantities[key].std > 0}
        damper = item.take('damper', True)
        if not isinstance(damper, bool):
            raise ConfigurationError(
                f'{item.where}.damper is {damper!r}; it must be true or false'
            )
        item.refuse_rest()
        recording = CampaignRecording(file, str(blow), Role(role), damper=damper, std=std)
        found.append(dataclasses.replace(recording, **numbers))  # type: ignore[arg-type]
    names = [r.file for r in found]
    double = next((n for n in names if names.count(n) > 1), None)
    if double is not None and kind is CampaignKind.IMPACT:
        raise ConfigurationError(f'{name}: recording {double!r} is listed more than once')
    if all(r.role is Role.HOLD_OUT for r in found):
        raise ConfigurationError(f'{name}: every recording is held out; none is left to fit')
    if not any(r.role is Role.HOLD_OUT for r in found):
        notes.append(
            'No recording is held out: predictions of recordings that were not fitted are not '
            'available.'
        )
    return tuple(found)


def _note_what_is_missing(
    recordings: Sequence[CampaignRecording],
    pendulum: Mapping[str, Quantity],
    notes: list[str],
) -> None:
    swings = [r for r in recordings if r.kind == 'pendulum']
    if swings and not pendulum:
        notes.append(
            "The pendulum's geometry is not stated: its effective mass and speed are estimated "
            'for each blow, and effects on speed and mass cannot be told.'
        )
    for recording in swings:
        for value, what in (
            (recording.release_angle_deg, 'release angle'),
            (recording.mass_distance, 'mass distance'),
        ):
            if pendulum and not math.isfinite(value):
                notes.append(f'{recording.file}: the {what} is not stated and is estimated.')
    if len(recordings) == 1:
        notes.append(
            'One recording only: what changes with strength or conditions cannot be told.'
        )
