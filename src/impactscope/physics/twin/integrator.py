"""One integrator for everything: an embedded Runge-Kutta pair with located events, compiled.

The pair of :mod:`.runge_kutta` steps through each of the :mod:`.modes` of the bench, the series
of :mod:`.power_series` through those that have one, where energies do not matter. A step that
would leave the mode ends where its guard crosses zero: found on the dense output, then stepped to
anew with the full method, so that an event is as accurate as any other state. Corners of the
drives are stepped to, never across.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from impactscope.physics.mechanisms.compiled import borrowed, compiled
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.crossings import dip, narrowed, secant
from impactscope.physics.twin.equations import (
    accelerations,
    derivative,
    energy,
    forces,
    free_compression,
    guard,
    spring_force,
    spring_region,
)
from impactscope.physics.twin.modes import (
    LEAST_SPEED,
    catch,
    change_mode,
    guide_after,
    slip_direction,
)
from impactscope.physics.twin.power_series import (
    CLAMPED,
    SeriesMode,
    borrowed_mode,
    expand,
    first_crossing,
    has_series,
    is_bare,
    may_have_series,
    mode_room,
    prepare_mode,
    series_state,
)
from impactscope.physics.twin.runge_kutta import dense_state, local_error, prepare_dense, step
from impactscope.physics.twin.start import approach, corners, start

__all__ = ['NOT_FINITE', 'TOO_MANY_EVENTS', 'TOO_MANY_STEPS', 'integrate', 'run']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

TOO_MANY_STEPS: Final = -1
TOO_MANY_EVENTS: Final = -2
NOT_FINITE: Final = -3

_SHORTEST = 1e-11  # s
_FIRST = 1e-5  # s, step with which a bare contact begins


@compiled
def _moving(par: Array, n: int, lean: bool) -> IntArray:
    """Places in the state that change at all; ``lean``: without energies."""
    places = np.empty(n, dtype=np.int64)
    count = 0
    for i in range(n):
        there = not lean or i not in (at.LOST, at.WORK)
        if i in (at.Q, at.VQ):
            there = par[at.SECOND_MASS] > 0.0
        elif i in (at.B, at.VB):
            there = par[at.BASE_MASS] > 0.0
        elif i == at.H:
            there = par[at.HYSTERESIS_SHARE] > 0.0
        elif i in (at.P, at.VP):
            there = par[at.IMPACTOR_MASS] > 0.0
        if there:
            places[count] = i
            count += 1
    return places[:count]


@compiled
def _crossing(
    par: Array,
    t: float,
    h: float,
    y: Array,
    moving: IntArray,
    dense: Array,
    modes: tuple[int, int, int],
    which: int,
    last: float,
    work: Array,
) -> float:
    """Share of the step, up to ``last``, at which a guard crosses zero (Illinois method)."""
    contact, guide, region = modes
    low, high = 0.0, last
    dense_state(y, h, moving, dense, high, work)
    f_high = guard(par, work, t + high * h, contact, guide, region)[which]
    f_low = guard(par, y, t, contact, guide, region)[which]
    if f_low <= LEAST_SPEED:
        # the mode began on its own edge: find a moment at which it is well inside
        probe = 0.5 * last
        while probe * h > _SHORTEST:
            dense_state(y, h, moving, dense, probe, work)
            f_low = guard(par, work, t + probe * h, contact, guide, region)[which]
            if f_low > 0.0:
                low = probe
                break
            high, f_high = probe, f_low
            probe *= 0.5
        if low == 0.0:
            return 0.0
    side = 0
    share = high
    for _ in range(60):
        share = secant(low, f_low, high, f_high)
        dense_state(y, h, moving, dense, share, work)
        value = guard(par, work, t + share * h, contact, guide, region)[which]
        if value == 0.0 or (high - low) * h < 1e-14:
            break
        low, f_low, high, f_high, side = narrowed(low, f_low, high, f_high, side, share, value)
    return share


@compiled
def _write(
    par: Array, t: float, y: Array, contact: int, guide: int, rows: Array, at_row: int
) -> None:
    """Row ``at_row`` of the output from one state."""
    par, y, rows = borrowed(par), borrowed(y), borrowed(rows)
    acting = forces(par, t, y, contact, guide)
    plate, impactor, _, base = accelerations(par, t, y, contact, acting)
    compression = y[at.X] - y[at.B]
    if par[at.READS_DISPLACEMENT] > 0.0:
        rows[at_row, at.READING] = par[at.STIFFNESS] * compression
    else:
        rows[at_row, at.READING] = spring_force(par, compression, y[at.H])
    rows[at_row, at.PLATE_ACCELERATION] = plate
    rows[at_row, at.IMPACTOR_ACCELERATION] = impactor
    rows[at_row, at.BASE_ACCELERATION] = base
    rows[at_row, at.CONTACT_FORCE] = acting[0]
    rows[at_row, at.FRICTION_FORCE] = acting[1]
    rows[at_row, at.PLATE_POSITION] = y[at.X]
    rows[at_row, at.PLATE_VELOCITY] = y[at.V]
    rows[at_row, at.IMPACTOR_POSITION] = y[at.P]
    rows[at_row, at.IMPACTOR_VELOCITY] = y[at.VP]
    rows[at_row, at.BASE_POSITION] = y[at.B]
    if rows.shape[1] < at.N_COLUMNS:
        return
    rows[at_row, at.LAYER_COMPRESSION] = 0.0
    if par[at.HAS_LAYER] > 0.0:
        free = contact != at.CLOSED
        rows[at_row, at.LAYER_COMPRESSION] = (
            free_compression(par, y) if free else y[at.P] - y[at.X]
        )
    rows[at_row, at.ENERGY] = energy(par, y, contact)
    rows[at_row, at.LOST_ENERGY] = y[at.LOST]
    rows[at_row, at.DONE_WORK] = y[at.WORK]


@compiled
def _leaving(
    par: Array,
    t: float,
    h: float,
    y: Array,
    y_new: Array,
    moving: IntArray,
    k: Array,
    modes: tuple[int, int, int],
    dense: Array,
    work: Array,
) -> tuple[float, int]:
    """First share of the step at which a guard ends the mode, and which guard; -1: none does.

    ``dense`` is prepared where one does.
    """
    par, y, y_new, moving, k, dense, work = (
        borrowed(par),
        borrowed(y),
        borrowed(y_new),
        borrowed(moving),
        borrowed(k),
        borrowed(dense),
        borrowed(work),
    )
    contact, guide, region = modes
    g0 = guard(par, y, t, contact, guide, region)
    g1 = guard(par, y_new, t + h, contact, guide, region)
    share, which = 2.0, -1
    prepared = False
    for i in range(3):
        slack = LEAST_SPEED if i == 1 and guide != 0 else 0.0
        last = 1.0 if g1[i] < -slack else 0.0
        # between its ends the step may dip out of the mode and back
        if last == 0.0 and g0[i] > 0.0:
            if i == 0 and contact == at.OPEN:
                last = dip(g0[0], y[at.V] - y[at.VP], g1[0], y_new[at.V] - y_new[at.VP], h)
            elif i == 0 and contact == at.CLOSED and par[at.HAS_LAYER] > 0.0:
                moment = 1e-6 * h  # the force's rate follows from that of the state
                for n in moving:
                    work[n] = y[n] + moment * k[0, n]
                before = guard(par, work, t, contact, guide, region)[0] - g0[0]
                for n in moving:
                    work[n] = y_new[n] + moment * k[6, n]
                after = guard(par, work, t + h, contact, guide, region)[0] - g1[0]
                last = dip(g0[0], before / moment, g1[0], after / moment, h)
            elif i == 1 and guide in (-1, 1):
                before, after = k[0, at.V] - k[0, at.VB], k[6, at.V] - k[6, at.VB]
                last = dip(g0[1], guide * before, g1[1], guide * after, h)
        if last == 0.0:
            continue
        if not prepared:
            prepare_dense(moving, k, dense)
            prepared = True
        if last < 1.0:
            dense_state(y, h, moving, dense, last, work)
            if guard(par, work, t + last * h, contact, guide, region)[i] >= 0.0:
                continue
        found = _crossing(par, t, h, y, moving, dense, modes, i, last, work)
        if found < share:
            share, which = found, i
    return share, which


@compiled
def _run(
    par: Array,
    y: Array,
    contact: int,
    at_corners: Array,
    times: Array,
    tolerance: float,
    longest_step: float,
    most_steps: int,
    rows: Array,
    event_times: Array,
    event_kinds: IntArray,
    k: Array,
    dense: Array,
    y_new: Array,
    work: Array,
    moving: IntArray,
    mode: SeriesMode,
    some_series: bool,
) -> tuple[int, int]:
    """As :func:`integrate`, with room for stages, dense output, two states and a mode's series.

    ``some_series``: whether any mode may be followed by series.
    """
    par, y, at_corners, times, rows = (
        borrowed(par),
        borrowed(y),
        borrowed(at_corners),
        borrowed(times),
        borrowed(rows),
    )
    k, dense, y_new, work = borrowed(k), borrowed(dense), borrowed(y_new), borrowed(work)
    moving, mode = borrowed(moving), borrowed_mode(mode)
    tracked = (
        par[at.STATIC_FORWARD] > 0.0
        or par[at.STATIC_BACKWARD] > 0.0
        or par[at.HYSTERESIS_SHARE] > 0.0
    )
    guide = guide_after(par, 0.0, y, contact, tracked)
    region = spring_region(par, y[at.X] - y[at.B])

    t = 0.0
    end = times[-1]
    next_row = 0
    next_corner = 0
    n_events = 0
    n_steps = 0
    h = 1e-4
    fresh = True  # the rate in k[0] is not that of y
    count = 0  # of numbers that change in a mode with a series; 0: it is not prepared
    while next_row < len(times) and times[next_row] <= t:
        _write(par, t, y, contact, guide, rows, next_row)
        next_row += 1
    while next_row < len(times):
        n_steps += 1
        if n_steps > most_steps:
            return TOO_MANY_STEPS, n_steps
        while next_corner < len(at_corners) and at_corners[next_corner] <= t + _SHORTEST:
            next_corner += 1
            fresh = True
        limit = min(at_corners[next_corner], end) if next_corner < len(at_corners) else end
        slips_to = 0
        wanted = 0.0
        if some_series and has_series(par, t, y, contact, h):
            if count == 0:
                count = prepare_mode(par, t, contact, guide, mode)
            wanted = min(expand(par, t, limit, y, contact, guide, count, mode), longest_step)
            if not wanted > 0.0:
                return NOT_FINITE, n_steps
        bare = is_bare(par, contact)
        if wanted > 0.0 and not (bare and wanted < h):  # as it is where such a contact begins
            to_limit = t + wanted * 1.0000001 >= limit
            length = limit - t if to_limit else wanted
            reached, which = first_crossing(par, length, contact, guide, count, mode)
            if which == CLAMPED:
                which, to_limit = -1, False
            if guide == 0:
                slips_to = 1 if which == 1 else -1
                which = min(which, 1)
            t_reached = limit if which < 0 and to_limit else t + reached
            for i in moving:
                y_new[i] = work[i] = y[i]
            while next_row < len(times) and times[next_row] <= t_reached:
                series_state(times[next_row] - t, count, mode, work)
                _write(par, times[next_row], work, contact, guide, rows, next_row)
                next_row += 1
            series_state(reached, count, mode, y_new)
            fresh = True
            if not bare or which >= 0:
                h = 1e-4
        else:
            h = min(h, longest_step)
            wanted = h
            to_limit = t + h * 1.0000001 >= limit
            if to_limit:
                h = limit - t
            if fresh:
                derivative(par, t, y, contact, guide, k[0])
                fresh = False
            step(par, t, h, y, contact, guide, moving, k, y_new)
            error = local_error(h, y, y_new, moving, k, tolerance)
            if not error <= 1.0 and h > _SHORTEST:  # also where it is not a number
                h *= max(0.1, 0.9 * error**-0.2) if error < 1e30 else 0.1
                continue
            if not error < 1e30:
                return NOT_FINITE, n_steps

            share, which = _leaving(
                par, t, h, y, y_new, moving, k, (contact, guide, region), dense, work
            )
            dense_ready = which >= 0
            if not dense_ready and times[next_row] <= t + 1.001 * h:
                prepare_dense(moving, k, dense)
                dense_ready = True
            reached = h if which < 0 else max(share * h, 0.0)
            t_reached = limit if which < 0 and to_limit else t + reached
            while next_row < len(times) and times[next_row] <= t_reached:
                dense_state(y, h, moving, dense, (times[next_row] - t) / h, work)
                _write(par, times[next_row], work, contact, guide, rows, next_row)
                next_row += 1
            if which == 1 and guide == 0:
                slips_to = slip_direction(par, y_new, t + h, contact)
            if which < 0:
                for i in moving:
                    k[0, i] = k[6, i]
                h *= min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
                if to_limit:
                    h = max(h, wanted)
            else:
                # an event: step to it with the full method
                if reached > 0.0:
                    step(par, t, reached, y, contact, guide, moving, k, y_new)
                h = min(wanted, 1e-4)

        if which >= 0 and n_events == len(event_times):
            return TOO_MANY_EVENTS, n_steps
        if reached > 0.0:
            for i in moving:
                y[i] = y_new[i]
            t = t_reached
        if which < 0:
            if contact == at.OPEN and t >= par[at.CATCH_TIME]:
                catch(par, y)
                contact = at.GONE
                fresh, count = True, 0
            continue
        fresh, count = True, 0
        contact, guide, region, kind = change_mode(
            par, t, y, (contact, guide, region), which, slips_to, tracked
        )
        if kind == at.CONTACT_BEGINS and par[at.HAS_LAYER] == 0.0:
            h = min(h, _FIRST)
        event_times[n_events] = t
        event_kinds[n_events] = kind
        n_events += 1
    return n_events, n_steps


@compiled
def integrate(
    par: Array,
    y: Array,
    contact: int,
    at_corners: Array,
    times: Array,
    tolerance: float,
    longest_step: float,
    most_steps: int,
    rows: Array,
    event_times: Array,
    event_kinds: IntArray,
) -> tuple[int, int]:
    """Integrate from time 0 and fill ``rows`` at ``times`` (rising, the first at least 0).

    ``y`` is the state at time 0 and is changed; ``at_corners`` are rising times at which a drive
    has a corner; ``rows`` has shape (len(times), N_COLUMNS), or N_LEAN_COLUMNS where energies do
    not matter. Returns the number of events,
    or TOO_MANY_STEPS, TOO_MANY_EVENTS or NOT_FINITE, and the number of steps.
    """
    n = len(y)
    lean = rows.shape[1] < at.N_COLUMNS
    some_series = lean and may_have_series(par)
    return _run(
        par.copy(),  # which changes where the loss of a contact goes by its speed
        y,
        contact,
        at_corners,
        times,
        tolerance,
        longest_step,
        most_steps,
        rows,
        event_times,
        event_kinds,
        np.zeros((7, n)),
        np.zeros((n, 4)),
        y.copy(),
        y.copy(),
        _moving(par, n, lean),
        mode_room(par, n if some_series else 0),
        some_series,
    )


@compiled
def run(
    par: Array,
    times: Array,
    tolerance: float,
    longest_step: float,
    most_steps: int,
    rooms: tuple[int, int],
    rows: Array,
) -> tuple[int, int, Array, IntArray]:
    """A whole blow, approach and all, at ``times`` (rising, s from first contact).

    ``rooms``: for so many events, and for so many where there are more. Fills ``rows`` as
    :func:`integrate` does and returns what that returns, then event times and kinds.
    """
    before = np.searchsorted(times, 0.0)
    rows[:before] = 0.0
    if before > 0 and par[at.IMPACTOR_MASS] > 0.0:
        approach(par, times[:before], rows[:before])
    found, steps = 0, 0
    event_times, event_kinds = np.empty(0), np.empty(0, dtype=np.int64)
    if before == times.size:
        return found, steps, event_times, event_kinds
    for room in rooms:
        event_times, event_kinds = np.empty(room), np.empty(room, dtype=np.int64)
        state, contact = start(par)
        found, steps = integrate(
            par,
            state,
            contact,
            corners(par),
            times[before:],
            tolerance,
            longest_step,
            most_steps,
            rows[before:],
            event_times,
            event_kinds,
        )
        if found != TOO_MANY_EVENTS:
            break
    if found >= 0 and not np.all(np.isfinite(rows[times.size - 1])):
        found = NOT_FINITE
    kept = max(found, 0)
    return found, steps, event_times[:kept].copy(), event_kinds[:kept].copy()
