import math

import numpy as np
import pytest

from impactscope.comply.evaluation import evaluate, read_force
from impactscope.comply.filtered_peak import filtered_peak_statement
from impactscope.comply.judge import judge
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import Verdict

PROFILE = MeasurementProfile()


def stated(event):
    reading = read_force(event)
    return filtered_peak_statement(reading, evaluate(event, reading, PROFILE), event.contact_start)


@pytest.mark.parametrize(
    ('width', 'loss'), [(0.0086, 0.001), (0.036, 0.0)]
)  # of the peak: a free hand blow, a fixed device
def test_a_blow_hardly_changes_and_noise_goes(make_event, width, loss):
    (sentence,) = stated(make_event(200.0, width=width, rate=10e3))
    read = float(sentence.split('would read ')[1].split(' N')[0])
    assert read == pytest.approx(200 * (1 - loss), abs=0.15)


def test_a_spike_that_decides_is_still_judged_raw(make_event, iso):
    def spike(values, t):
        values[0, np.argmin(np.abs(t - 0.118))] = 350.0

    found = judge(make_event(200.0, rate=10e3, zero=0.0, edit=spike), iso, PROFILE)
    assert found.verdict is Verdict.FAIL
    (sentence,) = [reason for reason in found.reasons if 'CFC 180' in reason]
    assert 200 < float(sentence.split('would read ')[1].split(' N')[0]) < 240


def test_where_it_cannot_be_told_nothing_is_said(make_event):
    def pierce(values, t):
        values[0, np.argmin(np.abs(t - 0.13))] = math.nan

    assert stated(make_event(edit=pierce)) == []
    assert stated(make_event(rate=500.0)) == []
    assert stated(make_event(edit=lambda values, t: values.fill(math.nan))) == []
    assert len(stated(make_event(rate=1000.0))) == 1
