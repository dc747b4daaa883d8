"""Results of an analysis in closed form: half-sine contacts, then a decaying cosine."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from impactscope.records import (
    AnalysisResult,
    Channel,
    ComplianceVerdict,
    Contact,
    ContactKind,
    Estimate,
    EventResult,
    ImpactEvent,
    ImpactParameters,
    Quality,
    SensorParameters,
    TestPoint,
    Verdict,
    VerdictScope,
)

START_NS = 1_795_000_000_000_000_000
FREQUENCY, DAMPING = 32.34, 0.0692
PRE = 0.1  # s before first contact
# start after first contact, duration, peak share
BOUNCES = ((0.0, 0.0362, 1.0), (0.118, 0.0330, 0.41), (0.196, 0.0301, 0.17))


def force_of(t: np.ndarray, peak: float, held: float) -> np.ndarray:
    """Force in N at times t in s after first contact; ``held`` N rest on it after a bounce."""
    force = np.zeros_like(t)
    for start, length, share in BOUNCES:
        inside = (t >= start) & (t < start + length)
        force[inside] = peak * share * np.sin(math.pi * (t[inside] - start) / length)
    begin = BOUNCES[-1][0] + BOUNCES[-1][1]
    if held:
        late = t >= begin
        return np.where(late, held * (1 - np.exp(-(t - begin).clip(0) / 0.05)), force)
    decay = math.tau * FREQUENCY * DAMPING
    damped = math.tau * FREQUENCY * math.sqrt(1 - DAMPING**2)
    late = (t - begin).clip(0)
    ring = 0.08 * peak * np.exp(-decay * late) * np.cos(damped * late + math.pi / 2)
    return force + np.where(t >= begin, ring, 0.0)


def build_event(
    event_id: int = 1,
    *,
    peak: float = 196.0,
    rate: float = 10_000.0,
    duration: float = 1.1,
    held: float = 0.0,
    quality: Quality = Quality.NONE,
    verdict: Verdict = Verdict.PASS,
    reasons: tuple[str, ...] = (
        'The transient force of 196 N lies 84 N below the limit of 280 N for hands / fingers.',
    ),
    point: str = 'A-1',
    accelerations: int = 3,
) -> EventResult:
    rng = np.random.default_rng(event_id)
    count = round(duration * rate)
    t = np.arange(count) / rate - PRE
    force = force_of(t, peak, held) + 2.5 + rng.normal(0, 0.4, count)
    names = ('plate', 'impactor', 'base')[:accelerations]
    rows = [force]
    rows += [
        scale * np.gradient(force_of(t, peak, held), 1 / rate) / 2e4 + rng.normal(0, 0.2, count)
        for scale in (58.0, -31.0, 3.0)[:accelerations]
    ]
    channels = (
        Channel('force', 'N', 'plate', rate, -20.0, 500.0),
        *(Channel(f'acceleration.{n}', 'm/s^2', n, rate, -500.0, 500.0) for n in names),
    )
    contacts = tuple(
        Contact(PRE + s, PRE + s + d, peak * k, PRE + s + d / 2, 2 / math.pi * peak * k * d)
        for s, d, k in BOUNCES
    )
    end = contacts[-1].end
    if held:
        contacts = (
            *contacts[:-1],
            dataclasses.replace(
                contacts[-1], end=duration - 0.05, peak_force=held, impulse=held * duration
            ),
        )
        end = duration - 0.05
    stamp = START_NS + event_id * 10_000_000_000
    test_point = TestPoint(
        id=point, body_region='hands_fingers', contact=ContactKind.CONSTRAINED,
        repetition=(event_id - 1) % 3 + 1, repetitions_planned=3,
        robot='Example Cobot 10, firmware 5.14.2', tool='Gripper, 1.2 kg payload',
        pose='TCP 0.42 m above the table, elbow up', speed=0.25,
        device='Force device 75 N/mm, serial 0117, calibrated 2026-03-02',
        spring_stiffness=75e3, spring_stiffness_std=0.4e3, damper='Shore A 70, replaced 2026-01',
        start_ns=START_NS,
    )  # fmt: skip
    event = ImpactEvent(
        event_id=event_id, stamp_ns=stamp, window_start_ns=stamp - round(PRE * 1e9),
        sample_rate=rate, channels=channels, values=np.asarray(rows, dtype=np.float32),
        contacts=contacts, contact_start=PRE, contact_end=end,
        event_end=min(end + 0.55, duration),
        zero_level=(2.5,) + (0.0,) * accelerations, noise_std=(0.4,) + (0.2,) * accelerations,
        rest_level=0.0, quality=quality, test_point=test_point,
    )  # fmt: skip
    if held:
        sensor = SensorParameters(
            event_id,
            stamp,
            valid=False,
            reason='the impactor rests on the plate: no free vibration',
        )
    else:
        sensor = SensorParameters(
            event_id, stamp, valid=True, method='free oscillation, variable projection',
            channel='force', span_start=end + 0.002, span_end=min(end + 0.35, duration),
            natural_frequency=Estimate(FREQUENCY, 0.021), damped_frequency=Estimate(
                FREQUENCY * math.sqrt(1 - DAMPING**2), 0.021),
            damping_ratio=Estimate(DAMPING, 0.00064), bandwidth=Estimate(49.93, 0.06),
            stiffness=Estimate(75e3, 0.4e3), moving_mass=Estimate(1.8164, 0.01),
            damping_constant=Estimate(51.08, 0.61), amplitude=Estimate(15.6, 0.12),
            offset=Estimate(0.004, 0.031), r_squared=0.99213, rmse=0.4031,
            spectral_frequency=Estimate(32.2, 0.4), spectral_damping_ratio=Estimate(0.075, 0.006),
        )  # fmt: skip
    impact = ImpactParameters(
        event_id, stamp, valid=True, method='measured force and plate acceleration',
        peak_force=Estimate(peak, 3.0), peak_contact_force=Estimate(peak * 0.8, 4.1),
        contact_time=Estimate(0.0362, 0.00012), impulse=Estimate(4.517, 0.034),
        impact_speed=Estimate(0.612, 0.011), effective_mass=Estimate(3.69, 0.09),
        transferred_energy=Estimate(0.2561, 0.008),
    )  # fmt: skip
    judgement = ComplianceVerdict(
        stamp, verdict, VerdictScope.EVENT, (event_id,), reasons, test_point,
        limit_set='ISO/TS 15066:2016 Annex A 1', measurement_profile='impactscope_default 1',
        decision_rule='ILAC-G8:09/2019, guard band equal to the expanded uncertainty (k = 2)',
        transient_force=Estimate(peak, 3.0), transient_limit=280.0,
        quasi_static_force=Estimate(held, 1.1) if held else Estimate(),
        quasi_static_limit=140.0, guard_band=6.1, reconstructed_peak_force=peak * 0.8,
    )  # fmt: skip
    return EventResult(event, sensor, impact, judgement)


def build_result(
    events: tuple[EventResult, ...], verdict: Verdict = Verdict.PASS, **changes: object
) -> AnalysisResult:
    points = ()
    if events:
        first = events[0].verdict
        largest = max(e.verdict.transient_force.value for e in events)
        smallest = min(e.verdict.transient_force.value for e in events)
        points = (
            dataclasses.replace(
                first, scope=VerdictScope.TEST_POINT, verdict=verdict,
                event_ids=tuple(e.event.event_id for e in events),
                transient_force=Estimate(largest, 3.0), spread=largest - smallest,
            ),
        )  # fmt: skip
    fields: dict[str, object] = {
        'source': 'pendulum_campaign.mcap', 'sha256': 'ab' * 32, 'software_version': '0.1.0',
        'parameters': {
            'synchroniser': {'longest_wait': 0.25},
            'impact_detector': {'trigger_channel': 'force', 'threshold_sigma': 6.0},
            'fitter': {'channel': '', 'stiffness': math.nan},
            'compliance': {
                'limit_set': 'iso_ts_15066_2016.yaml',
                'measurement_profile': {'transient_window': 0.5, 'guard_band': True},
            },
        },
        'channels': events[0].event.channels if events else (),
        'duration': 62.4, 'events': events, 'test_points': points, 'verdict': verdict,
        'notes': ('Simulated recording: no robot and no device stood behind these samples.',)
        if events else (),
        'provenance': {'origin': 'simulation', 'licence': 'CC0', 'seed': '20261120'},
    }  # fmt: skip
    return AnalysisResult(**{**fields, **changes})  # type: ignore[arg-type]


@pytest.fixture
def make_event() -> Callable[..., EventResult]:
    return build_event


@pytest.fixture
def make_result() -> Callable[..., AnalysisResult]:
    return build_result
