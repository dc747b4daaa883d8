#!/usr/bin/env python3
"""Writes docs/mechanisms.md from the mechanisms themselves: laws, numbers, sources, tests."""

from __future__ import annotations

import math
from pathlib import Path

from impactscope.physics.mechanisms.mechanism import Mechanism, Parameter
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


def numbers(parameters: tuple[Parameter, ...]) -> str:
    """Names and units, with what is taken where a number is not given."""
    shown = []
    for parameter in parameters:
        default = '' if math.isnan(parameter.default) else f' ({parameter.default:g})'
        shown.append(f'`{parameter.name}` {parameter.unit}{default}')
    return ', '.join(shown)


def row(mechanism: Mechanism) -> str:
    """A mechanism's row of the table of its subsystem."""
    law, sentence, source, test = (
        text.replace('|', '\\|')
        for text in (mechanism.equation, mechanism.sentence, mechanism.source, mechanism.test)
    )
    told = f'{sentence} Shown best by: {test}. Source: {source}'
    return f'| `{mechanism.name}` | {numbers(mechanism.parameters)} | {law} | {told} |'


def document() -> str:
    """The whole document."""
    parts = [HEAD]
    by_subsystem: dict[str, list[Mechanism]] = {}
    for mechanism in all_mechanisms().values():
        by_subsystem.setdefault(mechanism.subsystem.value, []).append(mechanism)
    for subsystem, found in by_subsystem.items():
        parts.append(f'\n## {subsystem.capitalize()}\n')
        parts += ['| name | numbers, unit (default) | law | what it is |', '|---|---|---|---|']
        parts += [row(m) for m in sorted(found, key=lambda m: m.name)]
    return '\n'.join(parts) + '\n'


if __name__ == '__main__':
    target = Path(__file__).resolve().parents[1] / 'docs' / 'mechanisms.md'
    target.write_text(document(), encoding='utf-8')
