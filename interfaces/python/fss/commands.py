"""Running the program's commands in this process, with files where the commands take files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import Optional, Union

from . import _fss
from .experiment import Experiment
from .log import Log
from .plant import Plant
from .progress import Progress, shown

AnyPath = Union[str, PathLike[str]]
#: A measured run: a Log, an Experiment, or the path of one.
Run = Union[Log, Experiment, AnyPath]


class Folder:
    """Where a command writes: the folder that was asked for, or one that goes with the last who holds this."""

    def __init__(self, asked: Optional[AnyPath]) -> None:
        if asked is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="fss-")
            asked = self._temporary.name
        self.path = Path(asked)
        self.path.mkdir(parents=True, exist_ok=True)

    def plant(self, plant: Union[None, Plant, AnyPath]) -> str:
        """The path of a plant file; of a plant that is in no file one is written."""
        if plant is not None and not isinstance(plant, Plant):
            if not Path(plant).is_file():
                raise FileNotFoundError(f"there is no plant file {plant}")
            return str(plant)
        plant = Plant() if plant is None else plant
        return str(plant.path or plant.write(self.path / "plant.toml"))


def runs_of(runs: Union[Run, Iterable[Run]]) -> list[str]:
    """Paths of runs. Raises TypeError for what is none."""
    listed: Sequence[Run] = [runs] if isinstance(runs, (Log, Experiment, str, PathLike)) else list(runs)
    paths = []
    for run in listed:
        if isinstance(run, (Log, Experiment)):
            paths.append(str(run.path))
        elif isinstance(run, (str, PathLike)):
            paths.append(str(run))
        else:
            raise TypeError(f"a run is a fss.Log, a fss.Experiment or a path, not {type(run).__name__}")
    return paths


def run(command: str, arguments: Sequence[str], progress: Progress = None) -> str:
    """Runs a command and gives what it would have printed."""
    with shown(progress, command) as tell:
        return _fss.command(command, list(arguments), tell)
