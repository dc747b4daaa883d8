"""How long eight recordings take: campaigns made by the twin, written, read and explained.

Two taps and six blows, one of them held out, on the bench with its damper layer and on the bare
plate; as the simulation has it, and with an effect that the campaign does not tell. The folder is
a temporary one with recordings and ``campaign.yaml``, as a user has it. A first, small campaign
compiles and is not counted.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from impactscope.campaign_files import explain_folder
from impactscope.discrepancy.answer import Answer
from impactscope.drivers.simulated_campaign import BLOWS, TAPS, write_campaign
from impactscope.physics.twin.assembly import Effect

EFFECTS: dict[str, tuple[Effect, ...]] = {
    'nothing': (),
    'coulomb_friction': (Effect('coulomb_friction', {'force': 0.3}),),
    'hardening_spring + zero_drift': (
        Effect('hardening_spring', {'cubic': 3e8}),
        Effect('zero_drift', {'rate': 0.3}, 'force'),
    ),
}
COUNTED = {True: tuple(EFFECTS), False: ('nothing', 'coulomb_friction')}


def explained(
    effects: Sequence[Effect], *, layered: bool, seed: int, count: int
) -> tuple[float, Answer]:
    """Seconds from the folder to the answer, and the answer."""
    with tempfile.TemporaryDirectory() as folder:
        write_campaign(Path(folder), effects, layered=layered, seed=seed, blows=count)
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
    print(f'{len(TAPS) + len(BLOWS)} recordings of 1 s at 5000 Hz, {trials} each')
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
