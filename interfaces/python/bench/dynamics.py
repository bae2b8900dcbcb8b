"""Generalized inertia and bias of 100,000 states: fss at once, against a loop over Pinocchio (`pip install pin`)."""

import time

import numpy as np

import fss


def pinocchio_model(plant):
    """The same mechanism: two sliding joints and one turning for the base, then the arm."""
    import pinocchio as pin

    model = pin.Model()
    base, joint = plant["base"], 0
    # Zero mass for what only slides: the base's mass goes with its turn.
    for kind in (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelRZ()):
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), f"base{joint}")
    about_z = np.diag([1e-9, 1e-9, 1.0])
    body = pin.Inertia(base["mass_kg"], np.zeros(3), about_z * base["inertia_kg_m2"])
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    place = pin.SE3(pin.utils.rotate("z", base.get("joint1_angle_rad", 0.0)), np.array([*base["joint1_xy_m"], 0.0]))
    for i, link in enumerate(plant["link"]):
        turned = place * pin.SE3(pin.utils.rotate("z", link.get("joint_offset_rad", 0.0)), np.zeros(3))
        joint = model.addJoint(joint, pin.JointModelRZ(), turned, f"joint{i + 1}")
        com = np.array([link["length_m"] - link["com_to_next_joint_m"], 0.0, 0.0])
        model.appendBodyToJoint(joint, pin.Inertia(link["mass_kg"], com, about_z * link["inertia_kg_m2"]), pin.SE3.Identity())
        place = pin.SE3(np.eye(3), np.array([link["length_m"], 0.0, 0.0]))
    model.gravity = pin.Motion.Zero()
    return pin, model, model.createData()


if __name__ == "__main__":
    plant = fss.Plant()
    dynamics, rng = plant.dynamics, np.random.default_rng(1)
    q, v = rng.normal(size=(2, 100_000, dynamics.dof))
    dynamics.inertia(q[:10])
    begin = time.perf_counter()
    inertia, bias = dynamics.inertia(q), dynamics.bias(q, v)
    own_s = time.perf_counter() - begin
    pin, model, data = pinocchio_model(plant)
    difference = 0.0
    begin = time.perf_counter()
    for k in range(len(q)):
        # Pinocchio fills the upper triangle.
        upper = pin.crba(model, data, q[k])
        h = pin.nonLinearEffects(model, data, q[k], v[k])
        difference = max(difference, np.abs(np.triu(upper) - np.triu(inertia[k])).max(), np.abs(h - bias[k]).max())
    other_s = time.perf_counter() - begin
    print(f"fss {own_s:.3f} s, Pinocchio in a loop {other_s:.2f} s: {other_s / own_s:.0f} times; largest difference {difference:.1e}")
