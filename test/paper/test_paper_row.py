import math

import pytest

from impactscope.errors import InputError
from impactscope.paper.row import Basis, Standing, row


def test_half_a_unit_of_the_last_printed_digit_is_granted():
    assert row('3:a', 'q', 'Hz', '32.37', 32.374).standing is Standing.HOLDS
    assert row('3:a', 'q', 'Hz', '32.37', 32.376).standing is Standing.DIFFERS
    assert row('3:a', 'q', 'Hz', '202.0', 202.04).standing is Standing.HOLDS
    assert row('3:a', 'q', 'Hz', '175', 175.4).standing is Standing.HOLDS


def test_a_given_value_must_agree():
    assert row('2:a', 'q', 'N', '10', 10.2, basis=Basis.GIVEN).standing is Standing.DIFFERS
    assert row('2:a', 'q', 'N', '10', 10.0, basis=Basis.GIVEN).standing is Standing.HOLDS


def test_difference_is_computed_minus_paper():
    item = row('3:a', 'q', 'Hz', '50', 51.0)
    assert item.difference == 1.0
    assert item.relative_difference == pytest.approx(0.02)
    assert row('3:a', 'q', 'Hz', '', 51.0).difference is None
    assert row('3:a', 'q', 'Hz', '0', 1.0).relative_difference is None


def test_what_is_not_printed_stands_alone():
    item = row('3:a', 'q', 'Hz', '', 51.0)
    assert item.paper is None
    assert item.standing is Standing.NOT_PRINTED


def test_what_noise_makes_is_not_called_different():
    item = row('3:a', 'q', 'N', '1.14', 0.4, basis=Basis.SIMULATED, comparable=False)
    assert item.standing is Standing.RECORDING
    assert item.difference == pytest.approx(-0.74)


def test_simulated_rows_say_so():
    assert 'simulated' in row('3:a', 'q', 'Hz', '', 1.0, basis=Basis.SIMULATED).remark
    assert 'simulated' in row('3:a', 'q', 'Hz', '', 1.0, 'by fit', basis=Basis.SIMULATED).remark


def test_json_has_the_keys_that_were_promised():
    content = row('3.1.1:a', 'q', 'Hz', '1.0', 1.0, 'why').to_json()
    promised = {
        'id', 'section', 'quantity', 'unit', 'paper', 'computed', 'difference', 'remark',
    }  # fmt: skip
    assert promised <= set(content)
    assert content['section'] == '3.1.1'


@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_refused(value):
    with pytest.raises(InputError, match='3:a'):
        row('3:a', 'q', 'Hz', '', value)


@pytest.mark.parametrize('identity', ['abc', ':a', '3:'])
def test_an_identity_needs_section_and_name(identity):
    with pytest.raises(InputError, match='section'):
        row(identity, 'q', 'Hz', '', 1.0)
