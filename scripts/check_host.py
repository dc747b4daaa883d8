#!/usr/bin/env python3
"""Names what the host lacks for a build, with the command that brings it."""

import importlib.util
import pathlib
import platform
import shutil
import sys
import sysconfig


def missing() -> list[str]:
    """One line for each thing that is not there."""
    lines = []
    if sys.version_info < (3, 11):  # noqa: UP036 - said in words before anything else fails
        lines.append(
            f'Python 3.11 or newer is needed, this is {platform.python_version()}: '
            'apt install python3.11 python3.11-venv python3.11-dev, then make PYTHON=python3.11'
        )
    if importlib.util.find_spec('ensurepip') is None or importlib.util.find_spec('venv') is None:
        lines.append('Python cannot make virtual environments: apt install python3-venv')
    lines.extend(
        f'no program {tool!r}: apt install build-essential'
        for tool in ('cc', 'c++', 'make')
        if shutil.which(tool) is None
    )
    header = pathlib.Path(sysconfig.get_paths()['include']) / 'Python.h'
    if not header.exists():
        lines.append(f'no header {header}: apt install python3-dev')
    return lines


if __name__ == '__main__':
    found = missing()
    for line in found:
        sys.stderr.write(f'impactscope: {line}\n')
    sys.exit(1 if found else 0)
