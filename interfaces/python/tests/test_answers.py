import json
import subprocess
import sys

import numpy as np
import pytest
from conftest import hear, optional

import fss


def test_a_flight_has_the_bytes_of_the_program(program, tmp_path):
    log = fss.fly("slew", seed=3, out=tmp_path / "python")
    program("run", "slew", "--fast", "--quiet", "--seed", "3", "--out", tmp_path / "program")
    assert log.path.read_bytes() == (tmp_path / "program" / "run.mcap").read_bytes()
    with pytest.raises(fss.Error, match="breakfast"):
        fss.fly("breakfast", out=tmp_path / "none")
    plant = fss.Plant()
    del plant["link.4"]
    with pytest.raises(fss.Error, match="4 numbers for the joints") as refused:
        fss.fly("hold", plant=plant, out=tmp_path / "none")
    assert refused.value.help and refused.value.line > 0


@pytest.fixture(scope="module")
def answer(flight):
    told = []
    answer = fss.diagnose(flight, progress=lambda share, words: told.append(words))
    assert told
    return answer


def test_a_diagnosis_names_the_sealed_effect_and_is_the_programs_to_the_bit(answer, flight, program, tmp_path):
    fss.Plant().write(tmp_path / "plant.toml")
    program("diagnose", flight.path, "--plant", tmp_path / "plant.toml", "--out", tmp_path / "d")
    assert answer.json == (tmp_path / "d" / "diagnosis.json").read_text()
    cause = answer.causes[0]
    assert (cause.effect, cause.index) == ("thruster_gain", 3) and answer.verdict == "explained"
    scale = cause.parameters["scale"]
    assert abs(scale.value - 0.6) < 5 * scale.std
    assert answer.extended.effects[0].id == "thruster_gain"
    assert "<iframe" in answer._repr_html_() and "thruster" in answer.page and "thruster_gain" in answer.text
    next_one = fss.next_experiment(answer)
    assert next_one.mission is None or next_one.write(tmp_path / "next.toml").exists()


def test_a_diagnosis_has_a_figure(answer, tmp_path):
    optional("matplotlib")
    answer.figure().savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_refusals_name_what_is_wrong(tmp_path):
    with pytest.raises(fss.Error, match="neither a folder nor a log"):
        fss.diagnose(tmp_path / "nothing")
    with pytest.raises(TypeError, match="not int"):
        fss.diagnose([7])
    with pytest.raises(FileNotFoundError):
        fss.diagnose(tmp_path, plant=tmp_path / "nothing.toml")


def test_ctrl_c_stops_a_diagnosis(flight):
    # The signal comes with the first progress, so that the diagnosis cannot have ended. A job in the background ignores it.
    heed = "signal.signal(signal.SIGINT, signal.default_int_handler)"
    interrupt = "lambda *_: signal.raise_signal(signal.SIGINT)"
    script = f"import fss, signal; {heed}; fss.diagnose({str(flight.path)!r}, progress={interrupt}); print('went on')"
    child = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert child.returncode != 0 and "KeyboardInterrupt" in child.stderr and "went on" not in child.stdout


def test_a_calibration_finds_the_lengths_of_the_plant(tmp_path):
    laboratory = fss.Plant()
    laboratory["link.1.length_m"] = 0.39
    log = fss.fly("calibrate", laboratory=laboratory, out=tmp_path)
    found = fss.calibrate_kinematic(log, each_length=True)
    name = next(name for name in found.parameters if "length" in name)
    assert abs(found.parameters[name].value - 0.39) < 6 * found.parameters[name].std
    assert found.plant != fss.Plant() and "parameter" in found.text
    with pytest.raises(fss.Error):
        fss.calibrate_dynamic(tmp_path / "nothing")


def test_a_workspace_is_that_of_the_program(program, tmp_path):
    fss.Plant().write(tmp_path / "plant.toml")
    program("workspace", "--plant", tmp_path / "plant.toml", "--out", tmp_path / "w", "--directions", "8")
    space = fss.workspace(directions=8)
    assert space.data == json.loads((tmp_path / "w" / "workspace.json").read_text())
    assert space.radius_m == pytest.approx(1.172, abs=1e-3) and "<svg" in space._repr_html_()


def test_a_campaign_has_the_rows_of_the_program(program, tmp_path):
    pandas = optional("pandas")
    optional("pyarrow")
    sweep = {"laboratory.base.mass_kg": [9.5, 10.5]}
    campaign = fss.campaign("slew", out=tmp_path / "python", seeds=range(1, 3), sweep=sweep)
    table = campaign.write([task() for task in campaign])
    program(
        "campaign", "slew", "--seeds", "1..3", "--sweep", "laboratory.base.mass_kg=9.5,10.5", "--out", tmp_path / "program", "--quiet"
    )
    own = pandas.read_parquet(table).drop(columns="wall_time_s")
    other = pandas.read_parquet(tmp_path / "program" / "runs").drop(columns="wall_time_s")
    pandas.testing.assert_frame_equal(own, other.sort_values("run", ignore_index=True))
    assert len(campaign) == 4 and campaign[-1].run == 4 and "complete" not in program("campaign", "--out", campaign.folder, "--quiet")


def test_a_running_stack_is_heard(program, tmp_path):
    optional("iceoryx2")
    heard = hear("/nav/state", "--out", tmp_path)
    sequence = np.concatenate([samples["sequence"] for samples in heard])
    assert len(sequence) > 200 and np.all(np.diff(sequence.astype(np.int64)) == 1)
