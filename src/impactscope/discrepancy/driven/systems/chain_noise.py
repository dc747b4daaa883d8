"""A measuring chain with noise at both ends: what that does to a residual.

The quantity x is known by u = x + n_u alone, and y = C x + n_y is measured. What C u leaves has
the variance s_y + |C|^2 s_u, so residuals are measured by the noise that their own filters leave:
a low-pass earns nothing by smoothing the input's noise (errors in variables; Soederstroem,
Automatica 43 (2007)). Filters act where the signal stands clear of that noise. Where there is
none, the input tells nothing of them; where it is faint, samples count little.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats

from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.measuring_chain import power_passed
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.noise.coloured_noise import Colour
from impactscope.discrepancy.driven.noise.input_rounding import Rounding, rounding_of
from impactscope.discrepancy.driven.systems.case import Settled

__all__ = ['CLEAR_LINE', 'ChainNoise', 'both_noises', 'input_at_most', 'settled_ends']

Array = NDArray[np.float64]

WINDOW = 128  # samples
WIDTH, DEEP = 7, 8  # lines and windows of a tile
# times the variance of a sum of independent squares that so many neighbouring lines have: behind
# a Hann window each shares 4/9 of its scatter with the next, and 1/36 with the one beyond
SPREAD = 1.0 + 2.0 * ((WIDTH - 1) * 4 / 9 + (WIDTH - 2) / 36) / WIDTH
FEWEST = 12  # tiles
# share of the windows of which the loudest tells how loud noise is at most, of so many
QUIETER, FEWEST_WINDOWS = 0.25, 20
LOWEST, QUIET = 0.05, 1.5  # quantile of the tiles' power, and how much above it is quiet
KNOWN = 0.3  # share of the input's noise that the output knows, if it passes the chain
SOME = 1e-6  # of the output's noise: in long recordings a hundredth matters
NEARLY = 1.3  # times the input's noise, within which quiet windows know nothing else
CLEAR = 100.0  # times the noise: lines with signal
FAINT = 1.6  # times the noise: where there is some signal
MOST_INPUT = 0.9  # of the noise, that comes from the input at most
WIDE = 41  # lines that tell whether there is signal
NEIGHBOURS = 5  # lines of a spectrum, averaged
CLEAR_LINE = 300.0  # times the noise: a line of a signal
TINY = 1e-12


def both_noises(inputs: Sequence[Array], outputs: Sequence[Array]) -> tuple[float, float] | None:
    """Variances of the noise of input and output, from where both are quiet in time and frequency.

    What both have in common there is signal, or noise that passes the chain. None where the
    input's noise passes, or does not matter.
    """
    tiles = np.concatenate([_tiles(u, y) for u, y in zip(inputs, outputs, strict=True)], axis=1)
    if tiles.shape[1] < FEWEST:
        return None
    quiet = tiles[0] <= QUIET * np.quantile(tiles[0], LOWEST)
    into, out, common = (float(np.mean(row[quiet])) for row in tiles)
    common = max(common, 0.0)
    if not out > common or common > KNOWN * into or not into - common > SOME * (out - common):
        return None
    return (into - common) / _of_the_quieter(), out - common


@functools.cache
def _of_the_quieter() -> float:
    """Mean power of the tiles that count as quiet, over that of all where none has signal."""
    freedom = 2.0 * WIDTH * DEEP / SPREAD
    most = QUIET * float(stats.chi2.ppf(LOWEST, freedom))
    return float(stats.chi2.cdf(most, freedom + 2.0) / stats.chi2.cdf(most, freedom))


def _tiles(u: Array, y: Array) -> Array:
    """Power of both and what they have in common, by tiles of time and frequency, (3, k)."""
    count = u.size // WINDOW // DEEP * DEEP
    if count == 0:
        return np.zeros((3, 0))
    a, b = (_windows(x[: count * WINDOW], WINDOW) for x in (u, y))
    rows = []
    for power in (np.abs(a) ** 2, np.abs(b) ** 2, np.real(a * np.conj(b))):
        parts = power.reshape(count // DEEP, DEEP, -1, WIDTH)
        rows.append(parts.mean(axis=(1, 3)).ravel())
    return np.stack(rows)


def _windows(x: Array, window: int) -> NDArray[np.complex128]:
    """Lines of the spectra of windows of so many samples, from one period in each on, (m, k)."""
    count = x.size // window
    shape = np.hanning(window)
    shape = shape / math.sqrt(float(np.sum(shape**2)))
    lines = np.fft.rfft(shape * signal.detrend(x[: count * window].reshape(count, window)))
    return np.asarray(lines[:, 1 : 1 + WIDTH * ((window // 2 - 1) // WIDTH)])


def input_at_most(inputs: Sequence[Array], noise: Array) -> Array:
    """Variance of the input's noise by line, shape as ``noise``: what quieter windows have.

    That is its noise where a quarter of the time is quiet, and more where it is not. Longer
    windows tell it at lower frequencies; below what they tell it is the same share of the noise
    of the residual, ``noise`` by line. Infinite with few windows.
    """
    place = np.linspace(0.0, 1.0, noise.size)
    most = np.full(noise.size, math.inf)
    freedom = 2.0 * WIDTH / SPREAD
    quarter = float(stats.chi2.ppf(QUIETER, freedom)) / freedom
    window, lowest = WINDOW, math.inf
    while sum(u.size // window for u in inputs) >= FEWEST_WINDOWS:
        power = np.concatenate([np.abs(_windows(u, window)) ** 2 for u in inputs])
        bands = power.reshape(power.shape[0], -1, WIDTH).mean(axis=2)
        level = np.quantile(bands, QUIETER, axis=0) / quarter
        lines = 1.0 + WIDTH * np.arange(level.size) + 0.5 * (WIDTH - 1)
        centres = lines / (window // 2)
        lowest = float(centres[0])
        told = np.where(place < lowest, math.inf, np.interp(place, centres, level))
        most = np.minimum(most, told)
        window *= 2
    below = place < lowest
    if np.all(below):
        return most
    first = int(np.argmin(below))
    return np.where(below, most[first] / noise[first] * noise, most)


@dataclass(frozen=True, slots=True, eq=False)
class ChainNoise:
    """Noise of a chain's residual, by line of the spectrum of one recording; arrays (m,)."""

    sensor: Array  # variance that stays whatever the chain does
    passed: Array  # variance that comes from the input where filters act and pass all
    input: Array  # variance that comes from the input in all
    output: Array  # variance of the output's own noise
    rounding: Rounding | None = None
    flat: float = 0.0  # standard deviation of a sample where residuals are whitened elsewhere

    @staticmethod
    def of(segment: Segment, into: Array, out: Array, gain: float) -> tuple[ChainNoise, Array]:
        """The noise of a recording, and its input as the parts of ``ChainModel``, shape (4, n).

        ``into``, ``out``: variances of the noise of both ends by line, shape (m,).
        """
        whole = segment.drive[:2].sum(axis=0)
        n = whole.size
        ramp = np.linspace(whole[0], whole[-1], n)  # so that the ends meet
        spectrum = np.fft.rfft(whole - ramp)
        power = np.abs(spectrum) ** 2 / n
        near = np.convolve(power, np.full(NEIGHBOURS, 1.0 / NEIGHBOURS), 'same')
        wide = np.convolve(power, np.full(WIDE, 1.0 / WIDE), 'same')
        # chosen by many lines, or by far: else lines would be chosen for their own noise
        clear = (wide > CLEAR * into) | (near > CLEAR_LINE * into)
        faint = (wide > FAINT * into) & ~clear
        doubt = np.where(faint, gain**2 * wide, 0.0)
        passed = np.where(clear, gain**2 * into, 0.0)
        other = np.where(clear, 0.0, gain**2 * into)
        seen = np.fft.irfft(np.where(clear, spectrum, 0.0), n) + ramp
        still = np.fft.irfft(np.where(clear | faint, 0.0, spectrum), n)
        noise = ChainNoise(out + other + doubt, passed, passed + other, out)
        noise = dataclasses.replace(noise, rounding=rounding_of(whole, noise.typical))
        # the quantity as both ends tell it: the input's noise alone would lower a gain
        share = into / (into + out)
        known = whole + np.fft.irfft(share * np.fft.rfft(segment.measured - whole), n)
        return noise, np.stack([seen, whole - seen, known if gain == 1.0 else whole, still])

    def evened_out(self) -> ChainNoise:
        """The same with noise that is equally loud everywhere, in all recordings."""
        return dataclasses.replace(self, flat=math.sqrt(float(np.mean(self.input + self.output))))

    def coloured(
        self, segment: Segment, colour: Colour, gain: float, inputs: Sequence[Array]
    ) -> Segment:
        """A recording where the noise of both ends together, as this has it, is of a colour.

        Filters act where the signal stands clear of that. What slow noise hides tells nothing,
        and where it is faint, the input's noise is no less than what its quiet bands have told,
        and no more than what quiet windows of all ``inputs``, shapes (n,), have of it.
        """
        noise = colour.power(np.linspace(0.0, 1.0, self.sensor.size)) * self.flat**2
        share = float(np.sum(self.input) / np.sum(self.input + self.output))
        most = gain**2 * input_at_most(inputs, noise / gain**2)
        into = np.maximum(np.minimum(share * noise, most), self.input)
        into = np.where(most < NEARLY * self.input, most, into)  # many windows tell it better
        into = np.minimum(into, MOST_INPUT * noise)
        ends, drive = ChainNoise.of(segment, into / gain**2, noise - into, gain)
        ends = dataclasses.replace(ends, rounding=self.rounding, flat=self.flat)
        return dataclasses.replace(segment, whitener=ends, drive=drive)

    @property
    def doubt(self) -> Array:
        """Variance of what may be signal or noise, by line."""
        return self.sensor - self.output - (self.input - self.passed)

    @property
    def typical(self) -> float:
        """Standard deviation of a sample of the residual."""
        return self.flat or math.sqrt(float(np.mean(self.sensor + self.passed)))

    def __call__(self, residual: Array) -> Array:
        """A residual, shape (n,), in units of its noise."""
        if self.rounding is not None:
            residual = self.rounding(residual)
        if self.flat:
            return residual / self.typical
        return np.asarray(np.fft.irfft(np.fft.rfft(residual) / self.level, residual.size))

    @property
    def level(self) -> Array:
        """Standard deviation of a sample of white noise as loud as each line of the residual."""
        found = np.sqrt(self.sensor + self.passed)
        return np.full_like(found, self.typical) if self.flat else found

    def logarithm(self, count: int) -> float:
        """Logarithm of the noise's determinant over that of ``count`` samples where it is flat."""
        if self.flat:
            return 0.0
        twice = np.full(self.sensor.size, 2.0)
        twice[0] = 1.0
        if count % 2 == 0:
            twice[-1] = 1.0
        return 2.0 * float(twice @ np.log(self.level / self.evened_out().flat))

    def _kept(
        self, terms: Sequence[Term], values: Mapping[str, float], segment: Segment
    ) -> Array | None:
        """Noise that filters leave over noise without them, by line; None without filters."""
        if all(t.name not in ('low_pass_filter', 'ac_coupling') for t in terms):
            return None
        rate = 1.0 / segment.period
        frequency: Array = np.fft.rfftfreq(segment.measured.size, segment.period).astype(
            np.float64
        )
        share = power_passed(terms, values, frequency, rate)
        return np.asarray((self.sensor + share * self.passed) / (self.sensor + self.passed))

    def _cut(
        self, made: Array, terms: Sequence[Term], values: Mapping[str, float]
    ) -> NDArray[np.bool_] | None:
        """Which samples of a prediction are cut off."""
        for term in terms:
            if term.name == 'saturation':
                limit = values[f'{term.label}.limit']
                cut: NDArray[np.bool_] = np.abs(made) >= (1.0 - TINY) * limit
                return cut
        return None

    def _own_louder(self) -> float:
        """Noise of a sample over the output's own, which alone is left where all is cut off."""
        whole = self.input + self.output if self.flat else self.sensor + self.passed
        return math.sqrt(float(np.mean(whole)) / float(np.mean(self.output)))

    def evened(
        self, made: Array, terms: Sequence[Term], values: Mapping[str, float], segment: Segment
    ) -> Array:
        """A prediction whose residual has the same noise as without filters and limits."""
        rest = segment.measured - made
        kept = self._kept(terms, values, segment)
        if kept is not None:
            rest = np.fft.irfft(np.fft.rfft(rest) / np.sqrt(kept), rest.size)
        cut = self._cut(made, terms, values)
        if cut is not None:
            rest = np.where(cut, rest * self._own_louder(), rest)
        elif kept is None:
            return made
        return np.asarray(segment.measured - rest)


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """Noise by line where the quantity is known from both ends."""

    level: Array
    rounding: Rounding | None

    def __call__(self, residual: Array) -> Array:
        if self.rounding is not None:
            residual = self.rounding(residual)
        return np.asarray(np.fft.irfft(np.fft.rfft(residual) / self.level, residual.size))


def settled_ends(model: Model, segments: Sequence[Segment]) -> Settled:
    """How a fit looks with the quantity as both ends tell it.

    Of each line of the residual the share that is the input's noise belongs to the input.
    """

    def settled(made: Fit) -> tuple[Fit, list[Segment]]:
        better, residuals = [], []
        gain = made.values.get('gain', 1.0)
        for i, s in enumerate(segments):
            ends = s.whitener
            assert isinstance(ends, ChainNoise)  # noqa: S101 - as made above
            share = ends.input / (ends.input + ends.output)
            lines = np.fft.rfft(made.residuals[i])
            n = s.measured.size
            clear = ends.passed > 0.0
            still = ~clear & (ends.doubt <= SOME * ends.output)
            drive = s.drive.copy()
            # each part has the noise of its own lines: filters would smooth that of others
            for part, chosen in ((0, clear), (1, ~clear), (3, still)):
                drive[part] += np.fft.irfft(np.where(chosen, share * lines, 0.0), n) / gain
            drive[2] = drive[0] + drive[1]
            rest = np.fft.irfft((1.0 - share) * lines, n)
            level = (1.0 - share) * ends.level
            whitener: Callable[[Array], Array] = _Known(level, ends.rounding)
            known = dataclasses.replace(s, drive=drive, whitener=whitener)
            predicted = model.predict(made.values, made.terms, made.starts[i], known)
            better.append(dataclasses.replace(known, measured=predicted + rest))
            residuals.append(rest)
        return dataclasses.replace(made, residuals=tuple(residuals)), better

    return settled
