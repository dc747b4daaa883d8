"""What a reader must know of a stream's quality, in sentences."""

from __future__ import annotations

from collections.abc import Mapping

from impactscope.synchronise.statistics import ChannelStatistics

__all__ = ['quality_notes']

_COUNTED = {
    'lost_samples': 'samples were lost; they are missing, not bridged',
    'late': 'blocks came too late and were left out',
    'not_waited_for': 'samples of the grid are without it: it lagged by more than longest_wait',
    'duplicates': 'blocks came twice and were taken once',
    'out_of_order': 'blocks came out of order and were put in their place',
    'clock_jumps': 'times the clock jumped',
    'restarts': 'times the device started again',
}


def quality_notes(statistics: Mapping[str, ChannelStatistics]) -> list[str]:
    """A sentence for each kind of loss in each channel; none where all is well."""
    notes = []
    for name, counts in statistics.items():
        if counts.blocks == 0:
            notes.append(f'{name}: no samples at all.')
            continue
        for field, words in _COUNTED.items():
            if count := getattr(counts, field):
                notes.append(f'{name}: {count} {words}.')
        if counts.refused:
            notes.append(f'{name}: {counts.refused} blocks were refused: {counts.refusal}')
    return notes
