"""Numbers of YAML files, as programs print them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.yaml_text import parse_yaml


@given(
    st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(['g', 'r', 'e', '.0e', 'f'])
)
def test_a_number_is_one_in_whatever_form_a_program_prints_it(number: float, form: str) -> None:
    text = repr(number) if form == 'r' else format(number, form)
    read = parse_yaml(f'value: {text}')['value']
    assert isinstance(read, int | float)
    assert math.isclose(read, float(text), rel_tol=1e-15)


@pytest.mark.parametrize('text', ['1e3', '1e+03', '-2E-5', '+.5e1', '3.e2', '1.5e3'])
def test_a_number_needs_neither_point_nor_sign(text: str) -> None:
    assert parse_yaml(f'[{text}]') == [float(text)]


@pytest.mark.parametrize('text', ['1e', 'e3', '1e3m', '"1e3"', '1e3.5', '.e3', 'tap1e3', '1-e3'])
def test_text_stays_text(text: str) -> None:
    assert parse_yaml(f'[{text}]') == [text.strip('"')]


def test_nothing_but_plain_data_is_made() -> None:
    with pytest.raises(Exception, match='could not determine a constructor'):
        parse_yaml('!!python/object/apply:os.getcwd []')
