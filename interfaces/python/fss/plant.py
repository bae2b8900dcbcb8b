"""Plants: a laboratory as a file, its effects, its simulation and its dynamics."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _fss
from .samples import Samples

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Effect:
    """What a plant can have beyond the nominal model: ``Effect("thruster_gain", index=3, scale=0.72)``.

    ``index`` counts thrusters, links or joints from 1; ``channel`` names a data stream, where the effect has one; it begins at
    ``onset_s``. Parameters are those of :func:`fss.effects`; one that is not given changes nothing.
    """

    id: str
    index: Optional[int] = None
    channel: Optional[str] = None
    onset_s: Optional[float] = None
    description: Optional[str] = None
    parameters: dict[str, float] = field(default_factory=dict)

    def __init__(
        self,
        id: str,
        *,
        index: Optional[int] = None,
        channel: Optional[str] = None,
        onset_s: Optional[float] = None,
        description: Optional[str] = None,
        **parameters: float,
    ) -> None:
        values = {"id": id, "index": index, "channel": channel, "onset_s": onset_s, "description": description}
        for name, value in {**values, "parameters": parameters}.items():
            object.__setattr__(self, name, value)

    def _table(self) -> dict[str, Any]:
        named = {key: getattr(self, key) for key in ("id", "index", "channel", "onset_s", "description")}
        return {**{key: value for key, value in named.items() if value is not None}, **self.parameters}


def effects() -> dict[str, dict[str, Any]]:
    """The catalogue of effects by id: sentence, what ``index`` counts, parameters with unit and meaning."""
    return {effect["id"]: effect for effect in json.loads(_fss.effects())}


class Plant:
    """A laboratory: base, links, thrusters, sensors, table, and its effects.

    ``Plant()`` is the default laboratory, ``Plant("plant.toml")`` a file. Values go by their way in the file, elements of lists
    counted from 1: ``plant["base.mass_kg"] = 11``, ``plant["link.2.length_m"]``. Each change is checked.

    Raises fss.Error with file, line and column for what no laboratory can be, FileNotFoundError where the file is missing.
    """

    def __init__(self, path: Optional[Union[str, PathLike[str]]] = None) -> None:
        self.path = None if path is None else Path(path)
        text = None if self.path is None else self.path.read_text()
        self._text = text
        self._file = _fss.PlantFile(text, "plant.toml" if path is None else str(path))

    @classmethod
    def parse(cls, text: str) -> Plant:
        """Of the text of a plant file."""
        return cls._of(_fss.PlantFile(text), text)

    @classmethod
    def _of(cls, file: _fss.PlantFile, text: Optional[str] = None) -> Plant:
        plant = cls.__new__(cls)
        plant.path, plant._file, plant._text = None, file, text
        return plant

    # reading and editing

    def to_dict(self) -> dict[str, Any]:
        """Everything, as a dictionary."""
        return dict(json.loads(self._file.to_json()))

    def to_toml(self) -> str:
        """The text of a plant file: as it was read, unless it was changed."""
        return self._file.to_toml() if self._text is None else self._text

    def write(self, path: Union[str, PathLike[str]]) -> Path:
        """Writes a plant file."""
        path = Path(path)
        path.write_text(self.to_toml())
        return path

    def __getitem__(self, key: str) -> Any:
        place, last = _way(self.to_dict(), key)
        return place[last]

    def __setitem__(self, key: str, value: Any) -> None:
        whole = self.to_dict()
        place, last = _way(whole, key, adds=True)
        place[last] = value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
        self._file, self._text, self.path = _fss.PlantFile.from_json(json.dumps(whole)), None, None

    def __delitem__(self, key: str) -> None:
        whole = self.to_dict()
        place, last = _way(whole, key)
        del place[last]
        self._file, self._text, self.path = _fss.PlantFile.from_json(json.dumps(whole)), None, None

    def copy(self) -> Plant:
        """Another plant with the same values."""
        return self._of(self._file, self._text)

    @property
    def effects(self) -> list[Effect]:
        """What it has beyond the nominal model. Assign a list to replace them."""
        return [Effect(**table) for table in self.to_dict().get("effect", [])]

    @effects.setter
    def effects(self, effects: list[Effect]) -> None:
        self["effect"] = [effect._table() for effect in effects]

    def with_effects(self, *effects: Effect) -> Plant:
        """The same with effects added."""
        plant = self.copy()
        plant.effects = [*self.effects, *effects]
        return plant

    def nominal(self) -> Plant:
        """The same without its effects."""
        return self._of(self._file.nominal())

    @property
    def link_count(self) -> int:
        """Links, and joints."""
        return self._file.links

    @property
    def thruster_count(self) -> int:
        """Thrusters."""
        return self._file.thrusters

    @property
    def mass_kg(self) -> float:
        """Of base and arm together, with its effects."""
        return self._file.mass_kg

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Plant) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> Any:
        return Plant.parse, (self.to_toml(),)

    def __repr__(self) -> str:
        words = [f"{self.mass_kg:.2f} kg", f"{self.link_count} links", f"{self.thruster_count} thrusters"]
        return f"<fss.Plant {', '.join([*words, *(effect.id for effect in self.effects)])}>"

    # motion

    def simulate(
        self,
        duration_s: float,
        *,
        step_s: float = 0.01,
        valves: Optional[npt.ArrayLike] = None,
        joints: Optional[npt.ArrayLike] = None,
        mode: str = "position",
        q: Optional[npt.ArrayLike] = None,
        v: Optional[npt.ArrayLike] = None,
        seed: int = 0,
    ) -> Samples:
        """The true motion of the laboratory, a row each ``step_s`` from 0 to ``duration_s`` (s), steps + 1 rows.

        ``valves``: levels of the thrusters, 0 to 1, shape (thrusters,) or (steps, thrusters); ``joints``: what the joints'
        drivers are told, shape (links,) or (steps, links), in rad, rad/s or A as ``mode`` says (``position``, ``velocity``,
        ``current``); without it they are off. ``q`` and ``v``: where it begins, [x, y, theta, joints], shape (3 + links,). ``seed``
        is of the room's disturbance. Forces of valves and drivers are those of the plant with its effects.

        Fields: ``t_s``, ``base_pose``, ``base_velocity``, ``ee_pose``, ``ee_velocity`` (x, y, theta in the table frame),
        ``q_rad``, ``qd_rad_s``, ``current_a``, ``torque_nm``. Raises ValueError for a shape that does not fit.
        """
        if not (step_s > 0 and duration_s >= 0):
            raise ValueError("step_s must be positive, duration_s not negative")
        steps, links = round(duration_s / step_s), self.link_count
        start = np.stack([_vector("q", q, 3 + links), _vector("v", v, 3 + links)])
        levels = _held("valves", valves, steps, self.thruster_count)
        commands = _held("joints", joints, steps, links)
        mode = mode if joints is not None else "free"
        values = self._file.simulate(step_s, steps, start, levels, commands, mode, seed)
        names = ["base_pose", "base_velocity", "ee_pose", "ee_velocity"]
        of_joints = ["q_rad", "qd_rad_s", "current_a", "torque_nm"]
        dtype = [("t_s", "<f8"), *((n, "<f8", (3,)) for n in names), *((n, "<f8", (links,)) for n in of_joints)]
        return values.view(dtype).view(Samples)

    @property
    def dynamics(self) -> Dynamics:
        """The equations of motion of base and arm, with the effects that the plant has from the start."""
        return Dynamics(self._file)


class Dynamics:
    """``H(q) a + h(q, v) = u`` of base and arm, for one state or many.

    Coordinates are ``q = [x, y, theta, q_1 .. q_n]`` (m, rad), ``v`` their rates, ``u = [Fx, Fy, Mz about the base origin, t_1 ..
    t_n]`` (N, N m), table axes; dof is n + 3. Arguments have the shape (dof,) or (..., dof), and what is computed has their
    leading shape; it is spread over all cores. Raises ValueError for a shape that does not fit.
    """

    def __init__(self, file: _fss.PlantFile) -> None:
        self._file = file
        #: Degrees of freedom: 3 and one a joint.
        self.dof = 3 + file.links

    def inertia(self, q: npt.ArrayLike) -> Array:
        """Generalized inertia ``H``, (..., dof, dof)."""
        return self._at("inertia", (self.dof, self.dof), q)

    def bias(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Array:
        """Centrifugal, Coriolis and gravity forces ``h``, (..., dof)."""
        return self._at("bias", (self.dof,), q, v)

    def jacobian(self, q: npt.ArrayLike) -> Array:
        """Jacobian of the end-effector, (..., 3, dof): its twist [vx, vy, omega] is ``J v``."""
        return self._at("jacobian", (3, self.dof), q)

    def generalized_jacobian(self, q: npt.ArrayLike) -> Array:
        """Twist of the end-effector per joint rate of a free base without momentum, (..., 3, n) (Umetani and Yoshida, 1989)."""
        return self._at("generalized_jacobian", (3, self.dof - 3), q)

    def forward(self, q: npt.ArrayLike, v: npt.ArrayLike, u: npt.ArrayLike) -> Array:
        """Accelerations under forces ``u``, (..., dof)."""
        return self._at("forward", (self.dof,), q, v, u)

    def inverse(self, q: npt.ArrayLike, v: npt.ArrayLike, a: npt.ArrayLike) -> Array:
        """Forces that give accelerations ``a``, (..., dof)."""
        return self._at("inverse", (self.dof,), q, v, a)

    def end_effector(self, q: npt.ArrayLike) -> Array:
        """Pose of the end-effector [x, y, angle], (..., 3)."""
        return self._at("end_effector", (3,), q)

    def momentum(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Array:
        """[Px, Py, L about the base origin, L about the centre of mass], (..., 4) (kg m/s, kg m^2/s)."""
        return self._at("momentum", (4,), q, v)

    def _at(self, quantity: str, shape: tuple[int, ...], *arguments: npt.ArrayLike) -> Array:
        given = [np.asarray(argument, dtype=np.float64) for argument in arguments]
        for array in given:
            if array.ndim == 0 or array.shape[-1] != self.dof:
                raise ValueError(f"{quantity} takes arrays whose last axis is {self.dof} long, not of shape {array.shape}")
        leading = np.broadcast_shapes(*(array.shape[:-1] for array in given))
        rows = [np.ascontiguousarray(np.broadcast_to(a, (*leading, self.dof))).reshape(-1, self.dof) for a in given]
        rows += [np.empty((0, self.dof))] * (3 - len(rows))
        return self._file.dynamics(quantity, rows[0], rows[1], rows[2]).reshape(*leading, *shape)


def _vector(name: str, given: Optional[npt.ArrayLike], length: int) -> Array:
    vector = np.zeros(length) if given is None else np.asarray(given, dtype=np.float64)
    if vector.shape != (length,):
        raise ValueError(f"{name} has the shape ({length},), not {vector.shape}")
    return vector


def _held(name: str, given: Optional[npt.ArrayLike], steps: int, count: int) -> Array:
    """One row a step."""
    if given is None:
        return np.zeros((0, count))
    rows = np.asarray(given, dtype=np.float64)
    if rows.shape not in ((count,), (steps, count)):
        raise ValueError(f"{name} has the shape ({count},) or ({steps}, {count}), not {rows.shape}")
    return np.ascontiguousarray(np.broadcast_to(rows, (steps, count)))


def _way(whole: dict[str, Any], key: str, adds: bool = False) -> tuple[Any, Any]:
    """The table or list that holds what `key` names, and its key there."""
    place: Any = whole
    *before, last = key.split(".")
    for part in before:
        if adds and isinstance(place, dict):
            place.setdefault(part, {})
        place = place[_element(place, part, key)]
    return place, last if adds and isinstance(place, dict) else _element(place, last, key)


def _element(place: Any, part: str, key: str) -> Any:
    if isinstance(place, list) and part.isdigit() and 1 <= int(part) <= len(place):
        return int(part) - 1
    if isinstance(place, dict) and part in place:
        return part
    has = f"{len(place)} elements" if isinstance(place, list) else ", ".join(place) if isinstance(place, dict) else "no parts"
    raise KeyError(f"the plant has no '{key}': at '{part}' there are {has}")


def plant_of(plant: Union[None, Plant, str, PathLike[str]]) -> Plant:
    """The plant itself, the one in a file, or the default."""
    return plant if isinstance(plant, Plant) else Plant(plant)
