"""Command lines made of verbs."""

import sys
import textwrap

import pytest

from autonomy.verbs import Verb, run_verb

VERBS = {"sing": Verb("a_song_module", "sing a song"), "missing": Verb("no_such_module", "never imported")}


@pytest.fixture(autouse=True)
def song(tmp_path, monkeypatch):
    (tmp_path / "a_song_module.py").write_text(
        textwrap.dedent(
            """
            def add_arguments(parser):
                parser.add_argument("title")
                parser.add_argument("--loud", action="store_true")

            def run(arguments):
                print(arguments.title.upper() if arguments.loud else arguments.title)
                return 3
            """
        )
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("a_song_module", None)


def run(*words):
    return run_verb("prog", "what it is about", VERBS, words)


def test_a_verb_gets_its_arguments_and_its_code_is_ours(capsys):
    assert run("sing", "la", "--loud") == 3
    assert capsys.readouterr().out == "LA\n"


def test_help_names_every_verb_and_imports_none(capsys):
    with pytest.raises(SystemExit, match="0"):
        run("--help")
    out = capsys.readouterr().out
    assert "sing a song" in out
    assert "never imported" in out
    assert "a_song_module" not in sys.modules


def test_help_of_a_verb(capsys):
    with pytest.raises(SystemExit, match="0"):
        run("sing", "--help")
    assert "usage: prog sing" in capsys.readouterr().out


@pytest.mark.parametrize("words", [(), ("dance",), ("sing",), ("sing", "la", "--quiet"), ("--loud", "sing")])
def test_usage_mistakes_exit_with_2(words, capsys):
    with pytest.raises(SystemExit, match="2"):
        run(*words)
    assert "usage: prog" in capsys.readouterr().err


def test_version(capsys):
    with pytest.raises(SystemExit, match="0"):
        run("--version")
    assert capsys.readouterr().out.startswith("halocline ")


def test_a_module_that_is_missing_is_a_bug_and_says_so():
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        run("missing")
