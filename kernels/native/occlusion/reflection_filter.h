// What rough surfaces mirror and what is seen through them, as means over pixels of one surface.
#pragma once
#include "occlusion/occlusion_filter.h"
#include "occlusion/reflection_rays.h"

namespace warpcam {

// Writes what is added to one pixel's light, and what its own is multiplied by before. Neighbours whose normals are
// farther from its own than facets are look elsewhere.
template <int LENS, class Frame> WARPCAM_DEVICE void filter_reflections(const Frame& frame, int index)
{
    const unsigned pixels = unsigned(frame.width * frame.height);
    if (!wp::index(frame.mask, int(unsigned(index) / pixels)))
        return;
    const Float3Int* const glossy = reinterpret_cast<const Float3Int*>(frame.glossy.data);
    const auto bytes_of = [&](int at) { return reinterpret_cast<const unsigned char*>(&glossy[at].w); };
    const Float3Int own = glossy[index];
    Vec3 seen = as_vec3(own);
    const float roughness = (1.0f / 255.0f) * float(own.w >> ROUGHNESS_SHIFT);
    if (roughness > 0.0f) {
        const float alpha = roughness * roughness, least = 1.0f - max(0.5f * alpha * alpha, 1.0e-4f);
        const Vec3 normal = stored_normal(bytes_of(index));
        Vec3 sum { 0.0f, 0.0f, 0.0f };
        float weights = 0.0f;
        each_of_surface<LENS>(frame, index, bytes_of, [&](int at, float weight) {
            if (!(glossy[at].w >> ROUGHNESS_SHIFT) || dot(normal, stored_normal(bytes_of(at))) < least)
                return;
            sum = sum + weight * as_vec3(glossy[at]);
            weights += weight;
        });
        if (weights > 0.0f)
            seen = 1.0f / weights * sum;
    }
    const Float3Int share = reinterpret_cast<const Float3Int*>(frame.glossy_share.data)[index];
    Float3Int* const to = reinterpret_cast<Float3Int*>(frame.reflections.data) + index;
    *to = make_float3_int(as_vec3(*to) + mul(as_vec3(share), seen), share.w);
}

}  // namespace warpcam
