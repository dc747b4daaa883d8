"""A filter that was run backwards over a recording that ends in motion leaves its end odd."""

from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.evidence import Thresholds
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.models.bench_model import RECORDING_END, ActiveEffect
from impactscope.discrepancy.impact.search import joint_fits, recording_ends
from impactscope.discrepancy.impact.search.joint_fits import JointFits
from impactscope.discrepancy.impact.search.recording_ends import runs_backwards, without_odd_ends

TIMES = np.arange(500) / 5000.0


def filter_of(zero_phase):
    active = ActiveEffect('low_pass_filter', 'force')
    constants = {'low_pass_filter:force.order': 4, 'low_pass_filter:force.zero_phase': zero_phase}
    return Candidate(
        'filter', 'low_pass_filter', 'measurement', effects=(active,), constants=constants
    )


FRICTION = Candidate(
    'friction', 'coulomb_friction', 'guide', effects=(ActiveEffect('coulomb_friction'),)
)


def left_of(at_end, elsewhere=1.0):
    """A fit of two channels of one blow; what it leaves of the force, at its end and before."""
    left = elsewhere * np.random.default_rng(5).standard_normal(2 * TIMES.size)
    last = np.flatnonzero(TIMES[-1] - RECORDING_END <= TIMES)
    left[last] = at_end * np.sign(left[last])
    channel = SimpleNamespace(centres=TIMES, time=TIMES)
    channels = dict.fromkeys(('force', 'acceleration.plate'), channel)
    every = np.ones(TIMES.size, dtype=bool)
    layout = SimpleNamespace(
        blows=(0,),
        window=0.25,
        spans={
            (0, 'force'): slice(0, TIMES.size),
            (0, 'acceleration.plate'): slice(TIMES.size, 2 * TIMES.size),
        },
        masks={(0, name): every for name in channels},
    )
    model = SimpleNamespace(
        data=SimpleNamespace(blows=[SimpleNamespace(channels=channels)], channels=channels),
        layout=lambda blows, window, without_ends: (blows, window, without_ends),
    )
    return SimpleNamespace(model=model, layout=layout, residuals=left, x=np.zeros(1))


@pytest.mark.parametrize(
    ('at_end', 'elsewhere', 'odd'),
    [
        (10.0, 1.0, True),
        (2.0, 1.0, False),  # not by much
        (10.0, 5.0, False),  # as much is left everywhere
    ],
)
def test_ends_are_odd_where_far_more_is_left_there(monkeypatch, at_end, elsewhere, odd):
    monkeypatch.setattr(recording_ends, 'fit', lambda model, layout, x, near: layout)
    found = without_odd_ends(left_of(at_end, elsewhere))
    assert found == (((0,), 0.25, frozenset({'force'})) if odd else None)


def test_only_filters_that_run_backwards_need_no_ends():
    assert [runs_backwards(c) for c in (filter_of(1), filter_of(0), FRICTION)] == [
        True,
        False,
        False,
    ]


@pytest.mark.parametrize(
    ('best', 'eased'), [(filter_of(1), True), (filter_of(0), False), (FRICTION, False)]
)
def test_without_odd_ends_only_what_leaves_such_is_found(monkeypatch, best, eased):
    """Anything else has to explain the ends, too."""
    whole, without = object(), object()
    monkeypatch.setattr(joint_fits, 'without_odd_ends', lambda _: without)
    asked = []

    def tried_at(self, current, sound, most, suspected):
        asked.append(current)
        return [SimpleNamespace(candidate=best)], 40, current

    monkeypatch.setattr(JointFits, '_tried_at', tried_at)
    _, _, where = JointFits((), Thresholds())._tried(whole, None, 0, ())
    assert where is (without if eased else whole)
    assert asked == ([without] if eased else [without, whole])
