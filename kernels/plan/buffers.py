"""Buffers between the passes of one camera."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from warpcam.kernels.flags import TRAVERSED, ShadingFlag, geometry_of
from warpcam.kernels.outputs import OUTPUTS, traced_as
from warpcam.kernels.plan import launches, occlusion, trace
from warpcam.kernels.plan.passes import pass_of
from warpcam.kernels.plan.request import BUFFER, ImageRequest
from warpcam.kernels.scene_tables import SceneTables

LIT_PIXELS = {"rgb": wp.vec3ub, "rgba": wp.vec4ub, "hdr": wp.vec3}  # of images before their edges are smoothed
REFLECTIONS, INDIRECT = f"{BUFFER}reflections", f"{BUFFER}indirect"


def planned_buffers(
    tables: SceneTables,
    request: ImageRequest,
    device: wp.Device,
    transparent: bool,
    mirrors: bool,
    smooth: Sequence[str],
) -> dict[str, Any]:
    """Buffers between the passes, with their dtypes; ``smooth``: outputs that are lit into a buffer first."""
    asked = [OUTPUTS[name] for name in request.outputs]
    derived = [name for name in request.outputs if traced_as(name, tables.shape_types) is None]
    # they go on from each other's depth and shape
    passes = tables.num_drawn > launches.MAX_LISTED or trace.chooses_in_view(tables, request, device)
    needed = passes or tables.splats is not None or bool(derived)
    images = {output.trace for output in asked} - ({"shape"} if tables.ids_by_world else set())
    if request.lens in launches.TABLES:  # whose trace has the distance where others have depth
        images = images - {"depth", "distance"} | ({"depth"} if "distance" in images else set())
    faces = bool(geometry_of(tables.shape_types) & TRAVERSED) and any("face" in pass_of(name).needs for name in derived)
    lit, shares = any(output.lit for output in asked), occlusion.shares_of(tables, request)
    count = occlusion.num_shares(tables, shares)
    # What is seen without the transparent shapes is nobody's image. It is there when all other outputs are made.
    wanted = {
        "depth": transparent or (needed and "depth" not in images),
        "shape": transparent or (needed and "shape" not in images),
        "face": faces,
        "shadow": request.shadows and tables.num_lights > 0 and lit and not shares & ShadingFlag.SOFT_SHADOWS,
        "rays": lit and bool(shares),
        "visible": lit and bool(shares),
        "indirect rays": request.indirect_light and lit,
        "indirect": request.indirect_light and lit,
        "glossy": request.reflections and lit,
        "glossy share": request.reflections and lit,
        "reflections": request.reflections and lit,
        "mirror depth": mirrors,
        "mirror shape": mirrors,
        "mirror face": mirrors and faces,
    }
    ids, faces_dtype = launches.id_dtypes(tables, device)
    dtypes = {
        "depth": wp.float32,
        "shape": ids,
        "face": faces_dtype,
        "shadow": wp.uint8,
        "rays": occlusion.pixel_bytes(occlusion.NORMAL_BYTES + count),
        "visible": occlusion.pixel_bytes(count),
        "indirect rays": wp.vec4,
        "indirect": wp.vec4,
        "glossy": wp.vec4,
        "glossy share": wp.vec4,
        "reflections": wp.vec4,
    }
    chosen = {BUFFER + name: dtypes[name.removeprefix("mirror ")] for name, there in wanted.items() if there}
    return chosen | {f"{BUFFER}lit {name}": LIT_PIXELS[name] for name in smooth}
