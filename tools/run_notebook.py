"""Run a notebook's cells in order, without Jupyter, and keep what they print and show.

    python tools/run_notebook.py examples/notebook.ipynb            # writes it, with its outputs
    python tools/run_notebook.py --check examples/notebook.ipynb    # exit 1 where a text differs

Of a cell its standard output is kept, and its last expression as text and, where it can be, as
HTML.
"""

import argparse
import ast
import io
import json
import os
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

Output = dict[str, Any]


def run(code: str, names: dict[str, Any]) -> list[Output]:
    """Run a cell; return its outputs, as a notebook's file has them."""
    *body, last = ast.parse(code).body or [ast.Pass()]
    said, outputs = io.StringIO(), list[Output]()
    shown = None
    with redirect_stdout(said):
        if isinstance(last, ast.Expr):
            exec(compile(ast.Module(body, []), "cell", "exec"), names)
            shown = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        else:
            exec(compile(ast.Module([*body, last], []), "cell", "exec"), names)
    if said.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": _lines(said.getvalue())})
    if shown is not None:
        data = {"text/plain": _lines(repr(shown))}
        if hasattr(shown, "_repr_html_"):
            data["text/html"] = _lines(shown._repr_html_())
        outputs.append({"output_type": "display_data", "data": data, "metadata": {}})
    return outputs


def said(document: Output) -> list[Any]:
    """What the cells print and show as text: pictures differ a little from machine to machine."""
    outputs = [o for cell in document["cells"] for o in cell.get("outputs", [])]
    return [o.get("text") or o["data"]["text/plain"] for o in outputs]


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("notebook", type=Path)
    parser.add_argument("--check", action="store_true")
    given = parser.parse_args()
    path = given.notebook.resolve()
    document = json.loads(path.read_text(encoding="utf-8"))
    before = said(document)
    names: dict[str, Any] = {"__name__": "notebook"}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for cell in document["cells"]:
            if cell["cell_type"] == "code":
                cell["outputs"] = run("".join(cell["source"]), names)
        os.chdir(path.parent)
    if given.check:
        if after := said(document) != before:
            print("it says something else")
        return int(after)
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
