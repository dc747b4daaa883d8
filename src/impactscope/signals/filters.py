"""Channel frequency classes of impact measurement (SAE J211-1, ISO 6487)."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import butter, sosfiltfilt

from impactscope.errors import ConfigurationError, InputError

__all__ = ['CHANNEL_CLASSES', 'Standard', 'channel_class_filter', 'design_frequency']

Standard = Literal['SAE J211', 'ISO 6487']

CHANNEL_CLASSES = (60, 180, 600, 1000)
_DESIGN_FACTOR = {'SAE J211': 2.0775, 'ISO 6487': 25 / 12}
_LOWEST_OVERSAMPLING = 2.5  # of the design frequency; nearer to Nyquist the class loses its shape


def design_frequency(channel_class: int, standard: Standard = 'SAE J211') -> float:
    """Cut-off of one of the two passes in Hz: 2.0775 (SAE J211) or 25/12 (ISO 6487) x CFC.

    Raises ConfigurationError for an unknown class or standard.
    """
    if channel_class not in CHANNEL_CLASSES:
        known = ', '.join(map(str, CHANNEL_CLASSES))
        raise ConfigurationError(f'channel class {channel_class} is unknown; known are {known}')
    if standard not in _DESIGN_FACTOR:
        known = ', '.join(_DESIGN_FACTOR)
        raise ConfigurationError(f'standard {standard!r} is unknown; known are {known}')
    return _DESIGN_FACTOR[standard] * channel_class


def channel_class_filter(
    values: ArrayLike,
    sample_rate: float,
    channel_class: int,
    standard: Standard = 'SAE J211',
) -> NDArray[np.float64]:
    """Filter a signal by channel frequency class, without phase shift.

    A two-pole Butterworth low-pass, run forward and backward. The whole is 3 dB down at about
    5/3 of the class in Hz: 100, 300, 1000 and 1650 Hz. Both ends are extended by an odd
    reflection over a hundred milliseconds of CFC 60 (in proportion for the others), or as much
    as there is, in which the filter has settled.

    Args:
        values: shape (..., n_samples), in any unit; time runs along the last axis.
        sample_rate: Hz.
        channel_class: one of 60, 180, 600, 1000.
        standard: whose design frequency.

    Returns:
        The shape and unit of ``values``, float64.

    Raises:
        ConfigurationError: unknown class or standard.
        InputError: values are not finite or fewer than two, or the rate is too low for the class.
    """
    cutoff = design_frequency(channel_class, standard)
    x = np.asarray(values, dtype=np.float64)
    if x.ndim == 0 or x.shape[-1] < 2:
        raise InputError(f'values have shape {x.shape}; at least two samples are needed')
    if not np.isfinite(x).all():
        raise InputError('values contain NaN or inf; a filter would spread them over all samples')
    if not (math.isfinite(sample_rate) and sample_rate >= _LOWEST_OVERSAMPLING * cutoff):
        raise InputError(
            f'sample rate {sample_rate} Hz is too low for CFC {channel_class}; '
            f'at least {_LOWEST_OVERSAMPLING * cutoff:.0f} Hz are needed'
        )
    sections = butter(2, cutoff, fs=sample_rate, output='sos')
    settled = math.ceil(0.1 * 60 / channel_class * sample_rate)
    padding = min(settled, x.shape[-1] - 1)
    filtered: NDArray[np.float64] = sosfiltfilt(
        sections, x, axis=-1, padtype='odd', padlen=padding
    )
    return filtered
