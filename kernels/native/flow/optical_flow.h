// Optical flow: motion in the image, since the world's previous frame, of the surface that a pixel sees, and whether
// that surface was visible then.
//
// flow.py, view_shape_lists.py or the block composes, for each shape of a world, the transform from a point seen now to
// the pixel that showed it. The previous frame is stored in a word a pixel.
#pragma once
#include "flow/visibility_history.h"

namespace warpcam {

// Row i of the place then in homogeneous pixels, of what pixel (x, y) sees: Trail.motions of flow.py.
template <int LENS> WARPCAM_DEVICE float project_previous(const Float3Int& by, float x, float y, float depth)
{
    const float last = as_float(by.w);
    if (LENS == PINHOLE)
        return depth * (by.x * x + (by.y * y + by.z)) + last;
    return by.x * x + (by.y * y + (by.z * depth + last));
}

// Motion of a point of a mesh's face in the mesh's own frame, without the shape's scale.
template <class Types, int LENS, class History, class Shapes>
WARPCAM_NOINLINE Vec3 moved_within(const History& history, const Shapes& shapes, const Camera& camera,
                                   const CameraRay<LENS>& seen, const Hit& hit, int corners, int world)
{
    const auto r = wp::index(shapes.rotations, world, hit.shape);
    const Vec3 away = point_of(hit, camera, seen) - as_vec3(wp::index(shapes.positions, world, hit.shape));
    Vec3 local { r.data[0][0] * away.x + r.data[1][0] * away.y + r.data[2][0] * away.z,
                 r.data[0][1] * away.x + r.data[1][1] * away.y + r.data[2][1] * away.z,
                 r.data[0][2] * away.x + r.data[1][2] * away.y + r.data[2][2] * away.z };
    if (Types::has(PER_SHAPE_SCALE)) {
        const Vec3 size = as_vec3(per_world(shapes.sizes, world, hit.shape));
        local = { local.x / size.x, local.y / size.y, local.z / size.z };
    }
    const unsigned row = wp::index(history.face_start, per_world(shapes.assets, world, hit.shape)) + 3 * hit.face;
    const Float3Int first = load(history.faces.data, row);
    const Vec3 a = as_vec3(first), b = as_vec3(load(history.faces.data, row + 1)),
               c = as_vec3(load(history.faces.data, row + 2));
    const Vec3 edge1 = b - a, edge2 = c - a, normal = cross(edge1, edge2), place = local - a;
    const float rate = 1.0f / max(dot(normal, normal), MIN_NORMAL);
    const float weight1 = dot(cross(place, edge2), normal) * rate, weight2 = dot(cross(edge1, place), normal) * rate;
    const int at = corners + 3 * first.w;
    return (1.0f - weight1 - weight2) * (as_vec3(wp::index(history.corners, at)) - a)
           + weight1 * (as_vec3(wp::index(history.corners, at + 1)) - b)
           + weight2 * (as_vec3(wp::index(history.corners, at + 2)) - c);
}

// Along one axis the two pixels that have a quarter or more of what is interpolated at a place, mostly the same one.
struct Beside {
    float place;  // from where the image begins; rounded down the number of one pixel, half a pixel further the other's

    // The coordinate sought is x * scale from the middle of the image's first pixel.
    WARPCAM_DEVICE Beside(float x, float scale) : place(fma(x, scale, 0.25f)) {}
    // True if both pixels are inside. Bits of floats that are not negative are in order; all others are above them.
    WARPCAM_DEVICE bool inside(int pixels) const
    {
        return unsigned(as_int(place)) < unsigned(as_int(float(pixels) - 0.5f));
    }
    WARPCAM_DEVICE float other() const { return place + 0.5f; }
};

// Tests whether the previous image showed the surface at a position inside of it, at distance `depth`. The pixel there
// must show the shape, and so must one that has a quarter or more of the weight in an interpolation there; the surface
// must not be farther than one of them by more than `last` allows.
template <class History, class Places> WARPCAM_DEVICE bool was_seen(const History& history, const Places& places,
                                                                    int shape, const Beside& x, const Beside& y,
                                                                    const Float3Int& last, float depth)
{
    return Places::Keeps::show(places.word_at_place(history, x.place, y.place),
                               places.word_at_place(history, x.other(), y.other()), shape, last, depth);
}

// Motion of what pixel (x, y) sees, by the three rows of a shape that moves.
template <int LENS> struct PixelMotion {
    float right, down;

    WARPCAM_DEVICE PixelMotion(const Float3Int& across, const Float3Int& along, const Float3Int& away, float x, float y,
                               float depth)
    {
        const float now = project_previous<LENS>(away, x, y, depth), rate = LENS == PINHOLE ? rcp(now) : 1.0f;
        const bool ahead = LENS != PINHOLE || now > 0.0f;
        right = ahead ? fma(-project_previous<LENS>(across, x, y, depth), rate, x) : 0.0f;
        down = ahead ? fma(-project_previous<LENS>(along, x, y, depth), rate, y) : 0.0f;
    }
};

// Writes the flow of pixel (i, j) and of those `step` rows below each other that show one shape, which does not move in
// its own frame; pixel_of(k): their numbers.
template <int LENS, int COUNT, class History, class Places, class PixelOf>
WARPCAM_DEVICE void put_flow_of(const History& history, const Places& places, int shape, const Hit (&hits)[COUNT],
                                int i, int j, int step, const PixelOf& pixel_of)
{
    const auto rows = places.of_shape(shape);
    float right[COUNT] = {}, down[COUNT] = {};
    if (!Places::Keeps::rests(rows.at(3))) {
        const Float3Int across = rows.at(0), along = rows.at(1), away = rows.at(2);
        for (int k = 0; k < COUNT; ++k) {
            const PixelMotion<LENS> shift(across, along, away, float(i), float(j + k * step), hits[k].depth);
            right[k] = shift.right;
            down[k] = shift.down;
        }
    }
    for (int k = 0; k < COUNT; ++k)
        *reinterpret_cast<Float2*>(history.flow.data + 2 * size_t(pixel_of(k))) = { right[k], down[k] };
}

// Writes the pixel that is `below` rows below pixel (i, j), number `pixel` of all worlds'.
template <class Types, int LENS, int WANTED, class History, class Places, class Shapes, class Index>
WARPCAM_DEVICE void put_flow(const History& history, const Places& places, const Shapes& shapes, const Camera& camera,
                             const CameraRay<LENS>& seen, const Hit& hit, int world, int i, int j, int below,
                             Index pixel)
{
    constexpr bool MOVES = WANTED & FLOW_MOVES;
    using Keeps = typename Places::Keeps;
    const auto rows = places.of_shape(hit.shape);
    const Float3Int last = rows.at(3);
    if (WANTED & FLOW_VALID)
        keep_word(places.kept + 8u * below, Places::place_of(history, i, j), Keeps::word(hit.shape, hit.depth, last));
    float right = 0.0f, down = 0.0f;
    unsigned valid = 0;
    if (Places::LISTED || hit.shape >= 0) {  // listed, nothing rests
        bool still = MOVES ? last.w & 1 : Keeps::rests(last);
        const int corners = last.w >> 1;
        Vec3 within { 0.0f, 0.0f, 0.0f };
        if constexpr (MOVES) {
            if (corners >= 0) {
                within = moved_within<Types>(history, shapes, camera, seen, hit, corners, world);
                still = still && within.x == 0.0f && within.y == 0.0f && within.z == 0.0f;
            }
        }
        if (still) {
            if (WANTED & FLOW_VALID)
                valid = settled(Keeps::shows(places.word_of(history, i, j + below), hit.shape));
        } else {
            const float column = float(i), row = float(j + below);
            float x = project_previous<LENS>(rows.at(0), column, row, hit.depth);
            float y = project_previous<LENS>(rows.at(1), column, row, hit.depth);
            float depth = project_previous<LENS>(rows.at(2), column, row, hit.depth);
            if constexpr (MOVES) {
                if (corners >= 0) {
                    x += dot(as_vec3(rows.at(4)), within);
                    y += dot(as_vec3(rows.at(5)), within);
                    depth += dot(as_vec3(rows.at(6)), within);
                }
            }
            const bool ahead = LENS != PINHOLE || depth > 0.0f;
            const float rate = LENS == PINHOLE ? rcp(depth) : 1.0f;
            right = ahead ? fma(-x, rate, column) : 0.0f;
            down = ahead ? fma(-y, rate, row) : 0.0f;
            if (WANTED & FLOW_VALID) {
                const Beside across(x, rate), along(y, rate);
                if ((depth >= last.z) & across.inside(Places::width(history)) & along.inside(Places::height(history)))
                    valid = settled(was_seen(history, places, hit.shape, across, along, last, depth));
            }
        }
    }
    if (WANTED & FLOW) {
#if defined(__CUDA_ARCH__)
        reinterpret_cast<float2*>(history.flow.data)[pixel] = make_float2(right, down);
#else
        history.flow.data[2 * size_t(pixel)] = right;
        history.flow.data[2 * size_t(pixel) + 1] = down;
#endif
    }
    if (WANTED & FLOW_VALID)
        history.flow_valid.data[pixel] = static_cast<unsigned char>(valid);
}

}  // namespace warpcam
