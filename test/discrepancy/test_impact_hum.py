"""A hum must be there before the blow, too, where the channel is compared there."""

from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.impact_search import _everywhere

TIMES = np.linspace(-0.2, 0.8, 1000)
HUM = 3 * np.sin(2 * np.pi * 50 * TIMES)
NOISE = np.random.default_rng(4).normal(size=TIMES.size)


def fits(old, new, mask):
    channel = SimpleNamespace(centres=TIMES)
    blow = SimpleNamespace(channels={'force': channel}, onset=0.0)
    layout = SimpleNamespace(
        size=int(mask.sum()),
        masks={(0, 'force'): mask},
        spans={(0, 'force'): slice(0, mask.sum())},
    )
    model = SimpleNamespace(data=SimpleNamespace(blows=[blow]))
    return (
        SimpleNamespace(model=model, layout=layout, residuals=new[mask]),
        SimpleNamespace(model=model, layout=layout, residuals=old[mask]),
    )


@pytest.mark.parametrize(
    ('old', 'first', 'stands'),
    [
        (NOISE + HUM, -0.2, True),
        (NOISE + HUM * (TIMES > 0), -0.2, False),  # it only stands for something after the blow
        (NOISE + HUM, 0.0, True),  # not compared before: nothing speaks against it
    ],
)
def test_a_hum_is_there_before_the_blow(old, first, stands):
    joint, current = fits(old, old - HUM, first <= TIMES)
    assert _everywhere(joint, current) is stands
