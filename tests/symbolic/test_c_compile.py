"""The cache of libraries: a loaded library is always complete. A missing compiler is reported."""

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from baqueano.diagnostics import fault
from baqueano.symbolic.c_code import compile
from tests.codes import refused

pytestmark = pytest.mark.skipif(compile.find_compiler().compiler is None, reason="no C compiler")

EXPORT = "#ifdef _WIN32\n__declspec(dllexport)\n#endif\n"
SCRIPT = """
import sys
from baqueano.symbolic.c_code import compile
library = compile.load_library((), lambda: (open(sys.argv[1], encoding="utf-8").read(), 0))
print(library.answer())
"""


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    """Return an empty cache in a home folder with a realistic name."""
    compile.find_compiler()  # its probe is not a library of the package
    home = tmp_path / "José Ñandú (casa)"
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "HOME"):
        monkeypatch.setenv(name, str(home))
    monkeypatch.setattr(compile, "_libraries", {})
    return compile._cache_folder()


def answer(number: int) -> str:
    return f"{EXPORT}int answer(void) {{ return {number}; }}\n"


def load(source: str, operation_count: int = 0, is_quick: bool = False) -> ctypes.CDLL:
    return compile.load_library((source,), lambda: (source, operation_count), is_quick=is_quick)


def libraries(cache: Path) -> list[Path]:
    return sorted(cache.rglob("*" + compile.LIBRARY_SUFFIX))


def test_a_library_is_cached_in_a_folder_with_spaces_and_accents(cache):
    assert load(answer(41)).answer() == 41
    assert len(libraries(cache)) == 1
    before = libraries(cache)[0].stat().st_mtime_ns
    compile._libraries.clear()
    assert load(answer(41)).answer() == 41
    assert libraries(cache)[0].stat().st_mtime_ns == before


def test_a_different_source_gives_a_different_library(cache):
    assert load(answer(1)).answer() == 1
    assert load(answer(2)).answer() == 2
    assert len(libraries(cache)) == 2


@pytest.mark.parametrize(
    ("name", "count"), [("LONG_LEVEL", 10**6), ("QUICK_LEVEL", 5000), ("QUICK_SCALAR_LEVEL", 5000)]
)
def test_a_different_optimisation_gives_a_different_library(cache, monkeypatch, name, count):
    """A program must not load a library that was compiled with another level."""
    for level in ("-O0", "-O1"):
        monkeypatch.setattr(compile, name, (level,))
        assert load(answer(1), count, is_quick=True).answer() == 1
    assert len(libraries(cache)) == 2


@pytest.mark.parametrize("damage", [b"", b"not a library", None])
def test_a_damaged_library_is_built_again(cache, damage):
    load(answer(42))
    path = libraries(cache)[0]
    data = path.read_bytes()
    path.unlink()  # the old one stays mapped
    path.write_bytes(data[: len(data) // 2] if damage is None else damage)
    compile._libraries.clear()
    assert load(answer(42)).answer() == 42
    assert [p.stat().st_size > 1000 for p in libraries(cache)] == [True]


def test_two_processes_can_build_the_same_library_at_once(cache, tmp_path):
    text = tmp_path / "answer.c"
    text.write_text(answer(43), encoding="utf-8")
    command = [sys.executable, "-c", SCRIPT, str(text)]
    processes = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)
    ]
    for process in processes:
        output, errors = process.communicate(timeout=120)
        assert output.strip() == "43", errors
    assert not list(cache.rglob("kernel.c"))


@pytest.mark.skipif(sys.platform == "win32", reason="a file in the place of a folder stops Windows elsewhere")
def test_compilation_works_without_a_writable_cache(cache):
    cache.parent.mkdir(parents=True)
    cache.write_text("a file where the folder should be")
    assert load(answer(44)).answer() == 44


def test_invalid_c_source_is_an_error_that_quotes_the_compiler(cache):
    with refused("compiler.refuses", compile.CompileError):
        load("int answer(void) { return nonsense; }\n")


def test_a_missing_compiler_is_reported_with_the_install_command(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("BAQUEANO_CC", raising=False)
    monkeypatch.setattr(compile.importlib.util, "find_spec", lambda name: None)
    compile._find.cache_clear()
    search = compile.find_compiler()
    assert search.compiler is None
    assert search.reason == fault("compiler.absent", "pip install ziglang")
    with refused("compiler.absent", compile.CompileError):
        load(answer(45))
    compile._find.cache_clear()


def test_a_configured_but_missing_compiler_is_reported_by_name(monkeypatch):
    monkeypatch.setenv("BAQUEANO_CC", "no-such-compiler --fast")
    search = compile.find_compiler()
    assert search.compiler is None
    assert search.reason == fault("compiler.no-command", value="no-such-compiler --fast")


def test_the_message_of_a_failing_compiler_is_quoted(monkeypatch, cache):
    monkeypatch.setenv("BAQUEANO_CC", f"{sys.executable} -c 'import sys; sys.exit(\"out of order\")'")
    search = compile.find_compiler()
    assert search.compiler is None
    assert (search.reason.code, search.reason.figures["error"].strip()) == (
        "compiler.refuses",
        "out of order",
    )


def test_a_library_that_cannot_be_loaded_is_a_compile_error(monkeypatch, cache):
    def fail_build(folder, *_):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "damaged").write_text("not a library")
        return folder / "damaged"

    compile.find_compiler()
    monkeypatch.setattr(compile, "_build", fail_build)
    with refused("compiler.no-library", compile.CompileError):
        load(answer(48))


def test_flags_that_a_compiler_refuses_are_omitted(monkeypatch, cache):
    flag_sets = compile._flag_sets

    def with_refused_flags(*arguments):
        first, *remaining = flag_sets(*arguments)
        return [(*first, "-march=no-such-processor"), *remaining]

    monkeypatch.setattr(compile, "_flag_sets", with_refused_flags)
    assert load(answer(46)).answer() == 46


@pytest.mark.parametrize(("machine", "is_whole"), [("x86_64", True), ("AMD64", True), ("aarch64", False)])
def test_only_batches_on_x86_use_whole_vectors(monkeypatch, machine, is_whole):
    monkeypatch.setattr(compile.platform, "machine", lambda: machine)
    compiler = compile.find_compiler().compiler
    batch, single = (compile._flag_sets(compiler, 10, find_vectors, False) for find_vectors in (True, False))
    assert [compile.WHOLE_VECTORS in flags for flags in batch] == [True] * is_whole + [False] * 3
    assert "-march=native" in batch[is_whole]  # also for a compiler that refuses the flag
    assert not any(compile.WHOLE_VECTORS in flags for flags in single)


def test_fast_math_is_never_enabled():
    compiler = compile.find_compiler().compiler
    assert compiler is not None
    for operations in (10, 10_000, 100_000):
        for flags in compile._flag_sets(compiler, operations, find_vectors=True, is_quick=False):
            assert not {"-ffast-math", "-Ofast", "-funsafe-math-optimizations"} & set(flags)


def test_loading_a_library_does_not_disable_subnormal_numbers(cache):
    load(answer(47))
    assert 1e-310 * 0.5 == 5e-311
