"""What simpler methods make of the same campaigns: a re-fitted baseline, sparse regression.

Neither knows of blows by an impactor, so both look at the free motion after taps (or after
the hammer's last pulse), as the bench's paper does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from impactscope.errors import ConfigurationError
from impactscope.recordings import open_recording
from impactscope.records import SampleBlock

__all__ = ['PeerView', 'free_motion', 'peers', 'refit', 'sparse_regression']

Array = NDArray[np.float64]

_SKIP = 0.02  # s after the largest value, in which the blow may still act
_SPAN = 0.35  # s
_TERMS: Mapping[str, Callable[[Array, Array], Array]] = {
    'x': lambda x, _: x,
    'v': lambda _, v: v,
    'sign v': lambda _, v: np.sign(v),
    'v|v|': lambda _, v: v * np.abs(v),
    'x^3': lambda x, _: x**3,
    'x|x|': lambda x, _: x * np.abs(x),
}
_MEANING = {
    'sign v': 'coulomb_friction',
    'v|v|': 'quadratic_damping',
    'x|x|': 'clearance',
}


@dataclass(frozen=True)
class PeerView:
    """What the simple methods say of one campaign."""

    campaign: str
    recordings: int  # free motions looked at
    r_squared: float  # mean of the fits of eq. (26)
    damping_ratio: float  # mean
    damping_spread: float  # standard deviation over recordings, relative
    terms: tuple[str, ...]  # which sparse regression finds beside x and v
    names: tuple[str, ...]  # those terms as mechanisms


def peers(folder: Path) -> PeerView:
    """Both methods on one campaign folder."""
    described = yaml.safe_load((folder / 'campaign.yaml').read_text())
    motions = []
    for entry in described['recordings']:
        if entry.get('kind', 'driven') in ('tap', 'driven'):
            motion = free_motion(folder / entry['file'])
            if motion is not None:
                motions.append(motion)
    fits = [refit(t, values) for t, values, _ in motions]
    found = sparse_regression(motions) if motions else ()
    ratios = np.array([f[1] for f in fits])
    names = {_meaning(term, weight) for term, weight in found}
    return PeerView(
        folder.name,
        len(fits),
        float(np.mean([f[0] for f in fits])) if fits else float('nan'),
        float(ratios.mean()) if fits else float('nan'),
        float(ratios.std(ddof=1) / ratios.mean()) if len(fits) > 1 else float('nan'),
        tuple(term for term, _ in found),
        tuple(sorted(names)),
    )


def free_motion(path: Path) -> tuple[Array, Array, float] | None:
    """Times from 0 s, values and rate of the free vibration in a recording.

    Of the force channel, else of the plate's acceleration; None where neither is recorded or
    too little of it is left.
    """
    channels: dict[str, list[SampleBlock]] = {}
    with open_recording(path) as recording:
        for _, _, record in recording.records(None):
            if isinstance(record, SampleBlock):
                channels.setdefault(record.channel, []).append(record)
    for name in ('force', 'acceleration.plate'):
        if name not in channels:
            continue
        rate = channels[name][0].sample_rate
        values = np.concatenate([b.values for b in channels[name]]).astype(np.float64)
        first = int(np.argmax(np.abs(values))) + round(_SKIP * rate)
        values = values[first : first + round(_SPAN * rate)]
        if values.size < 64:
            return None
        return np.arange(values.size) / rate, values, rate
    return None


def refit(t: Array, values: Array) -> tuple[float, float]:
    """R² and damping ratio of the decaying cosine of eq. (26), by least squares.

    The two linear amplitudes and the offset are solved for inside (variable projection).
    """
    spectrum = np.abs(np.fft.rfft(values - values.mean(), 8 * values.size))
    omega = 2 * np.pi * np.argmax(spectrum) / (8 * values.size * (t[1] - t[0]))

    def residual(shape: Array) -> Array:
        decay = np.exp(-shape[0] * t)
        basis = np.stack(
            [decay * np.cos(shape[1] * t), decay * np.sin(shape[1] * t), np.ones_like(t)], 1
        )
        result: Array = values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]
        return result

    fit = least_squares(residual, [0.05 * omega, omega], x_scale=[0.05 * omega, omega])
    rest = float(np.sum(fit.fun**2))
    spread = float(np.sum((values - values.mean()) ** 2))
    return 1 - rest / spread, float(fit.x[0] / np.hypot(fit.x[0], fit.x[1]))


def sparse_regression(
    motions: list[tuple[Array, Array, float]], share: float = 0.02
) -> tuple[tuple[str, float], ...]:
    """Terms beside x and v that PySINDy keeps in the equation of the acceleration.

    State x, v from a smoothing derivative (Savitzky and Golay), scaled by their largest;
    sequentially thresholded least squares (Brunton, Proctor, Kutz, PNAS 113, 2016) over all
    motions and columns of unit norm; a term stays while it carries at least ``share`` of the
    acceleration's norm.

    Raises ConfigurationError where PySINDy is not installed.
    """
    try:
        pysindy: Any = import_module('pysindy')
    except ImportError as error:
        raise ConfigurationError('sparse regression needs PySINDy: pip install pysindy') from error
    derived = [_derivatives(values, rate) for _, values, rate in motions]
    scales = [max(float(np.abs(d[:, i]).max()) for d in derived) for i in range(2)]
    pull = math.sqrt(sum(float(d[:, 2] @ d[:, 2]) for d in derived))
    states = [d[:, :2] / scales for d in derived]
    slopes = [np.stack([s[:, 1], d[:, 2] / pull], 1) for s, d in zip(states, derived, strict=True)]
    model = pysindy.SINDy(
        optimizer=pysindy.STLSQ(threshold=share, alpha=0, normalize_columns=True),
        feature_library=pysindy.CustomLibrary(library_functions=list(_TERMS.values())),
    )
    model.fit(states, t=1 / motions[0][2], x_dot=slopes)
    weights = np.asarray(model.coefficients(), dtype=np.float64)[1]
    return tuple(
        (name, float(w))
        for name, w in zip(_TERMS, weights, strict=True)
        if w != 0 and name not in ('x', 'v')
    )


def _derivatives(values: Array, rate: float) -> Array:
    """Displacement, speed and acceleration, shape (n, 3), about the place of rest."""
    window = max(5, round(0.006 * rate) | 1)
    derived = [savgol_filter(values, window, 4, deriv=d, delta=1 / rate) for d in range(3)]
    derived[0] -= np.mean(derived[0][-values.size // 4 :])
    inside: Array = np.stack(derived, 1)[window:-window]
    return inside


def _meaning(term: str, weight: float) -> str:
    if term == 'x^3':
        return 'softening_spring' if weight > 0 else 'hardening_spring'
    return _MEANING[term]
