"""Laws that no mechanism has: would the bench move as if one of them acted?

A weak further force on the plate changes the motion by the response of the bench to that force,
taken along the motion that was fitted. So friction that changes with the displacement, forces
with a memory, fractional damping, stiffness that swings or that differs from recording to
recording can each be held against what a fit leaves: the force is handed to the simulation like
that of a measured hammer, contacts and all, and the law need not be known to it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.models.bench_model import ImpactModel
from impactscope.discrepancy.processes import in_processes
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.registry import mechanism
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.simulate import CHANNELS, solve

__all__ = ['GROUPS', 'Law', 'law_forces', 'law_responses']

Array = NDArray[np.float64]

_STEP = 5e-4  # s, of the force that is handed to the simulation
_WEAK = 1e-4  # of the sensor's largest force, at first
_FELT = 3.0  # norm of the change of one recording's residuals
_SWINGS = (2.0, 4.0, 7.0, 10.0, 13.0, 17.0, 22.0, 30.0)  # Hz
_SLOW_SWINGS = (2.0, 7.0)  # Hz, of the damping
_MEMORIES = (1e-3, 3e-3, 1e-2, 3e-2, 0.1)  # s
_ORDERS = (0.25, 0.5, 0.75)  # of fractional derivatives
_RESONANCES = (12.0, 20.0, 45.0, 70.0, 110.0, 180.0, 300.0, 450.0)  # Hz, of a mass on the plate
_RESONANT_DAMPING = 0.05  # ratio
_PULLS = (0.3, 1.0, 3.0, 10.0)  # N, before a contact lets go
GROUPS = {  # a law of its kind, whatever its course: few numbers, and the picture of no formula
    'an odd force of the speed': 'damping with speed to the power',
    'an even force of the speed': 'a push with speed to the power',
    'an odd force of the displacement': 'a spring with displacement to the power',
    'an even force of the displacement': 'a spring that differs by side, to the power',
    'a force that follows the contact force': 'a force with the contact force',
}


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """A force along the motion: one column of the residuals for each of its numbers."""

    label: str
    columns: Array  # shape (size, n_numbers), over the noise


def law_responses(fit: Fit) -> list[Law]:
    """What each law would change of the residuals of a fit, to first order."""
    effects = tuple(e for e in fit.model.effects if not mechanism(e.name).on_channel)
    bench = dataclasses.replace(fit.model, effects=effects)  # channels show the plain motion
    columns: dict[str, dict[str, Array]] = {}
    found = in_processes(lambda i: list(_of_blow(fit, bench, i)), fit.layout.blows)
    for i, responses in zip(fit.layout.blows, found, strict=True):
        span = fit.layout.blow_spans[i]
        for label, number, response in responses:
            law = columns.setdefault(label, {})
            law.setdefault(number.replace('@', str(i)), np.zeros(fit.layout.size))[span] = response
    laws = [
        Law(label, np.stack(list(numbers.values()), axis=1)) for label, numbers in columns.items()
    ]
    for label, kind in GROUPS.items():
        members = [law.columns for law in laws if law.label.startswith(kind)]
        if len(members) > 1:
            laws.append(Law(label, np.concatenate(members, axis=1)))
    return laws


def _of_blow(fit: Fit, bench: ImpactModel, i: int) -> Iterator[tuple[str, str, Array]]:
    """Every law's response in one recording, in the order of the residuals."""
    blow, layout, values = fit.model.data.blows[i], fit.layout, fit.values
    start = values[f'time@{i}']
    wanted = {}
    for name, channel in blow.channels.items():
        mask = layout.masks[i, name]
        gain = values.get(f'gain.{name}', 1.0)
        wanted[name] = mask, channel.centres[mask] - start, gain / channel.std[mask]
    every = [times for _, times, _ in wanted.values() if times.size]
    if not every:
        return
    moments = np.unique(np.concatenate(every))
    grid = np.arange(0.0, float(moments[-1]) + 2 * _STEP, _STEP)
    par = bench.parameters(values, i)
    tap = np.zeros(grid.size)
    if par[at.TAP_PEAK] > 0.0:
        during = grid < par[at.TAP_DURATION]
        tap[during] = par[at.TAP_PEAK] * np.sin(math.pi * grid[during] / par[at.TAP_DURATION])
    try:
        plain = _moved(par, tap, moments)
    except ImpactscopeError:
        return
    x = np.interp(grid, moments, plain[:, at.PLATE_POSITION])
    v = np.interp(grid, moments, plain[:, at.PLATE_VELOCITY])
    before = grid < moments[moments > 0.0][0] if np.any(moments > 0.0) else grid < 0.0
    x[before] = v[before] = 0.0
    largest = float(np.max(np.abs(plain[:, at.READING])))
    if not largest > 0.0:
        return  # nothing has moved

    def response(force: Array, in_spring: bool) -> Array:
        moved = _moved(par, tap - force, moments)
        parts = []
        for name, (_, times, scale) in wanted.items():
            column = CHANNELS[name][1]
            place = np.searchsorted(moments, times)
            change = moved[place, column] - plain[place, column]
            if in_spring and column == at.READING:
                change = change + np.interp(times, grid, force, left=0.0)
            parts.append(bench.whitened(-scale * change, i, name, layout))
        return np.concatenate(parts)

    contact = np.interp(grid, moments, plain[:, at.CONTACT_FORCE])
    contact[before] = 0.0
    forces = law_forces(x, v, grid + start, contact / largest, largest)
    for label, number, in_spring, force in forces:
        top = float(np.max(np.abs(force)))
        if not top > 0.0:
            continue
        strength = _WEAK * largest / top
        try:
            change = response(strength * force, in_spring)
            norm = float(np.linalg.norm(change))
            if norm > 10 * _FELT:  # bounces would make it anything but linear
                strength *= _FELT / norm
                change = response(strength * force, in_spring)
        except ImpactscopeError:
            continue
        yield label, number, change / strength


def _moved(par: Array, force: Array, moments: Array) -> Array:
    """Motion of the bench with a further force on the plate, rows at the moments."""
    driven = np.concatenate([par[: at.N_PARAMETERS], force])
    driven[at.EXCITATION_RATE] = 1.0 / _STEP
    rows: Array = solve(driven, moments, lean=True)[0]
    return rows


def law_forces(
    x: Array, v: Array, time: Array, contact: Array | None = None, unit: float = 100.0
) -> Iterator[tuple[str, str, bool, Array]]:
    """Forces along a motion: label, key of the number, whether the spring carries it, values.

    ``x`` and ``v``: displacement, m, and speed, m/s, of the plate over ``time``, s; shape (n,).
    Times are even and begin at first contact. ``contact``: force between impactor and plate, in
    units of ``unit`` N; None: of no blow.
    A key with ``@`` is a number of its own for each recording. Forces are in arbitrary units,
    the same for all recordings.
    """
    size, speed = 1e-3, 0.1  # m, m/s: what is usual here
    r, w = x / size, v / speed
    s = np.tanh(v / (1e-3 * speed))
    for power in (0.3, 0.5, 1.5, 3.0):
        yield f'damping with speed to the power {power:g}', '', False, s * np.abs(w) ** power
    for power in (2.0, 3.0):
        label = f'a push with speed to the power {power:g}, either way'
        yield label, '', False, np.abs(w) ** power
        for way, moving in (('inwards', w > 0.0), ('outwards', w < 0.0)):
            label = f'damping with speed to the power {power:g}, {way} only'
            yield label, '', False, s * np.abs(w) ** power * moving
    if contact is not None and np.any(contact):
        yield 'friction with the contact force', '', False, s * contact
        yield 'damping with the contact force', '', False, w * contact
        yield 'a force with the contact force', '', False, contact
        loading = np.gradient(contact) > 0.0
        yield 'a force with the contact force while it rises', '', False, contact * loading
        yield 'a force with the square of the contact force', '', False, contact**2
        for most in _PULLS:
            label = f'a contact that pulls by {most:g} N before it lets go'
            yield label, '', False, _pulled(unit * contact, most)
    for power in (0.5, 1.0, 2.0):
        label = f'friction that changes with the displacement to the power {power:g}'
        yield label, '', False, s * np.abs(r) ** power
        label = f'damping that changes with the displacement to the power {power:g}'
        yield label, '', False, w * np.abs(r) ** power
    yield 'friction that differs by side', '', False, s * np.sign(r)
    yield 'damping that differs by side', '', False, w * np.sign(r)
    yield 'damping that differs by direction', '', False, np.abs(w)
    yield 'a force of displacement and speed', '', False, r * w * w
    for power in (1.5, 2.0, 5.0, 7.0):
        odd = np.sign(r) * np.abs(r) ** power
        yield f'a spring with displacement to the power {power:g}', '', True, odd
    for power in (1.0, 2.0, 4.0):
        label = f'a spring that differs by side, to the power {power:g}'
        yield label, '', True, np.abs(r) ** power
    for wave in (0.2, 0.4, 0.7, 1.0, 1.5, 2.5):
        label = f'a force that is periodic in the displacement ({wave:g} mm)'
        yield label, 'sine', False, np.sin(2 * math.pi * r / wave)
        yield label, 'cosine', False, np.cos(2 * math.pi * r / wave) - 1.0
    for memory in _MEMORIES:
        keep = math.exp(-_STEP / memory)
        followed = signal.lfilter([1.0], [1.0, -keep], np.diff(r, prepend=r[:1]))
        yield f'a force that relaxes within {memory:g} s', '', True, followed
    for order in _ORDERS:
        yield f'fractional damping of order {order:g}', '', False, _fractional(w, order)
    for frequency in _RESONANCES:
        carried = _carried(r, frequency)
        yield f'a mass on a spring that swings at {frequency:g} Hz', '', False, carried
    since = time - time[0]
    yield 'stiffness that drifts within a recording', '', True, r * since
    yield 'damping that drifts within a recording', '', False, w * since
    yield 'friction that drifts within a recording', '', False, s * since
    for frequency in _SWINGS:
        turn = 2 * math.pi * frequency * time
        for part, wave_form in (('sine', np.sin(turn)), ('cosine', np.cos(turn))):
            yield f'stiffness that swings at {frequency:g} Hz', f'{part}@', True, r * wave_form
            if frequency in _SLOW_SWINGS:
                label = f'damping that swings at {frequency:g} Hz'
                yield label, f'{part}@', False, w * wave_form
    yield 'stiffness that differs between recordings', '@', True, r
    yield 'damping that differs between recordings', '@', False, w
    yield 'friction that differs between recordings', '@', False, s


def _pulled(contact: Array, most: float) -> Array:
    """Force on the plate, N, of a contact that lets go only where it pulls by ``most`` N.

    Where ``contact``, N, ends, it goes on falling as steeply as it did, below zero.
    """
    edges = _STEP * (np.arange(contact.size + 1) - 0.5)
    pull: Array = np.zeros(contact.size)
    ends: list[int] = np.flatnonzero((contact[:-1] > 0.0) & (contact[1:] <= 0.0)).tolist()
    for last in ends:
        first = max(last - 2, 0)
        fallen = float(contact[first] - contact[last])
        steepness = fallen / (_STEP * max(last - first, 1))
        if not steepness > 0.0:
            continue
        # most of it is over within a few steps: means over each of them
        since = edges - (_STEP * last + contact[last] / steepness)
        impulse = 0.5 * steepness * np.clip(since, 0.0, most / steepness) ** 2
        pull -= np.diff(impulse) / _STEP
    return pull


def _carried(displacement: Array, frequency: float) -> Array:
    """Force, over its stiffness, of a damped mass on a spring that the plate carries along."""
    turn = 2 * math.pi * frequency
    response = signal.cont2discrete(
        ([2 * _RESONANT_DAMPING * turn, turn**2], [1.0, 2 * _RESONANT_DAMPING * turn, turn**2]),
        _STEP,
        'bilinear',
    )
    moved = signal.lfilter(response[0].ravel(), response[1], displacement)
    return np.asarray(displacement - moved, dtype=np.float64)


def _fractional(speed: Array, order: float) -> Array:
    """Derivative of that order of the displacement, from its speed; of a motion from rest."""
    length = 2 * speed.size
    omega = 2j * math.pi * np.fft.rfftfreq(length, _STEP)
    omega[0] = 1.0
    spectrum = np.fft.rfft(speed, length) * omega ** (order - 1.0)
    spectrum[0] = 0.0
    return np.asarray(np.fft.irfft(spectrum, length)[: speed.size], dtype=np.float64)
