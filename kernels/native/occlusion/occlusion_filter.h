// Means of rays over pixels of one surface: what noise there is has the period of a block, over which it is averaged.
#pragma once
#include "occlusion/occlusion_rays.h"

namespace warpcam {

constexpr float SAME_WAY = 0.9f;  // cosine between normals of one surface
constexpr float SAME_PLANE = 0.2f;  // how far off the plane of the other a place may be, as part of their distance

// Calls `add` with the indices of a pixel's neighbours that show its surface, itself among them, and with their weights;
// returns their sum, or 0 where nothing is drawn. Of 5 x 5 pixels those at the sides count half, so that each place of a
// block counts the same. `bytes_of`: where a pixel's normal is.
template <int LENS, class Frame, class BytesOf, class Add>
WARPCAM_DEVICE float each_of_surface(const Frame& frame, int index, const BytesOf& bytes_of, const Add& add)
{
    constexpr int REACH = OCCLUSION_BLOCK / 2;
    const unsigned pixels = unsigned(frame.width * frame.height);
    const int world = int(unsigned(index) / pixels), pixel = int(unsigned(index) - unsigned(world) * pixels);
    if (!wp::index(frame.mask, world) || frame.shape.data[index] < 0)
        return 0.0f;
    const int row = pixel / frame.width, column = pixel - row * frame.width;
    const Camera camera = load_camera(wp::index(frame.views, world));
    const auto place_of = [&](int i, int j, int at) {
        const CameraRay<LENS> seen = view_ray<LENS>(camera, i, j);
        return place_along<LENS>(seen.x, seen.y, frame.depth.data[at]);
    };
    const Vec3 normal = stored_normal(bytes_of(index)), place = place_of(column, row, index);
    const int shape = frame.shape.data[index];
    float weights = 0.0f;
    for (int down = -REACH; down <= REACH; ++down)
        for (int right = -REACH; right <= REACH; ++right) {
            const int i = column + right, j = row + down, at = index + down * frame.width + right;
            if (i < 0 || i >= frame.width || j < 0 || j >= frame.height || frame.shape.data[at] != shape)
                continue;
            const Vec3 away = place_of(i, j, at) - place;
            const float off = dot(normal, away);
            if (dot(normal, stored_normal(bytes_of(at))) < SAME_WAY
                || off * off > SAME_PLANE * SAME_PLANE * dot(away, away))
                continue;
            const float weight =
                (right == -REACH || right == REACH ? 0.5f : 1.0f) * (down == -REACH || down == REACH ? 0.5f : 1.0f);
            weights += weight;
            add(at, weight);
        }
    return weights;
}

// Writes the shares of one pixel: of 255 in a byte each. SHARES: how many.
template <int LENS, int SHARES, class Frame> WARPCAM_DEVICE void filter_occlusion(const Frame& frame, int index)
{
    const auto bytes_of = [&](int at) { return reinterpret_cast<const unsigned char*>(frame.rays.data + at); };
    float sums[SHARES] = {};
    const float weights = each_of_surface<LENS>(frame, index, bytes_of, [&](int at, float weight) {
        for (int k = 0; k < SHARES; ++k)
            sums[k] += weight * float(bytes_of(at)[NORMAL_BYTES + k] >> 1);
    });
    if (!(weights > 0.0f))
        return;
    const unsigned char* const own = bytes_of(index);
    unsigned char* const to = reinterpret_cast<unsigned char*>(frame.visible.data + index);
    for (int k = 0; k < SHARES; ++k) {
        const unsigned char one = own[NORMAL_BYTES + k];
        const float mean = one & 1 ? float(one >> 1) : sums[k] / weights;
        to[k] = static_cast<unsigned char>((255.0f / 127.0f) * mean + 0.5f);
    }
}

}  // namespace warpcam
