"""The notebooks in docs/notebooks: each runs to its end, and is stored without outputs."""

import json
import warnings
from pathlib import Path
from typing import Any

import pytest

from faces import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def cells(path: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(path.read_text("utf-8"))["cells"]
    return found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path: Path) -> None:
    """Its cells are numbered by their ids, so that a change of one changes no other."""
    assert [each["id"] for each in cells(path)] == [
        f"{path.stem}-{number}" for number in range(1, len(cells(path)) + 1)
    ]
    code = [each for each in cells(path) if each["cell_type"] == "code"]
    assert not any(each["outputs"] or each["execution_count"] for each in code)


@pytest.mark.thorough
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    """In an empty folder; nothing fails, and at least one of its values shows a picture."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    notebook = nbformat.read(path, as_version=4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        client = nbclient.NotebookClient(
            notebook, timeout=100, resources={"metadata": {"path": str(tmp_path)}}
        )
        client.execute()
    shown = [
        output["data"].get("text/html", "")
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        if "data" in output
    ]
    assert any("<img" in html for html in shown)
    assert not any("no picture" in html for html in shown[:1])
