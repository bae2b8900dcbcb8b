"""A flight and what its log tells."""

import numpy as np

import fss

log = fss.fly("zero-reaction", seed=1, out="out/python/zero-reaction")
print(log.summary["outcome"], [phase.name for phase in log.phases])

line = log.phase("line").read(["/nav/state", "/links/state"])
turned_deg = np.degrees(np.ptp(line["/nav/state"]["theta_rad"]))
print(f"the base turned by {turned_deg:.3f} deg while the arm moved")

common = log.resample(["/nav/state", "/truth/state"], rate_hz=50.0)
error_m = np.hypot(
    common["/nav/state"]["x_m"] - common["/truth/state"]["x_m"], common["/nav/state"]["y_m"] - common["/truth/state"]["y_m"]
)
print(f"navigation error {1e3 * np.sqrt(np.mean(error_m**2)):.3f} mm RMS")
