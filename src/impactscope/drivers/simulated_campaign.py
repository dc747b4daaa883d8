"""A campaign of the simulated bench whose description conceals effects that its recordings hold.

What ``campaign.yaml`` states is the paper's bench as a user would describe it; the recordings are
of the same bench with further mechanisms, which no file in the folder names. For practice, for
demonstrations and for timing; the examination of the search has a simulator of its own.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from impactscope.errors import ConfigurationError
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.physics.twin.assembly import Effect, implied_effects
from impactscope.physics.twin.bench import (
    PAPER_LAYER,
    BareContact,
    Bench,
    Blow,
    HammerTap,
    PendulumBlow,
    Sensor,
)
from impactscope.physics.twin.measurement import ChannelChain, device_times, read
from impactscope.physics.twin.simulate import simulate_at
from impactscope.recordings import RecordingWriter
from impactscope.records import NANOSECONDS, SampleBlock
from impactscope.version import __version__

__all__ = ['BLOWS', 'TAPS', 'describe_effects', 'parse_effect', 'write_campaign']

START_NS = 1_704_067_200 * NANOSECONDS  # 2024-01-01T00:00:00Z, so that a seed gives one file
NOISE = {
    'force': 0.4,  # N
    'acceleration.plate': 0.08,  # m/s^2
    'acceleration.impactor': 0.08,
    'acceleration.base': 0.08,
}
TAPS = (HammerTap(110.0, 0.0045), HammerTap(190.0, 0.0035))
# distance of the pendulum's mass in m, angle of release in degrees; the last is held out
BLOWS = ((0.0, 8.0), (0.05, 11.0), (0.10, 14.0), (0.15, 9.0), (0.20, 12.0), (0.25, 10.0))
RELEASE_STD = 0.1  # deg
BARE = BareContact(5e8, restitution=0.5)


def describe_effects() -> list[tuple[str, str, str, str]]:
    """Name, parameters with their units, sentence and equation of all that can be concealed."""
    return [
        (
            kind.name,
            ', '.join(
                f'{p.name} {p.unit}{"" if math.isnan(p.default) else f" ({p.default:g})"}'
                for p in kind.parameters
            ),
            kind.sentence,
            kind.equation,
        )
        for kind in all_mechanisms().values()
    ]


def parse_effect(text: str) -> Effect:
    """An effect from ``name``, ``name:parameter=value,...`` or ``name@channel:parameter=value``.

    Raises ConfigurationError for what is not known, missing or out of bounds.
    """
    head, _, tail = text.partition(':')
    name, _, channel = head.partition('@')
    kind = mechanism(name)
    if kind.on_channel and channel not in NOISE:
        raise ConfigurationError(
            f'{text!r}: {name} acts on a channel; write {name}@CHANNEL with one of '
            f'{", ".join(NOISE)}'
        )
    if channel and not kind.on_channel:
        raise ConfigurationError(f'{text!r}: {name} does not act on a channel')
    given: dict[str, float] = {}
    for part in filter(None, tail.split(',')):
        key, _, value = part.partition('=')
        try:
            given[key.strip()] = float(value)
        except ValueError:
            raise ConfigurationError(f'{text!r}: {part!r} is not parameter=number') from None
    return Effect(name, kind.values(given), channel)


def _blocks(
    bench: Bench,
    blow: Blow,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    sample_rate: float,
    duration: float,
) -> list[SampleBlock]:
    struck = isinstance(blow, PendulumBlow)
    there = {'impactor', 'damper' if bench.damper is not None else 'bare'} if struck else set()
    acting = (*implied_effects(bench, blow), *(e for e in effects if e.mechanism.needs <= there))
    contact_time = float(rng.uniform(0.1, 0.15))
    blocks = []
    for name, noise in NOISE.items():
        if name == 'acceleration.impactor' and not struck:
            continue
        own = tuple(e for e in acting if e.channel == name)
        chain = ChannelChain(name, sample_rate, noise, effects=own)
        simulated = simulate_at(
            bench,
            blow,
            device_times(chain, round(duration * sample_rate)),
            mechanisms=tuple(e for e in acting if not e.channel),
            contact_time=contact_time,
        )
        values = read(simulated[name], chain, rng).astype(np.float32)
        blocks.append(SampleBlock(name, chain.unit, sample_rate, START_NS, 0, values))
    return blocks


def _write(path: Path, blocks: Sequence[SampleBlock], seed: int) -> None:
    provenance = {
        'kind': 'simulated',
        'source': "simulated: the paper's bench",
        'seed': str(seed),
        'software': f'impactscope {__version__}',
    }
    with RecordingWriter(
        path, metadata={'provenance': provenance}, flush_interval=0, overwrite=True
    ) as writer:
        for block in blocks:
            writer.write_block(block)


def write_campaign(
    folder: Path,
    effects: Sequence[Effect] = (),
    *,
    layered: bool = True,
    seed: int = 1,
    blows: int = len(BLOWS),
    sample_rate: float = 5000.0,
    duration: float = 1.0,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Two hammer taps and up to six pendulum blows on the vertical bench, with ``campaign.yaml``.

    ``layered``: under the damper layer, else on the bare plate. The last blow is held out.
    Effects that need what a blow does not have (an impactor, a layer) are left out of it.

    Raises ConfigurationError where no blow can show an effect, or for counts, rates and
    durations that make no campaign.
    """
    if not 2 <= blows <= len(BLOWS):
        raise ConfigurationError(f'blows is {blows}; it must be from 2 to {len(BLOWS)}')
    if not (1000.0 <= sample_rate <= 100e3 and 0.3 <= duration <= 10.0):
        raise ConfigurationError(
            f'{sample_rate:g} Hz for {duration:g} s; it must be 1 to 100 kHz for 0.3 to 10 s'
        )
    there = {'impactor', 'damper' if layered else 'bare'}
    for effect in effects:
        if missing := effect.mechanism.needs - there:
            raise ConfigurationError(
                f'{effect.name} needs {", ".join(sorted(missing))}; this bench has it not'
            )
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    layer = PAPER_LAYER if layered else None
    struck = Bench(Sensor(), damper=layer, contact=BARE)
    planned: list[tuple[dict[str, Any], Bench, Blow]] = [
        ({'file': f'tap_{n}.mcap', 'kind': 'tap'}, Bench(damper=None), tap)
        for n, tap in enumerate(TAPS, 1)
    ]
    for n, (distance, angle) in enumerate(BLOWS[:blows], 1):
        released = math.radians(angle + RELEASE_STD * float(rng.standard_normal()))
        entry = {
            'file': f'blow_{n}.mcap',
            'kind': 'pendulum',
            'mass_distance': distance,
            'release_angle_deg': angle,
        }
        if not layered:
            entry['damper'] = False
        if n == blows:
            entry['role'] = 'hold_out'
        planned.append((entry, struck, PendulumBlow(Pendulum(mass_distance=distance), released)))
    for n, (entry, bench, blow) in enumerate(planned):
        made = _blocks(bench, blow, effects, rng, sample_rate, duration)
        _write(folder / str(entry['file']), made, seed)
        if progress is not None:
            progress((n + 1) / len(planned))
    description = _description([entry for entry, _, _ in planned], layered=layered)
    text = yaml.safe_dump(description, sort_keys=False, default_flow_style=None, width=99)
    (folder / 'campaign.yaml').write_text(text, encoding='utf-8')


def _description(recordings: Sequence[dict[str, Any]], *, layered: bool) -> dict[str, Any]:
    pendulum = dataclasses.asdict(Pendulum())
    names = ('rod_mass', 'rod_length', 'contact_distance', 'moving_mass')
    branches = [{'stiffness': b.stiffness, 'damping': b.viscosity} for b in PAPER_LAYER.branches]
    damper = {'parallel_stiffness': PAPER_LAYER.equilibrium_stiffness, 'branches': branches}
    return {
        'version': 1,
        'bench': {'kind': 'impact', 'orientation': Orientation.VERTICAL.value},
        'sensor': {
            'stiffness': {'value': 69000, 'std': 500, 'unit': 'N/m'},
            'moving_mass': None,
            'damping_ratio': None,
        },
        'damper': damper if layered else None,
        'pendulum': {
            **{name: float(pendulum[name]) for name in names},
            'release_angle_std_deg': RELEASE_STD,
        },
        'gain_std': {'force': 0.003, 'acceleration': 0.005},
        'baseline': [
            'linear_sensor',
            'zener_damper' if layered else 'hertz_contact',
            'unilateral_contact',
            'gravity_load',
        ],
        'recordings': list(recordings),
    }
