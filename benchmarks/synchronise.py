"""How fast channels of different rates, phases and clocks come onto one grid, and how exactly."""

from __future__ import annotations

import argparse
import platform
import statistics
import time
from collections.abc import Callable

import numpy as np

from impactscope.records import SampleBlock
from impactscope.signals.resample import SINC_TABLE, interpolate, resample_line
from impactscope.synchronise.sample_assembler import SampleAssembler
from impactscope.synchronise.synchroniser import Synchroniser, SynchroniserSettings

START = 1_700_000_000_000_000_000
TONE = 0.2  # of the slowest channel's rate

BENCHES: dict[str, list[tuple[str, float, float]]] = {
    '4 x 51.2 kS/s, same instants': [(n, 51_200.0, 0.0) for n in 'abcd'],
    '4 x 51.2 kS/s, phases apart': [
        (n, 51_200.0, p) for n, p in zip('abcd', (0.0, 3e-6, 7e-6, -4e-6), strict=True)
    ],
    '51.2, 25.6, 25.6, 10 kS/s': [
        ('a', 51_200.0, 0.0), ('b', 25_600.0, 3e-6), ('c', 25_600.0, 7e-6), ('d', 10_000.0, 4e-6),
    ],
    'force 1 kS/s (reference), 3 x 25.6': [
        ('force', 1000.0, 0.0), *((n, 25_600.0, 3e-6 * k) for k, n in enumerate('abc', 1)),
    ],
    '3 x 25.6 (reference), force 1 kS/s': [
        *((n, 25_600.0, 3e-6 * k) for k, n in enumerate('abc')), ('force', 1000.0, 5e-5),
    ],
}  # fmt: skip


def tone(times: np.ndarray, frequency: float) -> np.ndarray:
    return np.sin(2 * np.pi * frequency * times + 0.3)


def recording(
    channels: list[tuple[str, float, float]], seconds: float, frequency: float, duration: float
) -> list[SampleBlock]:
    """Blocks of all channels in the order in which they are complete."""
    blocks = []
    for name, rate, phase in channels:
        values = tone(np.arange(int(seconds * rate)) / rate + phase, frequency).astype(np.float32)
        cut = max(1, round(rate * duration))
        blocks += [
            SampleBlock(
                name, 'N', rate, START + round((phase + k / rate) * 1e9), k, values[k : k + cut]
            )
            for k in range(0, values.size, cut)
        ]
    return sorted(blocks, key=lambda b: b.stamp_ns + b.values.size / b.sample_rate * 1e9)


def timed(run: Callable[[], object], trials: int) -> tuple[float, float, float]:
    """Least, median and largest time of a process's own work in s, after one run to warm up."""
    run()
    spent = []
    for _ in range(trials):
        begun = time.process_time()
        run()
        spent.append(time.process_time() - begun)
    return min(spent), statistics.median(spent), max(spent)


def measure_bench(name: str, seconds: float, trials: int) -> None:
    channels = BENCHES[name]
    frequency = TONE * min(rate for _, rate, _ in channels)
    blocks = recording(channels, seconds, frequency, 0.02)

    settings = SynchroniserSettings(tuple(n for n, _, _ in channels))

    def run() -> None:
        synchroniser = Synchroniser(settings)
        for block in blocks:
            synchroniser.push(block)
        synchroniser.flush()

    synchroniser = Synchroniser(settings)
    out = [item for block in blocks for item in synchroniser.push(block)] + synchroniser.flush()
    values, rate = np.concatenate([o.values for o in out], axis=1), out[0].sample_rate
    del out
    truth = tone(np.arange(values.shape[1]) / rate + channels[0][2], frequency)
    edge = int(rate * 20 / min(r for _, r, _ in channels))
    error = float(np.nanmax(np.abs(values - truth)[:, edge:-edge]))
    least, median, most = timed(run, trials)
    print(
        f'  {name:38s} {seconds / median:6.0f} x real time ({seconds / most:.0f} to '
        f'{seconds / least:.0f}), {median / len(blocks) * 1e6:5.1f} us a block, '
        f'largest error {error:.1e} of the amplitude'
    )


def measure_interpolation(trials: int) -> None:
    rows = 1_000_000
    samples = tone(np.arange(rows + 100), 0.2).astype(np.float32)
    out = np.empty(rows, dtype=np.float32)
    for name, step in (('one phase', 1.0), ('every phase', 0.99995)):

        def run(step: float = step) -> None:
            resample_line(samples, 0, samples.size, 40, 0.37, step, 0, 1e-9, SINC_TABLE, out)

        _, median, _ = timed(run, trials)
        print(
            f'  32-tap sinc, {name:12s}                {rows / median / 1e6:6.0f} million rows/s'
        )
    positions = 40.37 + np.arange(rows) * 0.99995
    places = np.arange(samples.size, dtype=float)
    _, median, _ = timed(lambda: np.interp(positions, places, samples), trials)
    truth = tone(positions, 0.2)
    linear = np.abs(np.interp(positions, places, samples) - truth).max()
    sinc = np.abs(interpolate(samples, positions) - truth).max()
    print(f'  np.interp (linear), beside it            {rows / median / 1e6:6.0f} million rows/s')
    print(f'  error at 0.2 of the rate: sinc {sinc:.1e}, linear {linear:.1e} of the amplitude')


def measure_assembly(trials: int) -> None:
    size = 240_000
    rng = np.random.default_rng(1)
    stamps = START + (np.arange(size) * 1e6 + rng.normal(0, 5e4, size)).astype(np.int64)
    values = rng.normal(size=size).astype(np.float32)
    pairs = list(zip(stamps.tolist(), values.tolist(), strict=True))[:50_000]

    def arrays() -> list[SampleBlock]:
        assembler = SampleAssembler('force', 'N')
        return [*assembler.extend(stamps, values), *assembler.end()]

    def singles() -> None:
        assembler = SampleAssembler('force', 'N')
        for stamp, value in pairs:
            assembler.push(stamp, value)

    _, median, _ = timed(arrays, trials)
    print(f'  240,000 stamped samples as arrays        {median * 1e3:6.1f} ms')
    _, median, _ = timed(singles, trials)
    print(f'  one by one                               {median / len(pairs) * 1e6:6.2f} us each')


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='shorter recordings, fewer trials')
    quick = parser.parse_args(argv).quick
    seconds, trials = (10.0, 3) if quick else (60.0, 7)
    print(f'Synchronising, {platform.machine()}, Python {platform.python_version()}')
    print(f'{seconds:.0f} s of data in 20 ms blocks, {trials} trials, process time, one thread')
    print('(median, and from the slowest to the fastest trial)')
    for name in BENCHES:
        measure_bench(name, seconds, trials)
    measure_interpolation(trials)
    measure_assembly(trials)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
