"""Parameters of a plant from measured runs."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, Optional, Union

from .commands import AnyPath, Folder, Run, run, runs_of
from .diagnosis import Parameter
from .plant import Plant
from .progress import Progress


class Calibration:
    """What a calibration estimates: ``parameters`` by name, the calibrated ``plant``, ``data`` as the program writes it as JSON
    (intervals, rank, condition, residuals, what is undetermined), ``text`` as it prints it."""

    def __init__(self, data: dict[str, Any], plant: Plant, text: str) -> None:
        self.data, self.plant, self.text = data, plant, text
        self.parameters = {name: Parameter(p["value"], p["std"]) for name, p in data["parameters"].items()}

    @property
    def undetermined(self) -> list[str]:
        """Parameters that these runs cannot determine; they keep their old values."""
        return list(self.data["undetermined_parameters"])

    def __repr__(self) -> str:
        return f"<fss.Calibration {self.data['kind']}: {len(self.parameters)} parameters, {len(self.undetermined)} undetermined>"

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{n}</td><td>{p.value:.6g}</td><td>{p.std:.2g}</td></tr>" for n, p in self.parameters.items())
        return f"<table><tr><th>parameter</th><th>value</th><th>std</th></tr>{rows}</table>"


def _calibrate(
    kind: str,
    runs: Union[Run, Iterable[Run]],
    plant: Union[None, Plant, AnyPath],
    options: list[str],
    progress: Progress,
) -> Calibration:
    folder = Folder(None)
    out, answer = folder.path / "calibrated.toml", folder.path / "calibration.json"
    files = ["--plant", folder.plant(plant), "--out", str(out), "--json", str(answer)]
    text = run("calibrate", [kind, *runs_of(runs), *files, *options], progress)
    calibrated = Plant.parse(out.read_text())
    return Calibration(json.loads(answer.read_text()), calibrated, text)


def calibrate_kinematic(
    runs: Union[Run, Iterable[Run]],
    *,
    plant: Union[None, Plant, AnyPath] = None,
    each_length: bool = False,
    still: bool = False,
    progress: Progress = None,
) -> Calibration:
    """Link lengths, joint offsets and the first joint's pose, from poses of the end-effector.

    ``each_length``: a length of its own for each link; ``still``: only poses at rest. Raises fss.Error where the runs determine
    nothing.
    """
    options = [*(["--each-length"] if each_length else []), *(["--still"] if still else [])]
    return _calibrate("kinematic", runs, plant, options, progress)


def calibrate_dynamic(
    runs: Union[Run, Iterable[Run]],
    *,
    plant: Union[None, Plant, AnyPath] = None,
    method: str = "trajectory",
    each_length: bool = False,
    masses: bool = False,
    torque: bool = False,
    progress: Progress = None,
) -> Calibration:
    """Centres of mass and inertias with the kinematics, from motion without thrust.

    ``method``: ``trajectory`` or ``attitude``; ``masses``: estimate them too; ``torque``: read the torque sensors too. Raises
    fss.Error where the runs determine nothing.
    """
    flags = {"--each-length": each_length, "--masses": masses, "--torque": torque}
    options = ["--method", method, *(flag for flag, is_set in flags.items() if is_set)]
    return _calibrate("dynamic", runs, plant, options, progress)
