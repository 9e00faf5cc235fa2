"""Compile C code to a loaded library: find a compiler, choose its flags, store the result.

A library is stored in the user's cache folder under the hash of everything that it depends on: program, modules that
generate code, optimisation, compiler, processor. So the code of a stored library is not generated again. The file name
is the hash of its content, and is checked before loading: a damaged file is removed and built again. Two processes can
build the same kernel at the same time.

Never use -ffast-math: a library that is linked with this option sets subnormal numbers to zero in the whole process.
-fno-math-errno, -fno-trapping-math and -ffp-contract=fast make the code equally fast. Modules needed only for a build
are imported during the build, so a kernel from the cache is loaded in a few milliseconds.
"""

import atexit
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from baqueano.diagnostics import Diagnostic, fault, merge_diagnostics
from baqueano.errors import DiagnosticError

if TYPE_CHECKING:
    import ctypes

MAX_SCHEDULED_OPERATIONS = 4_000  # operations; for more, gcc's first scheduler makes kernels slower
MAX_THOROUGH_OPERATIONS = 20_000  # operations; for more, -O3 takes minutes
MIN_QUICK_OPERATIONS = 1_000  # operations; for fewer, -O1 saves only a tenth of a second
QUICK_LEVEL = ("-O2",)  # optimisation level of code that is compiled quickly
# of gcc, where it looks for no vectors: a fifth less time, and a tick takes 4 % longer
QUICK_SCALAR_LEVEL = ("-O1", "-fexpensive-optimizations", "-ftree-pre")
LONG_LEVEL = ("-O1",)  # of code with more than MAX_THOROUGH_OPERATIONS
# Quick code calls sin, exp and similar functions: to compile copies of them takes up to half of the time.
CALLS = "-DCALLED", "-Wno-psabi"
SIMPLE_REGISTERS = "--param=ira-max-conflict-table-size=0"  # gcc's quicker allocator: the code is as fast
WHOLE_VECTORS = "-mprefer-vector-width=512"  # else gcc splits √ and ⌊ ⌋ of eight lanes, through memory
TUNING = "-mtune=generic"  # gcc would choose the instructions of another model for an unknown processor
LIBRARY_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
PROBE_TEXT = """\
typedef double pair __attribute__((vector_size(16)));
double probe(double x) { pair a = {x, 1.0}, b = a * a + a; return b[0] + b[1]; }
"""


class CompileError(DiagnosticError, RuntimeError):
    """The error of a compiler that is missing, or that does not compile the code."""


class Compiler(NamedTuple):
    """A command that compiles C with the vector extensions of GCC and Clang."""

    command: tuple[str, ...]
    identity: str  # changes when the compiler is replaced by another version
    is_clang: bool


class CompilerSearch(NamedTuple):
    """The compiler in use, and the reasons why others do not work."""

    compiler: Compiler | None
    reason: Diagnostic | None  # None if the first compiler works


def load_library(
    identity: tuple[object, ...],
    code: Callable[[], tuple[str, int]],
    find_vectors: bool = True,
    is_quick: bool = False,
) -> "ctypes.CDLL":
    """Return the library of C code, from the cache if possible. Raise CompileError without a working compiler.

    `code` returns the code and the number of operations in its loop, on which the flags depend. `identity` determines
    both, and `code` is only called if the library is not in the cache. `find_vectors` lets the compiler vectorise;
    `is_quick` makes the compilation faster and the code slower.
    """
    compiler = find_compiler()
    if compiler.compiler is None:
        raise CompileError(compiler.reason or "")
    return _load(identity, code, compiler.compiler, find_vectors=find_vectors, is_quick=is_quick)


def find_compiler() -> CompilerSearch:
    """Return the first of cc, gcc, clang and ziglang that works; if $BAQUEANO_CC is set, only this compiler."""
    return _find(os.environ.get("BAQUEANO_CC", ""), os.environ.get("PATH", ""))


@cache
def _find(compiler_name: str, path: str) -> CompilerSearch:
    reasons: list[Diagnostic] = []
    for compiler in _candidates(compiler_name, path):
        try:
            _load((PROBE_TEXT,), lambda: (PROBE_TEXT, 0), compiler, find_vectors=True, is_quick=False)
        except CompileError as error:
            reasons.append(error.diagnostic)
        else:
            return CompilerSearch(compiler, merge_diagnostics(reasons))
    if compiler_name and not reasons:
        reasons.append(fault("compiler.no-command", value=compiler_name))
    return CompilerSearch(None, merge_diagnostics(reasons) or fault("compiler.absent", "pip install ziglang"))


def _candidates(compiler_name: str, path: str) -> Iterator[Compiler]:
    if compiler_name:
        command = [compiler_name] if shutil.which(compiler_name, path=path) else shlex.split(compiler_name)
        executable = shutil.which(command[0], path=path)
        if executable:
            yield _compiler((executable, *command[1:]))
        return
    for name in ("cc", "gcc", "clang"):
        executable = shutil.which(name, path=path)
        if executable and not _is_empty_shell(executable):
            yield _compiler((executable,))
    if importlib.util.find_spec("ziglang"):
        from importlib.metadata import version

        identity = f"ziglang {version('ziglang')}"
        yield Compiler((sys.executable, "-m", "ziglang", "cc"), identity, is_clang=True)


def _compiler(command: tuple[str, ...]) -> Compiler:
    """Return a compiler with its identity (path, size and date), which is read without starting a process."""
    real_path = os.path.realpath(command[0])
    status = os.stat(real_path)
    names = " ".join((real_path, *command))
    is_clang = sys.platform == "darwin" or "clang" in names or "zig" in names
    return Compiler(command, f"{names} {status.st_size} {status.st_mtime_ns}", is_clang)


def _is_empty_shell(path: str) -> bool:
    """Return True for /usr/bin/cc of macOS without the developer tools: it only opens a window."""
    if sys.platform != "darwin" or not path.startswith("/usr/bin/"):
        return False
    import subprocess

    return subprocess.run(["xcode-select", "-p"], capture_output=True, check=False).returncode != 0


def _flag_sets(
    compiler: Compiler, operation_count: int, find_vectors: bool, is_quick: bool
) -> list[tuple[str, ...]]:
    """Return the sets of flags to try in order: compilers have different flags for the present processor."""
    is_quick = is_quick and operation_count > MIN_QUICK_OPERATIONS
    is_long = operation_count > MAX_THOROUGH_OPERATIONS
    quick_level = QUICK_LEVEL if compiler.is_clang or find_vectors else QUICK_SCALAR_LEVEL
    level = LONG_LEVEL if is_long else quick_level if is_quick else ("-O3",)
    common_flags = (*level, "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-shared", "-w")
    if is_long or is_quick:
        common_flags += CALLS if compiler.is_clang else (*CALLS, SIMPLE_REGISTERS)
    if sys.platform != "win32":
        common_flags += ("-fPIC",)
    if sys.platform == "linux" and sys.maxsize > 2**32 and not compiler.is_clang:
        common_flags += ("-nostdlib",)  # without start-up code: 12 ms less; 32 bits divide int64 with libgcc
    if not find_vectors:  # in straight-line code, vectors cost more than they save
        common_flags += ("-fno-tree-vectorize", "-fno-tree-slp-vectorize")
    native: tuple[str, ...] = ("-march=native",)
    if not compiler.is_clang and sys.platform == "win32":
        native += ("-Wa,-muse-unaligned-vector-move",)  # gcc on Windows aligns the stack only to 16 bytes
    if not (compiler.is_clang or is_quick) and operation_count < MAX_SCHEDULED_OPERATIONS:
        common_flags += ("-fschedule-insns", "-fsched-pressure")
    sets = [common_flags + native, (*common_flags, "-mcpu=native"), common_flags]
    if find_vectors and platform.machine().lower() in ("x86_64", "amd64"):
        sets.insert(0, (*sets[0], WHOLE_VECTORS, TUNING))
    return sets


_libraries: dict[str, "ctypes.CDLL"] = {}
_lock = threading.Lock()


def _load(
    identity: tuple[object, ...],
    code: Callable[[], tuple[str, int]],
    compiler: Compiler,
    *,
    find_vectors: bool,
    is_quick: bool,
) -> "ctypes.CDLL":
    limits = MAX_SCHEDULED_OPERATIONS, MAX_THOROUGH_OPERATIONS, MIN_QUICK_OPERATIONS
    levels = limits, QUICK_LEVEL, QUICK_SCALAR_LEVEL, LONG_LEVEL
    parts = identity, find_vectors, is_quick, levels, compiler.identity, _processor(), _generator()
    key = hashlib.sha256(repr(parts).encode()).hexdigest()
    with _lock:
        if key not in _libraries:

            def source_and_flags() -> tuple[str, list[tuple[str, ...]]]:
                source, operation_count = code()
                return source, _flag_sets(compiler, operation_count, find_vectors, is_quick)

            _libraries[key] = _open_library(key, source_and_flags, compiler)
        return _libraries[key]


def _open_library(
    key: str, source_and_flags: Callable[[], tuple[str, list[tuple[str, ...]]]], compiler: Compiler
) -> "ctypes.CDLL":
    import ctypes

    last_error = None
    for root in (_cache_folder, _temporary_folder):  # the cache cannot always be written, or executed
        try:
            folder = root() / key
            return ctypes.CDLL(str(_stored_library(folder) or _build(folder, *source_and_flags(), compiler)))
        except OSError as error:
            last_error = error
    raise CompileError.of("compiler.no-library", command=" ".join(compiler.command), error=last_error)


def _stored_library(folder: Path) -> Path | None:
    """Return the path of the undamaged library in the folder of a key, or None; remove damaged files."""
    for path in folder.glob("*" + LIBRARY_SUFFIX):
        if hashlib.sha256(path.read_bytes()).hexdigest() == path.stem:
            return path
        path.unlink(missing_ok=True)
    return None


def _build(folder: Path, source: str, flag_sets: list[tuple[str, ...]], compiler: Compiler) -> Path:
    import tempfile

    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, ignore_cleanup_errors=True) as work:
        Path(work, "kernel.c").write_text(source, encoding="utf-8")
        library = Path(work, "kernel" + LIBRARY_SUFFIX)
        problem = ""
        for flags in flag_sets:
            problem = _run([*compiler.command, *flags, "kernel.c", "-o", library.name, "-lm"], work)
            if not problem:
                break
        if problem:
            raise CompileError.of("compiler.refuses", command=" ".join(compiler.command), error=problem)
        path = folder / (hashlib.sha256(library.read_bytes()).hexdigest() + LIBRARY_SUFFIX)
        os.replace(library, path)
    return path


def _run(command: list[str], folder: str) -> str:
    """Run a command inside the folder; return its output if it failed, else "".

    The arguments do not contain the folder, whose name can have spaces and accents.
    """
    import subprocess

    creation_flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
    try:
        process = subprocess.run(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
            creationflags=creation_flags,
        )
    except OSError as error:
        return str(error)
    if process.returncode == 0:
        return ""
    return process.stderr.decode(errors="replace")[-2000:] or f"exit code {process.returncode}"


def _cache_folder() -> Path:
    return user_cache() / "kernels"


def user_cache() -> Path:
    """Return the cache folder of this user; without a home folder, a folder that is deleted with the process."""
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    elif sys.platform == "darwin":
        root = "~/Library/Caches"
    else:
        root = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    folder = Path(os.path.expanduser(root))
    return folder / "baqueano" if folder.is_absolute() else _temporary_folder()


@cache
def _temporary_folder() -> Path:
    import tempfile

    folder = tempfile.mkdtemp(prefix="baqueano-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@cache
def _generator() -> str:
    """Return a digest of the modules that generate code: another version generates other code."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.[ph]*")):
        if path.suffix in (".py", ".h"):
            digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _processor() -> str:
    """Return the model and the features of the processor, on which -march=native depends."""
    descriptions = [sys.platform, platform.machine(), os.environ.get("PROCESSOR_IDENTIFIER", "")]
    if sys.platform == "darwin":
        import subprocess

        brand = subprocess.run(["sysctl", "-n", "machdep.cpu.brand_string"], capture_output=True, check=False)
        descriptions.append(brand.stdout.decode(errors="replace"))
    elif Path("/proc/cpuinfo").exists():
        first = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").split("\n\n")[0]
        names = ("model name", "flags", "Features", "CPU part", "CPU implementer", "CPU variant")
        descriptions += [line for line in first.splitlines() if line.startswith(names)]
    return "\n".join(descriptions)
