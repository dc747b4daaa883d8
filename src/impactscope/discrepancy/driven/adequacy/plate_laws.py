"""Laws that no known effect describes, as small forces on a plate or a mass.

Forces of position and speed, forces with a memory, stiffness that changes in time or from
recording to recording, further modes, readings that are not straight. Each acts on the fitted
plate, whose linear answer is simulated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.adequacy.cogging import periods_to_try
from impactscope.discrepancy.driven.adequacy.swinging import swinging_laws
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import LOOKS, Group, Shaped
from impactscope.discrepancy.driven.fits.innovations import each_alone, innovations, joined
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Model, Segment

__all__ = ['STATE', 'plate_laws']

Array = NDArray[np.float64]

NEAR = 1e-12
MODE_DAMPING = 0.03
FASTEST = 2.5  # of the natural frequency, up to which a stiffness is taken to swing
REPEATS = 'a force that repeats'
BELLS = 0.05, 0.15  # of the range of motion: widths of what acts about one place, at first


class _Plate:
    """Answer of the fitted plate to small forces, recording by recording."""

    def __init__(self, model: Model, made: Fit, segments: Sequence[Segment]) -> None:
        self.fitted = [i for i, s in enumerate(segments) if not s.held_out]
        self.chosen = [segments[i] for i in self.fitted]
        self.motions = []
        for i in self.fitted:
            x, v = model.motion(made.values, made.terms, made.starts[i], segments[i])
            self.motions.append((x, v))
        self.outputs = [segments[i].measured - made.residuals[i] for i in self.fitted]
        self.left = [innovations(segments[i], made.residuals[i]) for i in self.fitted]
        mass, stiffness = made.values.get('mass', 1.0), made.values.get('stiffness', 0.0)
        damping = made.values['damping']
        first = segments[self.fitted[0]]
        self.period = first.period
        self.position = max(float(np.max(np.abs(x))) for x, _ in self.motions) or 1.0
        self.speed = max(float(np.max(np.abs(v))) for _, v in self.motions) or 1.0
        self.natural = math.sqrt(stiffness / mass) or self.speed / self.position
        self.longest = max(s.measured.size * s.period for s in segments)
        rates = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
        push = np.array([[0.0], [1.0 / mass]])
        shows = np.array([[1.0, 0.0], [0.0, 1.0], list(rates[1])])[[first.derivative]]
        through = np.array([[1.0 / mass if first.derivative == 2 else 0.0]])
        a, b, c, d, _ = signal.cont2discrete((rates, push, shows, through), self.period, 'foh')
        self.above, self.below = signal.ss2tf(a, b, c, d)
        self.above = self.above[0]

    def answer(self, forces: Sequence[Array]) -> Array:
        """Whitened output, shape (n,), of small forces that act on the plate."""
        return self.output(self.motion_of(forces))

    def output(self, changes: Sequence[Array]) -> Array:
        """Whitened changes of the output, shape (n,)."""
        return joined(self.chosen, changes)

    def of_motion(self, law: Callable[[Array, Array], Array]) -> Array:
        """Answer to a force that is a law of position and speed over their largest values."""
        return self.answer([law(x / self.position, v / self.speed) for x, v in self.motions])

    def alone(self, shapes: Sequence[Array], *, force: bool) -> list[Array]:
        """One column for each recording, zero in the others."""
        return each_alone(self.chosen, self.motion_of(shapes) if force else shapes)

    def motion_of(self, forces: Sequence[Array]) -> list[Array]:
        """What small forces make of the channel, each shape (n,)."""
        return [signal.lfilter(self.above, self.below, f) for f in forces]


STATE: tuple[tuple[str, Callable[[Array, Array], Array]], ...] = (
    ('a force with the square of the displacement', lambda x, v: x * x),  # noqa: ARG005
    ('a force with x |x|', lambda x, v: x * np.abs(x)),  # noqa: ARG005
    ('a force with the fifth power of the displacement', lambda x, v: x**5),  # noqa: ARG005
    ('damping that depends on the direction', lambda x, v: np.abs(v)),  # noqa: ARG005
    ('a force with the square of the speed', lambda x, v: v * v),  # noqa: ARG005
    ('damping with the square of the speed one way', lambda x, v: np.maximum(v, 0.0) ** 2),  # noqa: ARG005
    ('damping with the square of the speed one way', lambda x, v: np.minimum(v, 0.0) ** 2),  # noqa: ARG005
    ('damping with the cube of the speed', lambda x, v: v**3),  # noqa: ARG005
    ('damping with the root of the speed', lambda x, v: np.sign(v) * np.sqrt(np.abs(v))),  # noqa: ARG005
    ('damping with |v|^1.5', lambda x, v: v * np.sqrt(np.abs(v))),  # noqa: ARG005
    ('damping that changes with the displacement', lambda x, v: x * v),
    ('damping that grows with the displacement', lambda x, v: np.abs(x) * v),
    ('damping that grows with the square of the displacement', lambda x, v: x * x * v),
    ('friction that grows with the displacement', lambda x, v: np.abs(x) * np.sign(v)),
    ('friction that grows with its square', lambda x, v: x * x * np.sign(v)),
    ('friction that grows to one side', lambda x, v: np.maximum(x, 0.0) * np.sign(v)),
    ('friction that grows to one side', lambda x, v: np.minimum(x, 0.0) * np.sign(v)),
    ('a stiffness to one side', lambda x, v: np.maximum(x, 0.0)),  # noqa: ARG005
    ('stiffness that falls with the speed', lambda x, v: x * np.abs(v)),
    ('stiffness that falls with the square of the speed', lambda x, v: x * v * v),
    ('a spring that sets in with the root', lambda x, v: np.sign(x) * np.sqrt(np.abs(x))),  # noqa: ARG005
)


def plate_laws(model: Model, made: Fit, segments: Sequence[Segment]) -> Iterator[Group]:
    """Laws beyond the vocabulary, each with the whitened answers that span it, beside a fit."""
    p = _Plate(model, made, segments)
    for name, law in STATE:
        yield Group(name, [p.of_motion(law)])
    times: list[Array] = [p.period * np.arange(x.size, dtype=np.float64) for x, _ in p.motions]
    xs, vs = [x for x, _ in p.motions], [v for _, v in p.motions]
    each = p.alone(xs, force=True)
    yield Group('a stiffness that differs between recordings', each, differs=True)
    yield Group('a damping that differs between recordings', p.alone(vs, force=True), differs=True)
    signs = [np.sign(v) for v in vs]
    yield Group(
        'a friction that differs between recordings',
        p.alone(signs, force=True),
        differs=True,
    )
    yield Group(
        'an offset that differs between recordings',
        p.alone([np.ones(x.size) for x in xs], force=False),
        differs=True,
    )
    yield Group(
        'a stiffness that changes in time',
        [p.answer([x * t for x, t in zip(xs, times, strict=True)])],
    )
    yield Group(
        'a damping that changes in time',
        [p.answer([v * t for v, t in zip(vs, times, strict=True)])],
    )
    yield Group(
        'a friction that changes in time',
        [p.answer([s * t for s, t in zip(signs, times, strict=True)])],
    )
    yield Group('a reading that is not straight', [p.output([y * y for y in p.outputs])])
    yield Group('a reading that is not straight', [p.output([y**3 for y in p.outputs])])
    if made.values.get('stiffness', 0.0) == 0.0 and segments[0].derivative == 0:
        yield from _repeating(p, xs)  # with a spring a place is hardly passed twice
        yield from _at_a_place(p, xs, signs)
    highest = FASTEST * p.natural / (2.0 * math.pi)
    yield from swinging_laws('stiffness', p.chosen, p.left, xs, highest, through=p.motion_of)
    yield from _memory(p, xs, vs)
    yield from _modes(p)


def _repeating(p: _Plate, xs: Sequence[Array]) -> Iterator[Group]:
    """Forces that repeat with the position: cogging, an eccentric gear, the teeth of a belt."""
    span = float(np.ptp(np.concatenate(xs)))
    if not span > 0.0:
        return
    unit = p.chosen[0].unit
    tried = periods_to_try(xs, span)
    for turns in tried.tolist():

        def columns(shape: Array, begun: float = turns) -> list[Array]:
            turn = 2.0 * math.pi * (begun + shape[0]) / span
            return [p.answer([wave(turn * x) for x in xs]) for wave in (np.sin, np.cos)]

        def law(shape: Array, begun: float = turns) -> str:
            return f'{REPEATS} every {span / (begun + shape[0]):.4g} {unit} of the position'

        yield Group(
            f'{REPEATS} with the position',
            columns(np.zeros(1)),
            LOOKS + tried.size,
            Shaped((0.0,), columns, law),
        )


def _at_a_place(p: _Plate, xs: Sequence[Array], signs: Sequence[Array]) -> Iterator[Group]:
    """Friction or a push about one place: a tight spot of a rail, a dent of a track, a cable.

    A bell of any place and width, which is found from the nearest of those that are tried first.
    """
    every = np.concatenate(xs)
    span = float(np.ptp(every))
    if not span > 0.0:
        return
    unit, lowest = p.chosen[0].unit, float(np.min(every))
    starts = [
        (lowest + (i + 0.5) * share * span, share * span)
        for share in BELLS
        for i in range(round(1.0 / share))
    ]
    ones = [np.ones(x.size) for x in xs]
    for kind, ways in (('friction', signs), ('a force', ones)):
        for about, width in starts:

            def columns(
                shape: Array, at: float = about, w: float = width, way: Sequence[Array] = ways
            ) -> list[Array]:
                place, wide = at + w * shape[0], w * math.exp(shape[1])
                pairs = zip(way, xs, strict=True)
                return [p.answer([s * np.exp(-(((x - place) / wide) ** 2)) for s, x in pairs])]

            def law(shape: Array, at: float = about, w: float = width, of: str = kind) -> str:
                return f'{of} about {at + w * shape[0]:.3g} {unit} of the position'

            yield Group(
                f'{kind} about one place',
                columns(np.zeros(2)),
                LOOKS + 2 * len(starts),
                Shaped((0.0, 0.0), columns, law),
            )


def _memory(p: _Plate, xs: Sequence[Array], vs: Sequence[Array]) -> Iterator[Group]:
    for ratio in (0.03, 0.1, 0.3, 1.0, 3.0, 10.0):
        keep = math.exp(-p.period * p.natural * ratio)
        forces = [signal.lfilter([1.0 - keep], [1.0, -keep], v) for v in vs]
        yield Group('a force that relaxes', [p.answer(forces)])
    length = 1 << (2 * max(x.size for x in xs) - 1).bit_length()
    turn = 2j * math.pi * np.fft.rfftfreq(length, p.period) / p.natural
    turn[0] = NEAR
    spectra = [np.fft.rfft(x, length) for x in xs]

    def columns(shape: Array) -> list[Array]:
        risen = turn ** math.exp(shape[0])
        forces = [
            np.fft.irfft(s * risen, length)[: x.size] for s, x in zip(spectra, xs, strict=True)
        ]
        return [p.answer(forces)]

    for order in (0.25, 0.5, 0.75, 1.5):
        start = math.log(order)
        yield Group(
            'damping of fractional order',
            columns(np.array([start])),
            shaped=Shaped((start,), columns, _fractional),
        )


def _fractional(shape: Array) -> str:
    return f'damping of fractional order, {math.exp(shape[0]):.2g}'


def _modes(p: _Plate) -> Iterator[Group]:
    """Answers of a further mode to the force, and to the motion of the plate."""
    for ratio in np.geomspace(0.1, 30.0, 28):
        omega = ratio * p.natural
        if omega * p.period > 2.0:
            break
        rates = np.array([[0.0, 1.0], [-(omega**2), -2.0 * MODE_DAMPING * omega]])
        push, shows = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
        system = signal.cont2discrete((rates, push, shows, [[0.0]]), p.period, 'foh')
        above, below = signal.ss2tf(*system[:4])
        pulled = [signal.lfilter(above[0], below, y) for y in p.outputs]
        rest = [np.gradient(y, p.period) for y in pulled]
        yield Group(
            f'a further mode at {omega / (2.0 * math.pi):.3g} Hz',
            [p.answer(pulled), p.answer(rest)],
        )
