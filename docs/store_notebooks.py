"""Run the notebooks and store them with outputs: ``python docs/store_notebooks.py [PATTERN ...]``.

What is stored is small and the same everywhere: figures with few colours, no progress bars, no
paths of this machine, no times.
"""

from __future__ import annotations

import base64
import io
import os
import re
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
#: What a progress line shows last.
PROGRESS = re.compile(r"\w+: .* \| so far: .* \| [\d.]+( of about [\d.]+)? s")


def small_png(data: str) -> str:
    """A picture with few colours, which is all that dots and lines need."""
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        few = image.convert("RGB").quantize(48, dither=Image.Dither.NONE)
    kept = io.BytesIO()
    few.save(kept, "PNG", optimize=True)
    return base64.b64encode(kept.getvalue()).decode()


def plain(text: str) -> str:
    """Text without folders of this machine."""
    return re.sub(r"(?:/[\w.\-]+)+/(?=[\w.\-]+)", "", text)


def cleaned(output: nbformat.NotebookNode) -> nbformat.NotebookNode | None:
    """An output as it is stored; None for progress bars and live widgets."""
    if output.output_type == "stream":
        bars = re.sub(r"[^\r\n]*\[\d\d:\d\d[,<][^\r\n]*", "", output.text)
        output.text = plain(bars)
        return output if output.text.strip() else None
    data = output.get("data", {})
    if "application/vnd.jupyter.widget-view+json" in data:
        return None
    if PROGRESS.fullmatch(data.get("text/plain", "")):
        return None
    if "image/png" in data:
        data["image/png"] = small_png(data["image/png"])
    if "text/plain" in data:
        data["text/plain"] = plain(data["text/plain"])
    return output


def store(path: Path) -> None:
    """Run one notebook and write it back."""
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(FOLDER)}})
    before = os.times().children_user
    client.execute()
    seconds = os.times().children_user - before
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [kept for one in cell.outputs if (kept := cleaned(one)) is not None]
    notebook.metadata.pop("widgets", None)
    notebook.metadata["language_info"] = {"name": "python"}
    nbformat.write(notebook, path)
    size = path.stat().st_size / 1000
    print(f"{path.name}: {seconds:.0f} s of a core, {size:.0f} kB", flush=True)


def main() -> None:
    os.environ.pop("MPLBACKEND", None)
    names = sys.argv[1:] or ["*.ipynb"]
    paths = sorted(path for name in names for path in FOLDER.glob(name))
    if not paths:
        sys.exit(f"no notebook in {FOLDER.name}/ is called {' or '.join(names)}: try 03*")
    for path in paths:
        store(path)


if __name__ == "__main__":
    main()
