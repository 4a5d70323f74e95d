"""Which code a result depends on: all that is imported, and nothing else."""

import grimp
import pytest

from sim.experiment.cells import SweepError
from sim.experiment.sweep_sources import digest_of_sources, files_reached


@pytest.fixture(scope="module")
def graph():
    return grimp.build_graph("autonomy", "sim")


def reached_by(graph, module):
    """The modules that run when `module` is imported: those it imports, and the packages around them."""
    found, waiting = set(), {module}
    while waiting:
        name = waiting.pop()
        found.add(name)
        around = {name.rpartition(".")[0]} - {""}
        waiting |= (graph.find_modules_directly_imported_by(name) | around) - found
    return found


@pytest.mark.parametrize("module", ["sim.discrete", "autonomy.learning.fitting"])
def test_another_reader_of_imports_finds_the_same(graph, module):
    """It knows of no compiled modules."""
    assert set(files_reached(module)) - {"autonomy.learning._compiled"} == reached_by(graph, module)


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A package whose module `a` imports `b` in every way there is, and not `c`."""
    package = tmp_path / "surveyors"
    package.mkdir()
    for name, text in {
        "__init__": "",
        "a": "def f(x):\n    from surveyors import d\n    from . import b\n",
        "b": "import surveyors.e as e\n",
        "c": "import surveyors.a\n",
        "d": "",
        "e": "import numpy\n",
    }.items():
        (package / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return package


@pytest.mark.parametrize(
    ("changed", "matters"), [("b", True), ("d", True), ("e", True), ("__init__", True), ("c", False)]
)
def test_a_change_counts_if_it_can_be_reached(project, changed, matters):
    before = digest_of_sources("surveyors.a")
    assert digest_of_sources("surveyors.a") == before
    with (project / f"{changed}.py").open("a") as file:
        file.write("# a change\n")
    assert (digest_of_sources("surveyors.a") != before) is matters


def test_a_module_that_is_missing_is_told():
    with pytest.raises(SweepError, match="no_such_module"):
        digest_of_sources("no_such_module.inner")
