"""The stage: one result for each blow, the same whatever came before."""

import numpy as np

from impactscope.estimate.fitter import Fitter
from impactscope.estimate.sensor_parameters import FitterSettings, estimate_sensor
from impactscope.records import Channel, Contact, ImpactEvent, TestPoint


def blow(number, seed, amplitude=80.0):
    time = np.arange(1200) / 1000
    wave = amplitude * np.exp(-14.2 * time) * np.cos(202.5 * time)
    values = np.r_[np.zeros(100), wave] + 0.3 * np.random.default_rng(seed).normal(size=1300)
    return ImpactEvent(
        event_id=number,
        stamp_ns=number * 10**9,
        window_start_ns=number * 10**9 - 10**8,
        sample_rate=1000.0,
        channels=(Channel('force', 'N', native_rate=1000.0),),
        values=values.astype(np.float32)[None],
        contacts=(Contact(0.05, 0.1, amplitude, 0.08, 1.0),),
        contact_start=0.05,
        contact_end=0.1,
        event_end=1.3,
        zero_level=(0.0,),
        noise_std=(0.3,),
        test_point=TestPoint(spring_stiffness=69_000.0, spring_stiffness_std=700.0),
    )


def test_one_result_for_each_blow_in_order():
    fitter = Fitter()
    results = [r for n in range(1, 5) for r in fitter.push(blow(n, n))]
    assert [r.event_id for r in results] == [1, 2, 3, 4]
    assert all(r.valid for r in results)
    assert fitter.flush() == []


def test_no_blow_depends_on_another():
    settings = FitterSettings(settle=0.004)
    fitter = Fitter(settings)
    fitter.push(blow(1, 1, amplitude=500.0))
    assert fitter.push(blow(2, 2)) == [estimate_sensor(blow(2, 2), settings)]
    assert Fitter(settings).push(blow(2, 2)) == fitter.push(blow(2, 2))
