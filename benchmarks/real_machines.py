"""Real machines: what is found from the linear model alone, beside what others publish.

    IMPACTSCOPE_DATA=FOLDER python benchmarks/real_machines.py [--quick] [--machine NAME ...]

The folder holds the published measurements (docs/real_machines.md). One engine and one set of
settings for all machines. Errors are those of simulations that are never corrected by what was
measured; nothing but a recording's own beginning is fitted to held-out recordings of free motion
and of the friction damper, nothing at all to those of the others.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from emps_identifiability import campaigns
from emps_identifiability import report as report_emps

from impactscope.campaign_files import explain_folder
from impactscope.discrepancy.answer import Answer, Trace

QUICK = ('pendulum', 'friction_damper')


@dataclass(frozen=True, slots=True)
class Expected:
    """What is known of a machine: the effect, and figures of others by recording part."""

    truth: str
    sets: tuple[frozenset[str], ...]  # right answers, up to effects that the data cannot tell
    unit: str
    factor: float  # from SI to the unit; 0: relative to the signal
    published: tuple[str, ...]  # beside each recording part, in the order of the campaign
    bound: tuple[float, ...]  # figure to reach, same order; infinite where there is none


NONE = float('inf')
FRICTION = ({'offset', 'coulomb_friction'}, {'asymmetric_friction'})
EXPECTED = {
    'silverbox': Expected(
        'hardening (cubic) spring',
        (frozenset({'hardening_spring'}),),
        'mV',
        1e3,
        ('-', 'quick cubic 1.00, GRU 1.49, LSTM 1.50', 'quick cubic 0.93, LSTM 2.68, GRU 2.80'),
        (NONE, 1.0, 0.9),
    ),
    'emps': Expected(
        'Coulomb friction and offset',
        tuple(frozenset(s) for s in FRICTION),
        'mm',
        1e3,
        ('quick Coulomb 5.0', 'quick Coulomb 7.0, LSTM 74, GRU 220'),
        (5.0, 5.0),
    ),
    'pendulum': Expected(
        'sine and dry friction',
        (frozenset({'restoring_force', 'coulomb_friction'}),),
        'deg',
        180.0 / np.pi,
        ('sine, Coulomb 0.66', 'sine, Coulomb 0.94', 'sine, Coulomb 1.8'),
        (0.66, 0.94, 1.8),
    ),
    'friction_damper': Expected(
        'asymmetric Coulomb friction and backlash',
        (
            frozenset({'asymmetric_friction', 'clearance'}),
            frozenset({'coulomb_friction', 'clearance', 'offset'}),
        ),
        'of the signal',
        0.0,
        ('friction, backlash 0.12', 'friction, backlash 0.11', 'friction, backlash 0.20'),
        (0.12, 0.11, 0.20),
    ),
    'modal_hammer': Expected(
        'nothing but more modes',
        (frozenset({'further_modes'}),),
        'of the signal',
        0.0,
        ('-',) * 5,
        (NONE,) * 5,
    ),
}


def _error(trace: Trace, model: str, factor: float) -> float:
    error = float(np.sqrt(np.mean((trace.measured - getattr(trace, model)) ** 2)))
    return error * factor if factor else error / float(np.sqrt(np.mean(trace.measured**2)))


def report(name: str, answer: Answer, seconds: float) -> bool:
    """Print one machine; whether the effect is right and every figure is reached."""
    expected = EXPECTED[name]
    right = any(s <= set(answer.accepted) for s in expected.sets)
    extra = set(answer.accepted) - set().union(*expected.sets)
    print(f'\n{name}: known effect: {expected.truth}')
    print(f'  found: {", ".join(answer.accepted) or "nothing"} ({seconds:.0f} s)')
    for finding in answer.findings:
        numbers = ', '.join(
            f'{key} {value.value:.5g} +- {value.std:.2g} {value.unit}'
            for key, value in list(finding.parameters.items())[:6]
            if not isinstance(value.value, str)
        )
        rivals = f'; not excluded: {", ".join(finding.confused_with)}' * bool(
            finding.confused_with
        )
        print(f'    {finding.name} (probability {finding.probability:.3f}): {numbers}{rivals}')
    reached = True
    for i, trace in enumerate(answer.traces):
        before = _error(trace, 'baseline', expected.factor)
        after = _error(trace, 'extended', expected.factor)
        role = 'held out' if trace.held_out else 'fitted'
        reached &= after <= expected.bound[i]
        mark = '' if after <= expected.bound[i] else f'  ABOVE {expected.bound[i]:g}'
        print(
            f'    {trace.recording:<38} {role:<8} linear {before:8.3f}  extended {after:7.3f} '
            f'{expected.unit}; others: {expected.published[i]}{mark}'
        )
    print(f'  effect {"right" if right else "WRONG"}', end='')
    print(f'; beside it: {", ".join(sorted(extra))}' if extra else '')
    return right and reached


def main(argv: list[str] | None = None) -> int:
    """Explain the machines whose data are there; 0 also where a figure is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help=f'only {" and ".join(QUICK)}')
    parser.add_argument('--machine', action='append', choices=tuple(EXPECTED), default=None)
    options = parser.parse_args(argv)
    folder = os.environ.get('IMPACTSCOPE_DATA', '')
    if not folder or not Path(folder).is_dir():
        print('IMPACTSCOPE_DATA names no folder with the published measurements: nothing done')
        return 0
    names = tuple(options.machine or (QUICK if options.quick else EXPECTED))
    good = 0
    with tempfile.TemporaryDirectory() as scratch:
        made = campaigns(Path(folder), Path(scratch), names)
        for name, path in made.items():
            begin = time.perf_counter()
            answer = explain_folder(path)
            good += report(name, answer, time.perf_counter() - begin)
            if name == 'emps':
                report_emps(path, 200)
    print(f'\n{good} of {len(made)} machines: effect right and every figure reached')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
