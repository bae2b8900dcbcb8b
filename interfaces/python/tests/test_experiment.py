import numpy as np
import pytest

import fss

T_S = np.arange(0.0, 2.0, 0.01)


def test_arrays_become_a_run_that_reads_back_the_same(tmp_path):
    pose = np.column_stack([T_S, np.sin(T_S) / 3, np.cos(T_S), np.pi * T_S])
    run = fss.Experiment.write(
        tmp_path, name="swing", duration_s=2.0, base_pose=pose, gyro={"t_s": T_S, "rate_rad_s": T_S / 7}, joint_mode="position"
    )
    assert np.array_equal(run["base_pose"]["x_m"], pose[:, 1]) and np.array_equal(run["gyro"]["rate_rad_s"], T_S / 7)
    assert (run.name, run.duration_s, run.joint_mode) == ("swing", 2.0, "position") and set(run) == {"base_pose", "gyro"}
    assert np.allclose(run["base_pose"]["theta_rad"], pose[:, 3])
    assert np.allclose(run["gyro"].resample([0.005])["rate_rad_s"], 0.005 / 7)


def test_what_the_format_does_not_have_is_refused(tmp_path):
    refused = [
        ({"pose": {"t_s": T_S}}, "no table 'pose'"),
        ({"gyro": {"t_s": T_S, "rate_deg_s": T_S}}, "rate_deg_s"),
        ({"gyro": {"rate_rad_s": T_S}}, "needs t_s"),
        ({"gyro": {"t_s": T_S, "rate_rad_s": T_S[1:]}}, "one length"),
        ({"base_pose": np.zeros((5, 3))}, "columns t_s, x_m, y_m, theta_rad"),
    ]
    for tables, words in refused:
        with pytest.raises(ValueError, match=words):
            fss.Experiment.write(tmp_path, name="x", **tables)
    with pytest.raises(FileNotFoundError):
        fss.Experiment(tmp_path / "nothing")


def test_a_malformed_file_is_refused_with_its_line(tmp_path):
    with pytest.raises(fss.Error, match="time does not increase") as refused:
        fss.Experiment.write(tmp_path, name="x", gyro={"t_s": [0.0, 0.0], "rate_rad_s": [1.0, 2.0]})
    assert refused.value.file.endswith("gyro.csv") and refused.value.line == 3
