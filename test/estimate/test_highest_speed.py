from __future__ import annotations

import dataclasses
import math

import pytest

from impactscope.estimate import highest_speed
from impactscope.physics.contact_model import permitted_speed
from impactscope.records import (
    ComplianceVerdict,
    Estimate,
    ImpactParameters,
    TestPoint,
    Verdict,
    VerdictScope,
)

MASS, STIFFNESS, LIMIT = 4.0, 75e3, 280.0
IMPACT = ImpactParameters(1, 0, True, impact_speed=Estimate(0.2, 0.004))
VERDICT = ComplianceVerdict(
    0,
    Verdict.PASS,
    VerdictScope.EVENT,
    (1,),
    (),
    TestPoint(),
    transient_force=Estimate(0.2 * math.sqrt(MASS * STIFFNESS), 1.5),
    transient_limit=LIMIT,
)


def test_it_is_the_permitted_speed_of_a_linear_contact():
    found = highest_speed(IMPACT, VERDICT)
    assert found.value == pytest.approx(permitted_speed(LIMIT, MASS, STIFFNESS), rel=1e-12)
    force = VERDICT.transient_force
    relative = math.hypot(0.02, force.std / force.value)
    assert found.std == pytest.approx(relative * found.value)


@pytest.mark.parametrize(
    ('impact', 'verdict'),
    [
        ({'impact_speed': Estimate()}, {}),
        ({}, {'transient_limit': math.nan}),
        ({}, {'transient_force': Estimate()}),
        ({'impact_speed': Estimate(-0.1, 0.01)}, {}),
    ],
)
def test_what_is_not_known_gives_no_speed(impact, verdict):
    found = highest_speed(
        dataclasses.replace(IMPACT, **impact), dataclasses.replace(VERDICT, **verdict)
    )
    assert math.isnan(found.value)
