"""Execute the notebooks: `python docs/run_notebooks.py [NAME ...]` writes notebooks/NAME.ipynb from notebooks/NAME.py.

The text sources are what is edited; the stored outputs are small: pictures of few dots per inch, no warnings of the
compiler, no times.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import jupytext
import nbclient
import nbformat

NOTEBOOKS = Path(__file__).resolve().parent.parent / "notebooks"
TIMEOUT = 900
"""Seconds that one cell may take: on a busy machine a finger compiles for minutes."""

SMALL_PICTURES = """
%matplotlib inline
%config InlineBackend.print_figure_kwargs = {"dpi": 96, "bbox_inches": "tight"}
"""
"""A cell that is run first and not stored."""


def execute(source: Path) -> nbformat.NotebookNode:
    """The notebook of a text source, with its outputs; raises where a cell does."""
    notebook = jupytext.read(source)
    notebook.cells.insert(0, nbformat.v4.new_code_cell(SMALL_PICTURES))
    # XLA tells its own mind about programs that it takes from the cache.
    os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"
    client = nbclient.NotebookClient(
        notebook,
        timeout=TIMEOUT,
        record_timing=False,
        kernel_name="python3",
        coalesce_streams=True,  # or the pieces depend on time
    )
    client.execute(cwd=str(source.parent))
    del notebook.cells[0]
    for k, cell in enumerate(notebook.cells):
        # The same sources and the same results give the same file.
        cell.id = str(k)
        if cell.cell_type == "code":
            cell.execution_count = None
            for output in cell.outputs:
                output.pop("execution_count", None)
                if output.output_type == "execute_result":
                    output.execution_count = None
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"]}
    return notebook


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(path.stem for path in NOTEBOOKS.glob("*.py")):
        print(name, flush=True)
        done = execute(NOTEBOOKS / f"{name}.py")
        nbformat.write(done, NOTEBOOKS / f"{name}.ipynb")
