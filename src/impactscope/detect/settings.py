"""Parameters of the impact detector: no force threshold among them, only sigma, N and times."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from impactscope.errors import ConfigurationError

__all__ = ['DetectorSettings']


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """How blows are told from noise; times in s, thresholds in standard deviations.

    Raises ConfigurationError on construction where a value is out of its range.
    """

    channel: str = ''  # in which blows are looked for; '' is the reference, channel 0
    polarity: int = 1  # sign of a blow in that channel: +1, -1, or 0 for either
    threshold: float = 6.5  # sigma of the detection statistic at which a blow is there
    hysteresis: float = 1.5  # sigma below the threshold at which the signal is quiet again
    samples: int = 4  # N, length of the shortest averaging window: a blow lasts that long
    window: float = 0.01  # longest averaging window, and the step of the analysis
    learning_time: float = 0.2  # of quiet signal, from which a noise floor is learned
    memory: float = 1.0  # of quiet signal that the noise floor and its drift rest on
    bounce_horizon: float = 0.7  # a contact later than this after the last one is a new blow
    natural_frequency: float = math.nan  # Hz, of the sensor's plate; NaN: learned from blows
    damping_ratio: float = math.nan  # of the sensor's plate; NaN: learned from blows

    def __post_init__(self) -> None:
        optional = ('natural_frequency', 'damping_ratio')
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name in {'channel', 'polarity'} or (
                item.name in optional and math.isnan(value)
            ):
                continue
            if not math.isfinite(value) or value <= 0:
                raise ConfigurationError(
                    f'detector: {item.name} is {value!r}; it must be finite and above zero'
                )
        if self.polarity not in {-1, 0, 1}:
            raise ConfigurationError(f'detector: polarity is {self.polarity!r}; -1, 0 or 1')
        if self.hysteresis >= self.threshold:
            raise ConfigurationError(
                f'detector: hysteresis is {self.hysteresis!r} sigma; '
                f'it must be below the threshold of {self.threshold!r} sigma'
            )
        if self.samples != int(self.samples) or self.samples < 2:
            raise ConfigurationError(
                f'detector: samples is {self.samples!r}; a whole number, at least 2, is needed'
            )
        if self.memory < self.learning_time:
            raise ConfigurationError(
                f'detector: memory is {self.memory!r} s; '
                f'it must not be below the learning_time of {self.learning_time!r} s'
            )
        if math.isnan(self.natural_frequency) != math.isnan(self.damping_ratio):
            raise ConfigurationError(
                'detector: natural_frequency and damping_ratio are given together or not at all'
            )
        if self.damping_ratio >= 1:
            raise ConfigurationError(
                f'detector: damping_ratio is {self.damping_ratio!r}; it must be below 1'
            )

    @property
    def release(self) -> float:
        """Sigma below which the signal counts as quiet."""
        return self.threshold - self.hysteresis
