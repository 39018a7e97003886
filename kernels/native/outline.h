// What a light sees of meshes, by their outlines: points whose hull holds all of a mesh, more tightly than its box does.
#pragma once
#include "bvh4.h"
#include "light_space.h"

namespace warpcam {

constexpr int OUTLINE = 32;  // points of a mesh, a lane each

constexpr bool has_outlines(int types) { return (types >> MESH & 1) && !(types >> MOVING & 1); }

// Points of a mesh along the light's axes, relative to a lamp: those of a shape as it stands.
struct LitMesh {
    Vec origin;  // the camera, in the mesh's frame
    Vec u, v, w; // along the mesh's axes
    Vec lamp;    // along the light's
    float pad;   // more than rounding

    WARPCAM_FN Vec of(Vec point) const
    {
        const Vec at = point - origin;
        return { dot(u, at) - lamp.x, dot(v, at) - lamp.y, dot(w, at) - lamp.z };
    }
};

template <int TYPES> WARPCAM_FN LitMesh lit_mesh(const Record& record, const Vec& center, const Vec& half, const Light& light)
{
    const Vec x = to_vec(record.axis_x), y = to_vec(record.axis_y), z = to_vec(record.axis_z);
    const bool scaled = TYPES >> SCALED & 1;  // the rows are the shape's axes over its sizes
    const Vec rate { scaled ? 1.0f / dot(x, x) : 1.0f, scaled ? 1.0f / dot(y, y) : 1.0f, scaled ? 1.0f / dot(z, z) : 1.0f };
    const auto turned = [&](Vec a) { return Vec { rate.x * dot(x, a), rate.y * dot(y, a), rate.z * dot(z, a) }; };
    LitMesh lit { to_vec(record.origin), turned(light.u), turned(light.v), turned(light.w), { 0.0f, 0.0f, 0.0f }, 0.0f };
    const auto size = [](Vec a) { return magnitude(a.x) + magnitude(a.y) + magnitude(a.z); };
    float sizes = size(center) + size(half)
        + size(rate.x * lit.origin.x * x + rate.y * lit.origin.y * y + rate.z * lit.origin.z * z);
    if (!light.distant) {
        lit.lamp = { dot(light.u, light.aim), dot(light.v, light.aim), dot(light.w, light.aim) };
        sizes += size(light.aim);
    }
    lit.pad = 1.0e-5f * sizes;
    return lit;
}

// What one point may cover: see window_of(). Without meaning behind a lamp.
WARPCAM_FN Window window_of_point(const LitMesh& mesh, bool distant, Vec point)
{
    const Vec at = mesh.of(point);
    const Window flat { at.x - mesh.pad, at.x + mesh.pad, at.y - mesh.pad, at.y + mesh.pad };
    return distant ? flat : seen_from(flat, at.z - mesh.pad, at.z + mesh.pad);
}

WARPCAM_FN void join(Window& all, const Window& one)
{
    all = { lower(all.left, one.left), upper(all.right, one.right), lower(all.bottom, one.bottom), upper(all.top, one.top) };
}

// Narrows the windows of a list's meshes, and how high they reach, to what their outlines cover. By a whole block.
template <int TYPES, class List, class Meshes>
WARPCAM_FN void narrow_windows(List& list, const Meshes& meshes, const Light& light, int thread)
{
#if defined(__CUDA_ARCH__)
    constexpr int SHARERS = THREADS / LANES, STEP = OUTLINE;
    const int first = thread / LANES, lane = thread % LANES;
#else
    constexpr int SHARERS = 1, STEP = 1;
    const int first = 0, lane = 0;
#endif
    for (int slot = first; slot < list.count; slot += SHARERS) {
        const Record& record = list.records[slot];
        if (record.axis_x.w != MESH)
            continue;
        const Vec half = list.boxes[slot].half;
        const LitMesh mesh = lit_mesh<TYPES>(record, list.boxes[slot].center, half, light);
        Window all { FAR_AWAY, -FAR_AWAY, FAR_AWAY, -FAR_AWAY };
        float nearest = FAR_AWAY, highest = -FAR_AWAY;
        for (int point = lane; point < OUTLINE; point += STEP) {
            const Vec at = to_vec(load(meshes.outlines.data, unsigned(record.axis_z.w * OUTLINE + point)));
            const float along = mesh.of(at).z;
            nearest = lower(nearest, along);
            highest = upper(highest, along);
            join(all, window_of_point(mesh, light.distant, at));
        }
#if defined(__CUDA_ARCH__)
        all = { warp_min(all.left), -warp_min(-all.right), warp_min(all.bottom), -warp_min(-all.top) };
        nearest = warp_min(nearest);
        highest = -warp_min(-highest);
#endif
        // A lamp beside a mesh, or inside of it, sees what has no window.
        if (!light.distant && !(nearest - mesh.pad > 1.0e-3f * (half.x + half.y + half.z)))
            continue;
        if (lane == 0) {
            const Window before = list.windows[slot];
            list.windows[slot] = { upper(before.left, all.left), lower(before.right, all.right),
                                   upper(before.bottom, all.bottom), lower(before.top, all.top) };
            list.heights[slot] = lower(list.heights[slot], light.distant ? highest + mesh.pad : mesh.pad - nearest);
        }
    }
}

}  // namespace warpcam
