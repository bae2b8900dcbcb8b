import numpy as np
import pytest

import fss


def test_values_are_read_changed_checked_and_written(tmp_path):
    plant = fss.Plant()
    plant["base.mass_kg"] = 11.5
    plant["link.2.length_m"] = 0.4
    again = fss.Plant(plant.write(tmp_path / "plant.toml"))
    assert again == plant and again["base.mass_kg"] == 11.5 and again != fss.Plant()
    with pytest.raises(fss.Error, match="mass_kg is -1") as refused:
        plant["base.mass_kg"] = -1
    assert "unit" in refused.value.help
    assert plant["base.mass_kg"] == 11.5
    with pytest.raises(KeyError, match="link.9"):
        plant["link.9.length_m"]


def test_a_wrong_file_is_refused_with_its_line_and_column(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(fss.Plant().to_toml().replace("mass_kg = 10", "mass_kg = -10"))
    with pytest.raises(fss.Error) as refused:
        fss.Plant(path)
    line = path.read_text().splitlines()[refused.value.line - 1]
    assert refused.value.file == str(path) and "mass_kg" in line and refused.value.column > 1
    with pytest.raises(FileNotFoundError):
        fss.Plant(tmp_path / "nothing.toml")


def test_an_effect_of_the_catalogue_acts_and_another_is_refused():
    plant = fss.Plant()
    assert fss.effects()["thruster_gain"]["index"] == "thruster"
    tilted = plant.with_effects(fss.Effect("table_tilt", accel_x_m_s2=0.01))
    still = plant.nominal().simulate(2.0)["base_pose"][-1]
    slid = tilted.simulate(2.0)["base_pose"][-1]
    assert slid[0] - still[0] == pytest.approx(0.5 * 0.01 * 2.0**2, rel=0.02)
    assert tilted.nominal() == plant
    with pytest.raises(fss.Error, match="there is no effect"):
        plant.with_effects(fss.Effect("table_turn"))


def test_a_floating_vehicle_keeps_its_momentum_while_its_arm_moves():
    plant = fss.Plant()
    if "disturbance" in plant.to_dict():
        del plant["disturbance"]
    motion = plant.simulate(1.0, joints=[0.4, -0.2, 0.1, 0.3], v=[0.01, 0.02, 0, 0, 0, 0, 0])
    q = np.column_stack([motion["base_pose"], motion["q_rad"]])
    v = np.column_stack([motion["base_velocity"], motion["qd_rad_s"]])
    momentum = plant.dynamics.momentum(q, v)
    assert np.ptp(motion["base_pose"][:, 2]) > 0.05
    assert np.abs(momentum[:, [0, 1, 3]] - momentum[0, [0, 1, 3]]).max() < 1e-6


def test_dynamics_of_many_states_obey_their_equation():
    dynamics = fss.Plant().dynamics
    rng = np.random.default_rng(1)
    q, v, u = rng.normal(size=(3, 4, 50, dynamics.dof))
    inertia, bias = dynamics.inertia(q), dynamics.bias(q, v)
    assert inertia.shape == (4, 50, 7, 7) and bias.shape == (4, 50, 7)
    a = dynamics.forward(q, v, u)
    assert np.abs(np.einsum("...ij,...j->...i", inertia, a) + bias - u).max() < 1e-11
    assert np.abs(dynamics.inverse(q, v, a) - u).max() < 1e-11
    # The tip of a free vehicle without momentum moves as the generalized Jacobian says.
    rates = v[..., 3:]
    base = -np.linalg.solve(inertia[..., :3, :3], np.einsum("...ij,...j->...i", inertia[..., :3, 3:], rates)[..., None])[..., 0]
    whole = np.concatenate([base, rates], axis=-1)
    tip = np.einsum("...ij,...j->...i", dynamics.jacobian(q), whole)
    assert np.abs(np.einsum("...ij,...j->...i", dynamics.generalized_jacobian(q), rates) - tip).max() < 1e-12
    assert dynamics.inertia(q[0, 0]).tobytes() == inertia[0, 0].tobytes()
    with pytest.raises(ValueError, match="last axis is 7"):
        dynamics.inertia(np.zeros(6))
    with pytest.raises(ValueError, match="shape"):
        fss.Plant().simulate(1.0, valves=[1, 0])
