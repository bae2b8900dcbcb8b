import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import fss

PROGRAM = Path(sys.executable).with_name("fss")


@pytest.fixture(scope="session")
def program():
    """The program that the wheel brings along."""
    if not PROGRAM.exists():
        pytest.skip("skipped: the program fss is not beside the interpreter")

    def run(*arguments):
        return subprocess.run([PROGRAM, *map(str, arguments)], check=True, capture_output=True, text=True).stdout

    return run


@pytest.fixture(scope="session")
def flight(tmp_path_factory):
    """A flight whose laboratory has a weak thruster."""
    laboratory = fss.Plant().with_effects(fss.Effect("thruster_gain", index=3, scale=0.6))
    return fss.fly("experiment-thrusters", laboratory=laboratory, seed=1, out=tmp_path_factory.mktemp("flight"))


def optional(module):
    """A package that a test needs; without it the test says so and passes."""
    return pytest.importorskip(module, reason=f"skipped: {module} is not installed")


def hear(topic, *arguments, **options):
    """Flies `hold` in real time and hears a topic for 2 s: its samples, array by array as they came."""
    command = [PROGRAM, "run", "hold", "--quiet", *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, **options) as stack:
        deadline = time.monotonic() + 20
        while True:
            try:
                live = fss.live(topic, bus=f"fss_{stack.pid}_")
                break
            except Exception:
                assert time.monotonic() < deadline, "the stack does not come up"
                time.sleep(0.2)
        with live:
            heard = list(live.stream(0.1, duration_s=2.0))
        stack.send_signal(signal.SIGINT)
    return heard
