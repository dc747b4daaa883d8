"""Finding blows in a stream: noise floor, trigger, contacts, rest."""

from impactscope.detect.impact_detector import DetectorStatistics, ImpactDetector
from impactscope.detect.settings import DetectorSettings

__all__ = ['DetectorSettings', 'DetectorStatistics', 'ImpactDetector']
