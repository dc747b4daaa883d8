import dataclasses

import pytest

from impactscope.comply.compliance import Compliance
from impactscope.comply.resting_load import RestingLoad
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import Quality, Verdict

PROFILE = MeasurementProfile()


@pytest.fixture
def loads(make_event):
    """The loads seen before blows of (zero level, level after the blow, flags)."""

    def seen(*blows):
        load = RestingLoad(3.0)
        return [
            load.before(
                dataclasses.replace(make_event(zero=zero, quality=flags), rest_level=rest), 'force'
            )
            for zero, rest, flags in blows
        ]

    return seen


NONE, HELD = Quality.NONE, Quality.HELD


def test_drift_is_no_load(loads):
    assert loads((0, 0, NONE), (5, 0.5, NONE), (12, 1, NONE)) == [0, 0, 0]


def test_a_load_left_behind_counts_until_it_is_taken_away(loads):
    assert loads(
        (1.0, 100, HELD), (101.0, 0, NONE), (101.0, 20, NONE), (121.0, 0, NONE), (1.5, 0, NONE),
        (9.0, 0, NONE),
    ) == [0, 100, 100, 120, 0, 0]  # fmt: skip


def test_a_load_that_was_lifted_before_the_next_blow_does_no_harm(loads):
    assert loads((1.0, 9.8, HELD), (1.2, 9.8, HELD), (0.9, 9.8, NONE)) == [0, 0, 0]


def test_what_tells_nothing_changes_nothing(loads, make_event):
    nan = float('nan')
    assert loads((nan, nan, NONE), (50, nan, NONE), (60, nan, HELD), (160, nan, NONE)) == [
        0, 0, 0, 100,
    ]  # fmt: skip
    assert RestingLoad(3.0).before(make_event(), 'acceleration.plate') == 0


def test_a_second_push_on_top_of_a_held_one_is_never_passed(make_event, iso):
    """100 N held and 100 N more read as 100 N: far above what is permitted for the hand."""
    held = make_event(100, 100, 5.0, length=5.1, quality=Quality.HELD, stamp_ns=2_000_000_000)
    held = dataclasses.replace(held, contact_end=5.1, rest_level=100.0)
    more = make_event(100, 90, 1.0, zero=101.5, stamp_ns=8_000_000_000)
    stage = Compliance(iso, PROFILE)
    assert stage.push(held)[0].verdict is Verdict.PASS
    found = stage.push(more)[0]
    assert found.verdict is Verdict.INVALID
    assert found.reasons[0].startswith('A load of 100.0 N rested on the device')
    above = make_event(300, zero=101.5, stamp_ns=9_000_000_000)
    assert stage.push(above)[0].verdict is Verdict.FAIL
    stage.flush()
    assert stage.push(more)[0].verdict is Verdict.PASS  # of another stream: nothing is known
