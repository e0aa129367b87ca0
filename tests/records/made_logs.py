"""Logs as text, and the files that hold them."""


def text(*columns, heading="", mark=",", decimal=".", end="\n"):
    """Rows of a log: its numbers in full, its words as they are."""
    rows = (
        [str(v).replace(".", decimal) if isinstance(v, float) else str(v) for v in row]
        for row in zip(*columns, strict=True)
    )
    return heading + "\n" * bool(heading) + "".join(mark.join(row) + end for row in rows)


def write(folder, content, name="run.csv", encoding="utf-8"):
    """The path of a file with this content."""
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return path
