"""What a sensor's dynamics make of the blow's contact time: how far its reading can be believed.

A statement beside the verdict, not part of it: the limits presume the reading of the device as
it is. See :func:`impactscope.physics.shock_response.peak_ratio`.
"""

from __future__ import annotations

import math

from impactscope.physics.shock_response import peak_ratio
from impactscope.records import ImpactEvent, SensorParameters

__all__ = ['validity_statement']

# Natural periods of contact beyond which the reading follows the force: a half-sine this long
# is read within 1 %, and the closed form would only be evaluated at great length.
LONG_CONTACT = 20.0


def validity_statement(event: ImpactEvent, sensor: SensorParameters | None) -> list[str]:
    """At most one sentence on over- or under-reading of the first contact, as a half-sine."""
    if sensor is None or not sensor.valid or not event.contacts:
        return []
    frequency, damping = sensor.natural_frequency.value, sensor.damping_ratio.value
    contact_time = event.contacts[0].end - event.contacts[0].start
    known = math.isfinite(frequency) and math.isfinite(damping) and math.isfinite(contact_time)
    if not known or frequency <= 0 or damping < 0 or contact_time <= 0:
        return []
    ratio = contact_time * frequency
    reading = peak_ratio(damping, ratio) if ratio < LONG_CONTACT else 1.0
    if abs(reading - 1) < 0.02:
        effect = 'reads within 2 % of the contact force'
    elif reading > 1:
        effect = f'over-reads, by a factor of {reading:.2f}'
    else:
        effect = f'under-reads, by a factor of {reading:.2f}'
    return [
        f'Validity: a half-sine contact of {contact_time * 1e3:.1f} ms, the first of the blow, on '
        f'this sensor ({frequency:.1f} Hz, damping ratio {damping:.3f}) {effect}.'
    ]
