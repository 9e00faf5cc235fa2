"""One wheel that pip installs without other files, with all its data, and that works."""

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(out), str(ROOT)]
    result = subprocess.run(build, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return next(out.glob("*.whl"))


def test_the_wheel_contains_every_data_file_and_no_test(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    for path in (ROOT / "src").rglob("*"):
        if path.suffix in {".toml", ".jinja", ".h", ".hex", ".typed"}:
            assert path.relative_to(ROOT / "src").as_posix() in names
    assert not [name for name in names if name.startswith("tests/")]


def test_su4_the_wheel_installs_offline_and_works_outside_the_repository(wheel, tmp_path):
    """The test has only the dependencies of this environment, not a network; the package comes from the wheel."""
    venv.create(tmp_path / "env", system_site_packages=False, with_pip=False, symlinks=os.name != "nt")
    scripts = tmp_path / "env" / ("Scripts" if sys.platform == "win32" else "bin")
    python = next(scripts.glob("python*"))
    target = tmp_path / "site"
    options = ["-q", "--no-deps", "--no-index", "--target", str(target), str(wheel)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options], check=True, capture_output=True)
    libraries = next(Path(p) for p in sys.path if p.endswith("site-packages"))
    code = (
        f"import sys; sys.path[:0] = [{str(target)!r}]; sys.path.append({str(libraries)!r}); import baqueano; "
        f"assert baqueano.__file__.startswith({str(target)!r}); from baqueano.cli import main; "
        "main(['simulate', '--vehicle', 'small', '--seconds', '2', '-o', 'a.mcap'])"
    )
    result = subprocess.run([python, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "a.mcap").stat().st_size > 1000
