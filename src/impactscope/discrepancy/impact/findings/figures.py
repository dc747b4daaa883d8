"""Figures of the answer: errors by channel before and after, overlays, residuals."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.answer import FitFigures, FitTable, Trace
from impactscope.discrepancy.impact.data.blows import CampaignData
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.search.outcome import Outcome
from impactscope.discrepancy.locate import Phase, Strip, phases
from impactscope.physics.twin import layout as at

__all__ = ['fit_table', 'pictures', 'rmse']

Array = NDArray[np.float64]


def fit_table(data: CampaignData, outcome: Outcome) -> FitTable:
    """Errors of baseline and extended model, fitted and held out, beside the noise."""

    def figures(fitted: Fit, held_out: Fit | None) -> FitFigures:
        return FitFigures(
            rmse=rmse(fitted),
            held_out_rmse={} if held_out is None else rmse(held_out),
            reduced_chi_square=fitted.reduced,
            held_out_reduced_chi_square=math.nan if held_out is None else held_out.reduced,
        )

    return FitTable(
        figures(outcome.baseline, outcome.held_out_baseline),
        figures(outcome.final, outcome.held_out_final),
        dict(data.noise_floor),
    )


def pictures(outcome: Outcome) -> tuple[tuple[Trace, ...], list[Strip]]:
    """Overlays for the page, and residuals for locating."""
    traces: list[Trace] = []
    strips: list[Strip] = []
    for before, after, held_out in (
        (outcome.baseline, outcome.final, False),
        (outcome.held_out_baseline, outcome.held_out_final, True),
    ):
        if before is None or after is None:
            continue
        for i in after.layout.blows:
            blow = after.model.data.blows[i]
            old = before.model.predict(before.values, i)
            new = after.model.predict(after.values, i)
            rows = new.rows
            spans = None
            for name, channel in blow.channels.items():
                mask = after.layout.masks[i, name]
                where = blow.where[name]
                same = rows.shape[0] == blow.times.size
                nothing = np.zeros(mask.size)
                x = channel.averaged(rows[where, at.PLATE_POSITION]) if same else nothing
                v = channel.averaged(rows[where, at.PLATE_VELOCITY]) if same else nothing
                if spans is None:
                    spans = _phases(blow.recording.kind, channel.centres, x, after, i)
                traces.append(
                    Trace(
                        blow.name,
                        name,
                        channel.unit,
                        held_out,
                        channel.noise,
                        channel.centres[mask],
                        channel.means[mask],
                        old.means[name][mask],
                        new.means[name][mask],
                        x[mask],
                        v[mask],
                    )
                )
                left = [
                    after.model.whitened(
                        (channel.means[mask] - p.means[name][mask]) / channel.std[mask],
                        i,
                        name,
                        after.layout,
                    )
                    for p in (old, new)
                ]
                strips.append(
                    Strip(
                        blow.name,
                        name,
                        channel.centres[mask],
                        left[0],
                        left[1],
                        x[mask],
                        v[mask],
                        spans,
                        held_out,
                    )
                )
    return tuple(traces), strips


def rmse(fitted: Fit) -> dict[str, float]:
    """RMSE of each channel over the samples that were fitted or predicted."""
    squares = fitted.model.mean_squares(fitted.values, fitted.layout)
    return {name: math.sqrt(square) for name, square in squares.items()}


def _phases(kind: str, time: Array, x: Array, after: Fit, i: int) -> tuple[Phase, ...]:
    values = after.values
    prediction = after.model.predict(values, i)
    start = prediction.start
    end = float(time[-1])
    early = (time > start) & (time < start + 0.05)
    peak = float(time[early][np.argmax(x[early])]) if early.any() else start + 0.01
    if kind == 'tap':
        lost = after.model.data.blows[i].settled
        return phases(start, min(peak, 0.5 * (start + lost)), [(lost, False)], end)
    contacts = [
        (float(t), int(k) == at.CONTACT_BEGINS)
        for t, k in zip(prediction.contacts, prediction.contact_kinds, strict=True)
    ]
    return phases(start, peak, contacts, end)
