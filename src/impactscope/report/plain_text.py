"""Text from recordings, made fit to be printed.

Escaping for HTML is the template engine's work; this sees to what escaping leaves alone:
control characters, marks that reverse the direction of reading, halves of surrogate pairs
(which no file can hold) and texts without end.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from typing import Any

__all__ = ['LONGEST_TEXT', 'flatten', 'printable']

LONGEST_TEXT = 2000
HIDDEN_CATEGORIES = frozenset({'Cc', 'Cf', 'Cs', 'Co', 'Cn', 'Zl', 'Zp'})
KEPT = frozenset('\n\t\u200d\u00ad')  # joiners and soft hyphens are ordinary writing
LONGEST_PARAMETER_LIST = 200


def printable(text: str, longest: int = LONGEST_TEXT) -> str:
    """``text`` with hidden characters shown as code points and its length bounded."""
    shown = text[:longest]
    if not (shown.isascii() and shown.isprintable()):
        shown = ''.join(
            c if c in KEPT or unicodedata.category(c) not in HIDDEN_CATEGORIES
            else f'[U+{ord(c):04X}]'
            for c in shown
        )  # fmt: skip
    left = len(text) - longest
    return f'{shown} ... ({left} more characters)' if left > 0 else shown


def flatten(parameters: Mapping[str, Any], prefix: str = '') -> list[tuple[str, str]]:
    """Names and values of a stage's parameters, nested ones with dotted names."""
    rows: list[tuple[str, str]] = []
    for name, value in parameters.items():
        full = f'{prefix}{name}'
        if isinstance(value, Mapping):
            rows += flatten(value, f'{full}.')
        elif isinstance(value, list | tuple | set | frozenset):
            items = [str(item) for item in list(value)[:LONGEST_PARAMETER_LIST]]
            more = len(value) - len(items)
            rows.append((full, ', '.join(items) + (f', ... ({more} more)' if more else '')))
        elif isinstance(value, bool):
            rows.append((full, 'yes' if value else 'no'))
        elif isinstance(value, float):
            rows.append((full, 'not set' if value != value else f'{value:.10g}'))
        else:
            rows.append((full, 'none' if value is None else str(value) or 'empty'))
    return rows
