"""A structure of several modes with nonlinear elements at places of it, as a model of recordings.

In modal coordinates q, of modal mass one, with the input u at the driven place and the force n of
an element at another one, a local law of its displacement z and its speed::

    q_k'' + 2 zeta_k omega_k q_k' + sum_j C_kj q_j' + omega_k^2 q_k = d_k u + w_k n
    z = sum_k w_k q_k,    y_i = sum_k f_ik q_k + r_i u

``r``: what modes beyond the recorded band add to an output. Damping that couples modes is
symmetric. Where the driven place is one of the outputs d = f of that output, and w is f of the
element's place. Else modal masses are not known: modes are counted with d = 1, and n acts on each
by w times a number of its own, that of the first mode being one.
Source: Ewins, Modal Testing (2000), ch. 2; Masri and Caughey, J. Appl. Mech. 46 (1979).
"""

from __future__ import annotations

import itertools
import math
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from impactscope.discrepancy.driven.models import parameter_layout as at
from impactscope.discrepancy.driven.models.equation_of_motion import run_modes
from impactscope.discrepancy.driven.models.mechanical_effects import (
    enter,
    with_slots_that_follow,
)
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Number, Term

__all__ = [
    'Place',
    'StructureModel',
    'coupling',
    'damping_ratio',
    'direct',
    'frequency',
    'hidden_shape',
    'mobility',
    'shape',
]

Array = NDArray[np.float64]
_Motions = dict[tuple[str, int], OrderedDict[object, tuple[Array, Array]]]

STEP_ANGLE = 0.12  # rad of the highest mode in a step beside elements: order 2 in that
KEPT = 4  # motions of a recording that are kept


def frequency(mode: int) -> str:
    """Name of the natural frequency of a mode, which counts from 0."""
    return f'mode_{mode + 1}.frequency'


def damping_ratio(mode: int) -> str:
    """Name of its damping ratio."""
    return f'mode_{mode + 1}.damping_ratio'


def shape(mode: int, channel: str) -> str:
    """Name of a mode's displacement at an output, of modal mass one."""
    return f'mode_{mode + 1}.{channel}'


def hidden_shape(mode: int) -> str:
    """An element's number for the shape of a further mode at a place that no output shows."""
    return f'shape_{mode + 1}'


def mobility(mode: int) -> str:
    """An element's number for how much less a further mode resists it, over the first mode."""
    return f'mobility_{mode + 1}'


def coupling(one: int, other: int) -> str:
    """Name of the damping that couples two modes."""
    return f'damping_{one + 1}_{other + 1}'


def direct(channel: str) -> str:
    """Name of the part of an output that goes with the input itself."""
    return f'direct.{channel}'


@dataclass(frozen=True, slots=True)
class Place:
    """Where an element acts: the displacement of one output, or of that against another's.

    Without a channel it is where no output is: then an element has numbers for its modal shape.
    """

    words: str
    channel: str = ''
    against: str = ''
    reversed: bool = False  # counted the other way

    def row(self, drive: Array, shapes: Mapping[str, Array], own: Mapping[str, float]) -> Array:
        """Its displacement by modal coordinates, shape (n_modes,).

        Args:
            drive: modal shape of the driven place.
            shapes: those of the outputs.
            own: numbers of the element; of a hidden place its shape over that of the driven one,
                and over that of the first mode.
        """
        if self.channel:
            row = shapes[self.channel]
            if self.against:
                row = row - shapes[self.against]
        else:
            row = drive * [1.0, *(own[hidden_shape(k)] for k in range(1, drive.size))]
        return -row if self.reversed else row


@dataclass(frozen=True, eq=False)
class StructureModel:
    """Modes that an input drives at the place of one output, with elements at places."""

    numbers: tuple[Number, ...]
    terms: tuple[Term, ...]
    channels: tuple[str, ...]
    driven: str  # channel of the driven place; empty where no output is there
    modes: int
    places: Mapping[str, Place]  # by the variant of a term
    _last: _Motions = field(default_factory=dict, repr=False)  # of each recording, in each thread

    @property
    def drifts(self) -> bool:
        """Modes come back."""
        return False

    def starts(self, segment: Segment) -> tuple[Number, ...]:  # noqa: ARG002
        """Recordings of a structure begin at rest."""
        return ()

    def shapes(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Modal shapes at the outputs, each shape (n_modes,)."""
        return {
            c: np.array([values[shape(k, c)] for k in range(self.modes)]) for c in self.channels
        }

    def matrices(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Modal stiffness (n_modes,) and damping (n_modes, n_modes) of modal mass one."""
        omega = 2.0 * np.pi * np.array([values[frequency(k)] for k in range(self.modes)])
        ratio = np.array([values[damping_ratio(k)] for k in range(self.modes)])
        damping = np.diag(2.0 * ratio * omega)
        for one, other in itertools.combinations(range(self.modes), 2):
            damping[one, other] = damping[other, one] = values.get(coupling(one, other), 0.0)
        return omega**2, damping

    def answer(
        self, values: Mapping[str, float], channel: str, derivative: int, place: Array
    ) -> NDArray[np.complex128]:
        """Answer of an output to the input at frequencies, Hz, without elements; shape (m,)."""
        stiffness, damping = self.matrices(values)
        shapes = self.shapes(values)
        s = 2.0j * np.pi * place[:, None, None]
        dynamic = s**2 * np.eye(self.modes) + s * damping + np.diag(stiffness)
        moved = np.linalg.solve(dynamic, self.drive(shapes)[:, None])[:, :, 0] @ shapes[channel]
        return np.asarray(moved * s[:, 0, 0] ** derivative + values[direct(channel)])

    def drive(self, shapes: Mapping[str, Array]) -> Array:
        """Modal shape of the driven place, (n_modes,)."""
        return shapes[self.driven] if self.driven else np.ones(self.modes)

    def _elements(
        self, values: Mapping[str, float], terms: tuple[Term, ...], shapes: Mapping[str, Array]
    ) -> tuple[Array, Array, Array]:
        """Parameters of the elements, (l, SIZE); their places and pushes, (l, n_modes)."""
        p = np.zeros((len(terms), at.SIZE))
        places, pushes = np.zeros((2, len(terms), self.modes))
        drive = self.drive(shapes)
        for i, term in enumerate(terms):
            mine = {k: v for k, v in values.items() if k.partition('.')[0] == term.label}
            enter(p[i], {**mine, **(term.fixed or {})})
            own = {k.partition('.')[2]: v for k, v in mine.items()}
            places[i] = pushes[i] = self.places[term.variant].row(drive, shapes, own)
            if not self.driven:
                pushes[i] = places[i] * [
                    1.0,
                    *(own[mobility(k)] for k in range(1, self.modes)),
                ]
            with_slots_that_follow(p[i])
        return p, places, pushes

    def modal_motion(
        self, values: Mapping[str, float], terms: tuple[Term, ...], segment: Segment
    ) -> tuple[Array, Array]:
        """Modal positions, speeds and accelerations, (n, 3 n_modes), and the input, (n,)."""
        labels, numbers = tuple(t.label for t in terms), tuple(sorted(values.items()))
        state = segment.begin, segment.measured.size, labels, numbers
        # outputs of a recording ask for the same motions in turn; fits go on side by side
        kept = self._last.setdefault((segment.recording, threading.get_ident()), OrderedDict())
        if state in kept:
            kept.move_to_end(state)
            return kept[state]
        n, count = self.modes, len(terms)
        stiffness, damping = self.matrices(values)
        shapes = self.shapes(values)
        p, places, pushes = self._elements(values, terms, shapes)
        drive = self.drive(shapes)
        step = 2.0 * segment.period / (segment.drive.shape[1] - 1)
        turn = math.sqrt(float(np.max(stiffness))) * step
        parts = math.ceil(turn / STEP_ANGLE) if count else 1
        a, b, c = _propagators(stiffness, damping, drive, pushes, step / parts)
        moved = np.zeros((segment.measured.size, 2 * n))
        pull = np.zeros((segment.measured.size, count))
        run_modes(a, b, c, places, p, segment.drive, parts, moved, pull)
        given = np.append(segment.drive[:, 0], segment.drive[-1, -1])
        force = given[:, None] * drive + pull @ pushes
        accelerations = force - moved[:, :n] * stiffness - moved[:, n:] @ damping
        made = np.concatenate([moved, accelerations], axis=1)
        kept[state] = made, given
        if len(kept) > KEPT:
            kept.popitem(last=False)
        return made, given

    def predict(
        self,
        values: Mapping[str, float],
        terms: tuple[Term, ...],
        start: Array,  # noqa: ARG002
        segment: Segment,
    ) -> Array:
        """Predicted channel, shape (n,)."""
        moved, given = self.modal_motion(values, terms, segment)
        n = self.modes
        mine = moved[:, segment.derivative * n : (segment.derivative + 1) * n]
        predicted = mine @ self.shapes(values)[segment.channel]
        return np.asarray(predicted + values[direct(segment.channel)] * given, np.float64)

    def motion(
        self,
        values: Mapping[str, float],
        terms: tuple[Term, ...],
        start: Array,  # noqa: ARG002
        segment: Segment,
    ) -> tuple[Array, Array]:
        """Position and speed of the place where the first element acts, else of the output."""
        if not terms:
            return self.at(self.shapes(values)[segment.channel], values, terms, segment)
        _, places, _ = self._elements(values, terms, self.shapes(values))
        return self.at(places[0], values, terms, segment)

    def at(
        self, row: Array, values: Mapping[str, float], terms: tuple[Term, ...], segment: Segment
    ) -> tuple[Array, Array]:
        """Position and speed of a place given by its modal shape, shapes (n,)."""
        moved, _ = self.modal_motion(values, terms, segment)
        n = self.modes
        return moved[:, :n] @ row, moved[:, n : 2 * n] @ row


def _propagators(
    stiffness: Array, damping: Array, drive: Array, pushes: Array, dt: float
) -> tuple[Array, Array, Array]:
    """Exact steps of the modes, see :func:`.equation_of_motion.run_modes`.

    From one exponential: columns of the input are followed by its first and second derivatives.
    """
    n = stiffness.size
    inputs = np.column_stack([drive, *pushes])
    count = inputs.shape[1]
    whole = np.zeros((2 * n + 3 * count, 2 * n + 3 * count))
    whole[:n, n : 2 * n] = np.eye(n)
    whole[n : 2 * n, :n] = -np.diag(stiffness)
    whole[n : 2 * n, n : 2 * n] = -damping
    whole[n : 2 * n, 2 * n : 2 * n + count] = inputs
    whole[2 * n : 2 * n + 2 * count, 2 * n + count :] = np.eye(2 * count) / dt
    made = expm(whole * dt)[: 2 * n]
    by_value, by_rise, by_bend = np.split(made[:, 2 * n :], 3, axis=1)
    # f(s) = f0 + s f' + s^2/2 f'' with s in steps: value, rise and bend from values at nodes
    b = np.column_stack(
        [
            by_value[:, 0] - 3.0 * by_rise[:, 0] + 4.0 * by_bend[:, 0],
            4.0 * by_rise[:, 0] - 8.0 * by_bend[:, 0],
            4.0 * by_bend[:, 0] - by_rise[:, 0],
        ]
    )
    c = np.stack([by_value[:, 1:] - by_rise[:, 1:], by_rise[:, 1:]], axis=-1).transpose(1, 0, 2)
    return np.ascontiguousarray(made[:, : 2 * n]), b, np.ascontiguousarray(c)
