"""The linear baseline of any driven, free or prescribed motion, or of a chain.

Signs that cannot be right are turned, the linear baseline is fitted, and what the campaign says
its simulation has is added to it.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.campaign import Campaign, CampaignKind, ChannelSamples
from impactscope.discrepancy.driven.data.recordings import Cut, cuts, derivative_of
from impactscope.discrepancy.driven.fits.growing_windows import (
    fit_over_growing_windows,
    lost_count,
)
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.systems.chain import linear_chain
from impactscope.discrepancy.driven.systems.linear_oscillator import (
    linear_oscillator,
    reversed_channels,
)
from impactscope.discrepancy.driven.systems.prescribed_motion import (
    force_counts_against,
    linear_prescribed,
)
from impactscope.errors import ConfigurationError

__all__ = [
    'MOST_OF_PLATE',
    'Start',
    'gain_tolerance',
    'held_between_samples',
    'linear_start',
    'sprung',
    'stated_modes',
    'with_known',
    'with_rest_at_zero',
    'with_right_signs',
    'with_the_mass_alone',
]

Array = NDArray[np.float64]

LINEAR = (
    'linear_sensor',
    'linear_mass_damper',
    'linear_spring_damper',
    'linear_mass_spring_damper',
)
MOST_OF_PLATE = 150_000  # samples of all fitted recordings of a plate under a hammer


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Usable parts of the recordings, the model and its segments, and the linear baseline."""

    parts: list[Cut]
    model: Model
    segments: list[Segment]
    linear: Fit


def linear_start(campaign: Campaign, notes: list[str]) -> Start:
    """Usable parts of the recordings, the model, and the fitted linear baseline."""
    bench = campaign.bench
    if campaign.kind is CampaignKind.PRESCRIBED_MOTION:
        parts = cuts(campaign, [str(bench['output'])], str(bench['motion']), notes)
        return Start(parts, *linear_prescribed(parts, spring=sprung(campaign)))
    if campaign.kind is CampaignKind.CHAIN:
        names = [str(bench['output'])], str(bench['input'])
        parts = cuts(campaign, *names, notes, MOST_OF_PLATE)
        return Start(parts, *linear_chain(parts))
    drive = campaign.input_channel
    parts = cuts(campaign, [str(name) for name in bench['outputs']], drive, notes)
    spring = sprung(campaign)
    held = held_between_samples(campaign)
    return Start(parts, *linear_oscillator(parts, spring=spring, held=held))


def gain_tolerance(campaign: Campaign) -> float | None:
    """Relative uncertainty of the gain between both ends of a chain, where one is stated."""
    ends = (str(campaign.bench.get('input', '')), str(campaign.bench.get('output', '')))
    stated = [x for x in map(campaign.stated_gain_std_of, ends) if x is not None]
    return math.hypot(*stated) if stated else None


def with_known(campaign: Campaign, model: Model, segments: Sequence[Segment], linear: Fit) -> Fit:
    """The baseline with the mechanisms that the campaign says the simulation has.

    A gain that is known to a tolerance is a number of it.
    """
    baseline = linear
    if gain_tolerance(campaign) is not None:
        for term in (t for t in model.terms if t.name == 'wrong_parameter'):
            baseline = _extended(model, segments, baseline, term, {})
    for item in campaign.baseline:
        if item.name in LINEAR:
            continue
        forms = [t for t in model.terms if t.name == item.name]
        if not forms:
            known = ', '.join(sorted({t.name for t in model.terms}.union(LINEAR)))
            raise ConfigurationError(
                f'{campaign.name}: baseline {item.name!r} is not known for a campaign of kind '
                f'{campaign.kind.value}; known are {known}'
            )
        tries = [_extended(model, segments, baseline, term, item.values) for term in forms]
        baseline = min(tries, key=lambda f: _misfit(f, segments))
    return baseline


def with_the_mass_alone(campaign: Campaign) -> Campaign:
    """The campaign without outputs that are not the motion of its mass, and a note.

    What a spring passes on is the motion times its stiffness: it tells nothing of the mass that
    the motion does not, and no more of the spring than of its own calibration. A base that yields
    shows in the motion of what stands on it.
    """
    if campaign.kind is not CampaignKind.DRIVEN:
        return campaign
    outputs = [str(name) for name in campaign.bench['outputs']]
    others = [n for n in outputs if n.startswith('force') or n.endswith('.base')]
    motions = [name for name in outputs if name not in others]
    if not others or not motions:
        return campaign
    note = (
        f'{", ".join(others)}: not compared, for it is not the motion of the mass; what is '
        f'missing is looked for in {", ".join(motions)}.'
    )
    return dataclasses.replace(
        campaign,
        bench={**campaign.bench, 'outputs': motions},
        notes=(*campaign.notes, note),
    )


def with_right_signs(campaign: Campaign) -> Campaign:
    """The campaign with the sign of outputs turned that answer their input the wrong way."""
    if campaign.kind is CampaignKind.PRESCRIBED_MOTION:
        drive, outputs = str(campaign.bench['motion']), [str(campaign.bench['output'])]
        against = force_counts_against(cuts(campaign, outputs, drive, []))
        turned = tuple(outputs) if against else ()
    elif campaign.kind is CampaignKind.DRIVEN:
        drive = campaign.input_channel
        # of a structure one place may well move against another
        if not drive or stated_modes(campaign) > 1:
            return campaign
        outputs = [str(name) for name in campaign.bench['outputs']]
        parts = cuts(campaign, outputs, drive, [])
        turned = reversed_channels(parts, spring=sprung(campaign))
    else:
        return campaign
    if not turned:
        return campaign
    note = f'{", ".join(turned)}: the sign is opposite to that of {drive}; it is turned here.'
    return _with_channels(campaign, dict.fromkeys(turned, np.negative), [note])


def with_rest_at_zero(campaign: Campaign) -> Campaign:
    """The campaign with a free swing's channels counted from their rest, and a note.

    Only where no recording comes by the sensor's zero, for an encoder's zero may be anywhere, and
    a swing about anything else than its rest is none; nor does a speed or an acceleration swing
    about another value than zero. What is a little off is found as such. Positions on a spring
    that have no value in common have a zero each: the sensor was moved, or is another one.
    """
    bench = campaign.bench
    if campaign.kind is not CampaignKind.DRIVEN or campaign.input_channel:
        return campaign
    changed = campaign
    for name in (str(n) for n in bench['outputs']):
        swings = {r.file: r.channels[name] for r in campaign.recordings if name in r.channels}
        swings = {f: c for f, c in swings.items() if np.isfinite(c.values).any()}
        position = all(derivative_of(c.unit) == 0 for c in swings.values())
        places = _places(swings) if position and sprung(campaign) else [swings] if swings else []
        for swung in places:
            ends = [
                (float(np.nanmin(c.values)), float(np.nanmax(c.values))) for c in swung.values()
            ]
            away = min(a for a, _ in ends) > 0.0 or max(b for _, b in ends) < 0.0
            if not away and len(places) == 1:
                continue
            quietest = min(swung.values(), key=lambda c: float(np.nanstd(c.values)))
            rest = _rest(quietest.values)
            which = f' in {", ".join(swung)}' if len(places) > 1 else ''
            about = f'{name}{which} never comes by zero; it' if away else f'{name}{which}'
            about = f'{about} swings about {rest:.5g} {quietest.unit}'
            if derivative_of(quietest.unit):
                note = f'{about}, which is taken for the zero of its sensor.'
            else:
                note = f'{about}, from which it is counted.'
            counted = functools.partial(np.add, -rest)
            changed = _with_channels(changed, {name: counted}, [note], set(swung))
    return changed


def _places(swings: Mapping[str, ChannelSamples]) -> list[dict[str, ChannelSamples]]:
    """Recordings by file, those together whose ranges of values meet."""
    groups: list[dict[str, ChannelSamples]] = []
    top = -math.inf
    for file, c in sorted(swings.items(), key=lambda item: float(np.nanmin(item[1].values))):
        if float(np.nanmin(c.values)) > top:
            groups.append({})
        groups[-1][file] = c
        top = max(top, float(np.nanmax(c.values)))
    return groups


def _with_channels(
    campaign: Campaign,
    changes: Mapping[str, Callable[[Array], Array]],
    notes: Sequence[str],
    files: Collection[str] | None = None,
) -> Campaign:
    """The campaign with the values of some channels changed, and notes that say so.

    ``files``: recordings in which they are; None: in all.
    """
    recordings = tuple(
        dataclasses.replace(
            r,
            channels={
                n: dataclasses.replace(c, values=changes[n](c.values)) if n in changes else c
                for n, c in r.channels.items()
            },
        )
        if files is None or r.file in files
        else r
        for r in campaign.recordings
    )
    return dataclasses.replace(campaign, recordings=recordings, notes=(*campaign.notes, *notes))


def _rest(values: Array) -> float:
    """About where a swing that dies out comes to rest: the middle of its last half."""
    last = values[np.isfinite(values)]
    last = last[last.size // 2 :]
    return 0.5 * float(np.min(last) + np.max(last))


def held_between_samples(campaign: Campaign) -> bool:
    """Whether the input is commanded: it stays constant between samples."""
    bench = campaign.bench
    return 'reference' in bench or 'controller' in bench or bench.get('hold') is True


def sprung(campaign: Campaign) -> bool:
    """Whether the baseline has a restoring force."""
    restoring = campaign.model.get('restoring', 'linear')
    return (
        restoring not in (None, 'none', False)
        and 'linear_mass_damper' not in campaign.baseline_names
    )


def stated_modes(campaign: Campaign) -> int:
    """How many modes the model is said to have; raises ConfigurationError where that is none."""
    value: Any = campaign.model.get('modes', 1)
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ConfigurationError(
            f'{campaign.name}: model.modes is {value!r}; it must be a whole number from 1'
        )
    return value


def _extended(
    model: Model,
    segments: Sequence[Segment],
    baseline: Fit,
    term: Term,
    stated: Mapping[str, float],
) -> Fit:
    initial = {**baseline.values, **(term.restart or {})}
    initial.update({f'{term.label}.{k}': v for k, v in stated.items()})
    terms = (*baseline.terms, term)
    made = fit(model, terms, segments, initial, baseline.starts, tolerance=FINE)
    if lost_count(model, made, segments):
        grown = fit_over_growing_windows(model, terms, segments, initial, baseline)
        made = min(made, grown, key=lambda f: f.cost)
    return made


def _misfit(made: Fit, segments: Sequence[Segment]) -> float:
    pairs = zip(made.residuals, segments, strict=True)
    return sum(float(np.sum(r**2)) for r, s in pairs if not s.held_out)
