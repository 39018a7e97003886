"""CPU kernels by the system's clang, with sanitizers and coverage, in place of Warp's own compiler.

The source of a module is what Warp writes, and is called with what Warp calls it with. It becomes a shared library.
"""

import ctypes
import functools
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import warp as wp

LOADS = "== loads "  # a line of a library that is loaded
VERSIONS = range(30, 15, -1)  # of clang and its tools, of which Debian's names have one
SANITIZERS = (
    "-fsanitize=address,undefined",
    "-fno-sanitize=vptr,function",  # of C++ classes and calls that no kernel has
    "-fsanitize-recover=all",  # go on behind a fault: one run finds them all
    "-fno-omit-frame-pointer",
)
COVERAGE = ("-fprofile-instr-generate", "-fcoverage-mapping")
# Nothing is optimised away, so that each access of the source is looked at.
KIND = ("-O0", "-g1", "-fPIC", "-shared", "-shared-libsan", "-std=c++17", "-march=native", "-w")
FIRST = re.compile(r"-include \S+|-mllvm\S*|-fpch\S+")  # for Warp's compiler alone
NATIVE = Path(wp.__file__).parent / "native"


@functools.cache
def tool(name: str) -> str | None:
    """The path of clang or of one of LLVM's tools, the newest there is; None if there is none."""
    return next(filter(None, map(shutil.which, [f"{name}-{version}" for version in VERSIONS] + [name])), None)


@functools.cache
def runtime() -> Path:
    """AddressSanitizer's library, which a process must load before all others."""
    said = subprocess.run(
        [str(tool("clang")), "-print-file-name=libclang_rt.asan-x86_64.so"], capture_output=True, text=True, check=True
    )
    path = Path(said.stdout.strip())
    if not path.is_absolute():  # newer ones have a folder for each target
        said = subprocess.run(
            [str(tool("clang")), "-print-file-name=libclang_rt.asan.so"], capture_output=True, text=True, check=True
        )
        path = Path(said.stdout.strip())
    return path


def build(output: str, source: str, **options: Any) -> None:
    """Compile one of Warp's modules; takes what Warp's own ``build_cpu`` takes."""
    flags = FIRST.sub("", options["extra_flags"]).split()
    folders = [f"-I{folder}" for folder in (NATIVE, *options["extra_include_dirs"])]
    partial = f"{output}.{os.getpid()}"
    command = [str(tool("clang")), *flags, *KIND, *SANITIZERS, *COVERAGE, "-DWARPCAM_QUICK", *folders, "-x", "c++"]
    compiled = subprocess.run([*command, source, "-o", partial], capture_output=True, text=True)
    if compiled.returncode != 0:
        raise RuntimeError(f"clang could not compile {source}:\n{compiled.stderr}")
    os.replace(partial, output)


class Modules:
    """Shared libraries in place of the objects that Warp's linker loads."""

    def __init__(self) -> None:
        self._libraries: dict[bytes, ctypes.CDLL] = {}

    def load(self, path: bytes, handle: bytes, _linker: bool) -> int:
        print(f"{LOADS}{os.fsdecode(path)}", flush=True)
        self._libraries[handle] = ctypes.CDLL(os.fsdecode(path), os.RTLD_LAZY | os.RTLD_LOCAL)
        return 0

    def lookup(self, handle: bytes, name: bytes) -> int:
        function = getattr(self._libraries[handle], name.decode())
        return ctypes.cast(function, ctypes.c_void_p).value or 0

    def unload(self, handle: bytes) -> int:
        return 0  # its counts are written when the process ends


def install() -> None:
    """Have this process compile and load CPU kernels so from now on."""
    wp.init()
    context = wp._src.context
    modules = Modules()
    wp._src.build.build_cpu = build
    for name, function in (("load_obj", modules.load), ("lookup", modules.lookup), ("unload_obj", modules.unload)):
        setattr(context.runtime.llvm, f"wp_{name}", function)
    _load_helpers()


def _load_helpers() -> None:
    """What Warp's linker gives modules beside the C library."""
    library = Path(wp.config.kernel_cache_dir) / f"helpers.{os.getpid()}.so"
    library.parent.mkdir(parents=True, exist_ok=True)
    command = [str(tool("clang")), "-shared", "-fPIC", "-O1", "-x", "c++", str(NATIVE / "crt.cpp"), "-o", str(library)]
    subprocess.run(command, check=True, capture_output=True)
    ctypes.CDLL(str(library), os.RTLD_NOW | os.RTLD_GLOBAL)
    library.unlink()
