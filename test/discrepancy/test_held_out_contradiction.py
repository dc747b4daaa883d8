"""When held-out recordings contradict a finding."""

from types import SimpleNamespace

import pytest

from impactscope.discrepancy.evidence import Thresholds
from impactscope.discrepancy.impact.search import held_out


def outcome_of(gained):
    """A finding that lowers chi-square of the fitted recordings by ``gained``."""
    model = SimpleNamespace(data=SimpleNamespace(held_out=()))
    layout = SimpleNamespace(size=100)
    return SimpleNamespace(
        baseline=SimpleNamespace(chi_square=100.0 + gained, model=model, layout=layout),
        final=SimpleNamespace(chi_square=100.0, model=model, layout=layout),
        accepted=[SimpleNamespace(label='coulomb_friction')],
        last=[],
        notes=[],
        tests=None,
        window=1.0,
    )


@pytest.mark.parametrize(
    ('gained', 'worse', 'stands'),
    [
        (50.0, 8.0, True),  # chance
        (50.0, 20.0, False),
        (1000.0, 20.0, True),  # not quite right beside another effect that is missing
        (1000.0, 60.0, False),
        (-5.0, 9.5, False),  # what gains nothing has nothing allowed
    ],
)
def test_a_finding_stands_unless_predictions_get_worse(monkeypatch, gained, worse, stands):
    monkeypatch.setattr(held_out, 'held_out_fit', lambda *_: SimpleNamespace(reduced=1.0))
    monkeypatch.setattr(held_out, 'further_misfit', lambda *_: worse)
    outcome = outcome_of(gained)
    held_out.check_held_out(outcome, Thresholds(), 3)
    assert bool(outcome.accepted) is stands
    assert (outcome.final is outcome.baseline) is not stands
    assert any('contradict' in note for note in outcome.notes) is not stands
