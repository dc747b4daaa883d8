"""The executables of the package: one node each, started by its name."""

from __future__ import annotations

import importlib
import signal
import sys

from impactscope.nodes.run import run

__all__ = ['NODES', 'main']

# name of the executable and of the node -> module and class
NODES = {
    'force_driver': ('force_driver', 'ForceDriver'),
    'accelerometer_driver': ('accelerometer_driver', 'AccelerometerDriver'),
    'synchroniser': ('synchroniser', 'SynchroniserNode'),
    'impact_detector': ('impact_detector', 'Detector'),
    'fitter': ('fitter', 'FitterNode'),
    'compliance': ('compliance', 'ComplianceNode'),
    'recorder': ('recorder', 'Recorder'),
    'discrepancy': ('discrepancy', 'Discrepancy'),
    'test_points': ('test_points', 'TestPoints'),
}


def main(name: str) -> int:
    """Run the node of this name with the arguments of the command line."""
    module, kind = NODES[name]
    node = getattr(importlib.import_module(f'impactscope.nodes.{module}'), kind)
    try:
        return run(node, sys.argv)
    finally:  # Ctrl-C comes from the terminal and from the launch: the second one is too late
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
