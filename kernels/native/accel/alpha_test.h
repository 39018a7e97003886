// Meshes that are not there where a map of their opacity says so.
#pragma once
#include "accel/bvh4.h"
#include "texture/sampler.h"

namespace warpcam {

// Least opacity at which a surface counts as present. Where a map asks for no more than this, the trace skips only what
// cannot be seen, and shading looks the rest of the map up.
constexpr float LEAST_SEEN = 1.0f / 255.0f;

// The red of a texture at (u, v), in images, between its four nearest texels.
WARPCAM_DEVICE float red_at(const unsigned* texels, int width, int height, float u, float v)
{
    const Between x = between_texels(fraction(u), width), y = between_texels(fraction(v), height);
    const int left = x.first < 0 ? width - 1 : x.first, right = x.first + 1 >= width ? 0 : x.first + 1;
    const int top = y.first < 0 ? height - 1 : y.first, bottom = y.first + 1 >= height ? 0 : y.first + 1;
    const auto red = [&](int row, int column) { return float(int(texels[row * width + column] & 0xffu)); };
    const float above = red(top, left) + x.on * (red(top, right) - red(top, left));
    const float below = red(bottom, left) + x.on * (red(bottom, right) - red(bottom, left));
    return (1.0f / 255.0f) * (above + y.on * (below - above));
}

// Tests whether a face of a mesh is present at `place`, in the mesh's frame. `cut`: only maps whose threshold is above
// LEAST_SEEN count.
template <class Meshes> WARPCAM_DEVICE bool unmasked(const Meshes& meshes, int mesh, int face, Vec3 place, bool cut)
{
    const Float3Int mask = load(meshes.masks.data, mesh);
    const int start = as_int(mask.x), width = as_int(mask.y), height = as_int(mask.z);
    const float least = as_float(mask.w);
    if (width == 0 || (cut && !(least > LEAST_SEEN)))
        return true;
    const unsigned row = unsigned(wp::index(meshes.face_start, mesh)) + unsigned(face * FACE_ROWS);
    const Float3Int first = load(meshes.faces.data, row);
    const Vec3 origin = as_vec3(first), away = place - origin;
    const Vec3 edge1 = as_vec3(load(meshes.faces.data, row + 1)) - origin;
    const Vec3 edge2 = as_vec3(load(meshes.faces.data, row + 2)) - origin;
    const Vec3 normal = cross(edge1, edge2);
    const float rate = rcp(max(dot(normal, normal), MIN_NORMAL));
    const float second = clamp(dot(cross(away, edge2), normal) * rate, 0.0f, 1.0f);
    const float third = clamp(dot(cross(edge1, away), normal) * rate, 0.0f, 1.0f - second);
    const int corner = 3 * (wp::index(meshes.corner_start, mesh) + first.w);
    const auto a = wp::index(meshes.uvs, corner), b = wp::index(meshes.uvs, corner + 1);
    const auto c = wp::index(meshes.uvs, corner + 2);
    const float u = a[0] + second * (b[0] - a[0]) + third * (c[0] - a[0]);
    const float v = 1.0f - (a[1] + second * (b[1] - a[1]) + third * (c[1] - a[1]));
    return red_at(meshes.mask_texels.data + start, width, height, u, v) >= least;
}

// Tests whether a face is present where a ray, in the mesh's frame, intersects it.
template <class Types, class Meshes>
WARPCAM_DEVICE bool is_there(const Meshes& meshes, const ShapeRecord& record, const Ray& ray, int face, float t)
{
    if constexpr (Types::has(ALPHA_TESTED))
        return unmasked(meshes, record.axis_z.w, face, ray.origin + t * ray.direction, false);
    return true;
}

// Tests presence as above, by cut-out maps alone.
template <class Types, class Meshes>
WARPCAM_DEVICE bool is_not_cut(const Meshes& meshes, const ShapeRecord& record, const Ray& ray, int face, float t)
{
    if constexpr (Types::has(ALPHA_TESTED))
        return unmasked(meshes, record.axis_z.w, face, ray.origin + t * ray.direction, true);
    return true;
}

}  // namespace warpcam
