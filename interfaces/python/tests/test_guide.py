import subprocess
import sys
from pathlib import Path

import pytest
from conftest import optional

HERE = Path(__file__).resolve().parent.parent


def test_examples_are_typed(tmp_path):
    optional("mypy")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path), *map(str, (HERE / "examples").glob("*.py"))]
    checked = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert checked.returncode == 0, checked.stdout


def test_stubs_say_what_the_native_module_has(tmp_path):
    optional("mypy")
    # A native module lists all that it has; its stub need not.
    (tmp_path / "allowed").write_text("fss\\._fss\\.__all__\n")
    command = [sys.executable, "-m", "mypy.stubtest", "fss._fss", "--allowlist", "allowed"]
    checked = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert checked.returncode == 0, checked.stdout


@pytest.mark.parametrize("name", ["flight", "laboratory", "campaign_dask"])
def test_examples_run(name, tmp_path):
    if name == "campaign_dask":
        optional("distributed")
    done = subprocess.run([sys.executable, HERE / "examples" / f"{name}.py"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {"flight": "done", "laboratory": "table_tilt", "campaign_dask": "8 of 8"}[name] in done.stdout


@pytest.mark.parametrize("name", ["flight", "hidden_effect", "your_data"])
def test_notebooks_execute(name, tmp_path):
    nbformat, nbclient = optional("nbformat"), optional("nbclient")
    optional("matplotlib")
    notebook = nbformat.read(HERE / "notebooks" / f"{name}.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    figures = [o for cell in notebook.cells for o in cell.get("outputs", []) if "image/png" in o.get("data", {})]
    assert len(figures) >= 2
