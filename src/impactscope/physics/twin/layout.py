"""Where everything stands in the flat arrays of the compiled twin.

Positions and forces point along the sensor's axis, positive where the spring is compressed:
the impactor comes in with positive speed. Zero is the plate's rest position; for the impactor
it is the place at which it just touches the undeformed surface.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# --- state, shape (N_STATES + number of Maxwell branches,) -------------------------------------
X: Final = 0  # plate, m
V: Final = 1  # plate, m/s
P: Final = 2  # impactor at its contact point, m
VP: Final = 3  # m/s
Q: Final = 4  # second mass of a flexible impactor, m
VQ: Final = 5  # m/s
B: Final = 6  # base (fixture, or the moving body part), m
VB: Final = 7  # m/s
H: Final = 8  # Bouc-Wen internal displacement, m
LOST: Final = 9  # energy turned into heat so far, J
WORK: Final = 10  # work done on the bench by drives and by the hammer so far, J
Z: Final = 11  # first dashpot displacement of the layer's Maxwell branches, m
N_STATES: Final = 11
MAX_BRANCHES: Final = 6

# --- parameters, shape (N_PARAMETERS,), longer by a measured force -----------------------------
PLATE_MASS: Final = 0  # kg
STIFFNESS: Final = 1  # N/m
DAMPING: Final = 2  # N s/m
QUADRATIC: Final = 3  # N s^2/m^2
CUBIC: Final = 4  # N/m^3
GAP: Final = 5  # m, whole play; the spring is slack within half of it either side
STOP_TRAVEL: Final = 6  # m
STOP_STIFFNESS: Final = 7  # N/m
HYSTERESIS_SHARE: Final = 8
HYSTERESIS_YIELD: Final = 9  # m
STATIC_FORWARD: Final = 10  # N, friction that resists the start of motion along +x
STATIC_BACKWARD: Final = 11  # N
KINETIC_FORWARD: Final = 12  # N
KINETIC_BACKWARD: Final = 13  # N
STRIBECK_SPEED: Final = 14  # m/s
HAS_LAYER: Final = 15  # 1: damper layer on the plate; 0: bare contact
LAYER_STIFFNESS: Final = 16  # N/m, of the layer's parallel spring
LAYER_STIFFENING: Final = 17  # 1/m
BRANCHES: Final = 18  # number of Maxwell branches
CONTACT_STIFFNESS: Final = 19  # N/m^exponent, of the bare contact
CONTACT_EXPONENT: Final = 20
CONTACT_LOSS: Final = 21  # s/m, Hunt-Crossley
UNILATERAL: Final = 22  # 1: pushes only; 0: glued after first touch
SQUARED: Final = 23  # N s^2/m^2, contact force growing with the approach speed squared
ADDED_MASS: Final = 24  # kg, of a struck medium that moves along while in contact
IMPACTOR_MASS: Final = 25  # kg, of the part that touches; 0: no impactor
SECOND_MASS: Final = 26  # kg, 0: rigid impactor
FLEXURE_STIFFNESS: Final = 27  # N/m
FLEXURE_DAMPING: Final = 28  # N s/m
LOAD: Final = 29  # N, constant force that presses the impactor on the plate
RESTORING: Final = 30  # N/m
LEVER: Final = 31  # m, pendulum's contact distance; 0: small angles
BASE_MASS: Final = 32  # kg, 0: fixed
BASE_STIFFNESS: Final = 33  # N/m
BASE_DAMPING: Final = 34  # N s/m
TAP_PEAK: Final = 35  # N, half-sine force on the plate from time 0 on
TAP_DURATION: Final = 36  # s
PUSH_FORCE: Final = 37  # N, a trapezoid: a robot that pushes on
PUSH_START: Final = 38  # s
PUSH_RISE: Final = 39  # s
PUSH_HOLD: Final = 40  # s, at full force
PUSH_FALL: Final = 41  # s
LIFT_FORCE: Final = 42  # N, a ramp that ends at this force and stays: the impactor is taken away
LIFT_START: Final = 43  # s
LIFT_RISE: Final = 44  # s
CATCH_TIME: Final = 45  # s, from here on the impactor is held where it is once it is off the plate
IMPACT_SPEED: Final = 46  # m/s, at time 0, which is first contact
READS_DISPLACEMENT: Final = 47  # 1: the reading is k x; 0: it is the spring's force
EXCITATION_RATE: Final = 48  # Hz, of a measured force on the plate; 0: none
BRANCH: Final = 49  # stiffness and damping of each branch in turn
N_PARAMETERS: Final = BRANCH + 2 * MAX_BRANCHES
EXCITATION: Final = N_PARAMETERS  # the samples of the measured force, N, follow from here

# --- columns of the output, shape (n_times, N_COLUMNS) -----------------------------------------
READING: Final = 0  # N, what the sensor reads
PLATE_ACCELERATION: Final = 1  # m/s^2
IMPACTOR_ACCELERATION: Final = 2
BASE_ACCELERATION: Final = 3
CONTACT_FORCE: Final = 4  # N
FRICTION_FORCE: Final = 5  # N, on the plate
PLATE_POSITION: Final = 6
PLATE_VELOCITY: Final = 7
IMPACTOR_POSITION: Final = 8
IMPACTOR_VELOCITY: Final = 9
BASE_POSITION: Final = 10
LAYER_COMPRESSION: Final = 11  # m
ENERGY: Final = 12  # J, kinetic and stored
LOST_ENERGY: Final = 13  # J
DONE_WORK: Final = 14  # J
N_COLUMNS: Final = 15
N_LEAN_COLUMNS: Final = 11  # all but the layer and the energies

# --- modes and events --------------------------------------------------------------------------
OPEN: Final = 0
CLOSED: Final = 1
GONE: Final = 2  # no impactor, or one that was caught

CONTACT_BEGINS: Final = 1
CONTACT_ENDS: Final = 2
STICKS: Final = 3
SLIPS: Final = 4
REVERSES: Final = 5
SPRING_REGION: Final = 6  # slack, spring or end stop was entered
CAUGHT: Final = 7


def blank() -> NDArray[np.float64]:
    """A parameter vector with every mechanism absent, shape (N_PARAMETERS,)."""
    vector = np.zeros(N_PARAMETERS)
    vector[STOP_TRAVEL] = np.inf
    vector[HYSTERESIS_YIELD] = 1.0
    vector[STRIBECK_SPEED] = 1.0
    vector[CONTACT_EXPONENT] = 1.5
    vector[PUSH_HOLD] = np.inf
    vector[LIFT_START] = np.inf
    vector[CATCH_TIME] = np.inf
    return vector
