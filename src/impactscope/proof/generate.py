"""Draw, measure and seal an examination; what exists already is kept."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np

from impactscope.errors import ConfigurationError

from .campaign_folder import write_campaign
from .draw import CATEGORIES, Concealed, draw
from .evidence_map import evidence_map
from .population import POPULATIONS
from .prediction_limit import prediction_limit
from .sealed import open_sealed, seal

__all__ = ['SHORT', 'answer_of', 'campaign_name', 'generate']

Progress = Callable[[str, int, int], None]

SHORT: tuple[str, ...] = (
    *('clean', 'single', 'single', 'single', 'pair', 'outside'),
    *('parameter', 'label', 'single', 'clean', 'single', 'single'),
)  # the mix of the short examination


def campaign_name(index: int) -> str:
    """Name of the folder of a campaign."""
    return f'campaign_{index:04d}'


def generate(
    output: Path,
    seed: int,
    campaigns: int,
    *,
    jobs: int = 1,
    categories: tuple[str, ...] = (),
    kind: str | None = None,
    classes: bool = True,
    population: str = 'paper',
    progress: Progress | None = None,
) -> str:
    """Make an examination and return the SHA-256 of its sealed answers.

    Args:
        output: folder; campaigns go to ``campaigns/``, the answers to ``answers.sealed``.
        seed: of all chance; with the index it fixes every campaign.
        campaigns: how many.
        jobs: processes.
        categories: given to the campaigns in turn; empty: drawn.
        kind: of every campaign; None: drawn.
        classes: whether to find what cannot be told from the truth.
        population: from which conditions are drawn, one of ``POPULATIONS``.
        progress: called with (what, done, all).

    Raises ConfigurationError where the folder holds an examination of another seed.
    """
    for name in categories:
        if name not in CATEGORIES:
            raise ConfigurationError(f'category is {name!r}; known are {", ".join(CATEGORIES)}')
    output.mkdir(parents=True, exist_ok=True)
    plan: dict[str, object] = {'campaigns': campaigns, 'categories': list(categories)}
    if kind is not None:
        plan['kind'] = kind
    if population != 'paper':
        plan['population'] = population
    _same_plan(output / 'examination.json', plan, seed)
    parts = output / 'sealed_parts'
    parts.mkdir(exist_ok=True)
    todo = [i for i in range(campaigns) if not (parts / f'{campaign_name(i)}.sha256').exists()]
    work = [
        (
            *(output, seed, i, categories[i % len(categories)] if categories else None),
            *(kind, classes, population),
        )
        for i in todo
    ]
    done = campaigns - len(todo)
    for _ in _each(_one, work, jobs):
        done += 1
        if progress is not None:
            progress('drawn', done, campaigns)
    answers = {
        campaign_name(i): open_sealed(parts / f'{campaign_name(i)}.sealed')
        for i in range(campaigns)
    }
    return seal(output / 'answers.sealed', {'seed': seed, 'campaigns': answers})


def answer_of(concealed: Concealed) -> dict[str, Any]:
    """What is hidden in a campaign, as it is sealed."""
    return {
        'category': concealed.category,
        'kind': concealed.truth.kind,
        'parts': [asdict(part) for part in concealed.parts],
        'detectability': concealed.detectability,
        'confusable': dict(concealed.confusable),
        'recordings': len(concealed.truth.blows),
        'orientation': concealed.truth.orientation,
        'layer': concealed.truth.layer is not None,
        'noise': {
            name: std * math.sqrt(concealed.truth.colour(name).variance)
            for name, std in concealed.truth.noise.items()
        },
        'prediction_limit': prediction_limit(concealed.truth),
        'colours': {n: c._asdict() for n, c in concealed.truth.colours.items()},
        'tolerated': ['quantisation'] if _with_steps(concealed) else [],
        'evidence': evidence_map(concealed) if concealed.detectability >= 1 else {},
    }


def _with_steps(concealed: Concealed) -> bool:
    """Whether a converter's steps are part of the noise: to name them is no finding."""
    return any(c.step for c in concealed.truth.colours.values())


def _one(
    output: Path,
    seed: int,
    index: int,
    category: str | None,
    kind: str | None,
    classes: bool,
    population: str,
) -> None:
    rng = np.random.default_rng([seed, index])
    among = POPULATIONS[population]
    concealed = draw(rng, category=category, kind=kind, classes=classes, population=among)
    folder = output / 'campaigns' / campaign_name(index)
    rmtree(folder, ignore_errors=True)  # of a run that was cut off
    write_campaign(folder, concealed.truth, concealed.stated, rng)
    seal(output / 'sealed_parts' / f'{campaign_name(index)}.sealed', answer_of(concealed))


def _same_plan(path: Path, plan: Mapping[str, object], seed: int) -> None:
    """Hold that a folder serves one examination; the seed itself is not written down here."""
    mark = {**plan, 'seed_sha256': hashlib.sha256(str(seed).encode()).hexdigest()}
    if path.exists() and json.loads(path.read_text()) != mark:
        raise ConfigurationError(
            f'{str(path.parent)!r} holds another examination; name another folder or its seed'
        )
    path.write_text(json.dumps(mark, indent=1))


def _each(function: Callable[..., None], work: list[tuple[Any, ...]], jobs: int) -> Iterable[None]:
    if jobs <= 1:
        for arguments in work:
            function(*arguments)
            yield
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context('spawn')) as pool:
        for future in as_completed([pool.submit(function, *a) for a in work]):
            future.result()
            yield
