"""FMPy validates the exported plant, and its simulation of it moves as a flight on the virtual clock did.

usage: read_fmu.py FSS, with PyPI's FMPy and mcap-ros2-support installed.
"""

import pathlib
import re
import subprocess
import sys
import tempfile

import numpy as np
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from mcap_ros2.reader import read_ros2_messages

MISSION = """name = "turn"
description = "Turns."
[[phase]]
name = "turn"
duration_s = 8
base = { goal = "goto", x_m = 0.1, y_m = 0, theta_deg = 20 }
arm = { goal = "hold" }
"""
POSE = ("x_m", "y_m", "theta_rad")


def main(fss):
    root = pathlib.Path(__file__).parent.parent
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        # Without an arm what moves the vehicle is its valves, which the log has to the millisecond.
        tables = (root / "deploy/etc/plants/fss.toml").read_text().split("[[")
        plant = "[[".join(table for table in tables if not table.startswith("link]]"))
        launch = (root / "deploy/etc/launch/lab.toml").read_text()
        # The FMU takes its inputs at whole milliseconds: the valves are told then.
        told = 'name = "thrusters"\nrate_hz = 200\nphase_us = '
        assert told + "2500" in launch
        launch = launch.replace(told + "2500", told + "3000")
        for name, text in {"plant": plant, "launch": re.sub(r"links = \[.*?\]", "links = []", launch), "turn": MISSION}.items():
            (folder / f"{name}.toml").write_text(text)
        run = [fss, "run", folder / "turn.toml", "--fast", "--quiet", "--seed", "5", "--plant", folder / "plant.toml"]
        subprocess.run(run + ["--launch", folder / "launch.toml", "--out", folder / "out"], check=True)
        read = lambda topic: [m.ros_msg for m in read_ros2_messages(folder / "out/run.mcap", topics=[topic])]
        truth, commands = read("/truth/state"), read("/thrusters/state")
        first, end_s = truth[0], truth[-1].stamp_ns * 1e-9
        for fmi in ("3", "2"):
            fmu = str(folder / f"vehicle-{fmi}.fmu")
            export = [fss, "plant", "export-fmu", folder / "plant.toml", "--out", fmu, "--fmi", fmi]
            subprocess.run(export, check=True, capture_output=True)
            problems = validate_fmu(fmu)
            assert not problems, problems
            names = [v.name for v in read_model_description(fmu).modelVariables]
            valves = [name for name in names if name.startswith("valve_")]
            # The laboratory takes a command when it is published.
            level = {m.published_ns // 1_000_000: [float(v) for v in m.valves[: len(valves)]] for m in commands}
            rows, now = [], [0.0] * len(valves)
            for ms in range(truth[-1].stamp_ns // 1_000_000 + 1):
                now = level.get(ms, now)
                rows.append((ms * 1e-3, *now))
            inputs = np.array(rows, dtype=[("time", float)] + [(name, float) for name in valves])
            start = {"seed": 5} | {f"start.{n}": getattr(first, n) for n in POSE}
            result = simulate_fmu(fmu, stop_time=end_s, step_size=1e-3, output_interval=1e-3, input=inputs,
                                  start_values=start, output=[f"base.{n}" for n in POSE])
            found = {round(row["time"] * 1e3): row for row in result}
            same = [(m, found[m.stamp_ns // 1_000_000]) for m in truth if m.stamp_ns // 1_000_000 in found]
            worst = max(abs(row[f"base.{n}"] - getattr(m, n)) for m, row in same for n in POSE)
            assert max(abs(m.theta_rad - first.theta_rad) for m in truth) > 0.1, "the vehicle turns"
            assert len(same) > 500 and worst < 1e-9, (len(same), worst)
            print(f"FMPy, FMI {fmi}: valid, and {len(same)} poses of a flight within {worst:.1e} m and rad")


main(sys.argv[1])
