import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.records import Estimate
from impactscope.report.numbers import (
    format_estimate,
    format_given,
    format_number,
    format_quantity,
    format_stamp,
    readable_estimate,
)


@pytest.mark.parametrize(
    ('value', 'std', 'scale', 'expected'),
    [
        (32.3412, 0.0583, 1.0, ('32.34', '0.12')),
        (203.2, 3.0, 1.0, ('203.2', '6.0')),
        (75_123.0, 402.0, 1e-3, ('75.12', '0.80')),
        (0.069214, 0.000641, 1.0, ('0.0692', '0.0013')),
        (1234.0, 61.0, 1.0, ('1230', '120')),
        (12.0, 1700.0, 1.0, ('0', '3400')),
        (5.0, 0.498, 1.0, ('5.0', '1.0')),  # 0.996 rounds up into the next decade
        (-0.001, 0.5, 1.0, ('0.0', '1.0')),  # no negative zero
        (math.nan, 1.0, 1.0, ('not estimated', '')),
        (math.inf, 1.0, 1.0, ('not estimated', '')),
        (3.14159, math.nan, 1.0, ('3.142', 'not known')),
        (3.14159, -1.0, 1.0, ('3.142', 'not known')),
        (7.5, 0.0, 1.0, ('7.500', '0')),
        (1.2345e-12, 2e-15, 1.0, ('1.2345e-12', '4.0e-15')),
        (1.2345e12, 2e9, 1.0, ('1.2345e+12', '4.0e+09')),
    ],
)
def test_value_and_expanded_uncertainty_end_at_the_same_place(value, std, scale, expected):
    assert format_estimate(Estimate(value, std), scale) == expected


finite = st.floats(-1e12, 1e12, allow_nan=False)


@given(finite, st.floats(1e-15, 1e12))
def test_printed_numbers_stay_near_the_true_ones(value, std):
    shown, uncertainty = format_estimate(Estimate(value, std))
    expanded = 2 * std
    # Two digits: the uncertainty is off by at most half of its second digit.
    assert float(uncertainty) == pytest.approx(expanded, rel=0.051)
    assert abs(float(shown) - value) <= 0.051 * expanded + 1e-12 * abs(value)
    if 'e' not in shown:
        assert len(shown.partition('.')[2]) == len(uncertainty.partition('.')[2])


@given(st.floats(allow_nan=True, allow_infinity=True), st.floats(), st.floats())
def test_no_float_is_refused(value, std, scale):
    assert format_number(value)
    assert format_given(value)
    assert format_estimate(Estimate(value, std), scale)[0]


@given(st.floats(1e-9, 1e8), st.integers(1, 8))
def test_significant_digits(value, digits):
    assert float(format_number(value, digits)) == pytest.approx(
        value, rel=0.51 * 10 ** (1 - digits)
    )


def test_a_quantity_without_value_has_neither_unit_nor_uncertainty():
    row = format_quantity('Moving mass', Estimate(), 'kg')
    assert (row.value, row.uncertainty, row.unit, row.relative) == ('not estimated', '', '', '')
    assert format_quantity('f', Estimate(200.0, 1.0), 'Hz').relative == '1.0 %'
    assert format_quantity('f', Estimate(0.0, 1.0), 'Hz').relative == ''


def test_stamps():
    assert format_stamp(1_795_000_000_123_456_789) == '2026-11-18 11:06:40.123 UTC'
    assert format_stamp(12_345_000_000) == '12.345 s (clock of the recording)'
    assert format_stamp(0).startswith('0.000 s')
    assert 'no calendar date' in format_stamp(10**30)


@pytest.mark.parametrize(
    ('value', 'std', 'unit', 'expected'),
    [
        (5.152e-7, 1.5e-8, 'm', ('0.515', '0.030', 'µm')),
        (0.2, 0.001, 'm', ('0.2000', '0.0020', 'm')),
        (-0.0205, 0.0004, 'N', ('-20.50', '0.80', 'mN')),
        (1.0e-4, 0.2, 'N', ('0.00', '0.40', 'N')),
        (2e-12, 1e-13, 's', ('0.00200', '0.00020', 'ns')),
        (0.0, math.nan, 'm', ('0', 'not known', 'm')),
        (math.nan, math.nan, 'kg', ('not estimated', '', 'kg')),
        (0.002, 0.0001, 'N/m', ('0.00200', '0.00020', 'N/m')),
        (3.0, 0.0, '1', ('3', '', '')),
    ],
)
def test_small_numbers_have_units_that_people_read(value, std, unit, expected):
    assert readable_estimate(value, std, unit) == expected
