"""The current language, and that each other language has all entries, none of them fuzzy or with other placeholders."""

import errno
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from babel.messages import Catalog

from baqueano.diagnostics import Diagnostic, fault
from baqueano.messages import language, text
from baqueano.messages.language import LANGUAGES, current_language, number, translate
from baqueano.messages.text_table import text_table, with_remark
from docs.site.reference import catalogue_file
from tests.catalogues import compiled, differs, faults, places, read_catalogue, required_reference

OTHERS = [language for language in LANGUAGES if language != "en"]


@pytest.fixture(autouse=True)
def _undone(monkeypatch):
    for name in ("BAQUEANO_LANG", "LC_ALL", "LC_MESSAGES", "LANG", "LANGUAGE"):
        monkeypatch.delenv(name, raising=False)
    yield
    language.choose_language("")


@pytest.mark.parametrize("language", OTHERS)
def test_a_catalogue_is_complete_and_compiled(language):
    catalogue = read_catalogue(language)
    assert not faults(catalogue), "type: make catalogues, and translate what it lists"
    assert places(language)[1].read_bytes() == compiled(catalogue), "type: make catalogues"


@pytest.mark.parametrize("language", OTHERS)
def test_the_reference_of_the_front_door_is_completely_translated(language):
    assert not faults(read_catalogue(language, catalogue_file(language)), required_reference()), (
        "type: make catalogues, and translate what it lists"
    )


@pytest.mark.parametrize(
    ("translation", "flags", "fault_name"),
    [
        (None, (), "missing"),
        ("", (), "missing"),
        ("{laps} vueltas", ("fuzzy",), "fuzzy"),
        ("{vueltas} vueltas", (), "placeholders"),
    ],
)
def test_a_missing_superfluous_fuzzy_or_different_entry_is_a_fault(translation, flags, fault_name):
    entries, catalogue = Catalog(), Catalog(locale="es")
    entries.add("{laps} laps", context="lap.count")
    if translation is not None:
        catalogue.add("{laps} laps", translation, context="lap.count", flags=flags)
    (failure,) = faults(catalogue, entries)
    assert failure.startswith(f"{fault_name}: lap.count '{{laps}} laps'")
    complete = Catalog(locale="es")
    complete.add("{laps} laps", "{laps} vueltas", context="lap.count")
    assert faults(complete, entries) == []
    assert faults(complete, Catalog()) == ["superfluous: lap.count '{laps} laps'"]


@pytest.mark.parametrize(
    ("english", "translation"),
    [("{x:.1f} m", "{y:.1f} m"), ("{arg[use]:{sensor}}", "{arg[use]}"), ("{a}", "a")],
)
def test_different_placeholders_of_a_translation_are_reported(english, translation):
    assert differs(english, translation)
    assert differs(english, english) is None


def test_command_line_variable_and_locale_set_the_language_in_this_order(monkeypatch):
    assert current_language() == "en"
    monkeypatch.setenv("LANG", "es_AR.UTF-8")
    assert current_language() == "es"
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    assert current_language() == "en"
    monkeypatch.setenv("BAQUEANO_LANG", "es")
    assert current_language() == "es"
    language.choose_language("en")
    assert current_language() == "en"


def test_a_sentence_is_spanish_and_its_numbers_have_a_decimal_comma():
    note = fault("vehicle.setting", setting="x")
    tilt_diagnostic = Diagnostic("vehicle.tilt", figures={"tilt_deg": 12.0, "max_tilt_rad": 0.5})
    english = text(note), text(tilt_diagnostic)
    language.choose_language("es")
    assert text(note) != english[0]
    assert text(tilt_diagnostic) == "el vehículo está inclinado 12°: max_tilt_rad es 0,5"
    language.choose_language("en")
    assert (text(note), text(tilt_diagnostic)) == english


@pytest.mark.parametrize(
    ("value", "spec", "text_written"),
    [(0.25, ".2f", "0,25"), (1234567, ",", "1\xa0234\xa0567"), (1.5e-7, ".1e", "1,5e-07"), (True, "", "True"),
     ("0.25", "", "0.25"), (float("nan"), ".1f", "nan")],
)  # fmt: skip
def test_numbers_are_written_as_in_spanish(value, spec, text_written):
    language.choose_language("es")
    assert f"{number(value):{spec}}" == text_written
    assert f"{number([value])[0]:{spec}}" == text_written


@pytest.mark.parametrize(
    "number_of_error", [errno.ENOSPC, errno.EACCES, errno.EROFS, errno.EISDIR, errno.EFBIG]
)
def test_an_error_of_the_operating_system_is_spanish(number_of_error):
    words = os.strerror(number_of_error)
    language.choose_language("es")
    assert words not in text(fault("runs.not-read", path="a", error=words))


def test_a_text_without_a_translation_stays_english():
    language.choose_language("es")
    assert translate("a sentence of tomorrow", "no.code") == "a sentence of tomorrow"
    assert translate("") == ""


def test_the_command_line_prints_spanish():
    def output_of(*args, **environment):
        end = subprocess.run(
            [sys.executable, "-m", "baqueano", *args], capture_output=True, encoding="utf-8",
            env={**os.environ, "PYTHONIOENCODING": "utf-8", **environment},
        )  # fmt: skip
        return end.stdout + end.stderr

    assert "Muestra este mensaje y termina." in output_of("compare", "--help", "--lang", "es")
    assert "Uso: baqueano" in output_of("--help", BAQUEANO_LANG="es")
    assert "Usage: baqueano" in output_of("--lang=en", "--help", BAQUEANO_LANG="es")
    assert "'fr' is not one of" in output_of("--lang", "fr", "compare")
    assert "variable BAQUEANO_LANG is fr" in output_of("blocks", "ls", BAQUEANO_LANG="fr")


def test_the_columns_of_a_table_are_as_wide_as_their_widest_cell():
    lines = text_table(
        "<>>", ["fault", "wrong", "not refused"], ["slip", "12", "0"], ["a lost sign", "3", "1"]
    )
    assert lines == [
        "fault        wrong  not refused",
        "slip            12            0",
        "a lost sign      3            1",
    ]
    with pytest.raises(ValueError, match="shorter"):
        text_table("<>", ["fault", "wrong"], ["slip"])


def test_a_heading_is_divided_only_in_a_table_that_is_wider_than_80_columns():
    name = "drivetrain.dead_zone_backward[0] of the rear axle"
    head, row = ["parámetro", "valor verdadero", "veredicto"], [name, "0,3401", "inconsistente"]
    first, second, *lines = text_table("<><", head, row)
    assert (first.split(), second.split()) == (["valor"], ["parámetro", "verdadero", "veredicto"])
    assert max(map(len, (first, second, *lines))) <= 80
    assert len(text_table("<><", head, ["a short name", *row[1:]])) == 2


@pytest.mark.parametrize(
    "first_column", ["ok", "a name of sixty letters that leaves no place for a second column"]
)
def test_words_beyond_80_columns_are_wrapped_in_the_last_column(first_column):
    sentence = (
        "the serial line of an Uno was not found, so neither its firmware nor its battery can be checked here"
    )
    head, first, *lines = text_table("<<", ["", "result"], [first_column, sentence])
    assert max(map(len, (head, first, *lines))) <= 80
    assert " ".join(" ".join([first, *lines]).split()) == f"{first_column} {sentence}"


def test_a_key_with_its_value_and_a_command_stay_in_one_line():
    key, command = 'unit = "deg/s"', "baqueano robot setup pilot@rover.local"
    advice = f"this sensor turns faster than a small vehicle can turn, so write {key} there or type {command}"
    for shift in range(20):
        table_text = "\n".join(text_table("<<", ["info", "x" * shift + " " + advice.replace("@", "-")]))
        assert key in table_text
        assert command.replace("@", "-") in table_text


def test_no_translated_text_has_a_fixed_width():
    """A Spanish word is often longer than the English word, so it would touch the next column."""
    fixed_width = re.compile(r"\{_\([^{}]*\):[<>^]?[0-9]")
    sources = Path(language.__file__).parents[1].rglob("*.py")
    assert [path.name for path in sources if fixed_width.search(path.read_text(encoding="utf-8"))] == []


def test_a_remark_that_is_too_long_for_its_line_stands_below_it():
    assert with_remark("drag  3.2", "may be 0") == ["drag  3.2  (may be 0)"]
    assert with_remark("drag" + 70 * " " + "3.2", "may be 0") == ["drag" + 70 * " " + "3.2", "    (may be 0)"]
    assert with_remark("drag  3.2", "") == ["drag  3.2"]
