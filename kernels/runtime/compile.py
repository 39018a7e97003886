"""Compilation: options of modules that call native code, and modules loaded ahead of their launches."""

import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import warp as wp

from warpcam.kernels.runtime.cpu_pool import cpu_threads

NATIVE = Path(__file__).resolve().parents[1] / "native"

# Warp's kernels are made and its modules loaded by one thread at a time: another finds them half made, or loads a
# module a second time and frees code that runs already.
building = threading.RLock()


def compiler_flags() -> dict[str, Any]:
    """The module option with which all modules are compiled for CPUs.

    Warp raises LLVM's thresholds of inlining. LLVM's own are enough, and modules take half as long to compile. With the
    same flags, among them folders of headers, for all of them Warp's own headers are precompiled once in a process,
    which takes longer than most kernels, and a third less without numbers of 16 bits that no kernel of ours has.
    """
    flags = getattr(wp.config, "cpu_compiler_flags", None)
    if not flags:
        return {}
    kept = [flag for flag in flags.split() if not flag.startswith("-mllvm=-inline")]
    return {"cpu_compiler_flags": " ".join([*kept, "-DWP_NO_BFLOAT16="])}


# CUDA's compiler keeps what it read up to here, Warp's headers, for the next module that begins with these alone.
_PRECOMPILED = "#pragma nv_hdrstop\n"

# Functions that are seen in their module alone are inlined where they have but one caller, which makes for faster and
# larger kernels; with WARPCAM_QUICK the compiler takes less time instead. What Warp writes for derivatives is left out
# as it is `inline`.
_ON_CPU = """
#if defined(WARPCAM_QUICK)
#include "{0}"
#else
namespace {{
#include "{0}"
}}
#endif
#undef CUDA_CALLABLE
#define CUDA_CALLABLE inline
"""


def native_options(header: str, threads: int | None = None) -> wp.ModuleBuildOptions:
    """Build options of a module that calls ``header`` from ``kernels/native``, on CPU and CUDA alike.

    Args:
        header: Its name.
        threads: Of a CUDA block, if not as many as core/platform.h says.
    """
    lines = "" if threads is None else f"#define WARPCAM_THREADS {threads}\n"
    return wp.ModuleBuildOptions(
        extra_cuda_include_dirs=[str(NATIVE)],
        extra_cpu_include_dirs=[str(NATIVE)],
        extra_cuda_preamble=f'{_PRECOMPILED}{lines}#include "{header}"',
        extra_cpu_preamble=_ON_CPU.format((NATIVE / header).as_posix()),
        extra_build_dependencies=[str(path) for path in sorted(NATIVE.rglob("*.h"))],
    )


def native_module(header: str, threads: int | None = None) -> dict[str, Any]:
    """Options of a module that calls ``header`` from ``kernels/native``; ``threads`` as above."""
    return {"extra_build_options": native_options(header, threads), **compiler_flags()}


def load_modules(wanted: Iterable[tuple[wp.Module, int]], device: wp.Device) -> None:
    """Compile and load modules for launches on a device, those for CUDA side by side.

    Not so on a CPU, where the headers are precompiled once for a thread, which takes longer than most kernels.

    Args:
        wanted: Each with the threads in a CUDA block.
        device: Where they are launched.
    """
    with building:
        _load_modules(wanted, device)


def _load_modules(wanted: Iterable[tuple[wp.Module, int]], device: wp.Device) -> None:
    blocks: dict[wp.Module, dict[int, None]] = {}
    for module, block_dim in wanted:
        blocks.setdefault(module, {})[block_dim if device.is_cuda else 1] = None

    def loaded(module: wp.Module) -> None:
        for block_dim in blocks[module]:
            wp.force_load(device, [module], block_dim=block_dim, max_workers=0)

    if not device.is_cuda or len(blocks) < 2:
        for module in blocks:
            loaded(module)
        return
    with ThreadPoolExecutor(cpu_threads()) as pool:
        for _ in pool.map(loaded, blocks):
            pass


@contextmanager
def compile_in_background(kernels: Sequence[tuple[wp.Kernel, int]], device: wp.Device) -> Iterator[None]:
    """Compile kernels for a CUDA device while something else is done.

    Args:
        kernels: Each with the threads in a block.
        device: Where they are launched. Nothing is done ahead for a CPU.
    """
    if not (kernels and device.is_cuda):
        yield
        return
    with building, ThreadPoolExecutor(1) as pool:
        compiled = pool.submit(_load_modules, [(kernel.module, block_dim) for kernel, block_dim in kernels], device)
        yield
        compiled.result()
