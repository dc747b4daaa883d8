"""Simulate one blow: what each channel would read without noise, and the truth behind it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError, ImpactscopeError
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.assembly import Effect, Effects, assemble, normalise
from impactscope.physics.twin.bench import Bench, Blow
from impactscope.physics.twin.integrator import NOT_FINITE, TOO_MANY_EVENTS, run

__all__ = [
    'CHANNELS',
    'ContactSpan',
    'Event',
    'Simulation',
    'SimulationError',
    'simulate',
    'simulate_at',
    'solve',
    'sufficient_tolerance',
]

Array = NDArray[np.float64]

CHANNELS = {
    'force': ('N', at.READING),
    'acceleration.plate': ('m/s^2', at.PLATE_ACCELERATION),
    'acceleration.impactor': ('m/s^2', at.IMPACTOR_ACCELERATION),
    'acceleration.base': ('m/s^2', at.BASE_ACCELERATION),
}
"""Channel name to unit and output column."""

TOLERANCE = 1e-8
BARE_TOLERANCE = 1e-9
"""Of bare contacts: they are short, and a hundred bounces amplify what one of them gets wrong."""
LONGEST_STEP = 5e-3  # s
MOST_STEPS = 1_000_000  # and some for each sample; a usual blow takes a thousand
CONTACT_SAMPLES = 65  # in which the peak of a contact is looked for ...
LONGEST_CONTACT = 0.1  # s ... over no more than its beginning: what is slower, the samples show
FEW_EVENTS, MAX_EVENTS = 500, 100_000

_EVENT_NAMES = {
    at.CONTACT_BEGINS: 'contact_begins',
    at.CONTACT_ENDS: 'contact_ends',
    at.STICKS: 'sticks',
    at.SLIPS: 'slips',
    at.REVERSES: 'reverses',
    at.SPRING_REGION: 'spring_region',
}


class SimulationError(ImpactscopeError):
    """The equations could not be integrated with these parameters."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at ``time`` s: see ``kind``."""

    time: float
    kind: str


@dataclass(frozen=True, slots=True)
class ContactSpan:
    """One true span of contact, s; the force above zero in between, N."""

    start: float
    end: float  # inf: still in contact when the simulation ends
    peak_force: float  # N, true contact force, between samples as well


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """One simulated blow. Times in s from the first sample; arrays of shape (n_samples,).

    ``rows`` holds all outputs, shape (n_samples, N_COLUMNS), columns as in :mod:`.layout`.
    """

    time: Array
    rows: Array
    contact_time: float  # s, of first contact or of the hammer's touch
    events: tuple[Event, ...]
    effects: tuple[Effect, ...]
    parameters: Array
    steps: int

    def __getitem__(self, channel: str) -> Array:
        """Values of one channel, shape (n_samples,); raises KeyError where there is none."""
        return self.rows[:, CHANNELS[channel][1]]

    @property
    def channels(self) -> dict[str, Array]:
        """All channels by name."""
        return {name: self[name] for name in CHANNELS}

    @property
    def contact_force(self) -> Array:
        """True force between impactor and plate, N; without the hammer's of a tap."""
        return self.rows[:, at.CONTACT_FORCE]

    @property
    def energy(self) -> Array:
        """Kinetic and stored energy, J, from first contact on."""
        return self.rows[:, at.ENERGY]

    @property
    def energy_balance(self) -> Array:
        """Energy plus losses minus work done, J: constant from first contact on."""
        rows = self.rows
        return rows[:, at.ENERGY] + rows[:, at.LOST_ENERGY] - rows[:, at.DONE_WORK]

    @property
    def contacts(self) -> tuple[ContactSpan, ...]:
        """True spans of contact between impactor and plate."""
        if self.parameters[at.IMPACTOR_MASS] == 0:
            return ()
        starts = [self.contact_time]
        ends: list[float] = []
        for event in self.events:
            if event.kind == 'contact_begins':
                starts.append(event.time)
            elif event.kind == 'contact_ends':
                ends.append(event.time)
        ends += [math.inf] * (len(starts) - len(ends))
        peaks = self._peaks(starts, ends)
        return tuple(map(ContactSpan, starts, ends, peaks))

    def _peaks(self, starts: list[float], ends: list[float]) -> list[float]:
        """Largest force of each contact, N, whatever the output's sampling rate.

        A contact without a layer lasts for some samples only, or for less than one: what the
        samples miss of its peak is found by integrating anew with samples inside each contact.
        """
        last = float(self.time[-1])
        fine = [
            np.linspace(begin, min(end, begin + LONGEST_CONTACT, last), CONTACT_SAMPLES)
            for begin, end in zip(starts, ends, strict=True)
        ]
        order, place = np.unique(np.concatenate(fine), return_inverse=True)
        rows, *_ = solve(self.parameters, order - self.contact_time, lean=True)
        forces = rows[place, at.CONTACT_FORCE].reshape(len(fine), CONTACT_SAMPLES)
        peaks = []
        for begin, end, inside in zip(starts, ends, forces, strict=True):
            top = int(np.clip(np.argmax(inside), 1, CONTACT_SAMPLES - 2))
            before, middle, after = inside[top - 1 : top + 2]
            bend = before - 2.0 * middle + after
            crest = middle - 0.125 * (after - before) ** 2 / bend if bend < 0.0 else middle
            sampled = self.contact_force[(self.time >= begin) & (self.time <= end)]
            peaks.append(float(max(crest, np.max(inside), np.max(sampled, initial=0.0))))
        return peaks


def sufficient_tolerance(par: Array) -> float:
    """Relative tolerance by which no sample is off by a tenth of a quiet sensor's noise."""
    return TOLERANCE if par[at.HAS_LAYER] > 0.5 else BARE_TOLERANCE


def solve(
    par: Array,
    times: Array,
    tolerance: float | None = None,
    *,
    lean: bool = False,
) -> tuple[Array, Array, NDArray[np.int64], int]:
    """Run the compiled twin on a parameter vector; the inner call of every fit.

    ``times``: rising, s from first contact; before it everything rests and the impactor
    approaches. ``lean`` leaves out what only the energy balance needs. Returns rows of shape
    (n_times, N_COLUMNS) or (n_times, N_LEAN_COLUMNS), event times and kinds, and the number of
    steps. ``tolerance`` None: the sufficient one. Raises SimulationError where the integration
    does not get through.
    """
    if tolerance is None:
        tolerance = sufficient_tolerance(par)
    rows = np.empty((len(times), at.N_LEAN_COLUMNS if lean else at.N_COLUMNS))
    found, steps, event_times, event_kinds = run(
        par,
        times,
        tolerance,
        LONGEST_STEP,
        MOST_STEPS + 8 * len(times),
        (FEW_EVENTS, MAX_EVENTS),
        rows,
    )
    if found < 0:
        if found == NOT_FINITE:
            raise SimulationError('the simulation does not stay finite with these parameters')
        what = 'events' if found == TOO_MANY_EVENTS else 'steps'
        raise SimulationError(
            f'the simulation needs more {what} than allowed: {steps} steps taken'
        )
    return rows, event_times, event_kinds, steps


def simulate_at(
    bench: Bench,
    blow: Blow,
    time: Array,
    *,
    mechanisms: Effects | None = None,
    contact_time: float = 0.0,
    tolerance: float | None = None,
) -> Simulation:
    """Simulate a blow and sample it at ``time``, rising, s, shape (n,)."""
    time = np.ascontiguousarray(time, dtype=np.float64)
    if time.ndim != 1 or time.size == 0 or not (np.diff(time) >= 0).all():
        raise ConfigurationError('simulation: sample times must be a rising array, not empty')
    possible = tolerance is None or 1e-13 <= tolerance <= 1e-2
    if not math.isfinite(contact_time) or not possible:
        raise ConfigurationError(
            f'simulation: contact_time {contact_time!r} s must be finite and tolerance '
            f'{tolerance!r} from 1e-13 to 0.01'
        )
    effects = normalise(mechanisms, bench, blow)
    par = assemble(bench, blow, effects)
    rows, event_times, event_kinds, steps = solve(par, time - contact_time, tolerance)
    events = tuple(
        Event(float(t) + contact_time, _EVENT_NAMES[int(kind)])
        for t, kind in zip(event_times, event_kinds, strict=True)
    )
    return Simulation(time, rows, contact_time, events, effects, par, steps)


def simulate(
    bench: Bench,
    blow: Blow,
    *,
    mechanisms: Effects | None = None,
    duration: float = 1.0,
    sample_rate: float = 10_000.0,
    contact_time: float = 0.0,
    tolerance: float | None = None,
) -> Simulation:
    """Simulate a blow on a bench.

    ``mechanisms`` None: those that bench and blow imply (contact that only pushes, the
    pendulum's weight, the robot's push); otherwise exactly those given, as Effects or as
    ``{name: values}``. ``contact_time`` is that of first contact, s after the first sample.
    Raises ConfigurationError for impossible descriptions, SimulationError where the equations
    cannot be integrated.
    """
    if not (0 < duration < 1e5 and 0 < sample_rate <= 1e8):
        raise ConfigurationError(
            f'simulation: duration {duration!r} s and sample_rate {sample_rate!r} Hz '
            'must be above zero'
        )
    count = max(1, round(duration * sample_rate))
    return simulate_at(
        bench,
        blow,
        np.arange(count) / sample_rate,
        mechanisms=mechanisms,
        contact_time=contact_time,
        tolerance=tolerance,
    )
