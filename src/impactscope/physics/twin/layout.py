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
CUBIC: Final = 3  # N/m^3
GAP: Final = 4  # m, whole play; the spring is slack within half of it either side
STOP_TRAVEL: Final = 5  # m
STOP_STIFFNESS: Final = 6  # N/m
HYSTERESIS_SHARE: Final = 7
HYSTERESIS_YIELD: Final = 8  # m
STATIC_FORWARD: Final = 9  # N, friction that resists the start of motion along +x
STATIC_BACKWARD: Final = 10  # N
KINETIC_FORWARD: Final = 11  # N
KINETIC_BACKWARD: Final = 12  # N
STRIBECK_SPEED: Final = 13  # m/s
HAS_LAYER: Final = 14  # 1: damper layer on the plate; 0: bare contact
LAYER_STIFFNESS: Final = 15  # N/m, of the layer's parallel spring
LAYER_STIFFENING: Final = 16  # 1/m
BRANCHES: Final = 17  # number of Maxwell branches
CONTACT_STIFFNESS: Final = 18  # N/m^exponent, of the bare contact
CONTACT_EXPONENT: Final = 19
CONTACT_LOSS: Final = 20  # s/m, Hunt-Crossley, of the contact that is or was
UNILATERAL: Final = 21  # 1: pushes only; 0: glued after first touch
IMPACTOR_MASS: Final = 22  # kg, of the part that touches; 0: no impactor
SECOND_MASS: Final = 23  # kg, 0: rigid impactor
FLEXURE_STIFFNESS: Final = 24  # N/m
FLEXURE_DAMPING: Final = 25  # N s/m
LOAD: Final = 26  # N, constant force that presses the impactor on the plate
RESTORING: Final = 27  # N/m
LEVER: Final = 28  # m, pendulum's contact distance; 0: small angles
BASE_MASS: Final = 29  # kg, 0: fixed
BASE_STIFFNESS: Final = 30  # N/m
BASE_DAMPING: Final = 31  # N s/m
TAP_PEAK: Final = 32  # N, half-sine force on the plate from time 0 on
TAP_DURATION: Final = 33  # s
PUSH_FORCE: Final = 34  # N, a trapezoid: a robot that pushes on
PUSH_START: Final = 35  # s
PUSH_RISE: Final = 36  # s
PUSH_HOLD: Final = 37  # s, at full force
PUSH_FALL: Final = 38  # s
LIFT_FORCE: Final = 39  # N, a ramp that ends at this force and stays: the impactor is taken away
LIFT_START: Final = 40  # s
LIFT_RISE: Final = 41  # s
CATCH_TIME: Final = 42  # s, from here on the impactor is held where it is once it is off the plate
IMPACT_SPEED: Final = 43  # m/s, at time 0, which is first contact
READS_DISPLACEMENT: Final = 44  # 1: the reading is k x; 0: it is the spring's force
EXCITATION_RATE: Final = 45  # Hz, of a measured force on the plate; 0: none
LOSS_BY_SPEED: Final = 46  # loss times approach speed of every contact; 0: one loss for all
BRANCH: Final = 47  # stiffness and damping of each branch in turn
OWN: Final = BRANCH + 2 * MAX_BRANCHES  # parameters of mechanisms that bring their own term
OWN_WIDTH: Final = 4
MAX_OWN: Final = 10
N_PARAMETERS: Final = OWN + OWN_WIDTH * MAX_OWN
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


def _blank() -> NDArray[np.float64]:
    vector = np.zeros(N_PARAMETERS)
    vector[STOP_TRAVEL] = np.inf
    vector[HYSTERESIS_YIELD] = 1.0
    vector[STRIBECK_SPEED] = 1.0
    vector[CONTACT_EXPONENT] = 1.5
    vector[PUSH_HOLD] = np.inf
    vector[LIFT_START] = np.inf
    vector[CATCH_TIME] = np.inf
    return vector


_BLANK = _blank()


def blank() -> NDArray[np.float64]:
    """A parameter vector with every mechanism absent, shape (N_PARAMETERS,)."""
    return _BLANK.copy()
