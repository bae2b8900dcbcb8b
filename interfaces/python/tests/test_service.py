"""A service of one's own in Python needs nothing but the wheel: it flies, is recorded and replayed, and is heard live."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import hear, optional

import fss


@pytest.fixture(scope="module")
def meter(program, tmp_path_factory):
    """The service as `fss new service` makes it."""
    folder = tmp_path_factory.mktemp("service") / "meter"
    program("new", "service", "meter", "--python", "--out", folder)
    return folder


@pytest.fixture(scope="module")
def environment():
    """This Python before any other, and no Rust."""
    return {**os.environ, "PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin"}


def test_it_flies_on_the_virtual_clock_and_is_replayed(meter, environment):
    said = subprocess.run([meter / "check"], capture_output=True, text=True, env=environment)
    assert said.returncode == 0, said.stderr
    assert "/meter/state is in the log at 50" in said.stdout and not (meter / "bin").exists(), said.stdout
    speed = fss.Log(meter / "out")["/meter/state"]
    assert np.all(np.isfinite(speed["speed_m_s"])) and len(speed) > 1000


def test_it_is_heard_while_it_flies(meter, environment, tmp_path):
    optional("iceoryx2")
    subprocess.run([meter / "check"], capture_output=True, env=environment, check=True)
    # Beside other flights on this computer: on ports of its own.
    launch = meter / "apart.toml"
    launch.write_text((meter / "launch.toml").read_text().replace("127.0.0.1:51", "127.0.0.1:53"))
    samples = hear("/meter/state", "--launch", launch, "--out", tmp_path, env=environment)
    assert "speed_m_s" in samples[0].dtype.names and sum(len(part) for part in samples) > 50
