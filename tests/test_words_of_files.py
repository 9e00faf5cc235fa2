"""Options, shipped files, C and JavaScript have plain names and comments, as test_words.py defines them."""

import re

from baqueano.parameter import ROLES
from tests.cli.test_in_spanish import helps
from tests.test_words import ADVERBS, DOCS, OLD, SAYING, SOURCE, USUAL, VERBS, words_of


def test_no_option_and_no_role_of_a_parameter_is_a_verb_of_saying_or_an_adverb():
    options = {
        name.lstrip("-").replace("-", "_")
        for _, command in helps()
        for param in command.params
        for name in (*param.opts, *param.secondary_opts)
    }
    names = [
        name
        for name in {*options, *ROLES} - USUAL - {"held_out", "with"}
        if VERBS.intersection(words_of(name)) or ADVERBS.fullmatch(name)
    ]
    assert not names, f"name what it gives: {sorted(names)}"


def test_comments_of_shipped_files_are_in_plain_language():
    """The files of the garage, of `new`, of the maps, of the examples, and of the robot."""
    files = [path for folder in (SOURCE, DOCS / "examples") for path in folder.rglob("*.toml")]
    files += [
        path
        for path in (SOURCE / "robot" / "files").glob("*")
        if path.suffix in (".service", ".sh", ".rules")
    ]
    for path in files:
        comments = re.findall(r"(?:^|\s)# ?(.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
        old = [comment for comment in comments if OLD.search(comment) or SAYING.search(comment)]
        assert not old, f"{path.name}: use a term of the field: {old}"
    assert len(files) > 15


def test_no_name_or_comment_in_c_or_javascript_contains_a_verb_of_saying():
    paths = [
        path
        for folder in (SOURCE / "web", DOCS / "docs", DOCS / "firmware")
        for path in folder.rglob("*")
        if path.suffix in (".js", ".c", ".h", ".ino")
    ]
    names = {
        f"{path.relative_to(DOCS)}: {word}"
        for path in paths
        for word in re.findall(r"[A-Za-z_]\w*", path.read_text(encoding="utf-8"))
        if VERBS.intersection(words_of(word))
    }
    assert len(paths) > 30
    assert not names, f"name what it holds: {sorted(names)}"
