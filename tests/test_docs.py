"""What the documents say is what the code does."""

import re
from pathlib import Path

from baqueano.vehicle_file.reference import reference_table

ROOT = Path(__file__).parents[1]


def test_reference_of_the_vehicle_file_is_the_one_the_code_gives():
    """To renew it: write reference_table() into docs/vehicle-file.md, and read the diff."""
    assert (ROOT / "docs/vehicle-file.md").read_text(encoding="utf-8").strip() == reference_table().strip()


def test_the_ten_lines_of_the_readme_run_and_say_what_they_found(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = (
        re.findall(r"```python\n(.*?)```", readme, re.DOTALL)[0]
        .replace("60.0", "20.0")
        .replace("laps=3", "laps=1")
    )
    exec(compile(lines, "README.md", "exec"), {})
    said = capsys.readouterr().out
    assert "friction.linear[0]" in said
    assert "across its reference" in said
