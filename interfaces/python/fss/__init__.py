"""fss: logs, plants, simulation, calibration and diagnosis of a floating spacecraft simulator.

    import fss

    log = fss.fly("zero-reaction", seed=1)
    nav = log["/nav/state"]                      # structured NumPy array, fields as in the message
    answer = fss.diagnose([log], plant=fss.Plant())

Quantities are in SI units, angles in radians; names of fields and parameters end with their unit. What fss refuses is raised as
:class:`fss.Error`, with ``help``, ``file``, ``line`` and ``column`` where they are known; a missing file as FileNotFoundError.

Services in Python need :mod:`fss.service` alone, which loads nothing else of this.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._fss import Error, __version__
    from .calibration import Calibration, calibrate_dynamic, calibrate_kinematic
    from .campaigns import Campaign, Row, Task, campaign
    from .diagnosis import Alternative, Cause, Diagnosis, Misfit, Parameter, diagnose
    from .experiment import Experiment
    from .flight import fly
    from .log import Event, Log, Phase, Topic
    from .planning import NextExperiment, Workspace, next_experiment, workspace
    from .plant import Dynamics, Effect, Plant, effects
    from .samples import Samples
    from .subscription import Subscription, live

#: Where each name comes from, which is loaded when it is asked for.
_HOMES = {
    "_fss": ("Error", "__version__"),
    "calibration": ("Calibration", "calibrate_dynamic", "calibrate_kinematic"),
    "campaigns": ("Campaign", "Row", "Task", "campaign"),
    "diagnosis": ("Alternative", "Cause", "Diagnosis", "Misfit", "Parameter", "diagnose"),
    "experiment": ("Experiment",),
    "flight": ("fly",),
    "log": ("Event", "Log", "Phase", "Topic"),
    "planning": ("NextExperiment", "Workspace", "next_experiment", "workspace"),
    "plant": ("Dynamics", "Effect", "Plant", "effects"),
    "samples": ("Samples",),
    "subscription": ("Subscription", "live"),
}

__all__ = [
    "Alternative", "Calibration", "Campaign", "Cause", "Diagnosis", "Dynamics", "Effect", "Error", "Event", "Experiment", "Log",
    "Misfit", "NextExperiment", "Parameter", "Phase", "Plant", "Row", "Samples", "Subscription", "Task", "Topic", "Workspace",
    "__version__", "calibrate_dynamic", "calibrate_kinematic", "campaign", "diagnose", "effects", "fly", "live",
    "next_experiment", "workspace",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    import importlib

    for module, names in _HOMES.items():
        if name in names:
            found = globals()[name] = getattr(importlib.import_module(f".{module}", __name__), name)
            return found
    raise AttributeError(f"module 'fss' has no attribute '{name}'")


def __dir__() -> list[str]:
    return [*__all__, "service"]
