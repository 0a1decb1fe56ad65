"""The notebooks: every one runs at smoke size by nbval, and "executed" cannot be faked."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

from srlrepro.pins import ARITHMETIC
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import ResultError
from srlrepro.storage.provenance import MADE_BY
from workflow.command_line import ALPHAS, COMMAND_VARIABLE, DELTAS, SEEDS
from workflow.notebooks import COMPARED, check_parameters, execute, forget_machine, parameters_of, prepare

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
TIME_OR_ADDRESS = r"\bat 0x[0-9a-f]{6}|[\d.]+ (min|s) left|it/s\]"
MACHINE_PATH = r"[^\w.:]/(home|root|tmp|usr|work|Users)/"
NAMES = [
    "01_pendulum",
    "02_training_data",
    "03_embedding",
    "04_safe_region",
    "05_training_run",
    "06_learning_performance",
    "07_activations_and_failures",
    "08_claims",
    "09_choices",
    "10_calibration",
    "11_behaviour",
    "12_theorem",
    "13_universe",
    "14_multiverse",
    "15_caution",
    "16_discrepancy",
    "17_crossed",
    "18_shift",
    "19_any_system",
    "20_joints",
    "21_more_joints",
]
# Of the studies.
APART = [
    "13_universe",
    "14_multiverse",
    "15_caution",
    "17_crossed",
    "18_shift",
    "20_joints",
    "21_more_joints",
]


def nbval(folder: Path, *names: str) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "--rootdir",
        str(folder),
    ]
    command += ["--nbval-lax", "--nbval-current-env", *names]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A notebook that computes 2 × N, compares it, and writes it to a file."""
    language = {
        "kernelspec": {"name": "python3", "display_name": "Python 3"},
        "language_info": {"name": "python"},
    }
    notebook = nbformat.v4.new_notebook(metadata=language)
    parameters = nbformat.v4.new_code_cell("N = 1\nRATE = 0.5\nNAME = 'a'", metadata={"tags": ["parameters"]})
    result = nbformat.v4.new_code_cell(
        f"{COMPARED}\nprint(2 * N)\n_ = open('result.txt', 'w').write(str(2 * N))"
    )
    result.execution_count = 2
    result.outputs = [nbformat.v4.new_output("stream", name="stdout", text="2\n")]
    notebook.cells = [parameters, result]
    path = tmp_path / "small.ipynb"
    nbformat.write(notebook, path)
    return path


def test_the_notebooks_are_all_there() -> None:
    assert [path.stem for path in NOTEBOOKS] == NAMES


def test_kept_figures_are_complete_and_small() -> None:
    """Every picture as PDF and PNG with its table; an animation for each of the twelve conditions."""
    folder = ROOT / "figures" / "full"
    pictures = list(folder.glob("*.pdf"))
    assert {"fig1_pendulum", "fig2_abc_training_data", "fig3_abc_learning"} < {p.stem for p in pictures}
    assert all(p.with_suffix(suffix).exists() for p in pictures for suffix in (".png", ".csv"))
    assert len(list((folder / "behaviour").glob("*.gif"))) == 12
    assert all(p.stat().st_size < 2_000_000 for p in folder.rglob("*") if p.is_file())


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_sources_are_small_and_compare_a_result(path: Path) -> None:
    """Exactly one parameters cell; outputs only where they are compared; at most about 100 lines of code."""
    cells = nbformat.read(path, as_version=4).cells
    code = [cell for cell in cells if cell.cell_type == "code"]
    compared = [cell for cell in code if cell.source.startswith(COMPARED)]
    assert parameters_of(path)["RESULTS"] == "../results/smoke"
    assert compared and all(cell.outputs for cell in compared)
    assert not any(cell.outputs for cell in code if cell not in compared)
    assert sum(len(cell.source.splitlines()) for cell in code) <= 110
    assert path.stat().st_size < 20_000


@pytest.mark.slow
@pytest.mark.parametrize("of_studies", [False, True], ids=["grid", "studies"])
def test_every_notebook_runs_and_gives_the_recorded_results(tmp_path: Path, of_studies: bool) -> None:
    """In their order: later notebooks read what earlier ones write."""
    folder = tmp_path / "notebooks"
    folder.mkdir()
    chosen = [path for path in NOTEBOOKS if (path.stem in APART) == of_studies]
    for path in chosen:
        shutil.copy(path, folder)
    trained = [path.name for path in chosen].index("05_training_run.ipynb") + 1 if not of_studies else 0
    passed = 0
    for part in (chosen[:trained], chosen[trained:]):  # measures are made of runs, as the rules do
        for path in part:
            prepare(folder / path.name)
        done = nbval(folder, *[path.name for path in part]) if part else None
        assert done is None or done.returncode == 0, done.stdout[-4000:]
        passed += int(re.findall(r"(\d+) passed", done.stdout)[-1]) if done else 0
    code = [c for path in chosen for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
    assert passed == len(code)


@pytest.mark.slow
def test_a_falsified_result_makes_nbval_fail(small: Path) -> None:
    assert nbval(small.parent, small.name).returncode == 0
    falsified = json.loads(small.read_text())
    falsified["cells"][1]["outputs"][0]["text"] = "3\n"
    small.write_text(json.dumps(falsified))
    done = nbval(small.parent, small.name)
    assert done.returncode == 1 and "1 failed" in done.stdout


def test_parameters_are_checked_by_name_and_type(small: Path) -> None:
    check_parameters(small, {"N": 2, "RATE": 1, "NAME": "b"})
    with pytest.raises(
        ParameterError, match=r"M = 2: must be one of the parameters of small.ipynb: N, RATE, NAME"
    ):
        check_parameters(small, {"M": 2})
    for wrong in ({"N": "2"}, {"N": 2.0}, {"N": True}, {"NAME": 1}, {"RATE": "1e-3"}):
        with pytest.raises(ParameterError, match="must be a"):
            check_parameters(small, wrong)


def test_a_notebook_without_parameters_cell_is_refused(small: Path) -> None:
    notebook = nbformat.read(small, as_version=4)
    notebook.cells[0].metadata = {}
    nbformat.write(notebook, small)
    with pytest.raises(ResultError, match="0 cells tagged"):
        parameters_of(small)


@pytest.mark.slow
def test_executed_means_ran_with_the_parameters(small: Path) -> None:
    output = small.parent / "executed" / "small.ipynb"
    execute(small, output, {"N": 21}, [small.parent / "result.txt"])
    text = output.read_text()
    assert (small.parent / "result.txt").read_text() == "42"
    assert "42" in text and str(small.parent) not in text and "papermill" not in json.loads(text)["metadata"]


@pytest.mark.slow
@pytest.mark.parametrize("length", [10, 200_000])
def test_a_notebook_is_told_what_makes_its_figures(
    small: Path, length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parameters that are too long for a variable of the system are named by their digest."""
    monkeypatch.setenv(COMMAND_VARIABLE, "./reproduce.sh --quick")
    notebook = nbformat.read(small, as_version=4)
    notebook.cells[1].source = f"import os\n_ = open('made.json', 'w').write(os.environ['{MADE_BY}'])"
    nbformat.write(notebook, small)
    execute(small, small.parent / "executed" / "small.ipynb", {"NAME": "x" * length})
    assert MADE_BY not in os.environ, "a notebook's own variable stays after it"
    made = json.loads((small.parent / "made.json").read_text())
    assert (made["notebook"], made["command"]) == ("small.ipynb", "./reproduce.sh --quick")
    assert made["arithmetic"] == ARITHMETIC and "code" not in made, "an edit of a source changes the figure"
    assert (
        made["parameters"] == {"NAME": "x" * 10} if length == 10 else list(made["parameters"]) == ["sha256"]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("1 / 0", "cell 1: ZeroDivisionError: division by zero"),
        ("import os\nos._exit(1)", "small.ipynb"),
        ("import os, signal\nos.kill(os.getpid(), signal.SIGKILL)", "small.ipynb: Kernel died"),
        ("import time\ntime.sleep(1000)", "small.ipynb: A cell timed out"),
        ("pass", "missing result"),
    ],
    ids=["raises", "dies", "is killed", "hangs", "writes nothing"],
)
def test_a_failed_notebook_is_not_taken_for_executed(small: Path, source: str, message: str) -> None:
    notebook = nbformat.read(small, as_version=4)
    notebook.cells[1].source = source
    nbformat.write(notebook, small)
    output = small.parent / "executed" / "small.ipynb"
    with pytest.raises(ResultError, match=message):
        execute(small, output, {}, [small.parent / "result.txt"], limit=10)
    assert list(output.parent.iterdir()) == []


@pytest.mark.slow
def test_an_old_result_is_not_taken_for_a_new_one(small: Path) -> None:
    """Also where the clock says that it was written after the start."""
    old = small.parent / "old.txt"
    old.write_text("1")
    os.utime(old, (2**32, 2**32))
    with pytest.raises(ResultError, match="left an old"):
        execute(small, small.parent / "executed" / "small.ipynb", {}, [old])


def test_an_unwritable_output_is_refused_before_the_launch(small: Path) -> None:
    with pytest.raises(ResultError, match="cannot write"):
        execute(small, small / "executed" / "small.ipynb", {}, [])
    assert not (small.parent / "result.txt").exists()


def executed() -> list[Path]:
    """Those of the full grid, which are kept; others are made and looked at by whoever wants them."""
    return sorted((ROOT / "notebooks" / "executed" / "full").rglob("*.ipynb"))


def tell(source: str) -> nbformat.NotebookNode:
    """A notebook of one cell."""
    cells = [
        nbformat.v4.new_code_cell("N = 1", metadata={"tags": ["parameters"]}),
        nbformat.v4.new_code_cell(source),
    ]
    return nbformat.v4.new_notebook(
        cells=cells, metadata={"kernelspec": {"name": "python3", "display_name": "P"}}
    )


@pytest.mark.slow
def test_an_executed_notebook_has_the_same_bytes_in_another_folder_home_and_locale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a picture, a table, and output that is cleared."""
    source = (ROOT / "notebooks" / "05_training_run.ipynb").read_text()
    assert "clear_output()" in source
    shown = "import time, pandas as pd, matplotlib.pyplot as plt\nfrom IPython.display import clear_output\n"
    shown += "print(time.time())\nclear_output()\nplt.plot([1, N])\nplt.show()\npd.DataFrame({'θ': [1.5]})"
    written = []
    monkeypatch.delenv("MPLBACKEND")  # the notebooks' own shows pictures
    for name, zone, seed in (("a", "UTC", "1"), ("another", "Asia/Tokyo", "2")):
        for variable, value in {
            "HOME": str(tmp_path / name),
            "TZ": zone,
            "PYTHONHASHSEED": seed,
            "LC_ALL": "C",
        }.items():
            monkeypatch.setenv(variable, value)
        folder = tmp_path / name
        folder.mkdir()
        nbformat.write(tell(shown), folder / "one.ipynb")
        execute(folder / "one.ipynb", folder / "executed" / "one.ipynb", {})
        written.append((folder / "executed" / "one.ipynb").read_bytes())
    assert written[0] == written[1] and b"image/png" in written[0]


def test_the_executed_notebooks_of_the_grid_are_complete() -> None:
    """Every source notebook of the grid, the training run 36 times."""
    names = [path.stem for path in executed()]
    assert sorted({n.split("__")[0] for n in names}) == [n for n in NAMES if n not in APART]
    assert {
        f"05_training_run__alpha_{a}__delta_{d:g}__seed_{s}"
        for a in ALPHAS
        for d in DELTAS
        for s in range(SEEDS)
    } <= set(names)


@pytest.mark.parametrize("path", executed(), ids=lambda p: p.stem)
def test_executed_notebooks_ran_to_their_end(path: Path) -> None:
    assert path.stat().st_size < 1_000_000
    text = path.read_text()
    assert re.search(MACHINE_PATH, text) is None and re.search(TIME_OR_ADDRESS, text) is None
    assert "version" not in json.loads(text)["metadata"]["language_info"]
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "code":
            assert cell.execution_count is not None
            assert not any(output.output_type == "error" for output in cell.outputs)


def test_an_address_in_memory_is_forgotten() -> None:
    data = {"text/plain": "<pandas.io.formats.style.Styler at 0x7f32c5d1a0>", "text/html": "<b>0x7f</b>"}
    outputs = [nbformat.v4.new_output("execute_result", data), nbformat.v4.new_output("stream", text="x")]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("table.style", outputs=outputs)])
    forget_machine(notebook)
    kept = notebook.cells[0].outputs[0]["data"]
    assert kept == data | {"text/plain": "<pandas.io.formats.style.Styler>"}
