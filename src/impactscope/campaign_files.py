"""Campaigns on disk: a folder with ``campaign.yaml`` and recordings."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from impactscope.discrepancy.answer import Answer
from impactscope.discrepancy.campaign import BaselineItem, Campaign, ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign, unit_factor
from impactscope.discrepancy.explain import explain
from impactscope.errors import ConfigurationError, RecordingError
from impactscope.inputs import inputs_of, recorded_items
from impactscope.recordings import open_recording
from impactscope.records import NANOSECONDS, SampleBlock
from impactscope.yaml_text import parse_yaml

__all__ = ['CAMPAIGN_FILE', 'explain_folder', 'load_campaign', 'read_channels', 'save_model']

CAMPAIGN_FILE = 'campaign.yaml'


def _description(path: Path) -> tuple[Path, Any]:
    """The file that describes a campaign, and what it says."""
    file = path / CAMPAIGN_FILE if path.is_dir() else path
    try:
        text = file.read_text(encoding='utf-8')
    except OSError as error:
        raise ConfigurationError(
            f'campaign: {str(file)!r} cannot be read: {error.strerror}'
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(
            f'campaign: {str(file)!r} is no text; name a folder with {CAMPAIGN_FILE}, or that file'
        ) from error
    try:
        return file, parse_yaml(text)
    except yaml.YAMLError as error:
        raise ConfigurationError(f'campaign: {file.name!r} is not YAML: {error}') from error


def read_channels(path: Path | str) -> dict[str, ChannelSamples]:
    """All channels of a recording as arrays; times start at the earliest channel's first sample.

    Lost samples become NaN. Raises RecordingError where the recording cannot be read or a
    channel changes its rate.
    """
    blocks: dict[str, list[SampleBlock]] = {}
    with open_recording(path, tolerate_damage=True) as recording:
        for item in recorded_items(recording, inputs_of(recording)):
            if isinstance(item, SampleBlock) and not item.is_end:
                blocks.setdefault(item.channel, []).append(item)
    origin = min((b[0].stamp_ns for b in blocks.values()), default=0)
    return {name: _joined(name, parts, origin, Path(path).name) for name, parts in blocks.items()}


def _joined(name: str, blocks: Sequence[SampleBlock], origin_ns: int, file: str) -> ChannelSamples:
    first = blocks[0]
    if any(b.sample_rate != first.sample_rate or b.epoch != first.epoch for b in blocks):
        raise RecordingError(f'{file!r}: channel {name!r} changes its rate or starts anew')
    begin = min(b.first_index for b in blocks)
    length = max(b.first_index + b.values.size for b in blocks) - begin
    if length > 50_000_000:
        raise RecordingError(f'{file!r}: channel {name!r} is too long for a campaign: {length}')
    values = np.full(length, np.nan)
    for block in blocks:
        at = block.first_index - begin
        values[at : at + block.values.size] = block.values
    # the median over the blocks, since a single stamp may have come late
    starts = [
        (b.stamp_ns - origin_ns) / NANOSECONDS - (b.first_index - begin) / b.sample_rate
        for b in blocks
    ]
    return ChannelSamples(
        name,
        first.unit,
        first.sample_rate,
        float(np.median(starts)),
        values,
        first.range_min,
        first.range_max,
    )


def load_campaign(path: Path | str, *, samples: bool = True) -> Campaign:
    """A campaign from its folder (or its file), with the samples of its recordings.

    Raises ConfigurationError for what is wrong in the file, RecordingError for recordings,
    MissingChannelError where one lacks what the file names.
    """
    file, data = _description(Path(path))
    folder = file.resolve().parent
    campaign = parse_campaign(data, folder.name if file.name == CAMPAIGN_FILE else file.stem)
    if not samples:
        return campaign

    def load(name: str) -> dict[str, ChannelSamples]:
        target = (folder / name).resolve()
        if not target.is_relative_to(folder):
            named = Path(os.path.normpath(folder / name))
            what = (
                f'is a link that points outside of the campaign, to {str(target)!r}; put the file '
                'itself there'
                if named.is_relative_to(folder)
                else 'lies outside of the campaign'
            )
            raise ConfigurationError(f'{campaign.name}: {name!r} {what}')
        return read_channels(target)

    loaded = campaign.with_samples(load)
    loaded.check_recordings()
    return loaded


def explain_folder(
    path: Path | str,
    progress: Callable[[float, str], None] | None = None,
    *,
    baseline: Sequence[BaselineItem | str] | None = None,
    within_s: float = math.inf,
) -> Answer:
    """What the recordings in a folder show that the simulation leaves out.

    ``progress`` is called with the share that is done, 0 to 1, and what is being done;
    ``within_s`` as for :func:`~impactscope.discrepancy.explain.explain`.
    """
    if progress is not None:
        progress(0.0, 'reading')
    return explain(load_campaign(path), baseline, progress, within_s)


def _correct(data: Any, place: Sequence[str], value: object) -> None:
    """Put a value where a description states another; what it does not state has no place."""
    *way, last = place
    for step in way:
        data = data[int(step)] if isinstance(data, list) else (data or {}).get(step)
    if not isinstance(data, dict):
        return
    old = data.get(last)
    if isinstance(old, dict):
        factor = unit_factor(old.get('unit'), last)
        old['value'] = value / factor if isinstance(value, float) else value
    else:
        data[last] = value


def save_model(path: Path | str, answer: Answer, target: Path | str) -> None:
    """Write ``campaign.yaml`` anew with the extended model as its baseline."""
    _, data = _description(Path(path))
    model = answer.to_json()['model']
    data['baseline'] = model.get('baseline', data.get('baseline', []))
    for place, value in model.get('corrected', {}).items():
        _correct(data, place.split('.'), value)
    if 'modes' in model:
        data['model'] = {**(data.get('model') or {}), 'modes': model['modes']}
    Path(target).write_text(yaml.safe_dump(data, sort_keys=False), encoding='utf-8')
