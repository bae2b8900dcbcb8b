"""FMPy validates the exported plant, and its simulation of it moves as a flight on the virtual clock did.

usage: read_fmu.py FSS, with PyPI's FMPy and mcap-ros2-support installed.
"""

import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from mcap_ros2.reader import read_ros2_messages

PLANT = """[base]
mass_kg = 10.0
inertia_kg_m2 = 0.25
"""


def main(fss):
    root = pathlib.Path(__file__).parent.parent
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        # Without an arm what moves the vehicle is its valves, which the log has to the millisecond.
        text = (root / "deploy/etc/plants/fss.toml").read_text()
        text = "".join("[[" + part for part in ("[[" + text).split("[[")[1:] if not part.startswith("link]]"))[2:]
        (folder / "plant.toml").write_text(text)
        launch = (root / "deploy/etc/launch/lab.toml").read_text()
        import re
        launch = re.sub(r"links = \[.*?\]", "links = []", launch)
        launch = "[[service]]".join(part for part in launch.split("[[service]]") if 'name = "arm"' not in part and 'name = "links"' not in part)
        (folder / "launch.toml").write_text(launch)
        (folder / "turn.toml").write_text('name = "turn"\ndescription = "Turns."\n[[phase]]\nname = "turn"\nduration_s = 8\n'
            'base = { goal = "goto", x_m = 0.1, y_m = 0, theta_deg = 20 }\narm = { goal = "hold" }\n')
        subprocess.run([fss, "run", folder / "turn.toml", "--fast", "--quiet", "--seed", "5", "--plant", folder / "plant.toml",
                        "--launch", folder / "launch.toml", "--out", folder / "out"], check=True)
        truth = [m.ros_msg for m in read_ros2_messages(folder / "out/run.mcap", topics=["/truth/state"])]
        commands = [m.ros_msg for m in read_ros2_messages(folder / "out/run.mcap", topics=["/thrusters/state"])]
        for fmi in ("3", "2"):
            fmu = folder / f"vehicle-{fmi}.fmu"
            subprocess.run([fss, "plant", "export-fmu", folder / "plant.toml", "--out", fmu, "--fmi", fmi], check=True, capture_output=True)
            problems = validate_fmu(str(fmu))
            assert not problems, problems
            names = [v.name for v in read_model_description(str(fmu)).modelVariables]
            valves = [name for name in names if name.startswith("valve_")]
            # The laboratory takes what the service commanded from its next millisecond on.
            times = sorted({round(m.published_ns * 1e-9, 3) for m in commands})
            level = {round(m.published_ns * 1e-9, 3): [float(v) for v in list(m.valves)[: len(valves)]] for m in commands}
            rows, now = [], [0.0] * len(valves)
            for t in np.arange(0, truth[-1].stamp_ns * 1e-9 + 1e-9, 1e-3):
                rows.append((round(t, 3), *now))
                now = level.get(round(t, 3), now)
            inputs = np.array(rows, dtype=[("time", float)] + [(name, float) for name in valves])
            first = truth[0]
            start = {"seed": 5, "start.x_m": first.x_m, "start.y_m": first.y_m, "start.theta_rad": first.theta_rad}
            result = simulate_fmu(str(fmu), stop_time=truth[-1].stamp_ns * 1e-9, step_size=1e-3, output_interval=1e-3,
                                  input=inputs, start_values=start, output=["base.x_m", "base.y_m", "base.theta_rad"])
            by_time = {round(row["time"], 3): row for row in result}
            worst = max(max(abs(by_time[round(m.stamp_ns * 1e-9, 3)][f"base.{n}"] - getattr(m, n)) for n in ("x_m", "y_m", "theta_rad"))
                        for m in truth if round(m.stamp_ns * 1e-9, 3) in by_time)
            moved = max(abs(m.theta_rad - first.theta_rad) for m in truth)
            assert moved > 0.1, moved
            assert worst < 1e-9, worst
            print(f"FMPy, FMI {fmi}: valid, and {len(truth)} poses of a flight within {worst:.1e} m and rad")


main(sys.argv[1])
