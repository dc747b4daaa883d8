"""Fits of simulation errors: models that run away, and beginnings as figures show them."""

import dataclasses

import numpy as np

from impactscope.discrepancy.driven.fits.simulation_error import fit, plainly_begun
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Number

TIME = np.linspace(0.0, 1.0, 200)


def segment(measured, whitener=None):
    return Segment(
        'r.mcap',
        'displacement.axis',
        'm',
        False,
        0.0,
        float(TIME[1]),
        measured,
        np.zeros((1, TIME.size)),
        whitener=whitener,
    )


class Growing:
    """Grows by a rate; beyond a tenth per second it overflows."""

    numbers = (Number('rate', '1/s', (0.0,), 1.0),)
    terms = ()
    drifts = False

    def starts(self, _):
        return ()

    def predict(self, values, _terms, _start, _segment):
        with np.errstate(over='ignore'):
            return np.exp(1e4 * np.maximum(values['rate'] - 0.1, 0.0) * TIME) * values['rate']


def test_a_model_that_runs_away_is_far_off_and_no_error():
    found = fit(Growing(), (), [segment(np.full(TIME.size, 0.1))], {'rate': 0.2})
    assert np.isfinite(found.cost)
    found = fit(Growing(), (), [segment(np.full(TIME.size, 0.09))], {'rate': 0.05})
    assert abs(found.values['rate'] - 0.09) < 1e-3


class Drifting:
    """A mass without forces: a position and a speed at the beginning."""

    numbers = (Number('mass', 'kg', (1.0,), 1.0),)
    terms = ()
    drifts = True

    def starts(self, _):
        return Number('position', 'm', (0.0,), 1.0), Number('speed', 'm/s', (0.0,), 1.0)

    def predict(self, _values, _terms, start, _segment):
        return start[0] + start[1] * TIME


def test_figures_have_beginnings_that_leave_least_as_it_is():
    measured = 0.3 + 0.2 * TIME
    walk = segment(measured, np.diff)  # differences forgive any position
    made = fit(Drifting(), (), [walk], {}, starts=[np.array([5.0, 0.0])])
    assert made.rms(0) > 1.0
    shown = plainly_begun(Drifting(), made, [walk])
    assert shown.rms(0) < 1e-6
    assert np.allclose(shown.starts[0], [0.3, 0.2])
    assert shown.values == made.values
    plain = segment(measured)
    assert plainly_begun(Drifting(), made, [plain]).starts is not None


class Turning:
    """A wheel that turns on and on: whole turns of its beginning cannot be seen."""

    numbers = (Number('mass', 'kg', (1.0,), 1.0),)
    terms = ()
    drifts = False

    def starts(self, _):
        return (Number('position', 'rad', (0.0,), 0.1),)

    def predict(self, _values, _terms, start, _segment):
        return np.sin(start[0] + 2.0 * TIME) + 0.01 * start[0]


def test_the_beginning_of_a_held_out_recording_does_not_stay_where_another_model_left_it():
    measured = Turning().predict({}, (), np.array([0.4]), None)
    held_out = dataclasses.replace(segment(measured), held_out=True, recording='held_out.mcap')
    segments = [segment(measured), held_out]
    carried = [np.array([0.4]), np.array([0.4 + 8.0 * np.pi])]
    found = fit(Turning(), (), segments, {}, starts=carried)
    assert found.rms(1) < 1e-6
