# SPDX-License-Identifier: Apache-2.0
"""Writes the examples as Jupyter notebooks. Usage: notebooks.py FOLDER"""

import json
import re
import sys
from pathlib import Path

HERE = Path(__file__).parent


def cell(kind, source):
    """A cell of the notebook format 4.5."""
    extra = {"execution_count": None, "outputs": []} if kind == "code" else {}
    lines = source.strip("\n").splitlines(keepends=True)
    return {"cell_type": kind, "id": "", "metadata": {}, "source": lines, **extra}


def cells_of(text):
    """The cells of a script: `# %% [markdown]` and `# %%`, with an optional title."""
    for part in re.split(r"^# %%", text, flags=re.M)[1:]:
        head, _, body = part.partition("\n")
        if head.strip() == "[markdown]":
            yield cell("markdown", re.sub(r"^# ?", "", body, flags=re.M))
        else:
            if head.strip():
                yield cell("markdown", head.strip())
            yield cell("code", body.replace("sys.argv", "[None]"))


def notebook(path):
    """The notebook of a script."""
    cells = list(cells_of(path.read_text()))
    for number, one in enumerate(cells):
        one["id"] = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


if __name__ == "__main__":
    out = Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    for script in sorted(HERE.glob("*.py")):
        if script != Path(__file__):
            (out / f"{script.stem}.ipynb").write_text(json.dumps(notebook(script), indent=1) + "\n")
