"""What a figure was measured on."""

from __future__ import annotations

import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path

__all__ = ['describe']

# As the executables do: all matrices are small, and threads would only wait for each other.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')


def describe() -> str:
    """One line: processor, cores, load, versions."""
    model = platform.processor() or platform.machine()
    info = Path('/proc/cpuinfo')
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith('model name')]
        model = names[0].partition(':')[2].strip() if names else model
    cores = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()
    load = os.getloadavg()[0] if hasattr(os, 'getloadavg') else float('nan')
    libraries = ', '.join(f'{name} {version(name)}' for name in ('numpy', 'scipy', 'numba'))
    return f'{model}, {cores} cores, load {load:.1f}, Python {sys.version.split()[0]}, {libraries}'
