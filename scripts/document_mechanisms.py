#!/usr/bin/env python3
"""Writes docs/mechanisms.md from the mechanisms themselves: laws, numbers, sources, tests."""

from __future__ import annotations

from pathlib import Path

from impactscope.drivers.simulated_campaign import describe_effects
from impactscope.physics.mechanisms.mechanism import Subsystem
from impactscope.physics.mechanisms.registry import all_mechanisms

HEAD = """# Mechanisms

Written by `scripts/document_mechanisms.py` from the mechanisms themselves, as is the list of
`impactscope conceal --list`. These are the names under which effects are found, hidden and stated
in a `baseline`, with the laws that are meant.

s is the compression of the sensor's spring, v the plate's speed over what carries the guide, x its
position, u the compression of the damper layer, p the impactor's position at the contact, along
its arc for a pendulum, which has the lever l; positive is into the sensor. On a driven mass or
under a prescribed motion s is the displacement and v the speed. k is the stiffness of the sensor's
spring, also within the laws that change it. An apostrophe is a derivative by the time."""


def document() -> str:
    """The whole document."""
    kinds = all_mechanisms()
    by_subsystem: dict[str, list[str]] = {}
    for name, numbers, sentence, law in sorted(describe_effects()):
        kind = kinds[name]
        told = f'{sentence} Shown best by: {kind.test}. Source: {kind.source}'
        cells = [f'`{name}`', *(text.replace('|', '\\|') for text in (numbers, law, told))]
        by_subsystem.setdefault(kind.subsystem.value, []).append(f'| {" | ".join(cells)} |')
    parts = [HEAD]
    for subsystem in Subsystem:
        parts.append(f'\n## {subsystem.value.capitalize()}\n')
        parts += ['| name | numbers, unit (default) | law | what it is |', '|---|---|---|---|']
        parts += by_subsystem[subsystem.value]
    return '\n'.join(parts) + '\n'


if __name__ == '__main__':
    target = Path(__file__).resolve().parents[1] / 'docs' / 'mechanisms.md'
    target.write_text(document(), encoding='utf-8')
