"""Numbers of the paper that its own further computations start from.

Source: Samarathunga et al., Considerations on the Dynamics of Biofidelic Sensors in the
Assessment of Human-Robot Impacts, Machines 2024, 12, 26, doi:10.3390/machines12010026.
"""

from __future__ import annotations

import math

__all__ = [
    'BANDWIDTH_DAMPING',
    'BANDWIDTH_FREQUENCY',
    'DAMPING_RATIO',
    'MASS_DISTANCES',
    'NATURAL_ANGULAR_FREQUENCY',
    'RELEASE_ANGLE',
    'SPRING_STIFFNESS',
    'SPRING_TEST_SPEED',
]

NATURAL_ANGULAR_FREQUENCY = 203.2  # rad/s, section 3.1.1
DAMPING_RATIO = 0.0692
SPRING_STIFFNESS = 69e3  # N/m, measured
SPRING_TEST_SPEED = 1e-3 / 60  # m/s: 1 mm/min
BANDWIDTH_FREQUENCY = 32.37  # Hz and the damping ratio from which it computes eq. 28
BANDWIDTH_DAMPING = 0.07
MASS_DISTANCES = (0.0, 0.05, 0.10, 0.15, 0.20, 0.25)  # m, section 3.2
RELEASE_ANGLE = math.radians(10.0)
