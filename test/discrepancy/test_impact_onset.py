"""When a blow begins: a heavy plate's force shows the contact later than the impactor does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import CampaignRecording, ChannelSamples
from impactscope.discrepancy.impact.data.blows import (
    _about_release,
    _first_sight,
    _noise,
    _seen_again,
)

RATE, CONTACT = 4000.0, 0.4
TIME = np.arange(round(RATE)) / RATE
SINCE = TIME - CONTACT
STRUCK = (SINCE > 0.0) & (SINCE < 0.012)


def channel(name, values, noise):
    rng = np.random.default_rng(5)
    return ChannelSamples(name, 'x', RATE, 0.0, values + noise * rng.standard_normal(TIME.size))


def impactor(**changes):
    falling = np.where(SINCE < 0.0, 0.8 + 0.5 * SINCE, 0.0)
    pushed = np.where(STRUCK, -300.0 * np.sin(np.pi * SINCE / 0.012), 0.0)
    return channel('acceleration.impactor', falling + pushed + changes.get('more', 0.0), 0.1)


def force(height=400.0):
    late = np.clip(SINCE, 0.0, 0.03)
    return channel(
        'force', height * (late / 0.03) ** 3 * np.exp(-np.clip(SINCE - 0.03, 0, 9)), 0.3
    )


def plate():
    moved = np.where(STRUCK, 200.0 * np.sin(np.pi * SINCE / 0.012), 0.0)
    return channel('acceleration.plate', moved, 0.1)


def seen(*channels, let_go=False):
    return _first_sight({c.name: c for c in channels}, let_go=let_go)


def test_the_impactor_tells_the_contact_that_the_force_shows_late():
    assert CONTACT + 3e-3 < seen(force()) < CONTACT + 5e-3
    assert seen(force(), impactor()) == pytest.approx(CONTACT, abs=1e-3)


def test_a_plate_with_an_accelerometer_needs_no_impactor():
    assert seen(force(), plate(), impactor()) == seen(force(), plate())


def test_an_impactor_that_moves_before_tells_nothing():
    shaking = np.where(SINCE < 0.0, 250.0 * np.sin(400.0 * SINCE), 0.0)
    assert seen(force(), impactor(more=shaking)) == seen(force())
    assert seen(force(), impactor(more=np.nan)) == seen(force())


def test_what_moves_an_impactor_long_before_the_force_is_no_contact():
    let_go = np.where((SINCE > -0.2) & (SINCE < -0.19), 100.0, 0.0)
    assert seen(force(), impactor(more=let_go)) == pytest.approx(CONTACT, abs=1e-3)


@pytest.mark.parametrize('rest', [0.0, 9.8])
def test_a_short_fall_is_no_contact(rest):
    """1.6 mm of height take 18 ms; at rest an accelerometer may show the earth's, or none."""
    falling = np.where((SINCE > -0.018) & (SINCE < 0.0), rest - 9.8, rest)
    pushed = np.where(STRUCK, -120.0 * np.sin(np.pi * SINCE / 0.012), 0.0)
    own = channel('acceleration.impactor', falling + pushed, 0.1)
    assert seen(force(), own, let_go=True) == pytest.approx(CONTACT, abs=1.5e-3)
    assert seen(own, let_go=True) == pytest.approx(CONTACT, abs=1.5e-3)


def test_a_contact_softer_than_a_fall_is_seen_still():
    pushed = np.where(STRUCK, -8.0 * np.sin(np.pi * SINCE / 0.012), 0.0)
    own = channel('acceleration.impactor', pushed, 0.1)
    assert seen(own, let_go=True) == pytest.approx(CONTACT, abs=1.5e-3)


def test_a_blow_is_looked_for_in_the_part_of_a_recording_that_counts():
    bumped = np.where((TIME > 0.1) & (TIME < 0.11), 60.0, 0.0)
    noise = 0.3 * np.random.default_rng(5).standard_normal(TIME.size)
    whole = CampaignRecording(
        'a.mcap',
        channels={'force': channel('force', force().values + bumped - noise, 0.3)},
    )
    part = dataclasses.replace(whole, start=0.2, end=0.7).part()
    assert seen(*whole.part().channels.values()) == pytest.approx(0.1, abs=2e-3)
    assert seen(*part.channels.values()) == pytest.approx(seen(force()), abs=2e-3)
    (left,) = part.channels.values()
    assert left.start == pytest.approx(0.2)
    assert left.time[-1] == pytest.approx(0.7, abs=1.5 / RATE)


def begun_early(drawn, kind, noise, begin):
    """How many recordings are seen to begin too early: alone, and beside what others tell."""
    early = []
    for channels in drawn:
        recording = CampaignRecording('short.mcap', kind=kind, channels=channels)
        alone = _first_sight(channels)
        ((_, told),) = _seen_again([(recording, alone)], noise)
        early.append([onset < begin - 1e-3 for onset in (alone, told)])
    return np.sum(early, axis=0)


def waves(count, forgets, rng):
    """Noise of unit variance whose differences are far smaller."""
    fresh = np.sqrt(1.0 - forgets**2) * rng.standard_normal(count + 400)
    return signal.lfilter([1.0], [1.0, -forgets], fresh)[400:]


def test_waves_of_noise_in_a_short_quiet_are_no_blow():
    """Differences tell a third of such noise, and thirty milliseconds hold few of its waves."""
    rng = np.random.default_rng(2)
    quiet, size = 0.032, round(0.08 * RATE)
    since = np.arange(size) / RATE - quiet
    blow = np.where(since > 0.0, 110.0 * np.sin(100.0 * np.clip(since, 0.0, 0.03)) ** 2, 0.0)
    drawn = [
        {'force': ChannelSamples('force', 'N', RATE, 0.0, blow + 2.0 * waves(size, 0.965, rng))}
        for _ in range(40)
    ]
    without, beside_others = begun_early(drawn, 'robot', {'force': 2.0}, quiet)
    assert without > 4
    assert beside_others == 0


def test_waves_of_noise_of_an_impactor_are_no_contact():
    """Forty milliseconds hold few of the waves of a pendulum that hangs beside a tap."""
    rng = np.random.default_rng(2)
    struck = force()
    hanging = [
        channel('acceleration.impactor', waves(TIME.size, 0.975, rng), 0.01) for _ in range(40)
    ]
    drawn = [{c.name: c for c in (struck, beside)} for beside in hanging]
    without, beside_others = begun_early(drawn, 'tap', {'acceleration.impactor': 1.0}, CONTACT)
    assert without > 4
    assert beside_others == 0


def test_a_heavy_plate_loads_its_spring_before_it_is_clearly_seen():
    """A twentieth of the peak is a hundred times the noise: what leads to it is no quiet."""
    rising = ChannelSamples('force', 'N', RATE, 0.0, force(400.0).values / 10.0)
    clear = CONTACT + TIME[np.argmax(rising.values[STRUCK.argmax() :] > 2.0)]
    assert clear > CONTACT + 8e-3
    assert _first_sight({'force': rising}) == pytest.approx(CONTACT + 3e-3, abs=2e-3)


@pytest.mark.parametrize('rate', [1.0, 4.0, 8.0, 16.0])
def test_a_level_that_drifts_is_no_blow(rate):
    """By the time of the blow it has left the level of the recording's beginning."""
    moved = np.where(STRUCK, 200.0 * np.sin(np.pi * SINCE / 0.012), 0.0)
    drifting = channel('acceleration.plate', moved + rate * TIME, 0.02)
    assert seen(drifting) == pytest.approx(CONTACT, abs=1e-3)


@pytest.mark.parametrize('takes', [0.0005, 0.01, 0.04])
def test_an_impactor_may_take_its_time_to_be_let_go(takes):
    rng = np.random.default_rng(3)
    let_go = np.clip((SINCE + 0.2) / takes, 0.0, 1.0) * (14.0 + SINCE)
    before = (let_go + 0.02 * rng.standard_normal(TIME.size))[SINCE < -2e-3]
    parts = _about_release(before)
    assert sum(p.size for p in parts) > before.size - 4.0 * takes * RATE - 10
    for part in parts:
        assert np.std(part) == pytest.approx(0.02, rel=0.15)


@pytest.mark.parametrize(
    ('quiet', 'told'),
    [((200, 20), 1.1), ((200, 0), 1.1), ((40, 20), 1.4), ((5, 0), np.inf)],
)
def test_a_recording_that_is_all_blow_tells_nothing_of_the_noise_where_others_do(quiet, told):
    """The end of such a recording still rings; with no quiet anywhere it is all that there is."""
    rng = np.random.default_rng(2)
    heard = []
    for before in quiet:
        since = np.arange(-before, 120) / RATE
        rings = np.where(since > 0.0, 300.0 * np.sin(2.0 * np.pi * 150.0 * since), 0.0)
        values = rings + 0.5 * rng.standard_normal(since.size)
        channels = {'force': ChannelSamples('force', 'N', RATE, 0.0, values)}
        heard.append((CampaignRecording('blow.mcap', channels=channels), before / RATE + 2e-3))
    noise = _noise(heard, {})[0]['force']
    assert 0.5 / told < noise < 0.5 * told
