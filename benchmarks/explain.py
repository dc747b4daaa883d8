"""How long eight recordings take: campaigns made by the twin, written, read and explained.

Two taps and six blows, one of them held out, on the bench with its damper layer and on the bare
plate; as the simulation has it, and with an effect that the campaign does not tell. The folder is
a temporary one with recordings and ``campaign.yaml``, as a user has it. A first, small campaign
compiles and is not counted.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from impactscope.campaign_files import explain_folder
from impactscope.discrepancy.answer import Answer
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
from impactscope.records import SampleBlock

RATE, DURATION, START_NS = 5000.0, 1.0, 1_700_000_000_000_000_000
NOISE = {
    'force': 0.4,
    'acceleration.plate': 0.08,
    'acceleration.impactor': 0.08,
    'acceleration.base': 0.08,
}
TAPS = (HammerTap(110.0, 0.0045), HammerTap(190.0, 0.0035))
BLOWS = ((0.0, 8.0), (0.05, 11.0), (0.10, 14.0), (0.15, 9.0), (0.20, 12.0), (0.25, 10.0))
EFFECTS: dict[str, tuple[Effect, ...]] = {
    'nothing': (),
    'coulomb_friction': (Effect('coulomb_friction', {'force': 0.3}),),
    'hardening_spring + zero_drift': (
        Effect('hardening_spring', {'cubic': 3e8}),
        Effect('zero_drift', {'rate': 0.3}, 'force'),
    ),
}
COUNTED = {True: tuple(EFFECTS), False: ('nothing', 'coulomb_friction')}


def samples(
    bench: Bench, blow: Blow, effects: Sequence[Effect], rng: np.random.Generator
) -> list[SampleBlock]:
    """One recording: a block of samples for each channel."""
    struck = isinstance(blow, PendulumBlow)
    there = {'impactor', 'damper' if bench.damper is not None else 'bare'} if struck else set()
    acting = (*implied_effects(bench, blow), *(e for e in effects if e.mechanism.needs <= there))
    contact_time = float(rng.uniform(0.1, 0.15))
    blocks = []
    for name, noise in NOISE.items():
        if name == 'acceleration.impactor' and not struck:
            continue
        own = tuple(e for e in acting if e.channel == name)
        chain = ChannelChain(name, RATE, noise, effects=own)
        simulated = simulate_at(
            bench,
            blow,
            device_times(chain, round(DURATION * RATE)),
            mechanisms=tuple(e for e in acting if not e.channel),
            contact_time=contact_time,
        )
        values = read(simulated[name], chain, rng).astype(np.float32)
        blocks.append(SampleBlock(name, chain.unit, RATE, START_NS, 0, values))
    return blocks


def make_campaign(
    folder: Path, effects: Sequence[Effect], *, layered: bool, seed: int, count: int
) -> None:
    """Recordings and ``campaign.yaml`` in a folder; ``count``: blows beside the taps."""
    rng = np.random.default_rng(seed)
    recordings: list[dict[str, Any]] = []
    for n, tap in enumerate(TAPS):
        recordings.append({'file': f'tap{n}.mcap', 'kind': 'tap'})
        write(folder / f'tap{n}.mcap', samples(Bench(damper=None), tap, effects, rng))
    layer = PAPER_LAYER if layered else None
    bench = Bench(Sensor(), damper=layer, contact=BareContact(5e8, restitution=0.5))
    for n, (distance, angle) in enumerate(BLOWS[:count]):
        released = math.radians(angle + 0.1 * float(rng.standard_normal()))
        blow = PendulumBlow(Pendulum(mass_distance=distance), released)
        role = 'hold_out' if n == count - 1 else 'fit'
        entry = {'file': f'hit{n}.mcap', 'kind': 'pendulum', 'role': role, 'damper': layered}
        entry |= {'mass_distance': distance, 'release_angle_deg': angle}
        recordings.append(entry)
        write(folder / f'hit{n}.mcap', samples(bench, blow, effects, rng))
    pendulum = dataclasses.asdict(Pendulum())
    names = ('rod_mass', 'rod_length', 'contact_distance', 'moving_mass')
    known = {name: float(pendulum[name]) for name in names}
    branches = [{'stiffness': b.stiffness, 'damping': b.viscosity} for b in PAPER_LAYER.branches]
    damper = {'parallel_stiffness': PAPER_LAYER.equilibrium_stiffness, 'branches': branches}
    description = {
        'version': 1,
        'bench': {'kind': 'impact', 'orientation': Orientation.VERTICAL.value},
        'sensor': {'stiffness': {'value': 69000, 'std': 500}, 'moving_mass': None},
        'damper': damper if layered else None,
        'pendulum': {**known, 'release_angle_std_deg': 0.1},
        'gain_std': {'force': 0.003, 'acceleration': 0.005},
        'baseline': [
            'linear_sensor',
            'zener_damper' if layered else 'hertz_contact',
            'unilateral_contact',
            'gravity_load',
        ],
        'recordings': recordings,
    }
    (folder / 'campaign.yaml').write_text(yaml.safe_dump(description), encoding='utf-8')


def write(path: Path, blocks: Sequence[SampleBlock]) -> None:
    """One recording as MCAP."""
    with RecordingWriter(path, flush_interval=0) as writer:
        for block in blocks:
            writer.write_block(block)


def explained(
    effects: Sequence[Effect], *, layered: bool, seed: int, count: int
) -> tuple[float, Answer]:
    """Seconds from the folder to the answer, and the answer."""
    with tempfile.TemporaryDirectory() as folder:
        make_campaign(Path(folder), effects, layered=layered, seed=seed, count=count)
        started = time.perf_counter()
        answer = explain_folder(folder)
        return time.perf_counter() - started, answer


def main(argv: list[str] | None = None) -> int:
    """Time the campaigns one after the other and print medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--trials', type=int, default=3, help='campaigns of each kind')
    parser.add_argument('--quick', action='store_true', help='one campaign of each kind')
    args = parser.parse_args(argv)
    trials = 1 if args.quick else args.trials
    explained((), layered=True, seed=0, count=2)  # compiles
    every = []
    print(f'{len(TAPS) + len(BLOWS)} recordings of {DURATION:g} s at {RATE:g} Hz, {trials} each')
    for layered, names in COUNTED.items():
        for name in names:
            times = []
            answers: dict[str, int] = {}
            for trial in range(trials):
                seconds, answer = explained(
                    EFFECTS[name], layered=layered, seed=1 + trial, count=len(BLOWS)
                )
                times.append(seconds)
                found = ' + '.join(answer.accepted) or 'nothing'
                answers[found] = answers.get(found, 0) + 1
            every += times
            told = ', '.join(f'{found} ({times_found})' for found, times_found in answers.items())
            where = 'layer' if layered else 'bare'
            print(
                f'  {where:5s} {name:30s} median {statistics.median(times):5.1f} s, '
                f'{min(times):.1f} to {max(times):.1f}; answer {told}',
                flush=True,
            )
    load = os.getloadavg()[0] if hasattr(os, 'getloadavg') else math.nan
    longest = f'median {statistics.median(every):.1f} s, longest {max(every):.1f} s'
    print(f'all: {longest}; load {load:.1f}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
