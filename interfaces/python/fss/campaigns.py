"""Campaigns: many flights, shared among workers in any way."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Optional, Union

from . import _fss
from .commands import AnyPath, Folder
from .plant import Plant


class Row(dict[str, Any]):
    """What a flight came to, with the names of the campaign's table: ``run``, ``seed``, swept values, ``outcome``, ``success``,
    ``reason``, figures of merit (None where the mission has none), ``wall_time_s``."""

    def __init__(self, values: Mapping[str, Any], journal: str) -> None:
        super().__init__(values)
        #: The same as a line of the campaign's journal.
        self.journal = journal

    def __reduce__(self) -> Any:
        return Row, (dict(self), self.journal)


@dataclass(frozen=True)
class Task:
    """One flight of a campaign: calling it flies it, in any process that sees the campaign's folder."""

    folder: Path
    run: int

    def __call__(self) -> Row:
        line, values = _fss.campaign_run(self.folder, self.run)
        return Row(json.loads(values), line)


class Campaign(Sequence[Task]):
    """The flights of a campaign, as tasks that Dask, Ray, joblib or a pool can map; the same rows as ``fss campaign``."""

    def __init__(self, folder: Path, count: int) -> None:
        #: Where it lies; ``fss campaign --out FOLDER`` goes on with it.
        self.folder = folder
        self._count = count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, place: Any) -> Any:
        if isinstance(place, slice):
            return [Task(self.folder, run + 1) for run in range(self._count)[place]]
        return Task(self.folder, range(self._count)[place] + 1)

    def __iter__(self) -> Iterator[Task]:
        return (Task(self.folder, run + 1) for run in range(self._count))

    def write(self, rows: Iterable[Row], name: str = "python") -> Path:
        """Adds rows to the campaign, in a journal and a Parquet file of this name, and gives the file's path; all of
        ``folder/runs`` is one table. Give each writer a name of its own."""
        return Path(_fss.campaign_write(self.folder, name, [row.journal for row in rows]))


def campaign(
    mission: Optional[str] = None,
    *,
    out: AnyPath,
    seeds: Optional[range] = None,
    sweep: Optional[Mapping[str, Iterable[float]]] = None,
    plant: Union[None, Plant, AnyPath] = None,
    laboratory: Union[None, Plant, AnyPath] = None,
    launch: Optional[AnyPath] = None,
) -> Campaign:
    """Begins a campaign in a folder, or finds the same one there, and flies nothing.

    ``seeds``: a range such as ``range(1, 101)``; ``sweep``: values by their way in the plant file (``base.mass_kg``), in the
    laboratory's (``laboratory.base.mass_kg``) or in the mission (``mission.phase.line.duration_s``): all combinations are flown,
    each with all seeds. Raises fss.Error where another campaign lies there or nothing of it can fly.
    """
    folder = Path(out).absolute()
    arguments = [] if mission is None else [str(mission)]
    arguments += ["--out", str(folder)]
    if seeds is not None:
        if seeds.step != 1:
            raise ValueError("the seeds of a campaign follow one another: range(first, behind_the_last)")
        arguments += ["--seeds", f"{seeds.start}..{seeds.stop}"]
    for key, values in (sweep or {}).items():
        arguments += ["--sweep", f"{key}={','.join(repr(float(value)) for value in values)}"]
    scratch = [Folder(None) for _ in range(2)]
    for option, given, place in (("--plant", plant, scratch[0]), ("--laboratory", laboratory, scratch[1])):
        if given is not None:
            arguments += [option, place.plant(given)]
    if launch is not None:
        arguments += ["--launch", str(launch)]
    return Campaign(folder, _fss.campaign_begin(arguments))
