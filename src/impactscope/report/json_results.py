"""The result of an analysis as JSON: every number with its unit in the field's name or record.

Numbers that are not finite become null; samples are left out, since the recording has them.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Any

import numpy as np

from impactscope.records import AnalysisResult, Estimate, Quality

__all__ = ['SCHEMA_VERSION', 'to_json']

SCHEMA_VERSION = 1


def to_json(result: AnalysisResult) -> dict[str, Any]:
    """Plain dictionaries, lists, texts and numbers, ready for ``json.dumps``."""
    return {'schema_version': SCHEMA_VERSION, **_plain(result)}


def _plain(value: Any) -> Any:
    if isinstance(value, Quality):
        return [flag.name for flag in value]
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, Estimate):
        return {'value': _plain(value.value), 'std': _plain(value.std)}
    if dataclasses.is_dataclass(value):
        return {
            item.name: _plain(getattr(value, item.name))
            for item in dataclasses.fields(value)
            if not isinstance(getattr(value, item.name), np.ndarray)
        }
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value
