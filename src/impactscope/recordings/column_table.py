"""Columns of numbers that were read from a file, found by what a user names them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import InputError, MissingChannelError, RecordingError
from impactscope.recordings.units import to_si

__all__ = ['HEADING_MARKS', 'ColumnFile', 'as_table']

MOST_LISTED = 100  # columns of a lying table that are named one by one
HEADING_MARKS = '#% '  # before the headings of programs that take them for a comment


@dataclass(frozen=True, slots=True, eq=False)
class ColumnFile:
    """The columns of one file.

    ``arrays`` holds tables of shape (n_rows, n_columns) by name; text and .npy files and lists in
    JSON have one, named ''. ``names`` are the headings of that one, where it has any; ``texts``
    are its columns that hold text, and what stands there: they are no numbers in the table.
    """

    path: Path
    arrays: dict[str, NDArray[np.float64]]
    names: tuple[str, ...] = ()
    first_row: int = 0  # line of a text file on which the data begins; 0 in other files
    passed_over: tuple[str, ...] = ()  # variables that are no tables, and what they are
    stamped: frozenset[int] = frozenset()  # columns of dates and times, as s from their first
    texts: Mapping[int, str] = dataclasses.field(default_factory=dict)

    def column(self, key: str | int) -> NDArray[np.float64]:
        """One column, shape (n_rows,).

        Args:
            key: index, heading, variable (``structure.field`` in a structure), or variable and
            index as in ``data[2]``.

        Raises MissingChannelError where it is not there or holds text.
        """
        name, index = '', self._place(key)
        if isinstance(index, int) and index in self.texts:
            raise MissingChannelError(
                f'column {key!r} of {self.path.name!r} holds {self.texts[index]}'
            )
        if isinstance(index, str):
            if index in self.arrays:
                name, index = index, 0
            else:
                name, _, rest = index.rpartition('[')
                index = int(rest[:-1]) if rest[:-1].isdecimal() and rest[-1:] == ']' else -1
        table = self.arrays.get(name)
        if table is None and isinstance(key, int) and len(self.arrays) == 1:
            table = next(iter(self.arrays.values()))
        if table is None or not 0 <= int(index) < table.shape[1]:
            raise MissingChannelError(
                f'{self.path.name!r} has no column {key!r}; it has {", ".join(self.keys())}'
            )
        if isinstance(key, str) and key == name and table.shape[1] > 1:
            raise MissingChannelError(
                f'{key!r} in {self.path.name!r} has {table.shape[1]} columns: '
                f"name one, as in '{key}[0]'"
            )
        return table[:, int(index)]

    def seconds(self, key: str | int, unit: str) -> NDArray[np.float64]:
        """A column of times in s, shape (n_rows,), of which ``unit`` is said.

        Raises MissingChannelError where it is not there, InputError where it holds dates and
        times, which are read in s, and another unit is said.
        """
        factor = to_si(unit)[1]
        if factor != 1.0 and self._place(key) in self.stamped:
            raise InputError(
                f'column {key!r} of {self.path.name!r} holds dates and times, which are read '
                f'in s; its unit is said to be {unit!r}'
            )
        return self.column(key) * factor

    def _place(self, key: str | int) -> str | int:
        """Index of a heading, with or without the mark before it; another key as it is."""
        if isinstance(key, str):
            for name in (key, key.lstrip(HEADING_MARKS) or key):
                if name in self.names:
                    return self.names.index(name)
        return key

    def keys(self) -> list[str]:
        """What :meth:`column` takes, and how many rows each has."""
        found = []
        for name, table in self.arrays.items():
            rows, columns = table.shape
            if columns > MOST_LISTED and columns > rows:
                found.append(
                    f'{name or "the table"}: {columns} columns of {rows} rows; '
                    f'transposed {rows} columns of {columns}'
                )
                continue
            for i in range(columns):
                if not name and i in self.texts:
                    continue
                own = name if columns == 1 else f'{name}[{i}]'
                label = own if name else self._label(i)
                dated = ', dates and times as s from the first' if i in self.stamped else ''
                found.append(f'{label} ({rows} rows{dated})')
        return found

    def left_out(self) -> list[str]:
        """Columns and variables that are no numbers, and what they are."""
        texts = [f'{self._label(i)} ({told})' for i, told in self.texts.items()]
        return [*texts, *self.passed_over]

    def transposed(self) -> ColumnFile:
        """The file with the rows of tables of more than one column as channels."""
        arrays = {}
        for name, table in self.arrays.items():
            gone = [] if name else list(self.texts)
            arrays[name] = np.delete(table, gone, axis=1).T if table.shape[1] > 1 else table
        return ColumnFile(self.path, arrays, passed_over=tuple(self.left_out()))

    def _label(self, index: int) -> str:
        """A column of the table without a name: its number, and its heading."""
        return f'{index} {self.names[index]!r}' if index < len(self.names) else str(index)


def as_table(array: NDArray[np.generic], path: Path, name: str) -> NDArray[np.float64]:
    """An array as a table of shape (n_rows, n_columns); ``name`` is that in the file, or ''.

    Raises RecordingError where it has more dimensions than two, or no real numbers.
    """
    real = array.dtype.kind in 'biuf'
    if not real or array.ndim > 2:
        example = f'{name or "array"}[0]'
        shape = ' x '.join(map(str, array.shape[1:]))
        remedy = (
            f'; save one part of it by itself, such as numpy.save("part.npy", {example}) of '
            f'{shape}, or give it two dimensions with reshape'
        )
        raise RecordingError(
            f'{name or "the array"!r} of {path.name!r} has {array.ndim} dimensions of '
            f'{array.dtype}; a table of real numbers is needed'
            f'{remedy if real and array.ndim == 3 else ""}'
        )
    table = np.asarray(array, dtype=np.float64)
    return table if table.ndim == 2 else table.reshape(-1, 1)
