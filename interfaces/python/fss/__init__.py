"""fss: logs, plants, simulation, calibration and diagnosis of a floating spacecraft simulator.

    import fss

    log = fss.fly("zero-reaction", seed=1)
    nav = log["/nav/state"]                      # structured NumPy array, fields as in the message
    answer = fss.diagnose([log], plant=fss.Plant())

Quantities are in SI units, angles in radians; names of fields and parameters end with their unit. What fss refuses is raised as
:class:`fss.Error`, with ``help``, ``file``, ``line`` and ``column`` where they are known; a missing file as FileNotFoundError.
"""

from ._fss import Error, __version__
from .calibration import Calibration, calibrate_dynamic, calibrate_kinematic
from .campaigns import Campaign, Row, Task, campaign
from .diagnosis import Alternative, Cause, Diagnosis, Misfit, Parameter, diagnose
from .experiment import Experiment
from .flight import fly
from .live import Subscription, live
from .log import Event, Log, Phase, Samples, Topic
from .plant import Dynamics, Effect, Plant, effects
from .planning import NextExperiment, Workspace, next_experiment, workspace

__all__ = [
    "Alternative", "Calibration", "Campaign", "Cause", "Diagnosis", "Dynamics", "Effect", "Error", "Event", "Experiment", "Log",
    "Misfit", "NextExperiment", "Parameter", "Phase", "Plant", "Row", "Samples", "Subscription", "Task", "Topic", "Workspace", "__version__",
    "calibrate_dynamic", "calibrate_kinematic", "campaign", "diagnose", "effects", "fly", "live", "next_experiment", "workspace",
]  # fmt: skip
