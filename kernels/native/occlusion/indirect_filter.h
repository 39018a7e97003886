// Means of the light of rays over pixels of one surface.
#pragma once
#include "occlusion/indirect_rays.h"
#include "occlusion/occlusion_filter.h"

namespace warpcam {

// Writes what arrives at one pixel: light from shapes, and the share of rays that meet none.
template <int LENS, class Frame> WARPCAM_DEVICE void filter_indirect(const Frame& frame, int index)
{
    const Float3Int* const rays = reinterpret_cast<const Float3Int*>(frame.indirect_rays.data);
    const auto bytes_of = [&](int at) { return reinterpret_cast<const unsigned char*>(&rays[at].w); };
    Vec3 sum { 0.0f, 0.0f, 0.0f };
    float open = 0.0f;
    const float weights = each_of_surface<LENS>(frame, index, bytes_of, [&](int at, float weight) {
        const Float3Int one = rays[at];
        sum = sum + weight * as_vec3(one);
        open += weight * float(one.w >> OPEN_RAYS_SHIFT);
    });
    if (!(weights > 0.0f))
        return;
    const float scale = 1.0f / weights;
    reinterpret_cast<Float3Int*>(frame.indirect.data)[index] =
        make_float3_int(scale * sum, as_int(scale * (1.0f / OCCLUSION_RAYS) * open));
}

}  // namespace warpcam
