"""The twin against scipy's integrators: 0.5 s of a damped, bouncing pendulum blow at 10 kHz.

Every method computes force and both accelerations; its error is the largest deviation over the
largest value, the worst of the three, against a tight run of the same program. scipy's solvers
get their right-hand side in plain Python and compiled, and stop at the same contact events.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from impactscope.physics.twin import layout as at
from impactscope.physics.twin.assembly import Effect, assemble, implied_effects, normalise
from impactscope.physics.twin.bench import Bench, PendulumBlow, RobotBlow
from impactscope.physics.twin.simulate import simulate, solve, sufficient_tolerance

DURATION, RATE, TARGET = 0.5, 10_000.0, 5e-5
COLUMNS = [at.READING, at.PLATE_ACCELERATION, at.IMPACTOR_ACCELERATION]


def layer(y, closed, ks, k2):
    """Compression and force of the layer."""
    pull = 0.0
    total = k2
    for i in range(len(ks)):
        pull += ks[i] * y[4 + i]
        total += ks[i]
    if not closed:
        return pull / total, 0.0
    u = y[2] - y[0]
    return u, total * u - pull


def rate(_, y, closed, numbers, ks, cs):
    """Plate, impactor and branches."""
    m, k, c, mass, load, lever, k2 = numbers
    u, f = layer(y, closed, ks, k2)
    dy = np.empty(len(y))
    dy[0] = y[1]
    dy[1] = (f - k * y[0] - c * y[1]) / m
    dy[2] = y[3]
    dy[3] = (load * math.cos(y[2] / lever) - f) / mass
    for i in range(len(ks)):
        dy[4 + i] = ks[i] * (u - y[4 + i]) / cs[i]
    return dy


compiled_layer = njit(layer)


@njit
def compiled_rate(_, y, closed, numbers, ks, cs):
    m, k, c, mass, load, lever, k2 = numbers
    u, f = compiled_layer(y, closed, ks, k2)
    dy = np.empty(len(y))
    dy[0] = y[1]
    dy[1] = (f - k * y[0] - c * y[1]) / m
    dy[2] = y[3]
    dy[3] = (load * math.cos(y[2] / lever) - f) / mass
    for i in range(len(ks)):
        dy[4 + i] = ks[i] * (u - y[4 + i]) / cs[i]
    return dy


def by_scipy(par, times, method, tolerance, compiled):
    """Force and accelerations at ``times``, shape (n, 3), stepping from contact to contact."""
    n = int(par[at.BRANCHES])
    ks, cs = par[at.BRANCH :: 2][:n].copy(), par[at.BRANCH + 1 :: 2][:n].copy()
    m, k, c = par[at.PLATE_MASS], par[at.STIFFNESS], par[at.DAMPING]
    numbers = (
        m,
        k,
        c,
        par[at.IMPACTOR_MASS],
        par[at.LOAD],
        par[at.LEVER],
        par[at.LAYER_STIFFNESS],
    )
    numbers = tuple(float(v) for v in numbers)
    f_layer = compiled_layer if compiled else layer
    f_rate = compiled_rate if compiled else rate
    if not compiled:
        ks, cs = ks.tolist(), cs.tolist()
    y = np.zeros(4 + n)
    y[3] = par[at.IMPACT_SPEED]

    def leaves(_, y, closed, numbers, ks, *_cs):
        u, f = f_layer(y, closed, ks, numbers[6])
        return f if closed else y[0] + u - y[2]

    leaves.terminal, leaves.direction = True, -1
    out, t, closed, end = np.empty((len(times), 3)), 0.0, True, times[-1]
    first = 0
    ks_a = np.asarray(ks)
    while True:
        result = solve_ivp(
            f_rate,
            (t, end),
            y,
            method,
            t_eval=times[first:],
            rtol=tolerance,
            atol=tolerance * 1e-3,
            events=leaves,
            args=(closed, numbers, ks, cs),
        )
        s = result.y
        if result.t.size:
            f = numbers[6] * (s[2] - s[0]) + ks_a @ (s[2] - s[0] - s[4:]) if closed else 0.0
            rows = slice(first, first + result.t.size)
            out[rows, 0] = k * s[0]
            out[rows, 1] = (f - k * s[0] - c * s[1]) / m
            weight = numbers[4] * np.cos(s[2] / numbers[5])
            out[rows, 2] = (weight - f) / numbers[3]
            first += result.t.size
        if result.status != 1 or first >= len(times):
            return out
        t, y = float(result.t_events[0][-1]), result.y_events[0][-1]
        closed = not closed


def timed(call: Callable[[], object], repeats: int) -> tuple[float, float, float]:
    """Median, 5th and 95th percentile of the run time, ms."""
    call()
    spans = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        spans.append(time.perf_counter() - begin)
    low, middle, high = np.percentile(spans, [5, 50, 95]) * 1e3
    return middle, low, high


def deviation(values: np.ndarray, reference: np.ndarray) -> float:
    """Worst of the channels: largest deviation over largest value."""
    return float((np.abs(values - reference).max(axis=0) / np.abs(reference).max(axis=0)).max())


def compile_times() -> tuple[float, float]:
    """Seconds to the first simulation in a new process, without and with the code on disk."""
    code = (
        'import time\n'
        'from impactscope.physics.twin.bench import Bench, PendulumBlow\n'
        'from impactscope.physics.twin.simulate import simulate\n'
        'begin = time.perf_counter()\n'
        'simulate(Bench(), PendulumBlow(), duration=0.01)\n'
        'print(time.perf_counter() - begin)\n'
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, 'NUMBA_CACHE_DIR': folder}
        spans = [
            float(subprocess.run([sys.executable, '-c', code], env=environment, check=True,
                                 capture_output=True, text=True).stdout)
            for _ in range(2)
        ]  # fmt: skip
    return spans[0], spans[1]


def compare_series(repeats: int) -> None:
    """1 s at 5 kHz as a search simulates it, at the tolerance that it takes."""
    print('\nAs a search simulates a blow (1 s at 5 kHz): by the pair, by power series')
    print('                         steps   error     ms    steps   error     ms')
    times = np.arange(5000) / 5000.0
    friction = Effect('coulomb_friction', {'force': 0.3})
    for where, bench in (('layer', Bench()), ('bare', Bench(damper=None))):
        for what, more in (('', ()), (' + friction', (friction,))):
            blow = RobotBlow(3.0, 0.2, push_force=0.0)
            load = Effect('gravity_load', {'force': 5.0})
            par = assemble(bench, blow, [*implied_effects(bench, blow), load, *more])
            exact = solve(par, times, 1e-12)[0][:, COLUMNS]
            line = f'{where + what:22s}'
            for lean in (False, True):
                rows, _, _, steps = solve(par, times, lean=lean)
                span = timed(lambda p=par, n=lean: solve(p, times, lean=n), repeats)
                line += f'{steps:8d}   {deviation(rows[:, COLUMNS], exact):.1e}   {span[0]:.2f}'
            print(line)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='fewer repetitions, no compile time')
    options = parser.parse_args(argv)
    repeats = 7 if options.quick else 40
    bench, blow = Bench(), PendulumBlow(large_angles=True)
    par = assemble(bench, blow, implied_effects(bench, blow))
    times = np.arange(round(DURATION * RATE)) / RATE
    print(
        f'Twin: {DURATION} s at {RATE:g} Hz of a pendulum blow with damper; {platform.machine()},'
    )
    print(f'Python {platform.python_version()}, {os.cpu_count()} processors, {repeats} runs each.')

    ours_reference = solve(par, times, 1e-12)[0][:, COLUMNS]
    scipy_reference = by_scipy(par, times, 'DOP853', 1e-12, True)
    apart = deviation(ours_reference, scipy_reference)
    print(f'Tight references of twin and scipy differ by {apart:.1e}.')

    print('\nmethod                     tolerance   error     ms (5 % to 95 %)')
    best_ours = math.inf
    for tolerance in (3e-6, 1e-6, 1e-7):
        for label, lean in (('twin', False), ('twin, by power series', True)):
            error = deviation(
                solve(par, times, tolerance, lean=lean)[0][:, COLUMNS], ours_reference
            )
            span = timed(lambda t=tolerance, n=lean: solve(par, times, t, lean=n), repeats)
            print(f'{label:26s} {tolerance:7.0e}   {error:.1e}   {span[0]:.2f} '
                  f'({span[1]:.2f} to {span[2]:.2f})')  # fmt: skip
            if error <= TARGET:
                best_ours = min(best_ours, span[0])
    span = timed(lambda: simulate(bench, blow, duration=DURATION), repeats)
    usual = sufficient_tolerance(par)
    print(f'{"simulate(), all included":26s} {usual:7.0e}             {span[0]:.2f} '
          f'({span[1]:.2f} to {span[2]:.2f})')  # fmt: skip

    best_scipy, name = math.inf, ''
    for method in ('RK23', 'RK45', 'DOP853', 'LSODA', 'Radau', 'BDF'):
        for tolerance in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9):
            error = deviation(by_scipy(par, times, method, tolerance, True), scipy_reference)
            if error > TARGET and tolerance > 1e-9:
                continue
            for compiled in (False, True):
                span = timed(
                    lambda m=method, t=tolerance, c=compiled: by_scipy(par, times, m, t, c),
                    3 if options.quick else 7,
                )
                label = f'{method}, {"compiled" if compiled else "plain"} equations'
                print(f'{label:26s} {tolerance:7.0e}   {error:.1e}   {span[0]:.2f} '
                      f'({span[1]:.2f} to {span[2]:.2f})')  # fmt: skip
                if error <= TARGET and span[0] < best_scipy:
                    best_scipy, name = span[0], label
            break
    print(f'\nAt an error of {TARGET:g} or less the twin is {best_scipy / best_ours:.1f} times')
    print(f'faster than the fastest of scipy ({name}); medians of this run.')

    compare_series(repeats)

    print('\nGrowth with mechanisms (simulate(), 0.5 s):')
    steps = {
        'as it is': {},
        '+ Coulomb friction': {'coulomb_friction': {'force': 2.0}},
        '+ hardening spring': {'hardening_spring': {'cubic': 1e9}},
        '+ flexible impactor': {'impactor_flexibility': {'frequency': 80.0, 'mass_share': 0.2}},
        '+ fixture': {'base_compliance': {'frequency': 120.0, 'mass': 20.0}},
        '+ hysteresis': {'hysteresis': {'share': 0.1, 'yield_displacement': 1e-3}},
    }
    chosen = {e.name: dict(e.values) for e in normalise(None, bench, blow)}
    for label, more in steps.items():
        chosen.update(more)
        result = simulate(bench, blow, mechanisms=chosen, duration=DURATION)
        span = timed(lambda: simulate(bench, blow, mechanisms=chosen, duration=DURATION), repeats)
        print(f'  {label:22s} {span[0]:.2f} ms, {result.steps} steps, {len(result.events)} events')
    print('Growth with duration (simulate()):')
    for duration in (0.25, 0.5, 1.0, 2.0):
        span = timed(lambda d=duration: simulate(bench, blow, duration=d), repeats)
        print(f'  {duration:4.2f} s   {span[0]:.2f} ms')
    if not options.quick:
        first, again = compile_times()
        print(f'First simulation in a new process: {first:.1f} s compiling, {again:.2f} s cached.')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
