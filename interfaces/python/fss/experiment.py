"""Measured experiments: folders of CSV in the format fss-experiment/1."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _fss
from .samples import Samples

Table = Union[Mapping[str, npt.ArrayLike], npt.NDArray[Any]]
_POSE = ("x_m", "y_m", "theta_rad")
#: The tables of an experiment, and the columns that each may have behind ``t_s``; ``#`` counts from 1.
TABLES: dict[str, tuple[str, ...]] = {
    "base_pose": _POSE,
    "ee_pose": _POSE,
    "gyro": ("rate_rad_s",),
    "joints": ("q#_rad", "qd#_rad_s", "current#_A", "torque#_Nm"),
    "joint_command": ("q#_rad",),
    "valves": ("v#",),
    "thrust_level": ("u#",),
}
_MODES = ("position", "velocity", "current", "none")


class Experiment(Mapping[str, Samples]):
    """One measured run: ``run["base_pose"]["x_m"]``.

    The tables are ``base_pose``, ``ee_pose`` (``x_m, y_m, theta_rad`` in the table frame), ``gyro`` (``rate_rad_s``), ``joints``
    (``q1_rad.., qd1_rad_s.., current1_A.., torque1_Nm..``), ``joint_command`` (``q1_rad..``), ``valves`` (``v1..``, 1 is open) and
    ``thrust_level`` (``u1..``, 0 to 1), each a structured array with ``t_s`` (s). What was not measured is missing. Angles come
    unwrapped.

    Raises fss.Error with file and line where a file is malformed, FileNotFoundError where ``run.toml`` is missing.
    """

    def __init__(self, folder: Union[str, PathLike[str]]) -> None:
        self.path = Path(folder)
        run = _fss.read_experiment(self.path)
        self.name: str = run["name"]
        self.duration_s: Optional[float] = run["duration_s"]
        self.joint_mode: str = run["joint_mode"]
        self._tables = {name: _samples(name, columns) for name, columns in run["tables"].items()}

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __getitem__(self, table: str) -> Samples:
        if table not in self._tables:
            raise KeyError(f"{self.path} has no {table}; it has {', '.join(self._tables)}")
        return self._tables[table]

    def __iter__(self) -> Iterator[str]:
        return iter(self._tables)

    def __len__(self) -> int:
        return len(self._tables)

    def __repr__(self) -> str:
        return f"<fss.Experiment {self.path}: {self.name}, {', '.join(self._tables)}>"

    @classmethod
    def write(
        cls,
        folder: Union[str, PathLike[str]],
        *,
        name: str,
        duration_s: Optional[float] = None,
        joint_mode: str = "none",
        **tables: Table,
    ) -> Experiment:
        """Writes a run from arrays, reads it back and so checks it.

        A table is a mapping of columns (a dictionary, a pandas DataFrame) with ``t_s`` (s, increasing) and the columns of
        :data:`fss.experiment.TABLES`, or an array of shape (n, 1 + columns) with the columns in that order; of joints an array
        has angles alone. ``joint_mode`` says what the joints' drivers followed: ``position``,
        ``velocity``, ``current`` or ``none``.

        An existing run in the folder is replaced. Raises ValueError for a table, column or shape that the format does not have.
        """
        if joint_mode not in _MODES:
            raise ValueError(f"joint_mode '{joint_mode}' is none of {', '.join(_MODES)}")
        checked = {table: _columns(table, given) for table, given in tables.items()}
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for table in TABLES:
            (folder / f"{table}.csv").unlink(missing_ok=True)
        for table, columns in checked.items():
            _write_csv(folder / f"{table}.csv", columns)
        lines = ['format = "fss-experiment/1"', f"name = {json.dumps(name)}", f'joint_mode = "{joint_mode}"']
        if duration_s is not None:
            lines.append(f"duration_s = {float(duration_s)!r}")
        (folder / "run.toml").write_text("\n".join(lines) + "\n")
        return cls(folder)


def _samples(table: str, columns: Mapping[str, npt.NDArray[np.float64]]) -> Samples:
    array = np.empty(len(columns["t_s"]), dtype=[(name, "<f8") for name in columns])
    for name, values in columns.items():
        array[name] = values
    samples = array.view(Samples)
    samples.topic = table
    return samples


def _columns(table: str, given: Table) -> dict[str, npt.NDArray[np.float64]]:
    if table not in TABLES:
        raise ValueError(f"an experiment has no table '{table}'; there are {', '.join(TABLES)}")
    if isinstance(given, np.ndarray) and given.dtype.names is None:
        given = dict(zip(("t_s", *_names(table, given)), np.atleast_2d(given).T))
    names = list(given.dtype.names or ()) if isinstance(given, np.ndarray) else list(given)
    known = [re.compile(column.replace("#", "[1-9][0-9]*")) for column in ("t_s", *TABLES[table])]
    unknown = [name for name in names if not any(pattern.fullmatch(str(name)) for pattern in known)]
    if unknown or "t_s" not in names:
        wrong = f"does not know {unknown}" if unknown else "needs t_s"
        raise ValueError(f"{table} {wrong}; its columns are t_s, {', '.join(TABLES[table])}")
    columns = {name: np.asarray(given[name], dtype=np.float64) for name in ("t_s", *(n for n in names if n != "t_s"))}
    shapes = {name: values.shape for name, values in columns.items()}
    if any(shape != shapes["t_s"] or len(shape) != 1 for shape in shapes.values()):
        raise ValueError(f"the columns of {table} must be of one length: {shapes}")
    return columns


def _names(table: str, array: npt.NDArray[Any]) -> list[str]:
    if array.ndim != 2 or array.shape[1] < 2:
        raise ValueError(f"{table} as an array has the shape (n, 1 + columns), not {array.shape}")
    width, columns = array.shape[1] - 1, TABLES[table]
    if "#" not in columns[0]:
        if width != len(columns):
            raise ValueError(f"{table} has the columns t_s, {', '.join(columns)}, not {width} behind t_s")
        return list(columns)
    return [columns[0].replace("#", str(i + 1)) for i in range(width)]


def _write_csv(path: Path, columns: Mapping[str, npt.NDArray[np.float64]]) -> None:
    rows = zip(*(values.tolist() for values in columns.values()))
    with path.open("w") as file:
        file.write(",".join(columns) + "\n")
        # The shortest text that reads back as the same number.
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)
