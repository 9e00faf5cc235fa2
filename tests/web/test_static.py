"""The files of the page, without a browser: small scripts, all texts in both languages."""

import json
import re
from pathlib import Path

import pytest

from baqueano.drive.mission import KINDS as MISSION_KINDS
from baqueano.guides.shapes import SHAPE_NAMES
from baqueano.web.http import static_files

STATIC = Path(__file__).parents[2] / "src" / "baqueano" / "web" / "static"
SCRIPTS = sorted(STATIC.glob("*.js"))
STYLES = sorted(STATIC.glob("*.css"))
JAVASCRIPT_KB = 120
WIRE_KB = 49  # of all scripts, as a browser gets them
LITERAL = re.compile(r'"([a-z][\w-]*(?:\.[\w-]+)*)"')
MADE = re.compile(r"`([a-z][\w-]*\.(?:[\w]+-)?)\$\{")  # t(`state.${name}`)
CALL_KEY = re.compile(r'\bt\("([^"]+)"')
WORD_FOR = re.compile(r'\bwordFor\("(\w+)"')  # wordFor("kind", name) needs kind.…
TEXT_KEY = re.compile(r' data-(?:t|label|title)="([^"]+)"')  # of an element of the document


def texts(language: str) -> dict[str, str]:
    return json.loads((STATIC / f"{language}.json").read_text(encoding="utf-8"))


def document() -> str:
    return (STATIC / "index.html").read_text(encoding="utf-8")


def source() -> str:
    return "\n".join(path.read_text(encoding="utf-8") for path in SCRIPTS)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_a_script_module_imports_only_existing_files_of_its_folder(path):
    for name in re.findall(r'from "([^"]+)"', path.read_text(encoding="utf-8")):
        assert name.startswith("./")
        assert (STATIC / name).is_file(), name


@pytest.mark.parametrize("language", ["en", "es"])
def test_each_shape_of_a_lap_and_each_kind_of_run_has_a_name(language):
    assert {f"shape.{name}" for name in SHAPE_NAMES} <= set(texts(language))
    assert {f"kind.{kind}" for kind in (*MISSION_KINDS, "simulate", "replay", "import")} <= set(
        texts(language)
    )


def test_the_list_of_keys_contains_a_digit_for_each_screen():
    screens = len(set(texts("en")) & {f"tab.{path.stem}" for path in SCRIPTS})
    assert f"<kbd>1</kbd>…<kbd>{screens}</kbd>" in document()


def test_the_scripts_are_small():
    assert sum(path.stat().st_size for path in SCRIPTS) <= JAVASCRIPT_KB * 1000
    assets = static_files(STATIC)
    assert sum(len(assets[f"/static/{path.name}"].gzip_bytes) for path in SCRIPTS) <= WIRE_KB * 1000


def test_the_html_document_contains_no_inline_script_or_style():
    assert not re.search(r"\sstyle=|\son\w+=|<style|<script(?![^>]*\ssrc=)", document())
    for address in re.findall(r'(?:src|href)="([^"]+)"', document()):
        assert (STATIC / address.removeprefix("/static/")).is_file(), address


def test_both_languages_have_the_same_texts_with_the_same_placeholders():
    english, spanish = texts("en"), texts("es")
    assert list(english) == list(spanish)
    for key, text in english.items():
        places = re.findall(r"\{\w+\}", text)
        assert sorted(places) == sorted(re.findall(r"\{\w+\}", spanish[key])), key
        assert bool(text) == bool(spanish[key]), key


def test_every_requested_text_exists():
    keys_used = set(CALL_KEY.findall(source())) | set(TEXT_KEY.findall(document()))
    assert keys_used <= set(texts("en"))


def test_every_text_is_used():
    script = source()
    literal = set(LITERAL.findall(script)) | set(TEXT_KEY.findall(document()))
    patterns = (*MADE.findall(script), *(f"{key}." for key in WORD_FOR.findall(script)))
    unused_keys = [key for key in texts("en") if key not in literal and not key.startswith(patterns)]
    assert not unused_keys


def test_spanish_texts_differ_from_english_except_names():
    english, spanish = texts("en"), texts("es")
    untranslated_keys = {key for key, text in english.items() if text and text == spanish[key]}
    assert untranslated_keys <= {
        "world.real",
        "drive.manual",
        "block.supervisor",
        "drive.pace-is",
        "identify.bits",
        "identify.rate",
    }


@pytest.mark.parametrize("path", STYLES, ids=lambda path: path.name)
def test_a_style_sheet_loads_no_resource(path):
    assert not re.search(r"@import|@font-face|url\(", path.read_text(encoding="utf-8"))


def test_both_dark_theme_rules_have_the_same_colours():
    style = (STATIC / "page.css").read_text(encoding="utf-8")
    dark_rules = re.search(r':root:not\(\[data-theme="light"\]\) \{(.*?)\}', style, re.DOTALL)
    light_rules = re.search(r':root\[data-theme="dark"\] \{(.*?)\}', style, re.DOTALL)
    assert dark_rules
    assert light_rules
    assert dark_rules[1].split() == light_rules[1].split()
    light = re.search(r":root \{(.*?)\}", style, re.DOTALL)
    assert light
    assert set(re.findall(r"--[\w-]+:", light_rules[1])) <= set(re.findall(r"--[\w-]+:", light[1]))
