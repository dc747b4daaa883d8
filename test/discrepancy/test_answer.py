"""The answer as plain data."""

from __future__ import annotations

import json
import math

from hypothesis import given
from hypothesis import strategies as st

from impactscope.discrepancy.answer import (
    ANSWER_VERSION,
    Answer,
    Finding,
    FitFigures,
    FitTable,
    Mismatch,
    ParameterEstimate,
    Region,
)


def answer(**changes):
    finding = Finding(
        'coulomb_friction',
        0.97,
        'guide',
        {'force': ParameterEstimate(1.5, 0.02, 'N')},
        ('stribeck_friction',),
        sentence='Dry friction.',
    )
    region = Region('hit0.mcap', 'force', 0.1, 0.2, 'loading', (20.0, 60.0), 1e-6, 4.0)
    values = {
        'campaign': 'bench',
        'kind': 'impact',
        'mismatch': Mismatch(True, 1e-6, (region,), ('guide',)),
        'accepted': ('coulomb_friction',),
        'ranking': (finding,),
        'fit': FitTable(FitFigures({'force': 1.0}, {'force': 1.2}), FitFigures(), {'force': 0.4}),
        'next_tests': ('taps',),
    }
    return Answer(**{**values, **changes})


def test_json_has_every_field_that_others_read():
    data = json.loads(json.dumps(answer().to_json(), allow_nan=False))
    assert data['version'] == ANSWER_VERSION
    assert data['mismatch']['detected'] is True
    assert data['mismatch']['p_value'] == 1e-6
    assert data['mismatch']['subsystems'] == ['guide']
    (region,) = data['mismatch']['regions']
    assert {k: region[k] for k in ('recording', 'channel', 'start_s', 'end_s', 'phase')} == {
        'recording': 'hit0.mcap',
        'channel': 'force',
        'start_s': 0.1,
        'end_s': 0.2,
        'phase': 'loading',
    }
    assert region['band_hz'] == [20.0, 60.0]
    assert data['accepted'] == ['coulomb_friction']
    (ranked,) = data['ranking']
    assert ranked['name'] == 'coulomb_friction'
    assert ranked['probability'] == 0.97
    assert ranked['parameters'] == {'force': {'value': 1.5, 'std': 0.02, 'unit': 'N'}}
    assert ranked['confused_with'] == ['stribeck_friction']
    assert data['fit']['baseline']['rmse'] == {'force': 1.0}
    assert data['fit']['baseline']['held_out_rmse'] == {'force': 1.2}
    assert data['fit']['extended']['rmse'] == {}
    assert data['fit']['noise_floor'] == {'force': 0.4}
    assert data['unexplained'] is False
    assert data['next_tests'] == ['taps']


@given(st.floats(), st.floats(), st.floats())
def test_json_is_strict_whatever_the_numbers_are(p_value, value, std):
    finding = Finding('offset', 0.5, parameters={'value': ParameterEstimate(value, std, 'N')})
    made = answer(mismatch=Mismatch(True, p_value), ranking=(finding,), duration_s=value)
    data = json.loads(json.dumps(made.to_json(), allow_nan=False))
    assert data['mismatch']['p_value'] == (p_value if math.isfinite(p_value) else None)


def test_text_parameters_stay_text():
    finding = Finding(
        'wrong_parameter', 1.0, parameters={'name': ParameterEstimate('mass', math.nan, 'text')}
    )
    data = answer(ranking=(finding,)).to_json()
    assert data['ranking'][0]['parameters']['name'] == {
        'value': 'mass',
        'std': None,
        'unit': 'text',
    }


def test_findings_follow_acceptance_and_may_repeat_a_name():
    first = Finding('wrong_parameter', 1.0, recording='a')
    second = Finding('wrong_parameter', 0.9, recording='b')
    made = answer(accepted=('wrong_parameter', 'wrong_parameter'), ranking=(first, second))
    assert [f.recording for f in made.findings] == ['a', 'b']


def test_summary_says_nothing_friction_or_unknown():
    assert 'Nothing is missing' in answer(mismatch=Mismatch(False, 1.0)).summary()
    assert answer().summary() == 'Dry friction.'
    unknown = answer(accepted=('unknown',), unexplained=True, unexplained_description='It rings.')
    assert unknown.summary() == 'It rings.'
