"""What a judgement demands beyond the measurement profile: device, rate, statements."""

from __future__ import annotations

import math
from dataclasses import dataclass

from impactscope.errors import ConfigurationError
from impactscope.records import Estimate, SensorParameters, TestPoint

__all__ = ['STATEMENTS', 'JudgementRules', 'unstated']

# Fields of a test point whose absence can be asked for, and what they are called in sentences.
STATEMENTS: dict[str, str] = {
    'robot': 'robot',
    'tool': 'tool and payload',
    'pose': 'pose',
    'speed': 'speed',
    'device': 'measuring device',
    'spring_stiffness': "stiffness of the device's spring",
    'damper': 'damper layer',
}


@dataclass(frozen=True, slots=True)
class JudgementRules:
    """Demands on device and documentation; proposed by this project, not taken from a standard.

    Raises ConfigurationError on construction where a value is out of its range.
    """

    force_channel: str = 'force'  # the reading of a measuring device for contact forces
    minimum_sample_rate: float = 1000.0  # Hz; devices on the market state 1 kHz and more
    spring_tolerance: float = 0.1  # relative; a softer spring reads too low to be judged
    required_statements: tuple[str, ...] = tuple(STATEMENTS)  # for the verdict of a test point
    natural_frequency: float = math.nan  # Hz, of the device's plate; NaN: no validity statement
    damping_ratio: float = math.nan  # of the device's plate; NaN: no statement of validity

    def __post_init__(self) -> None:
        if not self.force_channel:
            raise ConfigurationError('judgement rules: force_channel is empty; a name is needed')
        if not math.isfinite(self.minimum_sample_rate) or self.minimum_sample_rate <= 0:
            raise ConfigurationError(
                f'judgement rules: minimum_sample_rate is {self.minimum_sample_rate} Hz; '
                'a finite number above zero is needed'
            )
        if not 0 <= self.spring_tolerance < 1:
            raise ConfigurationError(
                f'judgement rules: spring_tolerance is {self.spring_tolerance}; '
                'zero or more and below 1 is needed'
            )
        for name, value in (
            ('natural_frequency', self.natural_frequency),
            ('damping_ratio', self.damping_ratio),
        ):
            if math.isinf(value) or value < 0:
                raise ConfigurationError(
                    f'judgement rules: {name} is {value}; it must be above zero, or NaN'
                )
        unknown = [name for name in self.required_statements if name not in STATEMENTS]
        if unknown:
            raise ConfigurationError(
                f'judgement rules: required_statements has {unknown[0]!r}; '
                f'known are {", ".join(STATEMENTS)}'
            )

    @property
    def sensor(self) -> SensorParameters | None:
        """The device as far as these rules know it; None where they do not."""
        if math.isnan(self.natural_frequency) or math.isnan(self.damping_ratio):
            return None
        return SensorParameters(
            event_id=0,
            stamp_ns=0,
            valid=True,
            method='stated',
            natural_frequency=Estimate(self.natural_frequency),
            damping_ratio=Estimate(self.damping_ratio),
        )


def unstated(test_point: TestPoint, names: tuple[str, ...]) -> tuple[str, ...]:
    """Which of these fields of a test point are empty or NaN, as called in sentences."""
    missing = []
    for name in names:
        value = getattr(test_point, name)
        if (isinstance(value, str) and not value.strip()) or (
            isinstance(value, float) and not math.isfinite(value)
        ):
            missing.append(STATEMENTS[name])
    return tuple(missing)
