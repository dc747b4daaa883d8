"""Smooth modes of the bench, followed by power series in time; compiled.

Between contacts, and pressed on a layer or in a bare contact, the bench is a linear system with
constant friction and drives that are ramps, and a few laws beside it: the weight of an impactor
that swings, Hertz's contact with its loss, a cubic spring, friction that falls with the speed.
The state is a power series in time whose terms follow from one another, (k + 1) a[k + 1] =
A a[k] + the term of each law; sines, powers and exponentials of a series are series, too. The
series is the dense output, and guards are polynomials.

Series of functions of a series: Knuth, The Art of Computer Programming 2, section 4.7. Order and
length of a step: Jorba and Zou, Experiment. Math. 14 (2005).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impactscope.physics.mechanisms.compiled import borrowed, compiled, law
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.crossings import lowest, narrowed, secant
from impactscope.physics.twin.equations import (
    derivative,
    drive_force,
    guard,
    stick_force,
    stick_reserves,
)
from impactscope.physics.twin.modes import LEAST_SPEED
from impactscope.physics.twin.runge_kutta import felt

__all__ = [
    'CLAMPED',
    'SeriesMode',
    'borrowed_mode',
    'expand',
    'first_crossing',
    'has_series',
    'is_bare',
    'may_have_series',
    'mode_room',
    'prepare_mode',
    'series_state',
]

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

CLAMPED: Final = 3
"""In place of a guard: its loss leaves no force to a bare contact that is still pressed."""

_ORDER: Final = 16
_PRECISION: Final = 1e-10  # of a state, that the last term of a series may be
_PIECES: Final = 4  # of a step, in which guards are looked at
_SHORTEST: Final = 1e-11  # s
_PRESSED: Final = 1e-12  # m, of a bare contact, from which it has a series
_SOONER: Final = 0.4  # of the time in which a contact would close, that its series holds for
_LEFT: Final = 1e-6  # of its force without loss, the same
_SLOWER: Final = 0.4  # of its speed, by which a plate may slow down in a step ...
_PEAK: Final = 0.4  # ... or of the speed at which its friction falls
_LEAST: Final = -100.0  # logarithm of the share of a peak that may matter within a step

# rows of what the laws are made of
_SINE, _COSINE, _POWER, _SQUARE, _QUOTIENT, _EXPONENTIAL, _INNER, _PARTS = range(8)


class SeriesMode(NamedTuple):
    """A mode's equations, and the series from one state; n numbers of the state at most.

    Attributes:
        still: the bench without drives and without what is no linear law, shape (n_parameters,).
        places: of the numbers that change, in the state, shape (n,).
        matrix: rate of each per number, the entries that are not zero, row by row; shape (n * n,).
        firsts: place of the first entry of each row, and of the end; shape (n + 1,).
        columns: number of each entry, shape (n * n,).
        constant: rate of each where all are zero, shape (n,).
        guards: of the contact, the guide, and a stuck guide's other way, each an affine function
            of the numbers, its constant last; shape (3, n + 1).
        series: terms of the state by powers of time, shape (n, _ORDER + 1).
        parts: the same of what the laws are made of, shape (_PARTS, _ORDER + 1).
        edges: the same of the guards and of what loss leaves of a force, shape (4, _ORDER + 1).
        whole: the matrix with its zeros, shape (n, n).
        trial: a state and two rates, shape (3, n).
    """

    still: Array
    places: IntArray
    matrix: Array
    firsts: IntArray
    columns: IntArray
    constant: Array
    guards: Array
    series: Array
    parts: Array
    edges: Array
    whole: Array
    trial: Array


@compiled
def mode_room(par: Array, n: int) -> SeriesMode:
    """Room for the modes of a bench whose state has ``n`` numbers."""
    still = par.copy()
    still[at.PUSH_FORCE] = still[at.LIFT_FORCE] = 0.0
    still[at.CUBIC] = still[at.CONTACT_STIFFNESS] = 0.0
    still[at.STATIC_FORWARD] = still[at.KINETIC_FORWARD]
    still[at.STATIC_BACKWARD] = still[at.KINETIC_BACKWARD]
    if par[at.LEVER] > 0.0:
        still[at.LOAD] = still[at.RESTORING] = 0.0
    return SeriesMode(
        still,
        np.empty(n, dtype=np.int64),
        np.empty(n * n),
        np.empty(n + 1, dtype=np.int64),
        np.empty(n * n, dtype=np.int64),
        np.empty(n),
        np.empty((3, n + 1)),
        np.empty((n, _ORDER + 1)),
        np.zeros((_PARTS, _ORDER + 1)),
        np.empty((4, _ORDER + 1)),
        np.empty((n, n)),
        np.empty((3, n)),
    )


@law
def borrowed_mode(room: SeriesMode) -> SeriesMode:
    """The same mode, its arrays borrowed; see :func:`.compiled.borrowed`."""
    return SeriesMode(
        borrowed(room.still),
        borrowed(room.places),
        borrowed(room.matrix),
        borrowed(room.firsts),
        borrowed(room.columns),
        borrowed(room.constant),
        borrowed(room.guards),
        borrowed(room.series),
        borrowed(room.parts),
        borrowed(room.edges),
        borrowed(room.whole),
        borrowed(room.trial),
    )


@compiled
def may_have_series(par: Array) -> bool:
    """Whether any mode of a bench is followed by series: no law beyond those of the module."""
    more = (
        par[at.GAP] != 0.0
        or par[at.STOP_STIFFNESS] != 0.0
        or par[at.HYSTERESIS_SHARE] != 0.0
        or par[at.EXCITATION_RATE] != 0.0
    )
    return not more and not np.any(par[at.OWN : at.OWN + at.OWN_WIDTH * at.MAX_OWN] != 0.0)


@law
def _swings(par: Array) -> bool:
    return bool(par[at.LEVER] > 0.0 and (par[at.LOAD] != 0.0 or par[at.RESTORING] != 0.0))


@law
def is_bare(par: Array, contact: int) -> bool:
    """Whether impactor and plate touch without a layer."""
    return bool(contact == at.CLOSED and par[at.HAS_LAYER] == 0.0)


@law
def _peak(par: Array, guide: int) -> float:
    """How much higher friction is at rest than in motion one way, N; zero where nothing slides."""
    peak = 0.0
    if guide == 1:
        peak = max(par[at.STATIC_FORWARD] - par[at.KINETIC_FORWARD], 0.0)
    elif guide == -1:
        peak = max(par[at.STATIC_BACKWARD] - par[at.KINETIC_BACKWARD], 0.0)
    return peak


@law
def has_series(par: Array, t: float, y: Array, contact: int, least: float) -> bool:
    """Whether a mode is followed by series from a state on, of a bench of which some may be.

    ``least``: s, that a series of a bare contact shall hold for. It ends where the contact does,
    forwards or backwards in time.
    """
    if t < par[at.TAP_DURATION] and par[at.TAP_PEAK] != 0.0:
        return False
    if contact == at.GONE:
        return True
    if par[at.SECOND_MASS] > 0.0 and _swings(par):
        return False
    if is_bare(par, contact):
        enough = max(_PRESSED, abs(y[at.VP] - y[at.V]) * least / _SOONER)
        pressed = par[at.UNILATERAL] > 0.0 and y[at.P] - y[at.X] > enough
        left = 1.0 + par[at.CONTACT_LOSS] * (y[at.VP] - y[at.V])
        return bool(pressed and left > _LEFT)
    return bool(contact == at.OPEN or par[at.LAYER_STIFFENING] == 0.0)


@compiled
def _places(par: Array, contact: int, places: IntArray, n: int) -> int:
    """Fill in the places of what changes in a mode; how many there are."""
    count = 0
    for i in range(n):
        there = i in (at.X, at.V)
        if i in (at.B, at.VB):
            there = par[at.BASE_MASS] > 0.0
        elif contact != at.GONE:
            there |= i in (at.P, at.VP) or i >= at.Z
            there |= i in (at.Q, at.VQ) and par[at.SECOND_MASS] > 0.0
        if there:
            places[count] = i
            count += 1
    return count


@compiled
def prepare_mode(par: Array, t: float, contact: int, guide: int, mode: SeriesMode) -> int:
    """Fill in the equations of a mode; returns how many numbers of the state change.

    Each column is the change of the bench's own rates and guards by one unit of a number.
    """
    still, whole, guards = mode.still, mode.whole, mode.guards
    state, zero, rate = mode.trial[0], mode.trial[1], mode.trial[2]
    n = state.size
    mode.trial[:] = 0.0
    guards[:] = 0.0
    count = _places(still, contact, mode.places, n)
    places = mode.places[:count]
    derivative(still, t, state, contact, guide, zero)
    guards[0, n], guards[1, n] = _guards(still, t, state, contact, guide)
    for j in range(count):
        state[places[j]] = 1.0
        derivative(still, t, state, contact, guide, rate)
        on_contact, on_guide = _guards(still, t, state, contact, guide)
        guards[0, j], guards[1, j] = on_contact - guards[0, n], on_guide - guards[1, n]
        state[places[j]] = 0.0
        for i in range(count):
            whole[i, j] = rate[places[i]] - zero[places[i]]
    entries = 0
    for i in range(count):
        mode.constant[i] = zero[places[i]]
        mode.firsts[i] = entries
        for j in range(count):
            if whole[i, j] != 0.0:
                mode.matrix[entries], mode.columns[entries] = whole[i, j], j
                entries += 1
    mode.firsts[count] = entries
    if guide == 0:
        guards[2] = -guards[1]
        guards[1, n], guards[2, n] = stick_reserves(par, guards[1, n])
    return count


@law
def _guards(par: Array, t: float, y: Array, contact: int, guide: int) -> tuple[float, float]:
    """Guard of the contact, and that of the guide or the friction that a stuck one needs."""
    on_contact, on_guide, _ = guard(par, y, t, contact, guide, 2)
    if guide == 0:
        on_guide = stick_force(par, y, t, contact)
    return on_contact, on_guide


@law
def _linear_rate(
    i: int, k: int, matrix: Array, firsts: IntArray, columns: IntArray, series: Array
) -> float:
    """Term ``k`` of the rate of a number by the linear laws, without what is constant."""
    total = 0.0
    for n in range(firsts[i], firsts[i + 1]):
        total += matrix[n] * series[columns[n], k]
    return total


@compiled
def expand(
    par: Array,
    t: float,
    limit: float,
    y: Array,
    contact: int,
    guide: int,
    count: int,
    mode: SeriesMode,
) -> float:
    """Fill in the series from a state; returns the length of step that it holds for, s.

    ``limit``: s, up to which drives are ramps. Zero or less where a number is not finite.
    """
    par, y = borrowed(par), borrowed(y)
    places, series, parts = borrowed(mode.places), borrowed(mode.series), borrowed(mode.parts)
    matrix, constant = borrowed(mode.matrix), borrowed(mode.constant)
    firsts, columns = borrowed(mode.firsts), borrowed(mode.columns)
    base = -1  # place of its position among the numbers
    moving = 0  # numbers that are a position and its speed in turn
    for i in range(count):
        series[i, 0] = y[places[i]]
        if places[i] == at.B:
            base = i
        if places[i] < at.H:
            moving = i + 1
    there = contact != at.GONE  # the impactor, of which numbers 2 and 3 tell
    pull = ramp = 0.0  # of drives, N and N/s
    if there and (par[at.PUSH_FORCE] != 0.0 or par[at.LIFT_FORCE] != 0.0):
        quarter = 0.25 * (limit - t)
        early, late = drive_force(par, t + quarter), drive_force(par, t + 3.0 * quarter)
        ramp = 0.5 * (late - early) / quarter
        pull = early - ramp * quarter
    swings, bare = there and _swings(par), is_bare(par, contact)
    cubic, peak = par[at.CUBIC], _peak(par, guide)
    for k in range(_ORDER):
        on_impactor = pull if k == 0 else ramp if k == 1 else 0.0
        on_plate = inner = 0.0
        if swings:
            _turn(par, k, series, parts)
            on_impactor += par[at.LOAD] * parts[_COSINE, k]
            on_impactor -= par[at.RESTORING] * par[at.LEVER] * parts[_SINE, k]
        if bare:
            on_plate = _press(par, k, series, parts)
            on_impactor -= on_plate
        if cubic != 0.0:
            inner += cubic * _cube(k, base, series, parts)
        if peak > 0.0:
            inner += guide * peak * _fall(par, k, base, series, parts)
        share = 1.0 / (k + 1)
        for i in range(0, moving, 2):
            series[i, k + 1] = share * series[i + 1, k]
            rate = _linear_rate(i + 1, k, matrix, firsts, columns, series)
            series[i + 1, k + 1] = share * (rate + constant[i + 1] if k == 0 else rate)
        for i in range(moving, count):
            rate = _linear_rate(i, k, matrix, firsts, columns, series)
            series[i, k + 1] = share * (rate + constant[i] if k == 0 else rate)
        if there:
            series[3, k + 1] += share * on_impactor / par[at.IMPACTOR_MASS]
        if guide != 0:
            series[1, k + 1] += share * (on_plate - inner) / par[at.PLATE_MASS]
            if base >= 0:
                series[base + 1, k + 1] += share * inner / par[at.BASE_MASS]
        elif base >= 0:
            together = share * on_plate / (par[at.PLATE_MASS] + par[at.BASE_MASS])
            series[1, k + 1] += together
            series[base + 1, k + 1] += together
        if guide == 0:  # what friction has to bear of it
            borne = 1.0
            if base >= 0:
                borne = par[at.BASE_MASS] / (par[at.PLATE_MASS] + par[at.BASE_MASS])
            parts[_INNER, k] = inner - borne * on_plate
    return _holds(par, count, base, peak, mode)


@compiled
def _holds(par: Array, count: int, base: int, peak: float, mode: SeriesMode) -> float:
    """Length of step that a series holds for, s; below zero where a number is not finite."""
    places, series = borrowed(mode.places), borrowed(mode.series)
    last = before = 0.0
    for i in range(count):
        scale = _PRECISION * (felt(places[i]) + abs(series[i, 0]))
        last = max(last, abs(series[i, _ORDER]) / scale)
        before = max(before, abs(series[i, _ORDER - 1]) / scale)
        if not abs(series[i, _ORDER]) < math.inf:
            return -1.0
    h = math.inf
    if last > 0.0:
        h = last ** (-1.0 / _ORDER)
    if before > 0.0:
        h = min(h, before ** (-1.0 / (_ORDER - 1)))
    if peak > 0.0:  # far above its speed a peak of friction leaves no trace in the terms
        speed = _relative(series, 0, 1, base)
        half = 0.5 * max(_SLOWER * abs(speed), _PEAK * par[at.STRIBECK_SPEED])
        h = min(h, half / max(abs(_relative(series, 1, 1, base)), 1e-300))
        h = min(h, math.sqrt(half / max(abs(_relative(series, 2, 1, base)), 1e-300)))
    return h


@law
def _turn(par: Array, k: int, series: Array, parts: Array) -> None:
    """Term ``k`` of sine and cosine of a swing's angle."""
    if k == 0:
        angle = series[2, 0] / par[at.LEVER]
        parts[_SINE, 0], parts[_COSINE, 0] = math.sin(angle), math.cos(angle)
        return
    sine = cosine = 0.0
    for j in range(1, k + 1):
        turn = j * series[2, j]
        sine += turn * parts[_COSINE, k - j]
        cosine -= turn * parts[_SINE, k - j]
    parts[_SINE, k] = sine / (k * par[at.LEVER])
    parts[_COSINE, k] = cosine / (k * par[at.LEVER])


@law
def _press(par: Array, k: int, series: Array, parts: Array) -> float:
    """Term ``k`` of the force of a bare contact, N: a power of how deep it is, and its loss."""
    n = par[at.CONTACT_EXPONENT]
    if k == 0:
        deep = series[2, 0] - series[0, 0]
        parts[_POWER, 0] = par[at.CONTACT_STIFFNESS] * deep**n
    else:
        total = 0.0
        for j in range(1, k + 1):
            total += (n * j - (k - j)) * (series[2, j] - series[0, j]) * parts[_POWER, k - j]
        parts[_POWER, k] = total / (k * (series[2, 0] - series[0, 0]))
    lost = 0.0
    for j in range(k + 1):
        lost += (series[3, j] - series[1, j]) * parts[_POWER, k - j]
    force: float = parts[_POWER, k] + par[at.CONTACT_LOSS] * lost
    return force


@law
def _relative(series: Array, k: int, of_plate: int, base: int) -> float:
    """Term ``k`` of a number of the plate, over that of the base."""
    term: float = series[of_plate, k]
    return term if base < 0 else term - series[base + of_plate, k]


@law
def _cube(k: int, base: int, series: Array, parts: Array) -> float:
    """Term ``k`` of the third power of the spring's compression, m^3."""
    square = cube = 0.0
    for j in range(k + 1):
        square += _relative(series, j, 0, base) * _relative(series, k - j, 0, base)
    parts[_SQUARE, k] = square
    for j in range(k + 1):
        cube += _relative(series, j, 0, base) * parts[_SQUARE, k - j]
    return cube


@law
def _fall(par: Array, k: int, base: int, series: Array, parts: Array) -> float:
    """Term ``k`` of the share of a peak of friction that the speed leaves."""
    total = 0.0
    for j in range(k + 1):
        total -= _relative(series, j, 1, base) * _relative(series, k - j, 1, base)
    parts[_QUOTIENT, k] = total / par[at.STRIBECK_SPEED] ** 2
    if k == 0:  # numbers that are all but zero would take a hundred times as long
        there = parts[_QUOTIENT, 0] > _LEAST
        parts[_EXPONENTIAL, 0] = math.exp(parts[_QUOTIENT, 0]) if there else 0.0
    else:
        total = 0.0
        for j in range(1, k + 1):
            total += j * parts[_QUOTIENT, j] * parts[_EXPONENTIAL, k - j]
        parts[_EXPONENTIAL, k] = total / k
    left: float = parts[_EXPONENTIAL, k]
    return left


@law
def _sum(terms: Array, s: float) -> float:
    """A series at ``s``: even and odd terms side by side, neither waits for the other."""
    square = s * s
    even: float = terms[_ORDER]
    odd: float = terms[_ORDER - 1]
    for k in range(_ORDER - 2, 0, -2):
        even = terms[k] + square * even
        odd = terms[k - 1] + square * odd
    return terms[0] + s * odd + square * even  # type: ignore[no-any-return]


@compiled
def series_state(s: float, count: int, mode: SeriesMode, out: Array) -> None:
    """State ``s`` seconds on, from the series; what does not change is left alone in ``out``."""
    places, series, out = borrowed(mode.places), borrowed(mode.series), borrowed(out)
    for i in range(count):
        out[places[i]] = _sum(series[i], s)


@compiled
def first_crossing(
    par: Array, h: float, contact: int, guide: int, count: int, mode: SeriesMode
) -> tuple[float, int]:
    """When the first guard ends the mode within a step of ``h`` s, and which; -1: none does.

    0: the contact, 1: the guide, 2: a stuck guide that gives the other way, or CLAMPED.
    """
    guards, series, parts = borrowed(mode.guards), borrowed(mode.series), borrowed(mode.parts)
    edges = borrowed(mode.edges)
    n = guards.shape[1] - 1
    reached, which = h, -1
    for i in range(4):
        if i == CLAMPED:
            if not (is_bare(par, contact) and par[at.CONTACT_LOSS] > 0.0):
                continue
            for k in range(_ORDER + 1):
                left = par[at.CONTACT_LOSS] * (series[3, k] - series[1, k])
                edges[i, k] = left + (1.0 if k == 0 else 0.0)
        else:
            if i == 2 and guide != 0:
                continue
            for k in range(_ORDER + 1):
                edges[i, k] = 0.0
            edges[i, 0] = guards[i, n]
            for j in range(count):
                if guards[i, j] != 0.0:
                    for k in range(_ORDER + 1):
                        edges[i, k] += guards[i, j] * series[j, k]
            if guide == 0 and i > 0:
                sign = 1.0 if i == 1 else -1.0
                for k in range(_ORDER):
                    edges[i, k] += sign * parts[_INNER, k]
        slack = LEAST_SPEED if i == 1 and guide != 0 else 0.0
        found = _first_below(edges[i], h, slack)
        if found >= 0.0 and (which < 0 or found < reached):
            reached, which = found, i
    return reached, which


@compiled
def _first_below(edge: Array, h: float, slack: float) -> float:
    """When a guard, by its terms, first falls below zero within ``h`` s; -1: it does not."""
    edge = borrowed(edge)
    bend, power = 0.0, 1.0  # at most, of the guard's second derivative
    for k in range(2, _ORDER + 1):
        bend += k * (k - 1) * abs(edge[k]) * power
        power *= h
    sag = bend * h * h / 8.0  # below the lower end of the step
    before, begin = edge[0], 0.0
    if before > sag and _sum(edge, h) > sag:
        return -1.0
    sag /= _PIECES**2
    for i in range(_PIECES):
        end = (i + 1) * (h / _PIECES)
        after = _sum(edge, end)
        if after < -slack:
            return _zero(edge, begin, end)
        if 0.0 < min(before, after) < sag:  # it may dip below zero and come back
            rates = _rate(edge, begin), _rate(edge, end)
            share = lowest(before, rates[0], after, rates[1], end - begin)
            if share > 0.0 and _sum(edge, begin + share * (end - begin)) < 0.0:
                return _zero(edge, begin, begin + share * (end - begin))
        begin, before = end, after
    return -1.0


@law
def _rate(terms: Array, s: float) -> float:
    """Rate of a series at ``s``."""
    rate: float = _ORDER * terms[_ORDER]
    for k in range(_ORDER - 1, 0, -1):
        rate = k * terms[k] + s * rate
    return rate


@compiled
def _zero(edge: Array, begin: float, end: float) -> float:
    """When a guard crosses zero that is below it at ``end`` (Illinois method)."""
    edge = borrowed(edge)
    low, high = begin, end
    f_low, f_high = _sum(edge, low), _sum(edge, high)
    if f_low <= LEAST_SPEED:
        # the mode began on its own edge: find a moment at which it is well inside
        probe = 0.5 * (end - begin)
        while probe > _SHORTEST:
            f_low = _sum(edge, begin + probe)
            if f_low > 0.0:
                low = begin + probe
                break
            high, f_high = begin + probe, f_low
            probe *= 0.5
        if low == begin:
            return begin
    side = 0
    s = high
    for _ in range(60):
        s = secant(low, f_low, high, f_high)
        value = _sum(edge, s)
        if value == 0.0 or high - low < 1e-14:
            break
        low, f_low, high, f_high, side = narrowed(low, f_low, high, f_high, side, s, value)
    return s
