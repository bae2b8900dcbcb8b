"""What an arm reaches, and which experiment is worth flying."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from .commands import AnyPath, Folder, run
from .diagnosis import Diagnosis
from .plant import Plant
from .progress import Progress


class Workspace:
    """Reach, straight paths and manipulability of a plant: ``data`` as ``fss workspace`` writes it, ``figures`` as SVG by name."""

    def __init__(self, folder: Path, text: str) -> None:
        self.text = text
        self.data: dict[str, Any] = json.loads((folder / "workspace.json").read_text())
        self.figures = {path.stem: path.read_text() for path in sorted(folder.glob("*.svg"))}

    @property
    def radius_m(self) -> Optional[float]:
        """Largest distance of the end-effector from the centre of mass, floating (m); None for a clamped base."""
        radius: Optional[float] = self.data["radius_m"]
        return radius

    def __repr__(self) -> str:
        return f"<fss.Workspace radius {self.radius_m} m, held {self.data['fixed_area_m2']:.3f} m^2>"

    def _repr_html_(self) -> str:
        return "".join(f"<div>{figure}</div>" for figure in self.figures.values())


def workspace(
    plant: Union[None, Plant, AnyPath] = None,
    *,
    postures: Sequence[npt.ArrayLike] = (),
    directions: int = 36,
    progress: Progress = None,
) -> Workspace:
    """Computes reach and manipulability of a plant.

    ``postures``: joint angles (rad), shape (links,) each, in which straight paths start; ``directions``: how many those take.
    """
    folder = Folder(None)
    arguments = ["--plant", folder.plant(plant), "--out", str(folder.path), "--directions", str(directions)]
    for posture in postures:
        degrees = np.degrees(np.asarray(posture, dtype=np.float64)).tolist()
        arguments.append("--posture=" + ",".join(map(repr, degrees)))
    return Workspace(folder.path, run("workspace", arguments, progress))


class NextExperiment:
    """The maneuver that decides best between causes that a diagnosis could not tell apart.

    ``mission`` is its file's text, None where nothing is undecided; ``candidates`` are all maneuvers, best first, with the
    separation to expect and their cost in seconds and gas. :meth:`write` gives the file that ``fss.fly`` takes.
    """

    def __init__(self, mission: Optional[str], candidates: list[dict[str, Any]], text: str) -> None:
        self.mission, self.candidates, self.text = mission, candidates, text

    def write(self, path: AnyPath) -> Path:
        """Writes the mission file. Raises ValueError where nothing is undecided."""
        if self.mission is None:
            raise ValueError("nothing is undecided: there is no mission to write")
        path = Path(path)
        path.write_text(self.mission)
        return path


def next_experiment(
    diagnosis: Union[Diagnosis, AnyPath], *, plant: Union[None, Plant, AnyPath] = None, progress: Progress = None
) -> NextExperiment:
    """Finds the maneuver that decides best between the causes that are still possible.

    ``diagnosis`` is an answer of :func:`fss.diagnose` or its folder, ``plant`` the one that it was made with.
    """
    folder = Folder(None)
    out, answer = folder.path / "next.toml", folder.path / "next.json"
    source = diagnosis.folder if isinstance(diagnosis, Diagnosis) else diagnosis
    files = ["--plant", folder.plant(plant), "--out", str(out), "--json", str(answer)]
    text = run("next-experiment", [str(source), *files], progress)
    mission = out.read_text() if out.exists() else None
    return NextExperiment(mission, json.loads(answer.read_text()) if answer.exists() else [], text)
