"""Every public name is documented, and what the pages show runs."""

import ast
import builtins
import dataclasses
import doctest
import importlib.util
import inspect
import json
import operator
import re
import shutil
import warnings
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from diagnosis_cases import among
from numpydoc.docscrape import NumpyDocString

import dryfric_control as dfc
from dryfric_control.model.effects.effect import REGISTRY

ROOT = Path(__file__).resolve().parent.parent


def files(*patterns):
    """Paths of what fits, from the root, in order."""
    return sorted(str(path.relative_to(ROOT)) for one in patterns for path in ROOT.glob(one))


PAGES = ["README.md", "docs/index.md", "docs/tutorial.md", "docs/observer.md", "docs/effects.md"]
PAGES += files("docs/howto/*.md")


def extension(name):
    """A module of the site's own, by its file."""
    path = ROOT / "docs" / "_extensions" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


ITEMS = {
    name: operator.attrgetter(name)(dfc)
    for name in extension("public_names").public_names()
    if name != "__version__"
}
#: An exception or warning takes a message, as every one does.
EXCEPTIONS = [n for n, it in ITEMS.items() if inspect.isclass(it) and issubclass(it, Exception)]
#: Public methods that a class of the package defines itself.
METHODS = {
    f"{name}.{method}": getattr(cls, method)  # with the text of the class it overrides
    for name, cls in ITEMS.items()
    if inspect.isclass(cls)
    for method, item in vars(cls).items()
    if isinstance(item, (classmethod, staticmethod)) or inspect.isfunction(item)
    # `law`, `flow` and `jump` are the equations of an effect; the class documents them.
    if method[0] != "_"
    and not (method in ("law", "flow", "jump") and issubclass(cls, dfc.effects.Effect))
}


def parsed(item):
    with warnings.catch_warnings(action="error"):  # numpydoc warns of sections it does not know
        return NumpyDocString(inspect.getdoc(item) or "")


def names_in(section):
    """Names of a section, "x0, v0" taken apart and the stars of **options taken off."""
    return [name.lstrip("*") for part in section for name in re.split(r"\s*,\s*", part.name)]


DOCUMENTED = ITEMS | METHODS


@pytest.mark.parametrize("name", DOCUMENTED)
def test_a_docstring_has_a_short_summary_and_the_parameters_of_the_signature(name):
    item, doc = DOCUMENTED[name], parsed(DOCUMENTED[name])
    summary = doc["Summary"]
    assert len(summary) == 1 and 0 < len(summary[0]) < 64, summary
    assert ". " not in summary[0]  # tables of the reference end it there
    documented = names_in(doc["Parameters"])
    if name in ITEMS and dataclasses.is_dataclass(item) and not documented:
        # A result that the package makes and the user reads: its fields.
        documented = names_in(doc["Attributes"])
    if name not in EXCEPTIONS:
        asked = [one for one in inspect.signature(item).parameters if not one.startswith("_")]
        assert documented == [one for one in asked if name in ITEMS or one not in ("self", "cls")]


@pytest.mark.parametrize("name", ITEMS)
def test_has_an_example_that_the_doctests_run(name):
    """`pytest --doctest-modules` runs them; here they must exist, with output to compare."""
    item = ITEMS[name]
    assert "\nExamples\n" in inspect.getdoc(item)
    assert inspect.unwrap(item).__module__.startswith("dryfric_control.")
    examples = doctest.DocTestParser().get_examples(inspect.getdoc(item))
    assert any(example.want for example in examples)
    assert not any(doctest.SKIP in example.options for example in examples)


def given_nowhere(source):
    """Names that code reads and nothing in it binds."""
    nodes = list(ast.walk(ast.parse(source)))
    bound = set(dir(builtins))
    for node in nodes:
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            bound.add(node.id)
        elif isinstance(node, ast.alias):
            bound.add((node.asname or node.name).partition(".")[0])
        elif isinstance(node, ast.FunctionDef | ast.ClassDef | ast.ExceptHandler):
            bound.add(node.name)
        elif isinstance(node, ast.arg):
            bound.add(node.arg)
    return {node.id for node in nodes if isinstance(node, ast.Name)} - bound


@pytest.mark.parametrize("name", DOCUMENTED)
def test_an_example_can_be_pasted(name):
    """Doctests find the names of their module; whoever pastes an example does not."""
    text = inspect.getdoc(DOCUMENTED[name])
    code = "".join(example.source for example in doctest.DocTestParser().get_examples(text))
    assert not given_nowhere(code)


@pytest.mark.parametrize("slug", REGISTRY)
def test_an_effect_says_its_equation(slug):
    """The catalogue takes them from the classes."""
    cls = REGISTRY[slug]
    if cls.__module__.startswith("dryfric_control."):
        assert any(".. math::" in line for line in parsed(cls)["Notes"])


def test_the_catalogue_of_effects_is_up_to_date():
    """``sphinx-build docs docs/_build/html`` writes it."""
    catalogue = extension("effects_catalogue")
    assert (ROOT / "docs" / catalogue.PAGE).read_text(encoding="utf-8") == catalogue.page()


def test_reference_lists_every_public_name():
    text = (ROOT / "docs" / "reference.rst").read_text(encoding="utf-8")
    listed = re.findall(r"^   ([\w.]+)$", text, re.MULTILINE)
    assert sorted(listed) == sorted(ITEMS)
    assert ".. data:: __version__" in text


def test_files_that_a_benchmark_names_exist():
    scripts = "".join(script.read_text() for script in (ROOT / "benchmarks").glob("*.py"))
    named = set(re.findall(r"\b(?:tests|benchmarks|dryfric_control)/[\w/]+\.py", scripts))
    assert len(named) > 20
    # The suite runs away from the sources of the package, too.
    own = Path(dfc.__file__).parents[1]
    assert not [path for path in named if not any((at / path).is_file() for at in (ROOT, own))]


#: Every page that is read as it is, on a code host too.
MARKDOWN = files("*.md", "benchmarks/*.md", "docs/*.md", "docs/*/*.md")
NOTEBOOKS = files("notebooks/*.ipynb")


def prose(path):
    """Text of a page, or of the Markdown cells of a notebook, without its blocks of code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = (cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown")
        text = "\n\n".join("".join(cell["source"]) for cell in cells)
    return re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)


def anchors(path):
    """Names by which headings of a page are reached; a title that comes again is numbered."""
    made = []
    for title in re.findall(r"^#+ (.+)$", prose(path), re.M):
        name = re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-")
        made.append(f"{name}-{made.count(name)}" if name in made else name)
    return made


@pytest.mark.parametrize("page", [*MARKDOWN, *NOTEBOOKS])
def test_a_page_reads_on_a_code_host_as_it_is(page):
    """Links and images resolve; what only the site understands would stand there as raw text."""
    text = (ROOT / page).read_text(encoding="utf-8") if page in MARKDOWN else prose(ROOT / page)
    raw = r"^[`:]{3,}\s*\{.*|^:::.*|\{(?:eq|ref|doc|numref|math|py:\w+)\}`|^\(\w+\)=$|^\$\$ ?\(.*"
    assert not re.findall(raw, text, re.M)
    text = re.sub(r"`[^`\n]*`", "", prose(ROOT / page))
    assert not re.findall(r"<(?:img|a) |\]\[", text), "write links and images as [text](target)"
    for title, target in re.findall(r"\[([^\[\]]*)\]\(([^()\s]+)\)", text):
        assert title, f"{target} is linked without a text: a code host shows nothing"
        if re.match(r"https?://|mailto:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (ROOT / page).parent / name if name else ROOT / page
        assert path.exists(), f"{page}: {target} is not there"
        if anchor:
            assert anchor in anchors(path), f"{page}: {target} has no such heading"


@pytest.mark.parametrize("page", [page for page in MARKDOWN if "CHANGELOG" not in page])
def test_names_of_the_package_on_a_page_exist(page):
    for name in set(re.findall(r"\bdfc((?:\.[A-Za-z_]\w*)+)", (ROOT / page).read_text("utf-8"))):
        operator.attrgetter(name[1:])(dfc)


def test_every_page_with_code_is_run():
    with_code = {page for page in MARKDOWN if "```python" in (ROOT / page).read_text("utf-8")}
    assert with_code <= {*PAGES}


@pytest.fixture
def bench(page, tmp_path, monkeypatch):
    """A folder with a measured `run.csv`: the pages' axis, and a spring nobody told us of."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "docs" / "data", tmp_path / "docs" / "data")
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: None)
    machine = dfc.FrictionAxis(
        mass=2.0, viscous=15.0, coulomb=8.0,
        stribeck=None if page == "README.md" else dfc.Stribeck(excess=0.3, speed=0.01),
        effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),),
    )  # fmt: skip
    t = 2e-3 * np.arange(3000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=2e-3).y[0])
    np.savetxt(
        tmp_path / "run.csv", np.column_stack([1e3 * t, u, 1e3 * x]), fmt="%.6f", delimiter=",",
        header="t [ms],u [N],pos [mm]", comments="",
    )  # fmt: skip
    # The diagnosis of the README tries the whole catalogue, those of other pages some causes.
    some = "spring", "gravity", "bias_force", "stribeck"
    with nullcontext() if page == "README.md" else among(*some):
        yield tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_code_of_the_pages_runs(page, bench):
    """Blocks of one page in turn: plain code is run, a transcript is compared as well."""
    if page in ("docs/howto/fmu.md", "docs/howto/add_effect.md"):
        pytest.importorskip("fmpy", reason="no fmpy: FMUs are neither built nor run")
        if shutil.which("gcc") is None:
            pytest.skip("no gcc: FMUs are not built")
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.S | re.M)
    # As in a script; numba would write all globals of nameless code into its cache.
    space = {"__name__": "__main__"}
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    for i, block in enumerate(blocks):
        if block.startswith(">>>"):
            test = doctest.DocTestParser().get_doctest(block, space, f"{page}[{i}]", page, 0)
            runner.run(test, clear_globs=False)
            space = test.globs
        else:
            # In a file: numba keeps the compiled law of an effect beside its source.
            path = bench / f"block{i}.py"
            path.write_text(block)
            exec(compile(block, str(path), "exec"), space)
    assert runner.summarize(verbose=False).failed == 0


@pytest.mark.parametrize("page", NOTEBOOKS)
def test_notebooks_are_stored_with_small_outputs_of_no_machine(page):
    """``python docs/store_notebooks.py`` writes them."""
    path = ROOT / page
    assert path.stat().st_size < 250_000
    cells = [cell for cell in json.loads(path.read_text("utf-8"))["cells"] if "outputs" in cell]
    assert all(cell["execution_count"] for cell in cells), "not run from top to bottom"
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    words = json.dumps([one.get("text", one.get("data", {}).get("text/plain")) for one in outputs])
    assert not re.findall(r"/(?:home|root|tmp|work|usr|Users)/|step/s|it/s", words)


def test_pages_that_messages_name_exist():
    text = "".join(path.read_text() for path in Path(dfc.__file__).parent.rglob("*.py"))
    pages = set(re.findall(r'\bpage_reference\("([^"]+)"\)', text))
    assert "howto/read_csv" in pages
    assert not [page for page in pages if not (ROOT / "docs" / f"{page}.md").exists()]
