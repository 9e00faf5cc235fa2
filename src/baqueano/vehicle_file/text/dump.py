"""Convert tables to TOML text: with tomlkit if tomlkit read them, else in a plain format without comments."""

import json
from collections.abc import Mapping
from datetime import date
from typing import Any


def dump(document: Any) -> str:
    """Return the TOML text of a document: a tomlkit document or a dict of tables."""
    if hasattr(document, "as_string"):
        return document.as_string()
    return "\n".join(_lines(document, ())).strip("\n") + "\n"


def _lines(table: Mapping[str, object], path: tuple[str, ...]) -> list[str]:
    own_values = {k: v for k, v in table.items() if not isinstance(v, Mapping)}
    subtables = {k: v for k, v in table.items() if isinstance(v, Mapping)}
    lines = ["", f"[{'.'.join(map(_key, path))}]"] if path and (own_values or not subtables) else []
    lines += [f"{_key(k)} = {_value(v)}" for k, v in own_values.items()]
    for name, value in subtables.items():
        lines += _lines(value, (*path, name))
    return lines


def _key(name: str) -> str:
    letters = name.replace("_", "").replace("-", "")
    return name if letters.isascii() and letters.isalnum() else json.dumps(name, ensure_ascii=False)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list):
        rows = any(isinstance(v, list) for v in value)
        texts = [_value(v) for v in value]
        return "[\n" + "".join(f"  {v},\n" for v in texts) + "]" if rows else "[" + ", ".join(texts) + "]"
    return value.isoformat() if isinstance(value, date) else repr(value)
