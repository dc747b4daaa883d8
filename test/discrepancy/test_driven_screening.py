"""Starts of candidates: what is not straight in its amount is scaled anew."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.driven.fits.linearisation import Linearisation
from impactscope.discrepancy.driven.models.terms import Number, Term
from impactscope.discrepancy.driven.search import screening as screening_module
from impactscope.discrepancy.driven.search.screening import ScreenedStart, prospects

TIME = np.linspace(0.0, 1.0, 400)


def faded(corner):
    """What a first-order high-pass takes from a step: straight in its corner at small ones."""
    return 200.0 * (1.0 - np.exp(-corner * TIME))


def coupling(amounts=('corner',)):
    number = Number('corner', '1/s', (1.0,), 0.1, 1e-9, 1e3)
    return Term('ac_coupling', '', '', '', '', '', (number,), amounts=amounts)


@pytest.fixture
def promised(monkeypatch):
    """The prospect of a term from a corner, and what it would take away if nothing bent."""
    monkeypatch.setattr(
        screening_module,
        'change',
        lambda _model, _made, terms, values, _segments: faded(values[f'{terms[-1].label}.corner']),
    )

    def look(term, start, true):
        here = Linearisation(faded(true), np.zeros((0, TIME.size)), np.zeros((TIME.size, 0)))
        name = f'{term.label}.corner'
        seen = ScreenedStart(term, {name: start}, faded(start)[None].astype(np.float32))
        made = SimpleNamespace(values={}, terms=())
        (found,) = prospects(None, made, [seen], [], here)
        return found.initial[name], found.gain

    return look


@pytest.mark.parametrize('start', [30.0, 1.0, 0.1])
def test_a_start_that_is_far_too_large_is_scaled_until_it_is_right(promised, start):
    true = 0.05
    value, gain = promised(coupling(), start, true)
    assert value == pytest.approx(true, rel=0.5)  # from where a fit finds it
    assert gain > 0.8 * float(faded(true) @ faded(true))


def test_what_has_no_amount_is_not_scaled(promised):
    value, _ = promised(coupling(amounts=()), 3.0, 0.05)
    assert value == 3.0


def test_nothing_that_is_not_there_is_promised(promised):
    _, gain = promised(coupling(), 30.0, 1e-4)
    assert gain < screening_module.HOPE
