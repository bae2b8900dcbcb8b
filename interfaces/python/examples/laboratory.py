"""A laboratory's own data become a case: arrays to an experiment, a plant file, a diagnosis."""

import numpy as np

import fss

rng = np.random.default_rng(0)
t_s = np.arange(0.0, 40.0, 0.01)
plant = fss.Plant()
tilted = plant.with_effects(fss.Effect("table_tilt", accel_x_m_s2=0.002))
truth = tilted.simulate(39.99, step_s=0.01, v=[0.02, 0.01, 0.02, 0, 0, 0, 0])
pose = truth["base_pose"] + rng.normal(scale=[2e-4, 2e-4, 5e-4], size=(len(t_s), 3))
gyro = truth["base_velocity"][:, 2] + rng.normal(scale=3e-4, size=len(t_s))

run = fss.Experiment.write(
    "out/python/coast",
    name="coast",
    base_pose=np.column_stack([t_s, pose]),
    gyro={"t_s": t_s, "rate_rad_s": gyro},
)
answer = fss.diagnose(run, plant=plant)
for cause in answer.causes:
    print(cause, {name: (value.value, value.std) for name, value in cause.parameters.items()})
