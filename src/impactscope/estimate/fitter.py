"""The stage that tells from each blow what the sensor is."""

from __future__ import annotations

from impactscope.estimate.sensor_parameters import FitterSettings, estimate_sensor
from impactscope.records import ImpactEvent, SensorParameters

__all__ = ['Fitter', 'FitterSettings']


class Fitter:
    """Stage: events in, sensor parameters out; keeps no state between blows."""

    def __init__(self, settings: FitterSettings | None = None) -> None:
        self.settings = FitterSettings() if settings is None else settings

    def push(self, record: ImpactEvent) -> list[SensorParameters]:
        """Fit one blow; always one result, which may say that the blow cannot tell."""
        return [estimate_sensor(record, self.settings)]

    def flush(self) -> list[SensorParameters]:
        """Nothing is ever open."""
        return []
