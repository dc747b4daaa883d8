"""The skeleton of a self-contained page: templates, style, script, and what it may not do.

A page carries its style and its one script inside and forbids everything else by its content
security policy: no network, no other script, no inline handlers. Text is escaped by the
template engine; the policy holds should an escape ever be missing.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import os
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from impactscope.report.plain_text import printable

__all__ = ['render_page', 'write_page']


def _asset(name: str) -> str:
    folder = resources.files('impactscope.report') / 'templates'
    return (folder / name).read_text(encoding='utf-8')


def _finalize(value: Any) -> Any:
    """Make text fit to print on its way into the page; our own markup passes."""
    if isinstance(value, str) and not isinstance(value, Markup):
        return printable(value)
    return value


@functools.cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader('impactscope.report'),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_finalize,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _source_hash(text: str) -> str:
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"


def render_page(template: str, **context: Any) -> str:
    """A page from a template that extends ``page.html.j2``; texts in ``context`` are escaped."""
    style, script = _asset('page.css'), _asset('figure.js')
    policy = (
        f"default-src 'none'; style-src {_source_hash(style)}; "
        f"script-src {_source_hash(script)}; base-uri 'none'; form-action 'none'"
    )
    return (
        _environment()
        .get_template(template)
        .render(style=Markup(style), script=Markup(script), policy=policy, **context)  # noqa: S704
    )


def write_page(text: str, path: Path) -> None:
    """Write a page so that ``path`` holds either what it held or the whole page.

    Raises OSError where the folder cannot be written.
    """
    part = path.with_name(f'.{path.name}.{os.getpid()}.part')
    try:
        with part.open('w', encoding='utf-8', newline='\n') as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
