"""package.xml names everything that the installed package imports."""

from __future__ import annotations

import ast
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).parents[2]
KEYS = {  # module: key in rosdep's index, where it is not the module's own name
    'jinja2': 'python3-jinja2',
    'lz4': 'python3-rosbags-pip',
    'markupsafe': 'python3-jinja2',
    'mcap': 'mcap-ros2-support',
    'mujoco': 'python3-mujoco-pip',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'rich': 'python3-rich',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'typer': 'python3-typer',
    'yaml': 'python3-yaml',
    'zstandard': 'python3-rosbags-pip',
}
OPTIONAL = {'pysindy'}


def _imported() -> set[str]:
    names: set[str] = set()
    for path in [*(ROOT / 'src').rglob('*.py'), *(ROOT / 'launch').glob('*.py')]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add((node.module or '').split('.')[0])
    return names - set(sys.stdlib_module_names) - {'impactscope'} - OPTIONAL


def test_manifest_names_every_import() -> None:
    manifest = ET.parse(ROOT / 'package.xml').getroot()
    named = {
        (item.text or '').strip()
        for kind in ('depend', 'exec_depend', 'test_depend')
        for item in manifest.iter(kind)
    }
    assert {KEYS.get(name, name) for name in _imported()} <= named
