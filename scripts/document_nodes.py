#!/usr/bin/env python3
"""Writes docs/nodes.md from the nodes themselves: topics, services, parameters as declared."""

from __future__ import annotations

import importlib
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import rclpy
from rclpy.parameter import Parameter

from impactscope.nodes.main import NODES
from impactscope.nodes.topics import TOPICS

HEAD = """# Nodes

Written by `scripts/document_nodes.py` from the nodes themselves; `ros2 param describe` says the
same of a running node. All names are relative: they live in the bench's namespace and can be
remapped. `config/bench.yaml` sets the ones that a bench is likely to change.

## Topics of a bench

| topic | type | reliability | history | latched |
|---|---|---|---|---|
"""
CAMPAIGN = """
version: 1
bench: {kind: impact, orientation: vertical}
baseline: [linear_sensor]
recordings: [{file: tap.mcap, kind: tap}]
"""
KINDS = {1: 'bool', 2: 'integer', 3: 'number', 4: 'text', 9: 'texts', 8: 'numbers', 7: 'integers'}


def topics() -> str:
    """The table of topics."""
    rows = [
        f'| `{name}` | `{topic.type.__name__}` | '
        f'{topic.profile.reliability.name.lower().replace("_", " ")} | '
        f'{topic.profile.depth} | {"yes" if topic.is_latched else ""} |'
        for name, topic in TOPICS.items()
    ]
    rows.append('| `mirror/<channel>` | `WrenchStamped` or `AccelStamped` | best effort | 100 | |')
    rows.append('| `/diagnostics` | `DiagnosticArray` | reliable | 50 | |')
    return HEAD + '\n'.join(rows) + '\n'


def parameters(node: Any) -> str:
    """The table of a node's parameters."""
    rows = ['| parameter | type | default | meaning |', '|---|---|---|---|']
    names = sorted(
        name
        for name in node._parameters
        if not name.startswith(('qos_overrides', 'use_sim_time', 'start_type'))
    )
    for name in names:
        value, descriptor = node.get_parameter(name).value, node.describe_parameter(name)
        shown = ', '.join(value) if isinstance(value, list) else value
        text = descriptor.description.replace('|', '\\|')
        limits = [
            f' [from {item.from_value:g}]'
            for item in (*descriptor.floating_point_range, *descriptor.integer_range)
        ]
        rows.append(
            f'| `{name}` | {KINDS.get(descriptor.type, "?")} | {shown!s} | '
            f'{text}{"".join(limits)} |'
        )
    return '\n'.join(rows) + '\n'


def document() -> str:
    """The whole page."""
    rclpy.init()
    parts = [topics()]
    folder = Path(tempfile.mkdtemp())
    (folder / 'campaign.yaml').write_text(CAMPAIGN, encoding='utf-8')
    try:
        for name, (module, kind) in NODES.items():
            code = importlib.import_module(f'impactscope.nodes.{module}')
            needed = {
                'recorder': {'path': str(folder / 'unused.mcap')},
                'discrepancy': {'campaign': str(folder / 'campaign.yaml')},
            }.get(name, {'autostart': False} if 'driver' in name else {})
            overrides = [Parameter(key, value=value) for key, value in needed.items()]
            node = getattr(code, kind)(parameter_overrides=overrides)
            said = (code.__doc__ or '').partition('Node: ')[2].strip()
            parts.append(f'\n## {name}\n\n{said[:1].upper()}{said[1:]}\n\n{parameters(node)}')
            node.destroy_node()
    finally:
        rclpy.shutdown()
    shutil.rmtree(folder)
    text = ''.join(parts)
    for made in (folder / 'unused.mcap', folder / 'campaign.yaml'):
        text = text.replace(str(made), '')
    return text.replace('| False | configure', '| True | configure')


if __name__ == '__main__':
    target = Path(sys.argv[1] if len(sys.argv) > 1 else 'docs/nodes.md')
    target.write_text(document(), encoding='utf-8')
