"""What a simulation gets wrong about measured runs, and why."""

from __future__ import annotations

import html
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Optional, Union

from .commands import AnyPath, Folder, Run, run, runs_of
from .plant import Effect, Plant
from .progress import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAN = float("nan")


@dataclass(frozen=True)
class Parameter:
    """A value and its standard deviation; None where it was not fitted."""

    value: float
    std: Optional[float]


@dataclass(frozen=True)
class Alternative:
    """Another effect that could stand in a cause's place."""

    effect: str
    index: Optional[int]
    channel: Optional[str]
    probability: float
    #: Whether the data cannot tell it from the cause at all.
    equivalent: bool
    parameters: Mapping[str, Parameter]

    def __str__(self) -> str:
        place = self.index if self.index is not None else self.channel
        return self.effect if place is None else f"{self.effect} {place}"

    def as_effect(self) -> Effect:
        """The effect with its values, for a plant."""
        values: dict[str, Any] = {name: parameter.value for name, parameter in self.parameters.items()}
        return Effect(self.effect, index=self.index, channel=self.channel, **values)


@dataclass(frozen=True)
class Cause(Alternative):
    """What is asserted to act."""

    alternatives: tuple[Alternative, ...] = ()


@dataclass(frozen=True)
class Misfit:
    """RMS error of a channel in one run with the plant file, what noise alone would give, and their ratio."""

    channel: str
    run: str
    rms: float
    noise: float
    ratio: float


class Diagnosis:
    """The answer of :func:`diagnose`.

    ``verdict`` is ``consistent``, ``explained``, ``partly_explained`` or ``unexplained``; ``causes`` are what is asserted, strongest
    first, ``suspects`` what is probable; ``misfit`` is each channel of each run with the plant file. ``extended`` is the plant with
    the causes. ``json`` is the program's own answer, ``data`` the same as a dictionary, ``text`` what the program prints, ``page``
    its report as HTML.
    """

    def __init__(self, folder: Folder, text: str) -> None:
        #: Where ``diagnosis.json``, ``diagnosis.html`` and ``extended.toml`` lie.
        self.folder: Path = folder.path
        self._keeps = folder
        self.text = text
        self.json = (self.folder / "diagnosis.json").read_text()
        self.page = (self.folder / "diagnosis.html").read_text()
        self.data: dict[str, Any] = json.loads(self.json)
        self.verdict: str = self.data["verdict"]
        self.causes = [_cause(cause) for cause in self.data["causes"]]
        self.suspects = [_cause(cause) for cause in self.data.get("suspects", [])]
        self.misfit = [Misfit(*(_number(m[k]) for k in ("channel", "run", "rms", "noise", "ratio"))) for m in self.data["misfit"]]
        self.extended = Plant(self.folder / self.data["extended_model"])

    @property
    def gain(self) -> dict[str, Optional[float]]:
        """RMS over noise of the validation runs, of the fitted ones where there are none: ``ratio_before``, ``ratio_after``,
        ``noise_floor``."""
        return dict(self.data["gain"])

    @property
    def posterior(self) -> dict[str, Any]:
        """Probability that no cause acts (``none``), and of every effect that was considered (``inclusion``)."""
        return dict(self.data.get("posterior", {}))

    @property
    def discrepancy(self) -> list[dict[str, Any]]:
        """Strengths of what disturbs each run without a known effect, as inferred and as expected."""
        return list(self.data.get("discrepancy", []))

    def __repr__(self) -> str:
        causes = ", ".join(f"{cause} ({cause.probability:.2f})" for cause in self.causes)
        return f"<fss.Diagnosis {self.verdict}{': ' if causes else ''}{causes}>"

    def _repr_html_(self) -> str:
        # A frame of its own: the page's style is not the notebook's.
        return f'<iframe srcdoc="{html.escape(self.page)}" style="width:100%;height:640px;border:0"></iframe>'

    def figure(self) -> Figure:
        """RMS error over noise of each channel and run, and the causes' probabilities. Needs matplotlib."""
        from matplotlib.figure import Figure

        channels = list(dict.fromkeys(misfit.channel for misfit in self.misfit))
        figure = Figure(figsize=(9, 1.4 + 0.26 * max(len(channels), 6)), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=[2, 1])
        for run in dict.fromkeys(misfit.run for misfit in self.misfit):
            of_run = [misfit for misfit in self.misfit if misfit.run == run]
            left.plot([m.ratio for m in of_run], [m.channel for m in of_run], "o", alpha=0.7, label=run)
        left.axvline(1.0, color="black", linewidth=1)
        left.set_xscale("log")
        left.invert_yaxis()
        left.set_xlabel("RMS error / noise with the plant file (1 is noise alone)")
        left.legend(fontsize="small")
        shown = [*self.causes, *(a for cause in self.causes for a in cause.alternatives)] or list(self.suspects)
        right.barh([str(one) for one in shown], [one.probability for one in shown], height=0.6, color="tab:orange")
        right.set_xlim(0, 1)
        right.set_ylim(max(len(shown), 4) - 0.5, -0.5)
        right.set_xlabel("probability")
        right.set_title(self.verdict.replace("_", " "))
        return figure


def _number(value: Any) -> Any:
    return _NAN if value is None else value


def _alternative(said: Mapping[str, Any]) -> dict[str, Any]:
    parameters = {name: Parameter(p["value"], p.get("std")) for name, p in said.get("parameters", {}).items()}
    return {
        "effect": said["effect"],
        "index": said.get("index"),
        "channel": said.get("channel"),
        "probability": said["probability"],
        "equivalent": said.get("equivalent", False),
        "parameters": parameters,
    }


def _cause(said: Mapping[str, Any]) -> Cause:
    alternatives = tuple(Alternative(**_alternative(a)) for a in said.get("alternatives", []))
    return Cause(**_alternative(said), alternatives=alternatives)


def diagnose(
    runs: Union[Run, Iterable[Run]],
    *,
    plant: Union[None, Plant, AnyPath] = None,
    validate: Union[Run, Iterable[Run]] = (),
    out: Optional[AnyPath] = None,
    progress: Progress = None,
) -> Diagnosis:
    """Finds what the simulation of a plant gets wrong about measured runs: where, why, and what knowing it gains.

    Runs are logs, experiments or their paths; those of ``validate`` measure the gain and choose nothing. ``plant`` is what the
    laboratory believes; the default plant where absent. ``out`` keeps the report; without it the report goes with the answer.
    The answer is that of ``fss diagnose``, to the last bit. Ctrl-C stops waiting at once, the computation at its next step.

    Raises fss.Error where a run or the plant makes no sense, with file and line.
    """
    folder = Folder(out)
    validation = runs_of(validate)
    arguments = [*runs_of(runs), "--plant", folder.plant(plant), "--out", str(folder.path)]
    text = run("diagnose", [*arguments, *(["--validate", *validation] if validation else [])], progress)
    return Diagnosis(folder, text)
