"""The highest speed at which an impactor would keep a limit, from one blow of known speed.

Contact forces grow in proportion to speed as long as the contact is linear: F = v sqrt(k mu),
eq. A3 of Samarathunga et al., Machines 2024, 12, 26. The blow itself has measured the root, damper
layer, device and effective mass together, so neither needs to be known apart.
"""

from __future__ import annotations

import math

from impactscope.records import ComplianceVerdict, Estimate, ImpactParameters

__all__ = ['highest_speed']


def highest_speed(impact: ImpactParameters, verdict: ComplianceVerdict) -> Estimate:
    """Speed, m/s, at which the blow's transient force would be the transient limit.

    For the same impactor, pose and device; NaN where speed, force or limit is not known. It is an
    extrapolation: a robot that reacts to the contact, or a layer that stiffens, departs from it.
    """
    speed, force = impact.impact_speed, verdict.transient_force
    if not (speed.value > 0 and force.value > 0 and verdict.transient_limit > 0):
        return Estimate()
    value = speed.value * verdict.transient_limit / force.value
    return Estimate(value, value * math.hypot(speed.std / speed.value, force.std / force.value))
