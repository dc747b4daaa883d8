"""Let an engine answer every campaign of an examination; answers that exist are kept."""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

__all__ = ['examine']

Progress = Callable[[str, int, int], None]


def examine(
    output: Path,
    engine: Sequence[str],
    *,
    jobs: int = 1,
    timeout: float = 900.0,
    progress: Progress | None = None,
) -> None:
    """Run ``engine explain CAMPAIGN --json FILE`` on every campaign without an answer.

    Beside ``results/NAME.json`` stands ``results/NAME.run.json`` with the seconds it took, the
    return code and the end of what it said. An engine that fails or exceeds the time leaves no
    answer, which is scored as such; removing the ``.run.json`` has the campaign asked again.

    Args:
        output: folder of the examination.
        engine: command line, without ``explain``.
        jobs: engines at the same time.
        timeout: s for one campaign.
        progress: called with (what, done, all).
    """
    folders = sorted((output / 'campaigns').iterdir())
    results = output / 'results'
    results.mkdir(exist_ok=True)
    todo = [f for f in folders if not (results / f'{f.name}.run.json').exists()]
    done = len(folders) - len(todo)
    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        for future in as_completed([pool.submit(_ask, engine, f, results, timeout) for f in todo]):
            future.result()
            done += 1
            if progress is not None:
                progress('answered', done, len(folders))


def _ask(engine: Sequence[str], folder: Path, results: Path, timeout: float) -> None:
    answer = results / f'{folder.name}.json'
    command = [*engine, 'explain', str(folder), '--json', str(answer)]
    begin = time.perf_counter()
    try:
        run = subprocess.run(  # noqa: S603  the command is the examiner's own
            command, capture_output=True, text=True, timeout=timeout, check=False, env=os.environ
        )
        code, said = run.returncode, run.stderr[-2000:]
    except subprocess.TimeoutExpired:
        code, said = -1, f'no answer within {timeout:g} s'
    except OSError as error:
        code, said = -2, str(error)
    seconds = time.perf_counter() - begin
    record = {'seconds': seconds, 'code': code, 'said': said}
    (results / f'{folder.name}.run.json').write_text(json.dumps(record, indent=1))
