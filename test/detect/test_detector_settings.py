from __future__ import annotations

import math

import pytest

from impactscope.detect import DetectorSettings
from impactscope.errors import ConfigurationError


@pytest.mark.parametrize(
    'wrong',
    [
        {'polarity': 2},
        {'threshold': 0.0},
        {'threshold': math.inf},
        {'hysteresis': 7.0},
        {'samples': 1},
        {'samples': 2.5},
        {'window': -0.01},
        {'memory': 0.1},
        {'natural_frequency': 32.0},
        {'damping_ratio': 1.2, 'natural_frequency': 32.0},
        {'bounce_horizon': math.nan},
    ],
)
def test_what_makes_no_sense_is_refused_by_name(wrong):
    with pytest.raises(ConfigurationError, match=next(iter(wrong))):
        DetectorSettings(**wrong)


def test_the_default_is_valid():
    assert DetectorSettings().release < DetectorSettings().threshold
