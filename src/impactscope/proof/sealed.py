"""Answers that are written before the examination and opened after it.

The file is packed so that nobody reads it by accident; the published SHA-256 shows that it was
not changed between the drawing of the campaigns and the scoring.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from impactscope.errors import InputError

__all__ = ['open_sealed', 'seal']


def seal(path: Path, answers: Mapping[str, Any]) -> str:
    """Write the answers packed, and beside them their SHA-256; returns it."""
    packed = base64.b64encode(zlib.compress(json.dumps(answers, sort_keys=True).encode(), 9))
    path.write_bytes(packed)
    digest = hashlib.sha256(packed).hexdigest()
    path.with_suffix('.sha256').write_text(f'{digest}  {path.name}\n')
    return digest


def open_sealed(path: Path, digest: str | None = None) -> dict[str, Any]:
    """The answers, once the seal has been compared.

    Args:
        path: of the sealed file.
        digest: SHA-256 published before; None: the one in the file beside it.

    Raises InputError where the file is not the one whose digest was published.
    """
    packed = path.read_bytes()
    published = digest or path.with_suffix('.sha256').read_text().split()[0]
    found = hashlib.sha256(packed).hexdigest()
    if found != published:
        raise InputError(f'{path.name!r} has SHA-256 {found}, published was {published}')
    answers: dict[str, Any] = json.loads(zlib.decompress(base64.b64decode(packed)))
    return answers
