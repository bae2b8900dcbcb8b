"""Flights on the virtual clock."""

from __future__ import annotations

import itertools
from os import PathLike
from pathlib import Path
from typing import Optional, Union

from . import _fss
from .log import Log
from .plant import Plant, plant_of
from .progress import Progress, shown

AnyPath = Union[str, PathLike[str]]


def fly(
    mission: AnyPath = "zero-reaction",
    *,
    plant: Union[None, Plant, AnyPath] = None,
    laboratory: Union[None, Plant, AnyPath] = None,
    seed: int = 1,
    out: Optional[AnyPath] = None,
    launch: Optional[AnyPath] = None,
    faults: Optional[AnyPath] = None,
    fault_seed: Optional[int] = None,
    progress: Progress = None,
) -> Log:
    """Flies a mission with the whole stack against the simulated laboratory, as ``fss run --fast`` does: the same seed and
    files give the same bytes.

    ``mission`` is one that comes with fss, or a file; ``plant`` what the services believe, ``laboratory`` the simulated
    laboratory, where it is another. ``out`` is the folder for log, summary and picture; ``out/MISSION``, ``out/MISSION-2`` and
    so on where absent. ``faults`` is a file of what goes wrong, ``fault_seed`` draws it. Ctrl-C ends the flight.

    Raises fss.Error where a file makes no sense, with its line. An aborted mission raises nothing: ``log.summary["outcome"]``.
    """
    folder = _unused(Path(mission).stem) if out is None else Path(out)
    texts = [None if given is None else plant_of(given).to_toml() for given in (plant, laboratory)]
    with shown(progress, Path(mission).stem) as tell:
        _fss.fly(
            str(mission),
            folder,
            seed,
            plant=texts[0],
            laboratory=texts[1],
            launch=launch,
            faults=faults,
            fault_seed=fault_seed,
            progress=tell,
        )
    return Log(folder)


def _unused(mission: str) -> Path:
    numbered = (f"{mission}-{k}" for k in itertools.count(2))
    folders = (Path("out") / name for name in itertools.chain([mission], numbered))
    return next(folder for folder in folders if not (folder / "run.mcap").exists())
