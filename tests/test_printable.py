"""Text from other programs contains no terminal control code and no extra line."""

import unicodedata

from hypothesis import given, strategies as st

from baqueano.drive.manual import screen
from baqueano.messages.printable import join_rows, one_line, printable, printable_json

DANGEROUS = "\x1b\x07\r\b\x7f\x9b\x85\u200e\u202e\u2066\u2028\u2029\ufeff\ud800\x00"


def test_control_characters_are_printed_as_escape_codes():
    assert printable("a\x1b[2Jb") == r"a\x1b[2Jb"
    for c in DANGEROUS:
        assert c not in printable(f"a{c}b")
        assert printable(f"a{c}b").startswith("a\\")


def test_letters_signs_and_tables_are_printed_unchanged():
    for text in ("Núñez, η ν̇ ≤ 0.1 m/s², 漢字 🤖", "a\n  b\tc", "12\u202f000\u00a0km"):
        assert printable(text) == text


def test_a_table_has_one_line_for_each_row():
    assert join_rows(["READY\nbaqueano: forged", "a"]) == "READY baqueano: forged\na"


@given(st.text())
def test_printable_text_contains_no_control_character(text):
    line = one_line(text)
    assert not {unicodedata.category(c) for c in line} & {"Cc", "Cf", "Cs", "Zl", "Zp"}
    assert printable(line) == line
    assert text != text.strip() or not text.isprintable() or line == text


@given(
    st.recursive(st.none() | st.integers() | st.text(), lambda x: st.lists(x) | st.dictionaries(st.text(), x))
)
def test_printable_json_contains_no_control_character(data):
    def texts(value):
        if isinstance(value, dict):
            yield from value
            value = list(value.values())
        for element in value if isinstance(value, list) else ():
            yield from texts(element)
        if isinstance(value, str):
            yield value

    assert all(one_line(text) == text for text in texts(printable_json(data)))


def test_the_display_of_a_drive_contains_no_external_control_character():
    rows = screen.status_lines(screen.Status("r\x1b[2J1", state="\x9bREADY", reason="\nforged\x07"))
    assert all(one_line(row) == row for row in rows)
    assert any("r\\x1b[2J1" in row for row in rows)
