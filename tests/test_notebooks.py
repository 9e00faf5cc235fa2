"""The notebook of a new project runs cell by cell in a kernel, and its output is short and readable."""

import ast

import nbformat
import pytest
from nbclient import NotebookClient

from baqueano import new, replay
from baqueano.errors import FileError
from baqueano.runs import read_run

pytestmark = pytest.mark.filterwarnings("ignore:Proactor event loop:RuntimeWarning")  # of zmq, on Windows
BROKEN = """
class Broken:
    def init(self):
        return None
    def step(self, state, tick):
        return state, tick.imu

bq.check(Broken)"""
MODEL = """
import numpy as np
from dataclasses import dataclass
from baqueano.parameter import parameter
from baqueano.vehicles import AccelerationModel

@dataclass(frozen=True, slots=True, eq=False)
class Cart(AccelerationModel):
    push: float = parameter("m/s²", "acceleration of full command", low=0.1, high=50.0, default=4.0, role="gain")
    drag: float = parameter("1/s", "drag", low=0.1, high=50.0, default=8.0)

    def nu_dot(self, nu, effort, psi):
        turn = 60.0 * effort[2] - 8.0 * nu[2]
        return np.array([self.push * effort[0] - self.drag * nu[0], -30.0 * nu[1], turn])

cart = bq.load("small").with_values({"model.kind": Cart, "model.push": 5.0})
signal = bq.excitation("random_steps", cart.command.limit, 20.0, cart.rate_hz)
cart_run = bq.experiment(cart, signal)
fit = bq.identify(cart_run, cart.with_values({"model.push": 3.0, "model.drag": 5.0}))
gains = bq.tune(fit.vehicle_file, bq.guides.shapes.circle(0.4, 0.2), starts=1, polish=False)
cart_run.save("cart.mcap")
written = bq.simulate(cart, signal, backend="python")
sweep = bq.sweep(cart, bq.guides.shapes.circle(0.4, 0.2), controllers=["kanayama", "lqr"], processes=2)
estimates = {name: fit.value(name) for name in ("push", "drag")}
estimates | {"drives": len(sweep.drives), "text": cart_run.metadata["vehicle.text"]}
"""
MISSPELT = 'def reader():\n    return bq.load("smal")\n\nreader()'
LINE = '\nmine = bq.repeat(robot, route, controller=MyController, duration_s=0.5, path="mine.mcap")\n'


@pytest.fixture(scope="module")
def executed_notebooks(tmp_path_factory):
    """Return the folder of a new project, and its notebook after all cells were executed."""
    folder = new(tmp_path_factory.mktemp("notebook") / "mi lab")
    notebook = nbformat.read(folder / "first_evening.ipynb", as_version=4)
    nbformat.validate(notebook)
    misspelt = nbformat.v4.new_code_cell(MISSPELT, metadata={"tags": ["raises-exception"]})
    notebook.cells += [misspelt, *map(nbformat.v4.new_code_cell, [LINE, MODEL, BROKEN])]
    client = NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    client.execute()
    return folder, notebook


def outputs_of(notebook, kind):
    return [
        output.data[kind]
        for cell in notebook.cells
        for output in cell.get("outputs", [])
        if kind in output.get("data", {})
    ]


def test_the_notebook_of_a_new_project_runs_without_warnings(executed_notebooks):
    _, notebook = executed_notebooks
    cells = [cell for cell in notebook.cells if cell.source != MISSPELT]
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert {output.output_type for output in outputs} <= {"execute_result", "display_data"}


def test_notebook_results_are_cards_with_short_texts_and_figures_are_images(executed_notebooks):
    folder, notebook = executed_notebooks
    cards = outputs_of(notebook, "text/html")
    assert any("Fit of small" in card and "friction.linear[0]" in card for card in cards)
    assert any("Fit of small" in card and "USABLE" in card for card in cards), (
        "the file was a guess at the beginning"
    )
    assert any("Gains of small" in card for card in cards)
    assert all(text.count("\n") < 12 for text in outputs_of(notebook, "text/plain"))
    assert len(outputs_of(notebook, "image/png")) == 3
    assert (folder / "errors.pdf").read_bytes().startswith(b"%PDF")


def test_an_error_in_a_notebook_shows_the_lines_of_its_cells_and_one_paragraph(executed_notebooks):
    _, notebook = executed_notebooks
    (cell,) = [cell for cell in notebook.cells if cell.source == MISSPELT]
    *lines, message = cell.outputs[0].traceback
    name = f"In[{cell.execution_count}]"
    assert lines == [f"{name} line 4: reader()", f'{name} line 2: return bq.load("smal")']
    assert message.startswith("FileError: ")
    assert '"smal"' in message


def test_a_run_stores_the_source_of_a_block_from_a_cell(executed_notebooks):
    folder, _ = executed_notebooks
    metadata = read_run(folder / "mine.mcap").metadata
    assert "class MyController:" in metadata["controller.text"]
    assert metadata["controller"].startswith("MyController(k_x=")


def test_a_model_from_a_cell_is_identified_tuned_simulated_and_compared(executed_notebooks):
    _, notebook = executed_notebooks
    answer = ast.literal_eval(outputs_of(notebook, "text/plain")[-2])
    assert answer["push"] == pytest.approx(5.0, rel=0.05)
    assert answer["drag"] == pytest.approx(8.0, rel=0.05)
    assert answer["drives"] == 2
    assert "class Cart" in answer["text"]


def test_a_run_with_a_model_from_a_cell_states_elsewhere_that_its_class_is_missing(executed_notebooks):
    folder, _ = executed_notebooks
    with pytest.raises(FileError) as error_info:
        replay(read_run(folder / "cart.mcap"))
    assert "block.cell-class-unknown" in str(error_info.value.diagnostic.to_json())


def test_a_fault_of_a_block_names_its_cell_and_the_fields_of_the_signal(executed_notebooks):
    _, notebook = executed_notebooks
    words = " ".join(outputs_of(notebook, "text/plain")[-1].split())
    cell = f"In[{notebook.cells[-1].execution_count}]"
    assert f"{cell} line 4: Broken.step() raises AttributeError" in words
    assert "(it has t_ns, u, sensors) on line 5" in words
