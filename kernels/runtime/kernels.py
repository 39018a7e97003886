"""Kernels whose threads each run a piece of native code."""

import linecache
from collections.abc import Mapping
from typing import Any

import warp as wp


def make_kernel(
    name: str,
    code: str,
    arguments: Mapping[str, Any],
    module_options: Mapping[str, Any],
    launch_bounds: tuple[int, int] | None = None,
) -> wp.Kernel:
    """Make a kernel of its own module that runs native code in each thread.

    Args:
        name: Of the kernel.
        code: C++ that a thread runs. Arguments have their names, the thread's number is ``index``.
        arguments: Types by name, in the order of a launch's inputs. A last one follows: see ``bind_launch``.
        module_options: Those of ``native_module``, with the header that declares what the code calls.
        launch_bounds: Threads of a CUDA block, and blocks that a multiprocessor is to hold.
    """
    names = ", ".join(arguments)
    call = wp.func_native(code)(_function("call", f"{names}, index", "...", {**arguments, "index": int}, {}))
    body = f"call({names}, first + wp.tid())"
    launched = _function(name, f"{names}, first", body, {**arguments, "first": wp.int32}, {"call": call, "wp": wp})
    bounds = {} if launch_bounds is None else {"launch_bounds": launch_bounds}
    options = {"enable_backward": False, "grid_stride": False, "module_options": dict(module_options), **bounds}
    return wp.kernel(module="unique", **options)(launched)


def _function(name: str, parameters: str, body: str, types: Mapping[str, Any], scope: dict[str, Any]) -> Any:
    """A function of one line. Warp reads the source of functions, and finds it as Python's own tracebacks do."""
    source, file = f"def {name}({parameters}):\n    {body}\n", f"<kernel {name}({parameters})>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope["__name__"] = __name__
    exec(compile(source, file, "exec"), scope)
    function = scope[name]
    function.__annotations__ = dict(types)
    return function
