"""A unit error as a finding: the channel of one recording in another unit than it says.

A unit is a word beside numbers, and nothing in one recording contradicts it. But the other
recordings of the campaign tell what the machine does, and one that does just the same, times one
of the factors by which units differ, has not been made by another machine.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.answer import Answer, Finding, Mismatch, ParameterEstimate, Region
from impactscope.discrepancy.campaign import Campaign, CampaignKind, Role
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.systems.linear_baseline import linear_start
from impactscope.discrepancy.driven.systems.prescribed_noise_limited import PARTS, prescribed_case
from impactscope.discrepancy.evidence import noise_std

__all__ = ['WrongUnit', 'told', 'with_right_units']

Array = NDArray[np.float64]

FACTORS = (
    (4.4482216, 'newtons and pounds-force'),
    (9.80665, 'newtons and kilograms-force, or m/s^2 and g'),
    (1000.0, 'a unit and its thousandth'),
    (100.0, 'metres and centimetres'),
    (25.4, 'inches and millimetres'),
    (39.370079, 'metres and inches'),
    (0.3048, 'feet and metres'),
    (180.0 / math.pi, 'degrees and radians'),
    (2.0 * math.pi, 'turns and radians'),
    (1e6, 'a unit and its millionth'),
)
FEWEST = 3  # recordings: two that agree, against one
ODD = 1.5  # ratio of an output to its input over that of the others, from which it is looked at
NEAR = 0.06  # of a factor
ALIKE = 0.1  # by which the others may differ among themselves
SHAPE = 0.05  # of the power, that a factor may leave
MOST, LOUDER = 0.5, 1.5  # the same where it leaves hardly more than the others have of noise


@dataclasses.dataclass(frozen=True, slots=True)
class WrongUnit:
    """A recording whose output is a factor too large, or too small."""

    recording: str
    channel: str
    factor: float  # measured over what it should be
    std: float
    units: str
    end_s: float
    as_noisy: bool  # once it is set right, as the others are


def with_right_units(campaign: Campaign) -> tuple[Campaign, tuple[WrongUnit, ...]]:
    """The campaign with the unit of one recording set right, and what was wrong with it.

    Only where it is plain: the other recordings agree among themselves, this one does the same
    but for a factor by which units differ, and nothing else explains it.
    """
    ends = _ends(campaign)
    if ends is None or len(campaign.recordings) < FEWEST:
        return campaign, ()
    drive, outputs = ends
    for output in outputs:
        odd = _odd_one(campaign, drive, output)
        found = None if odd is None else _unit_of(campaign, odd, output)
        if found is not None:
            return _scaled(campaign, found), (found,)
    return campaign, ()


def told(answer: Answer, wrong: Sequence[WrongUnit]) -> Answer:
    """The answer with the units that were wrong among its findings."""
    for unit in wrong:
        finding = Finding(
            'wrong_parameter',
            0.97,
            'parameter',
            {
                'name': ParameterEstimate(f'unit of {unit.channel}', 0.0, 'text'),
                'ratio': ParameterEstimate(1.0 / unit.factor, unit.std / unit.factor**2, '1'),
            },
            channel=unit.channel,
            recording=unit.recording,
            sentence=(
                f'{unit.channel} of {unit.recording} is {unit.factor:.4g} times what the other '
                f'recordings make of it, as {unit.units} are: its unit, or that of what drives '
                'it, is not the one that is stated.'
            ),
            equation=f'{unit.channel} x {1.0 / unit.factor:.4g}',
        )
        region = Region(unit.recording, unit.channel, 0.0, unit.end_s)
        before = answer.mismatch
        mismatch = Mismatch(
            True,
            0.0,
            (region, *before.regions),
            tuple(dict.fromkeys(('parameter', *before.subsystems))),
        )
        answer = dataclasses.replace(
            answer,
            mismatch=mismatch,
            accepted=('wrong_parameter', *answer.accepted),
            ranking=(finding, *answer.ranking),
            notes=(
                *answer.notes,
                f'{finding.sentence} It is {"set right" if unit.as_noisy else "left out"} here.',
            ),
        )
    return answer


def _ends(campaign: Campaign) -> tuple[str, list[str]] | None:
    """Names of what drives and of what answers; None of a free motion."""
    bench = campaign.bench
    if campaign.kind is CampaignKind.PRESCRIBED_MOTION:
        return str(bench['motion']), [str(bench['output'])]
    if campaign.kind is CampaignKind.CHAIN:
        return str(bench['input']), [str(bench['output'])]
    drive = campaign.input_channel
    if campaign.kind is not CampaignKind.DRIVEN or not drive:
        return None
    return drive, [str(name) for name in bench['outputs']]


def _odd_one(campaign: Campaign, drive: str, output: str) -> int | None:
    """The recording whose output is furthest out of proportion to its input; None if none is."""
    ratios = []
    for r in campaign.recordings:
        if drive not in r.channels or output not in r.channels:
            return None
        sizes = [float(np.nanstd(r.channels[name].values)) for name in (drive, output)]
        if not all(math.isfinite(s) and s > 0.0 for s in sizes):
            return None
        ratios.append(math.log(sizes[1] / sizes[0]))
    apart = np.abs(np.array(ratios) - np.median(ratios))
    odd = int(np.argmax(apart))
    return odd if apart[odd] > math.log(ODD) else None


def _unit_of(campaign: Campaign, odd: int, output: str) -> WrongUnit | None:
    """What the linear model of the other recordings says of one; None if no unit explains it."""
    if any(
        r.role is not Role.HOLD_OUT and r.file == campaign.recordings[odd].file
        for i, r in enumerate(campaign.recordings)
        if i != odd
    ):
        return None  # parts of one file, which has one unit
    others = [i for i, r in enumerate(campaign.recordings) if i != odd and r.role is Role.FIT]
    if len(others) < FEWEST - 1:
        return None
    asked = tuple(
        dataclasses.replace(r, role=Role.FIT if i in others else Role.HOLD_OUT)
        for i, r in enumerate(campaign.recordings)
    )
    segments, made = _linear(dataclasses.replace(campaign, recordings=asked))
    scales: dict[str, tuple[float, float, float, float]] = {}
    for s, left in zip(segments, made.residuals, strict=True):
        if s.channel == output:
            scales.setdefault(s.recording, _scale(s.measured, s.measured - left))
    wrong = campaign.recordings[odd].file
    if wrong not in scales:
        return None
    factor, std, shape, left_of_it = scales.pop(wrong)
    rest = [scales[campaign.recordings[i].file] for i in others]
    alike = all(abs(scale - 1.0) < ALIKE for scale, *_ in rest)
    usual = float(np.median([r[3] for r in rest]))
    fits = shape < SHAPE or (shape < MOST and left_of_it < LOUDER * usual)
    units = _units(factor)
    if not units or not alike or not fits:
        return None
    channel = campaign.recordings[odd].channels[output]
    return WrongUnit(
        wrong,
        output,
        factor,
        std,
        units,
        channel.values.size / channel.sample_rate,
        _as_noisy(campaign, odd, others, output, factor),
    )


def _as_noisy(
    campaign: Campaign, odd: int, others: Sequence[int], output: str, factor: float
) -> bool:
    """Whether a recording has the noise of others, once it is set right by a factor."""
    known = [noise_std(campaign.recordings[i].channels[output].values) for i in (odd, *others)]
    ratio = known[0] / factor / float(np.median(known[1:])) if all(known) else 1.0
    return not (ratio < 1.0 / LOUDER or ratio > LOUDER)


def _linear(campaign: Campaign) -> tuple[Sequence[Segment], Fit]:
    """The linear model of the recordings that are fitted, and what it leaves of all."""
    begun = linear_start(campaign, [])
    if campaign.kind is CampaignKind.PRESCRIBED_MOTION:
        case = prescribed_case(begun.parts, PARTS)  # by the motion's whole course
        if case is not None:
            return case.segments, case.baseline
    return begun.segments, begun.linear


def _scale(measured: Array, predicted: Array) -> tuple[float, float, float, float]:
    """By how much a prediction is too small, its uncertainty, the share that is left, its rms."""
    seen, made = measured - np.mean(measured), predicted - np.mean(predicted)
    below = float(made @ made)
    if not below > 0.0:
        return math.nan, math.nan, math.inf, math.inf
    factor = float(seen @ made) / below
    left = float(np.sum((seen - factor * made) ** 2)) / float(seen @ seen)
    rms = float(np.std(seen - factor * made))
    return factor, abs(factor) * math.sqrt(left / seen.size), left, rms


def _units(factor: float) -> str:
    """Units that differ by about a factor; empty where none do."""
    if not factor > 0.0:
        return ''
    off = {
        words: abs(math.log(factor) - way * math.log(size))
        for size, words in FACTORS
        for way in (1.0, -1.0)
        if abs(math.log(factor) - way * math.log(size)) < NEAR
    }
    return min(off, key=lambda words: off[words]) if off else ''


def _scaled(campaign: Campaign, wrong: WrongUnit) -> Campaign:
    """The campaign with one channel of one recording set right by the factor of its units.

    Without the recording, where its noise is then not that of the others: nobody knows what else
    was done to it.
    """
    if not wrong.as_noisy:
        rest = tuple(r for r in campaign.recordings if r.file != wrong.recording)
        return dataclasses.replace(campaign, recordings=rest)
    sizes = [s**way for s, words in FACTORS if words == wrong.units for way in (1.0, -1.0)]
    exact = min(sizes, key=lambda s: abs(math.log(s / wrong.factor)))
    recordings = []
    for r in campaign.recordings:
        if r.file != wrong.recording:
            recordings.append(r)
            continue
        channel = r.channels[wrong.channel]
        right = dataclasses.replace(channel, values=channel.values / exact)
        recordings.append(dataclasses.replace(r, channels={**r.channels, wrong.channel: right}))
    return dataclasses.replace(campaign, recordings=tuple(recordings))
