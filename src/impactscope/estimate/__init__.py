"""Stages that estimate: samples in, values with standard uncertainties out."""

from impactscope.estimate.fitter import Fitter
from impactscope.estimate.highest_speed import highest_speed
from impactscope.estimate.impact_parameters import (
    ImpactEstimator,
    ImpactSettings,
    estimate_impact,
)
from impactscope.estimate.repeated_blows import RepeatedBlows
from impactscope.estimate.sensor_parameters import FitterSettings, estimate_sensor

__all__ = [
    'Fitter',
    'FitterSettings',
    'ImpactEstimator',
    'ImpactSettings',
    'RepeatedBlows',
    'estimate_impact',
    'estimate_sensor',
    'highest_speed',
]
