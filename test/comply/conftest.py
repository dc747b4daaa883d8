"""Blows in closed form: a half-sine, and where asked for a plateau that outlasts 0.5 s."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from impactscope.comply.limits import LimitSet
from impactscope.records import Channel, Contact, ContactKind, ImpactEvent, Quality, TestPoint

CONFIG = Path(__file__).parents[2] / 'config'


@pytest.fixture(scope='session')
def iso_mapping():
    return yaml.safe_load((CONFIG / 'limits' / 'iso_ts_15066_2016.yaml').read_text())


@pytest.fixture(scope='session')
def iso(iso_mapping):
    return LimitSet.from_mapping(iso_mapping)


def _test_point(**changes):
    stated = {
        'id': 'P1',
        'body_region': 'hands_fingers',
        'contact': ContactKind.CONSTRAINED,
        'robot': 'maker, model, firmware 1.2',
        'tool': 'gripper, 0.5 kg',
        'pose': 'elbow up',
        'speed': 0.25,
        'device': 'device 7, calibrated 2026-05-02',
        'spring_stiffness': 75e3,
        'damper': 'Shore A 70, 2026-03-01',
        'start_ns': 1_000_000_000,
    }
    return TestPoint(**(stated | changes))


def _event(
    peak=120.0,
    plateau=0.0,
    hold=0.0,
    *,
    width=0.036,
    rate=2000.0,
    oversampling=1,
    zero=1.5,
    noise=0.25,
    length=None,
    quality=Quality.NONE,
    channel_quality=Quality.NONE,
    name='force',
    unit='N',
    range_max=math.nan,
    range_min=math.nan,
    native_rate=None,
    extra=(),
    point=None,
    event_id=1,
    stamp_ns=2_000_000_000,
    edit=None,
):
    """A half-sine of ``peak`` N from 0.1 s on, then ``plateau`` N for ``hold`` s."""
    grid = rate * oversampling
    start = 0.1
    end = start + (width + hold if hold else width)
    n = round((length or (end + 0.6)) * grid)
    t = np.arange(n) / grid
    force = np.zeros(n)
    blow = (t >= start) & (t <= start + width)
    force[blow] = peak * np.sin(math.pi * (t[blow] - start) / width)
    force[np.argmin(np.abs(t - start - width / 2)) // oversampling * oversampling] = peak
    if hold:
        held = (t > start + width / 2) & (t <= end)
        force[held] = np.maximum(force[held], plateau)
    values = (force + zero)[np.newaxis, :].astype(np.float32)
    channels = [
        Channel(
            name,
            unit,
            'plate',
            rate if native_rate is None else native_rate,
            range_min,
            range_max,
            channel_quality,
        ),
        *extra,
    ]
    values = np.vstack([values] + [np.zeros((1, n), np.float32) for _ in extra])
    if edit is not None:
        edit(values, t)
    return ImpactEvent(
        event_id=event_id,
        stamp_ns=stamp_ns,
        window_start_ns=stamp_ns - 100_000_000,
        sample_rate=grid,
        channels=tuple(channels),
        values=values,
        contacts=(Contact(start, end, peak, start + width / 2, 2 * peak * width / math.pi),),
        contact_start=start,
        contact_end=end,
        event_end=n / grid,
        zero_level=(zero,) + (0.0,) * len(extra),
        noise_std=(noise,) + (0.1,) * len(extra),
        rest_level=0.0,
        quality=quality,
        oversampling=oversampling,
        test_point=_test_point() if point is None else point,
    )


@pytest.fixture(scope='session')
def make_point():
    return _test_point


@pytest.fixture(scope='session')
def make_event():
    return _event
