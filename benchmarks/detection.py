"""Detection of blows with known truth: misses, false alarms, contact times, speed.

A pendulum of given equivalent mass strikes the paper's sensor (1.67 kg plate, 69 kN/m, damping
ratio 0.07), with a viscoelastic layer between them or without, along gravity (the weight stays
on the plate and is lifted off later) or across it. The equations are integrated here, apart from
the package's own simulation; contact begins and ends where the simulated contact force does.
Noise of a given RMS is added: SNR is the reading's peak over it.
"""

from __future__ import annotations

import argparse
import csv
import math
import platform
import time
from pathlib import Path

import numpy as np
from numba import njit
from scipy import stats
from scipy.signal import lfilter

from impactscope.detect import ImpactDetector
from impactscope.detect.plate_motion import pulse_response
from impactscope.records import Channel, ImpactEvent, SyncedBlock

PLATE, SPRING, DAMPING = 1.67, 69e3, 0.07
OMEGA = math.sqrt(SPRING / PLATE)
STEP = 1e-5  # s, of the integration
PEAK = 60.0  # N, to which every blow is scaled
LENGTH = 2.4  # s, of the stretch that holds one blow
LIFT = 1.0  # s after the blow at which a resting weight is lifted off


@njit(cache=True)
def swing(steps, every, mass, speed, spring, branch, relaxation, gravity, hit, lift):
    """Reading and contact force of one blow; semi-implicit Euler steps of ``STEP``."""
    reading = np.zeros(steps // every + 1)
    contact = np.zeros(steps + 1)
    damper = 2 * DAMPING * math.sqrt(SPRING * PLATE)
    x = v = s = 0.0
    y, w = -speed * hit, speed
    touched = False
    for i in range(steps):
        if i % every == 0:
            reading[i // every] = SPRING * x
        force = 0.0
        if y > x:
            touched = True
            s += STEP * (branch * (w - v) - s / relaxation)
            force = max(spring * (y - x) + s, 0.0)
        else:
            s = 0.0
        contact[i] = force
        if touched:
            pull = gravity if i * STEP < lift else -0.3 * gravity
            w += STEP * (pull - force / mass)
        y += STEP * w
        v += STEP * (force - SPRING * x - damper * v) / PLATE
        x += STEP * v
    return reading, contact


def blow(rng, rate):
    """One random blow at ``rate``: reading scaled to PEAK and contacts (start, end) in s."""
    hit = 0.6 + rng.uniform(0, 0.2)
    layer = rng.random() < 0.6
    spring = rng.uniform(25e3, 60e3) if layer else rng.uniform(2e5, 8e5)
    branch = spring * rng.uniform(0.3, 1.0) if layer else 0.0
    gravity = 9.81 if rng.random() < 0.25 else 0.0
    every = round(1 / (rate * STEP))
    reading, force = swing(
        round(LENGTH / STEP), every, rng.uniform(0.29, 1.21), rng.uniform(0.15, 0.6),
        spring, branch, rng.uniform(3e-3, 0.02), gravity, hit, hit + LIFT,
    )  # fmt: skip
    edges = np.diff(np.concatenate(([0], (force > 0).astype(np.int8), [0])))
    contacts = np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)]) * STEP
    return reading[: round(LENGTH * rate)] * PEAK / reading.max(), contacts


def noise(rng, n, rate, kind):
    """Noise of unit RMS.

    white; coloured: first order, 200 Hz; outliers: one sample in a thousand from a distribution
    20 times as wide; student: three degrees of freedom, the heaviest tails with a finite RMS.
    """
    if kind == 'student':
        return rng.standard_t(3, n) / math.sqrt(3)
    if kind == 'outliers':
        wild = rng.random(n) < 1e-3
        return rng.standard_normal(n) * np.where(wild, 20.0, 1.0) / math.sqrt(1.399)
    white = rng.standard_normal(n)
    if kind == 'white':
        return white
    pole = math.exp(-2 * math.pi * 200 / rate)
    return lfilter([math.sqrt(1 - pole * pole)], [1, -pole], white)


def run(values, rate, detector=None) -> list[ImpactEvent]:
    detector = detector or ImpactDetector()
    channels = (Channel('force', 'N'),)
    step = round(rate / 50)
    row = values.astype(np.float32)[np.newaxis]
    events = []
    for i in range(0, row.shape[1], step):
        stamp = round(i * 1e9 / rate)
        part = row[:, i : i + step]
        events += detector.push(SyncedBlock(stamp, rate, 0, i, channels, part))
    return events + detector.flush()


def campaign(n, rate, snr, kind, drift, seed, settings=None):
    """Misses, false events and errors (s) of the first contact's start, end and centre."""
    rng = np.random.default_rng(seed)
    sigma = PEAK / 10 ** (snr / 20)
    quiet = round(2 * rate)
    size = round(LENGTH * rate)
    force = np.zeros(quiet + n * size)
    truth = []
    for k in range(n):
        at = quiet + k * size
        reading, contacts = blow(rng, rate)
        force[at : at + size] += reading
        truth.append(contacts + at / rate)
    force += sigma * noise(rng, force.size, rate, kind)
    force += drift * np.sin(2 * np.pi * np.arange(force.size) / rate / 60)
    began = time.process_time()
    events = run(force, rate, ImpactDetector(settings))
    took = time.process_time() - began
    starts = np.array([event.window_start_ns * 1e-9 for event in events])
    found = [
        (starts[i] + event.contacts[0].start, starts[i] + event.contacts[0].end, event)
        for i, event in enumerate(events)
    ]
    errors, fitted = [], 0
    matched = set()
    for contacts in truth:
        near = [
            (abs(f[0] - contacts[0, 0]), i)
            for i, f in enumerate(found)
            if abs(f[0] - contacts[0, 0]) < 0.03
        ]
        if not near:
            continue
        _, i = min(near)
        matched.add(i)
        start, end = found[i][0] - contacts[0, 0], found[i][1] - contacts[0, 1]
        errors.append((start, end - start, (start + end) / 2, len(contacts)))
        fitted += 1
    spurious = sum(
        1
        for i, f in enumerate(found)
        if i not in matched
        and not any(c[0, 0] - 0.03 < f[0] < c[0, 0] + LENGTH - 0.8 for c in truth)
    )
    return {
        'blows': n,
        'missed': n - len(matched),
        'extra': len(found) - len(matched) - spurious,
        'false': spurious,
        'errors': np.array(errors).reshape(-1, 4),
        'speed': force.size / rate / took,
        'reached': sum(c[-1, 1] - c[0, 0] > 0 for c in truth),
    }


def bound(snr, rate, duration):
    """Cramér-Rao bounds (s) of start, duration and centre of a half-sine contact, plate known.

    Unknown: start, duration, amplitude; white noise; the reading until 3 periods later.
    """
    times = np.arange(-0.02, duration + 3 * 2 * math.pi / OMEGA, 1 / rate)

    def reading(start, length):
        basis = np.empty((3, times.size))
        pulse_response(times[0], 1 / rate, start, length, OMEGA, DAMPING, basis)
        return basis[0]

    step = 1e-6
    base = reading(0.0, duration)
    scale = 10 ** (snr / 20) / base.max()
    by_start = (reading(step, duration) - reading(-step, duration)) / (2 * step)
    by_length = (reading(0.0, duration + step) - reading(0.0, duration - step)) / (2 * step)
    jacobian = np.stack([by_start, by_length, base]) * scale
    covariance = np.linalg.inv(jacobian @ jacobian.T)
    centre = np.array([1.0, 0.5, 0.0])
    variances = covariance[0, 0], covariance[1, 1], centre @ covariance @ centre
    return tuple(math.sqrt(v) for v in variances)


def poisson(count, hours):
    """Exact 95 % interval of a rate, per hour."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return low / hours, stats.chi2.ppf(0.975 if count else 0.95, 2 * count + 2) / 2 / hours


def false_alarms(hours, rate, kind, seed):
    rng = np.random.default_rng(seed)
    detector = ImpactDetector()
    channels = (Channel('force', 'N'),)
    step = round(rate / 50)
    index = events = 0
    phase = rng.uniform(0, 6)
    for _ in range(round(hours * 360)):
        part = noise(rng, round(10 * rate), rate, kind)
        part += 5 * np.sin(2 * np.pi * (index + np.arange(part.size)) / rate / 600 + phase)
        row = part.astype(np.float32)[np.newaxis]
        for i in range(0, row.shape[1], step):
            stamp = round(index * 1e9 / rate)
            block = SyncedBlock(stamp, rate, 0, index, channels, row[:, i : i + step])
            events += len(detector.push(block))
            index += step
    return events + len(detector.flush())


def quiet_speed(seconds):
    """Times real time, by CPU time, of 4 channels at 51.2 kS/s without a blow, in 20 ms blocks."""
    rate, n = 51200.0, 1024
    rng = np.random.default_rng(0)
    values = rng.standard_normal((4, n * 50)).astype(np.float32)
    channels = (
        Channel('force', 'N'),
        *(Channel(f'acceleration.{k}', 'm/s^2') for k in ('plate', 'impactor', 'base')),
    )
    speeds = []
    for _ in range(5):
        detector = ImpactDetector()
        made = [
            SyncedBlock(
                round(i * n * 1e9 / rate), rate, 0, i * n, channels,
                values[:, (i % 50) * n : (i % 50 + 1) * n],
            )
            for i in range(seconds * 50)
        ]  # fmt: skip
        began = time.process_time()
        for block in made:
            detector.push(block)
        speeds.append(seconds / (time.process_time() - began))
    return np.median(speeds), min(speeds), max(speeds)


def percentiles(errors):
    """Of absolute errors in ms: 50, 95 and 99 %."""
    if errors.size == 0:
        return '     -      -      -'
    return ' '.join(f'{1e3 * p:6.2f}' for p in np.percentile(np.abs(errors), [50, 95, 99]))


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split('\n', 1)[0])
    parser.add_argument('--quick', action='store_true', help='few blows, minutes of noise')
    parser.add_argument('--blows', type=int, default=1000, help='blows a row (white noise)')
    parser.add_argument('--hours', type=float, default=4.0, help='of noise for each kind')
    parser.add_argument('--csv', type=Path, help='write the curve to this file')
    arguments = parser.parse_args(argv)
    blows = 40 if arguments.quick else arguments.blows
    hours = 0.05 if arguments.quick else arguments.hours

    print(
        f'machine: {platform.machine()}, {platform.platform()}, Python {platform.python_version()}'
    )
    campaign(2, 1000.0, 30, 'white', 0.0, 0)  # compiles
    middle, low, high = quiet_speed(5 if arguments.quick else 20)
    print(f'quiet stream, 4 x 51.2 kS/s, 20 ms blocks: {middle:.0f} times real time '
          f'(5 runs, {low:.0f} to {high:.0f})')  # fmt: skip

    print('\nfalse alarms in noise that drifts by 10 sigma in 10 minutes')
    print('  rate Hz  noise      hours  alarms  per hour (95 %)')
    for rate in (1000.0, 10000.0):
        for kind in ('white', 'coloured', 'outliers', 'student'):
            count = false_alarms(hours, rate, kind, 7)
            low, high = poisson(count, hours)
            print(f'  {rate:7.0f}  {kind:9} {hours:6.2f}  {count:6d}  {low:.2f} to {high:.2f}')

    print(
        '\nblows: missed, extra events of a blow, false alarms; |error| in ms at 50, 95, 99 % of'
    )
    print('the first contact: start, duration, centre, and centre of the blows without a bounce;')
    print('bound: Cramér-Rao standard deviation of start, duration and centre for a half-sine of')
    print('9 ms in white noise with the plate known')
    print(
        '  rate Hz noise     dB  blows missed extra false |      start        |     duration      '
        '|      centre       | centre, no bounce |    bound / ms     | x real time'
    )
    rows = []
    levels = (40, 12, 6) if arguments.quick else (40, 30, 20, 15, 12, 9, 6)
    for rate in (1000.0, 10000.0):
        for kind in ('white', 'coloured', 'outliers'):
            for snr in levels:
                n = blows if kind == 'white' else max(blows // 5, 20)
                drift = PEAK / 10 ** (snr / 20)
                got = campaign(n, rate, snr, kind, drift, 1000 + snr)
                errors = got['errors']
                least = bound(snr, rate, 0.009)
                least_ms = (
                    f'{1e3 * least[0]:5.2f} {1e3 * least[1]:5.2f} {1e3 * least[2]:5.2f}'
                    if kind == 'white'
                    else ' ' * 17
                )
                columns = [percentiles(errors[:, k]) for k in range(3)]
                columns.append(percentiles(errors[errors[:, 3] == 1, 2]))
                print(
                    f'  {rate:7.0f} {kind:9} {snr:2d} {n:6d} {got["missed"]:6d} '
                    f'{got["extra"]:5d} {got["false"]:5d} | {" | ".join(columns)} | {least_ms} | '
                    f'{got["speed"]:.0f}',
                    flush=True,
                )
                worst = (
                    np.percentile(np.abs(errors[:, :3]), [50, 95], axis=0)
                    if errors.size
                    else np.full((2, 3), math.nan)
                )
                rows.append([rate, kind, snr, n, got['missed'], got['extra'], got['false'],
                             *worst.T.ravel(), *least])  # fmt: skip
    if arguments.csv:
        with arguments.csv.open('w', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(
                ['rate_hz', 'noise', 'snr_db', 'blows', 'missed', 'extra', 'false']
                + [f'{what}_{p}_s' for what in ('start', 'duration', 'centre') for p in (50, 95)]
                + ['bound_start_s', 'bound_duration_s', 'bound_centre_s']
            )
            writer.writerows(rows)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
