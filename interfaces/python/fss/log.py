"""Logs of flights."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _fss
from .samples import Samples, dtype_of, samples_of

_ALL = 2**64 - 1
_SEVERITIES = ("debug", "info", "warning", "error", "critical")
_STATES = {0: "waiting", 2: "done", 3: "aborted"}


@dataclass(frozen=True)
class Topic:
    """What a log holds of a topic."""

    name: str
    #: Name of the message.
    schema: str
    #: Its ROS 2 definition.
    definition: str
    #: How many samples the whole log has.
    count: int
    #: Names and meanings of its fields; empty where its schema is none of plain samples.
    fields: Mapping[str, str]
    #: NumPy's type of a sample; None where its schema is none of plain samples.
    dtype: Optional[np.dtype[Any]]


@dataclass(frozen=True)
class Event:
    """Something that happened."""

    t_s: float
    severity: str
    service: str
    text: str


@dataclass(frozen=True)
class Phase:
    """A phase of a mission, from ``start_s`` up to ``stop_s``, since the start of the log."""

    name: str
    start_s: float
    stop_s: float


class Log(Mapping[str, Samples]):
    """A log of a flight, an MCAP file: ``log["/nav/state"]`` are a topic's samples.

    ``path`` is a file, or a flight's folder with ``run.mcap``. Each question reads the file anew, a chunk at a time: a log may
    be larger than memory (see :meth:`chunks`). A log that was cut off or damaged gives what is whole of it; ``is_complete`` and
    ``damage`` tell.

    Raises FileNotFoundError where there is no such file, fss.Error where it is no log.
    """

    def __init__(self, path: Union[str, PathLike[str]]) -> None:
        path = Path(path)
        self.path = path / "run.mcap" if path.is_dir() else path
        self._file: Optional[_fss.LogFile] = _fss.LogFile(self.path)
        self._from_ns, self._to_ns = 0, _ALL
        self._contents: Optional[dict[str, Any]] = None

    # Two logs are one if they are one object: their samples are not read to compare them.
    __eq__ = object.__eq__
    __hash__ = object.__hash__

    @property
    def _open(self) -> _fss.LogFile:
        if self._file is None:
            raise ValueError(f"{self.path} is closed")
        return self._file

    @property
    def _all(self) -> dict[str, Any]:
        file = self._open
        if self._contents is None:
            self._contents = file.contents()
        return self._contents

    def close(self) -> None:
        """Ends the use of this log: every later question raises ValueError. Arrays that were taken stay."""
        self._file = self._contents = None

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # what it holds

    @property
    def topics(self) -> dict[str, Topic]:
        """The topics of the whole log by name."""
        return {name: self._topic(name) for name in self}

    def _topic(self, name: str) -> Topic:
        if name not in self._all["topics"]:
            raise KeyError(f"{self.path} has no topic '{name}'; it has {', '.join(self)}")
        schema, definition, count, fields = self._all["topics"][name]
        meanings = {field[0]: field[3] for field in fields or []}
        return Topic(name, schema, definition, count, meanings, dtype_of(fields) if fields else None)

    @property
    def start_ns(self) -> int:
        """Log time of the first message of the whole log (ns, on the clock of its stamps): where ``t_s`` is 0."""
        return int(self._all["first_ns"])

    @property
    def duration_s(self) -> float:
        """From the first to the last message, or how long the slice is."""
        return float(min(self._to_ns, self._all["last_ns"]) - max(self._from_ns, self.start_ns)) * 1e-9

    @property
    def attachments(self) -> dict[str, bytes]:
        """Attached files: the plant, mission and launch file that flew, and others."""
        return dict(self._all["attachments"])

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Facts about build, host and clocks."""
        return dict(self._all["metadata"])

    @property
    def is_complete(self) -> bool:
        """Whether the log was ended properly; if not, its recorder died."""
        return bool(self._all["is_complete"])

    @property
    def damage(self) -> dict[str, int]:
        """What cannot be read of a log that was not ended properly: places, bytes there, bytes cut off at the end."""
        return dict(zip(("places", "bytes", "cut_off_bytes"), self._all["damage"]))

    @property
    def summary(self) -> dict[str, Any]:
        """The figures of merit in ``summary.json`` beside the log. Raises FileNotFoundError where there is none."""
        return dict(json.loads((self.path.parent / "summary.json").read_text()))

    # samples

    def __getitem__(self, topic: str) -> Samples:
        """All samples of a topic. Raises KeyError where the log has no such topic."""
        return self.read([topic])[topic]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all["topics"])

    def __len__(self) -> int:
        return len(self._all["topics"])

    def read(self, topics: Sequence[str], fields: Sequence[str] = ()) -> dict[str, Samples]:
        """The samples of several topics in one pass over the file. With ``fields`` only these of each sample, and its
        ``stamp_ns``: of a large log a small part of the memory. Raises KeyError where a topic has no such field."""
        if isinstance(topics, str):
            raise TypeError("read takes a list of topics; log[topic] is one of them")
        known = {topic: self._topic(topic) for topic in topics}
        wanted = self._wanted(known.values(), fields)
        selected = self._open.select(list(topics), wanted, self._from_ns, self._to_ns)
        return {topic: self._samples(known[topic], wanted, of) for topic, of in zip(topics, selected)}

    def chunks(self, topic: str, rows: int = 65_536, fields: Sequence[str] = ()) -> Iterator[Samples]:
        """A topic's samples in arrays of at most ``rows``, one after the other: of a log that memory does not hold.
        ``fields`` as in :meth:`read`."""
        wanted = self._wanted([self._topic(topic)], fields)
        if rows < 1:
            raise ValueError("rows must be 1 or more")
        blocks = self._open.blocks(topic, wanted, rows, self._from_ns, self._to_ns)
        try:
            for described, size, data in blocks:
                yield samples_of(described, size, data, topic, self.start_ns)
        finally:
            blocks.close()

    @staticmethod
    def _wanted(topics: Iterable[Topic], fields: Sequence[str]) -> list[str]:
        if isinstance(fields, str):
            raise TypeError("fields is a list of names")
        for topic in topics:
            for field in fields:
                if field not in topic.fields:
                    raise KeyError(f"{topic.name} has no field '{field}'; it has {', '.join(topic.fields)}")
        return ["stamp_ns", *fields] if fields else []

    def _samples(self, topic: Topic, wanted: list[str], selected: Optional[tuple[list[tuple[str, str, int, str]], int, npt.NDArray[np.uint8]]]) -> Samples:
        if selected is None:
            if topic.dtype is None:
                raise _fss.Error(f"{self.path}: topic {topic.name} holds no plain samples")
            described = self._all["topics"][topic.name][3]
            if wanted:
                described = [field for field in described if field[0] in wanted]
            return samples_of(described, None, np.empty(0, np.uint8), topic.name, self.start_ns)
        described, size, data = selected
        return samples_of(described, size, data, topic.name, self.start_ns)

    # slices

    def between(self, start_s: float = 0.0, stop_s: float = float("inf")) -> Log:
        """The same log from ``start_s`` up to and with ``stop_s``, since its start, by the time of publication. Chunks
        outside are not read."""
        if not start_s <= stop_s:
            raise ValueError(f"the slice from {start_s} s to {stop_s} s is empty")
        part = Log.__new__(Log)
        part.path, part._file, part._contents = self.path, self._open, self._all
        start_ns = self.start_ns + round(max(start_s, 0.0) * 1e9)
        part._from_ns = max(self._from_ns, start_ns)
        part._to_ns = self._to_ns if stop_s == float("inf") else min(self._to_ns, self.start_ns + round(stop_s * 1e9))
        return part

    @property
    def phases(self) -> list[Phase]:
        """The phases that the mission went through, by the names in its file, with ``waiting`` before and ``done`` or
        ``aborted`` behind."""
        states = self["/mission/state"]
        if len(states) == 0:
            return []
        mission = json.loads(_fss.toml_to_json(self.attachments.get("mission.toml", b"").decode()))
        names = [phase.get("name", "") for phase in mission.get("phase", [])]

        def name_of(state: int, phase: int) -> str:
            named = phase < len(names) and names[phase]
            return _STATES.get(state) or (names[phase] if named else f"phase {phase + 1}")

        key = states["state"].astype(np.int64) * 2**32 + np.where(states["state"] == 1, states["phase"], 0)
        starts = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1])))
        times = [*states.t_s[starts], states.t_s[-1]]
        return [
            Phase(name_of(int(states["state"][at]), int(states["phase"][at])), float(times[i]), float(times[i + 1]))
            for i, at in enumerate(starts)
        ]

    def phase(self, name: str) -> Log:
        """The same log during one phase of its mission. Raises KeyError where it has none of this name."""
        phases = self.phases
        for phase in phases:
            if phase.name == name:
                return self.between(phase.start_s, phase.stop_s)
        raise KeyError(f"there is no phase '{name}'; there are {', '.join(phase.name for phase in phases)}")

    @property
    def events(self) -> list[Event]:
        """What happened, in order."""
        if "/events" not in self:
            return []
        found = self["/events"]
        texts = zip(found.t_s, found["severity"], found["service"], found["text"])
        return [
            Event(float(t_s), _SEVERITIES[min(int(severity), 4)], service.decode(), text.decode("utf-8", "replace"))
            for t_s, severity, service, text in texts
        ]

    def resample(self, topics: Sequence[str], rate_hz: float) -> dict[str, Samples]:
        """Topics at common times, ``rate_hz`` a second over the time that all of them have: see Samples.resample."""
        if not rate_hz > 0:
            raise ValueError("rate_hz must be positive")
        found = self.read(topics)
        empty = [topic for topic, samples in found.items() if len(samples) == 0]
        if empty:
            raise ValueError(f"{', '.join(empty)} has no samples here")
        start = max(float(samples.t_s[0]) for samples in found.values())
        stop = min(float(samples.t_s[-1]) for samples in found.values())
        times: npt.NDArray[np.float64] = start + np.arange(int((stop - start) * rate_hz + 1e-6) + 1) / rate_hz
        return {topic: samples.resample(times) for topic, samples in found.items()}

    def __repr__(self) -> str:
        if self._file is None:
            return f"<fss.Log {self.path}, closed>"
        return f"<fss.Log {self.path}: {self.duration_s:.1f} s, {len(self)} topics>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{topic.name}</td><td>{topic.schema}</td><td>{topic.count}</td></tr>" for topic in self.topics.values()
        )
        return (
            f"<p>{self.path}: {self.duration_s:.1f} s</p><table><tr><th>topic</th><th>message</th><th>samples</th></tr>{rows}</table>"
        )
