"""Make a campaign folder of every real machine in the folder of published measurements.

    python scripts/real_machines.py DATA_FOLDER OUTPUT

Each campaign states the linear model alone; `impactscope explain OUTPUT/NAME` says what that
leaves out. What is not in DATA_FOLDER is passed over. The data of `emps` and `silverbox` carry no
licence: campaigns made of them must not be published.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from impactscope.errors import ImpactscopeError
from impactscope.recordings import ColumnMapping, ColumnSpec, convert
from impactscope.recordings.column_files import read_columns

START_NS = 1_704_067_200_000_000_000  # 2024-01-01T00:00:00Z, by convention
SILVERBOX_RATE = 1e7 / 2**14  # Hz


@dataclass(frozen=True, slots=True)
class Recording:
    """A source below the data folder, and what the campaign says of its parts."""

    source: str
    name: str
    mapping: ColumnMapping
    parts: tuple[Mapping[str, Any], ...] = field(default_factory=lambda: ({},))


@dataclass(frozen=True, slots=True)
class Machine:
    """A campaign: its description without recordings, and the recordings."""

    name: str
    description: Mapping[str, Any]
    recordings: tuple[Recording, ...]


def _mapping(
    channels: tuple[ColumnSpec, ...], title: str, origin: str, licence: str, **options: Any
) -> ColumnMapping:
    provenance = {
        'title': title,
        'kind': 'measured',
        'origin': origin,
        'licence': licence,
        'stamps': 'begin at 2024-01-01T00:00:00Z by convention',
    }
    return ColumnMapping(channels, start_ns=START_NS, provenance=provenance, **options)


HELD_OUT = {'role': 'hold_out'}


def silverbox() -> Machine:
    """Electronic oscillator with a cubic spring; voltages stand for force and position."""
    rate = SILVERBOX_RATE
    mapping = _mapping(
        (ColumnSpec('voltage.input', 'V1', 'V'), ColumnSpec('voltage.output', 'V2', 'V')),
        'Silverbox: arrow and multisine',
        'Wigren and Schoukens, Three free data sets, ECC 2013',
        'not stated; not to be published',
        sample_rate=rate,
    )
    first, last = 40_650, 127_400
    middle = first + 16_384
    parts = (
        {'start': first / rate, 'end': middle / rate},
        {'start': middle / rate, 'end': last / rate, **HELD_OUT},
        {'start': 100 / rate, 'end': 40_575 / rate, **HELD_OUT},
    )
    return Machine(
        'silverbox',
        {
            'bench': {'kind': 'driven', 'input': 'voltage.input', 'outputs': ['voltage.output']},
            'model': {'modes': 1},
            'baseline': ['linear_sensor'],
        },
        (Recording('silverbox/SNLS80mV.mat', 'silverbox', mapping, parts),),
    )


def emps(data: Path) -> Machine:
    """Motor and ball screw in closed loop; the drive's force is its voltage times a gain."""
    recordings = []
    for suffix, part in (('', {}), ('_PULSES', HELD_OUT)):
        source = f'emps/DATA_EMPS{suffix}.mat'
        gain = float(read_columns(data / source).column('gtau')[0])  # N/V
        mapping = _mapping(
            (
                ColumnSpec('force.drive', 'vir', 'N', scale=gain),
                ColumnSpec('displacement.axis', 'qm', 'm'),
                ColumnSpec('displacement.reference', 'qg', 'm'),
            ),
            'EMPS: electro-mechanical positioning system',
            'Janot, Gautier and Brunot, Nonlinear System Identification Benchmarks 2019',
            'not stated; not to be published',
            sample_rate=1000.0,
        )
        recordings.append(Recording(source, f'axis{suffix.lower()}', mapping, (part,)))
    return Machine(
        'emps',
        {
            'bench': {
                'kind': 'driven',
                'input': 'force.drive',
                'outputs': ['displacement.axis'],
                'reference': 'displacement.reference',
            },
            'model': {'restoring': 'none'},
            'baseline': ['linear_mass_damper'],
        },
        tuple(recordings),
    )


def pendulum() -> Machine:
    """A pendulum that swings freely; the arm that let it go moves at first."""
    recordings = []
    for number, begin, part in ((3, 0.5, {}), (1, 1.8, HELD_OUT), (2, 1.8, HELD_OUT)):
        mapping = _mapping(
            (ColumnSpec('displacement.angle', 0, 'deg'),),
            f'Free swing {number} of a pendulum',
            'https://github.com/jensen-benard/rotary-inverted-pendulum (commit 1f3bb80)',
            'MIT',
            sample_rate=1000.0,
            skip_rows=2,
        )
        source = f'pendulum_free_swing/pendulum_free_swing_data_{number:02d}.txt'
        recordings.append(
            Recording(source, f'swing_{number}', mapping, ({'start': begin, **part},))
        )
    return Machine(
        'pendulum',
        {
            'bench': {'kind': 'driven', 'input': 'none', 'outputs': ['displacement.angle']},
            'baseline': ['linear_sensor'],
        },
        tuple(recordings),
    )


def friction_damper() -> Machine:
    """A rotary friction damper under a prescribed sine."""
    recordings = []
    for name, part in (
        ('ds2_1Hz36lbtension1amplitude', {}),
        ('ds2_0.5Hz36lbtension1amplitude', HELD_OUT),
        ('ds2_1Hz36lbtension0.5amplitude', HELD_OUT),
    ):
        mapping = _mapping(
            (
                ColumnSpec('displacement.piston', 1, 'inch'),
                ColumnSpec('force.damper', 2, 'kip'),
            ),
            f'Friction damper with backlash, {name}',
            'https://github.com/ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash',
            'CC BY-SA 4.0; Coble, Huggins, Cao, Ricles, Downey 2022',
            time=0,
        )
        source = f'friction_damper/{name}.json'
        recordings.append(Recording(source, name.replace('.', '_'), mapping, (part,)))
    return Machine(
        'friction_damper',
        {
            'bench': {
                'kind': 'prescribed_motion',
                'motion': 'displacement.piston',
                'output': 'force.damper',
            },
            'baseline': ['linear_spring_damper'],
        },
        tuple(recordings),
    )


def modal_hammer() -> Machine:
    """Blows of an instrumented hammer on a linear structure with many modes."""
    recordings = []
    for number in range(1, 6):
        mapping = _mapping(
            (
                ColumnSpec('force.hammer', 1, 'N'),
                ColumnSpec('acceleration.structure', 2, 'm/s^2'),
            ),
            f'Instrumented hammer blow {number} of 5 on a structure',
            'https://github.com/ladisk/pyFRF (data/, commit e3ce4ef)',
            'MIT',
            time=0,
            transpose=True,
        )
        source = f'modal_hammer/measurements_{number}.npy'
        part = {} if number <= 3 else HELD_OUT
        recordings.append(Recording(source, f'blow_{number}', mapping, (part,)))
    return Machine(
        'modal_hammer',
        {
            'bench': {
                'kind': 'driven',
                'input': 'force.hammer',
                'outputs': ['acceleration.structure'],
            },
            'model': {'modes': 1},
            'baseline': ['linear_sensor'],
        },
        tuple(recordings),
    )


MACHINES = {
    'silverbox': lambda _data: silverbox(),
    'emps': emps,
    'pendulum': lambda _data: pendulum(),
    'friction_damper': lambda _data: friction_damper(),
    'modal_hammer': lambda _data: modal_hammer(),
}
FOLDERS = {'pendulum': 'pendulum_free_swing'}


def write(machine: Machine, data: Path, output: Path) -> Path:
    """Write one campaign folder; raises ImpactscopeError where a source cannot be converted."""
    folder = output / machine.name
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for recording in machine.recordings:
        file = f'{recording.name}.mcap'
        convert(
            data / recording.source,
            folder / file,
            recording.mapping,
            time_tolerance=0.5,
            overwrite=True,
        )
        for part in recording.parts:
            entry = {'file': file, **part}
            if machine.name == 'modal_hammer':
                entry['kind'] = 'driven'
            entries.append(entry)
    text = yaml.safe_dump(
        {'version': 1, **machine.description, 'recordings': entries}, sort_keys=False
    )
    (folder / 'campaign.yaml').write_text(text, encoding='utf-8')
    return folder


def make(data: Path, output: Path, names: tuple[str, ...] = tuple(MACHINES)) -> dict[str, Path]:
    """Campaign folders of the machines whose data are there, by name."""
    made = {}
    for name in names:
        if (data / FOLDERS.get(name, name)).is_dir():
            made[name] = write(MACHINES[name](data), data, output)
    return made


def main(argv: list[str] | None = None) -> int:
    """Make all campaigns; 1 where a source cannot be converted or nothing is there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('data', type=Path)
    parser.add_argument('output', type=Path)
    options = parser.parse_args(argv)
    try:
        made = make(options.data, options.output)
    except ImpactscopeError as error:
        sys.stderr.write(f'{error}\n')
        return 1
    for name, folder in made.items():
        sys.stdout.write(f'{name}: {folder}\n')
    if not made:
        sys.stderr.write(f'{options.data}: none of {", ".join(MACHINES)} is there\n')
    return 0 if made else 1


if __name__ == '__main__':
    raise SystemExit(main())
