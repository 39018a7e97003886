"""Which functions of kernels/native a run has reached, by clang's counters."""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path

from tests.sanitizers import clang, includes

# Headers none of whose functions a CPU's kernels call: those of CUDA's own ways of tracing, shadows and smooth edges,
# and one of types alone. On a GPU, compute-sanitizer looks at them.
NOT_ON_CPU = frozenset((
    "core/conditional.h",
    "antialiasing/edge_resolve_analytic.h", "antialiasing/edge_resolve_in_place.h", "antialiasing/edge_scan.h",
    "antialiasing/neighbor_shapes.h", "antialiasing/neighborhood.h", "antialiasing/occupied_tiles.h",
    "antialiasing/pixel_cache.h", "antialiasing/sample_batch.h", "antialiasing/sample_color.h",
    "build/horizon_builder.h", "build/occluder_builder.h", "camera/tile_frustum.h", "flow/plane_history.h",
    "geometry/triangle.h", "output/store_vec3.h", "shading/plane_shading.h", "shading_pass/plane_strips.h",
    "shading_pass/store_quads.h", "shading_pass/visibility_albedo.h", "shadow/caster_bounds.h",
    "shadow/many_casters.h", "shadow/mesh_any_hit.h", "shadow/near_casters.h", "shadow/occluder_boxes.h",
    "shadow/plane_receiver_cull.h", "shadow/receivers.h", "shadow/shadow_span.h", "shadow/shadow_strips.h",
    "shadow/shadow_tile.h", "shadow/turned_away.h", "traversal/cooperative_leaf_test.h",
    "traversal/infinite_plane.h", "traversal/mesh_closest_hit.h", "traversal/normal_cache.h",
    "traversal/ray_queue.h", "traversal/shapes_in_view.h", "traversal/view_shape_list.h",
    "traversal/visibility_listed.h",
))  # fmt: skip
NATIVE = includes.NATIVE


def measure(counts: Sequence[Path], libraries: Sequence[str], folder: Path) -> dict[str, dict[str, int]]:
    """Functions and lines of each header, and those of them that were reached.

    Args:
        counts: Files that the libraries wrote.
        libraries: Those that were loaded.
        folder: For what is put together.
    """
    merged = folder / "counts.profdata"
    inputs = folder / "counts.txt"
    inputs.write_text("".join(f"1,{path}\n" for path in counts))
    command = [str(clang.tool("llvm-profdata")), "merge", f"-input-files={inputs}", "-o", str(merged)]
    subprocess.run(command, check=True, capture_output=True)
    first, *others = libraries
    objects = [word for path in others for word in ("-object", path)]
    command = [str(clang.tool("llvm-cov")), "export", "-summary-only", f"-instr-profile={merged}", first, *objects]
    exported = subprocess.run(command, check=True, capture_output=True, text=True)
    files = json.loads(exported.stdout)["data"][0]["files"]
    reached = {Path(file["filename"]): file["summary"] for file in files}
    return {str(header.relative_to(NATIVE)): _counts(reached.get(header)) for header in sorted(NATIVE.rglob("*.h"))}


def _counts(summary: dict[str, dict[str, int]] | None) -> dict[str, int]:
    functions, lines = (summary or {}).get("functions", {}), (summary or {}).get("lines", {})
    return {
        "functions": functions.get("count", 0),
        "reached": functions.get("covered", 0),
        "lines": lines.get("count", 0),
        "lines_reached": lines.get("covered", 0),
    }


def missed(headers: dict[str, dict[str, int]]) -> list[str]:
    """Headers no function of which was reached, though a CPU's kernels call some."""
    return [name for name, counts in headers.items() if counts["reached"] == 0 and name not in NOT_ON_CPU]
