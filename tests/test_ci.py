"""In the public workflow a skipped test fails, except for the reasons that tests/conftest.py lists, and pictures of the
screens are stored.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = """
import pytest

@pytest.mark.skipif(True, reason="needs chromium")
def test_marked(): ...

def test_called():
    pytest.skip("this systemd-analyze judges no file")

@pytest.mark.skipif(True, reason="recordings of the CPM Lab")
def test_without_recordings(): ...

@pytest.mark.xfail(strict=True)
def test_known(): assert False

def test_run(): ...
"""
MODULE = "import pytest; pytest.importorskip('no_such_package')"
OUTCOMES = {"": "1 passed, 4 skipped, 1 xfailed", "1": "1 failed, 1 passed, 1 skipped, 1 xfailed, 2 errors"}


@pytest.mark.skipif(sys.platform != "linux", reason="other systems skip tests of Linux")
@pytest.mark.parametrize("no_skips", OUTCOMES)
def test_a_skipped_test_fails_in_ci(tmp_path, no_skips):
    (tmp_path / "test_cases.py").write_text(TESTS, encoding="utf-8")
    (tmp_path / "test_module.py").write_text(MODULE, encoding="utf-8")
    (tmp_path / "pytest.ini").touch()
    options = ("-q", "-p", "tests.conftest", "-p", "no:cacheprovider", "--continue-on-collection-errors")
    result = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "-c", str(tmp_path / "pytest.ini"), str(tmp_path)],
        capture_output=True, text=True, cwd=Path(__file__).parents[1], env=os.environ | {"BAQUEANO_NO_SKIPS": no_skips},
    )  # fmt: skip
    assert result.stdout.splitlines()[-1].startswith(OUTCOMES[no_skips]), result.stdout + result.stderr
    assert result.returncode == bool(no_skips)


def test_the_pictures_of_all_screens_are_stored_by_ci():
    workflow = (Path(__file__).parents[1] / ".github/workflows/tests.yml").read_text(encoding="utf-8")
    job = workflow[workflow.index("\n  all:") : workflow.index("\n  docs:")]
    (folder,) = re.findall(r"BAQUEANO_SHOTS: \$\{\{ github.workspace \}\}/(\S+)", job)
    upload_step = job[job.index("uses: actions/upload-artifact") :]
    assert f"path: {folder}\n" in upload_step
    assert "if: always()" in upload_step  # above all if a test has failed
