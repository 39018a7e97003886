// How far what a pixel sees has moved in the image since its world was last drawn, and whether it was seen then.
//
// flow.py has composed, for each shape of a world, what takes a point seen now to the pixel where it was. What was seen
// then is kept in a word a pixel, whose order is that of shapes, then of depths.
#pragma once
#include "hits.h"

namespace warpcam {

// What a trace writes of it: bits of visibility.py. FLOW_MOVES: some meshes move.
enum FlowOutput { FLOW = 1 << 24, FLOW_VALID = 1 << 25, FLOW_MOVES = 1 << 26 };
constexpr int FLOWS = FLOW | FLOW_VALID;

// What is kept of a pixel: above the shape, below 16 bits of the depth's float, five of its exponent, which is enough
// for 15 um to 65 km; 0: nothing.
constexpr int DEPTH_BITS = 12, LEAST_DEPTH = 111 << 23;  // what is cut off the float, and bits of 2^-16 m
constexpr unsigned DEPTHS = 0xffffu;
WARPCAM_FN unsigned shape_bits(int shape) { return unsigned(shape + 1) << 16; }
WARPCAM_FN int depth_bits(float depth) { return (as_int(depth) - LEAST_DEPTH) >> DEPTH_BITS; }
WARPCAM_FN unsigned kept_word(int shape, float depth)
{
    return shape < 0 ? 0u : shape_bits(shape) | (unsigned(depth_bits(depth)) & DEPTHS);
}

// Trail.known: what was seen is kept in the first or the second of two places, what is seen goes to the other; or nothing
// is known of what was. Values of views.py.
enum Known { SECOND = 1, FIRST = 2, NEW = 4 };

// Where what one world's last image showed is kept, and where this one's goes.
struct FlowPlaces {
    const unsigned* words;
    unsigned* kept;
    int known;
};

template <class Trail> WARPCAM_FN FlowPlaces flow_places(const Trail& trail, int world)
{
    const int known = wp::index(trail.known, world);
    const size_t first = size_t(world) * (trail.width * trail.height);
    unsigned* one = trail.kept_first.data + first;
    unsigned* other = trail.kept_second.data + first;
    return { known == FIRST ? one : other, known == FIRST ? other : one, known };
}

// Has the word on its way that a pixel that rests will need: it comes from far, and meanwhile the pixel is traced.
WARPCAM_FN void expect_flow(const FlowPlaces& places, int place)
{
#if defined(__CUDA_ARCH__)
    asm volatile("prefetch.global.L1 [%0];" ::"l"(places.words + place));
#endif
}

// How a shape has moved: rows of Trail.motions, see flow.py.
template <bool MOVES, class Trail> struct Motion {
    const void* rows;
    unsigned first;

    WARPCAM_FN Motion(const Trail& trail, int world, int shape)
        : rows(trail.motions.data), first((unsigned(world) * trail.columns + shape) * (MOVES ? 7 : 4))
    {
    }
    WARPCAM_FN Row row(int i) const { return load(rows, first + i); }
    // Row i of the place then in homogeneous pixels, of what pixel (x, y) sees.
    template <int LENS> WARPCAM_FN float then(int i, float x, float y, float depth) const
    {
        const Row by = row(i);
        const float last = as_float(by.w);
        if (LENS == PINHOLE)
            return depth * (by.x * x + by.y * y + by.z) + last;
        return by.x * x + by.y * y + (by.z * depth + last);
    }
};

// How a point of a mesh's face has moved in the mesh's own frame, as it would be without its shape's scale.
template <int TYPES, int LENS, class Trail, class Shapes>
WARPCAM_COLD Vec moved_within(const Trail& trail, const Shapes& shapes, const Camera& camera, const ViewRay<LENS>& seen,
                              const Hit& hit, int corners, int world)
{
    const auto r = wp::index(shapes.rotations, world, hit.shape);
    const Vec away = point_of(hit, camera, seen) - to_vec(wp::index(shapes.positions, world, hit.shape));
    Vec local { r.data[0][0] * away.x + r.data[1][0] * away.y + r.data[2][0] * away.z,
                r.data[0][1] * away.x + r.data[1][1] * away.y + r.data[2][1] * away.z,
                r.data[0][2] * away.x + r.data[1][2] * away.y + r.data[2][2] * away.z };
    if (TYPES >> SCALED & 1) {
        const Vec size = to_vec(row_of(shapes.sizes, world, hit.shape));
        local = { local.x / size.x, local.y / size.y, local.z / size.z };
    }
    const unsigned row = wp::index(trail.face_start, row_of(shapes.assets, world, hit.shape)) + 3 * hit.face;
    const Row first = load(trail.faces.data, row);
    const Vec a = to_vec(first), b = to_vec(load(trail.faces.data, row + 1)), c = to_vec(load(trail.faces.data, row + 2));
    const Vec edge1 = b - a, edge2 = c - a, normal = cross(edge1, edge2), place = local - a;
    const float rate = 1.0f / upper(dot(normal, normal), TINY);
    const float weight1 = dot(cross(place, edge2), normal) * rate, weight2 = dot(cross(edge1, place), normal) * rate;
    const int at = corners + 3 * first.w;
    return (1.0f - weight1 - weight2) * (to_vec(wp::index(trail.corners, at)) - a)
        + weight1 * (to_vec(wp::index(trail.corners, at + 1)) - b) + weight2 * (to_vec(wp::index(trail.corners, at + 2)) - c);
}

// A whole number near a float that is less than 2^22, as bits of a float between 2^23 and 2^24.
constexpr float TO_WHOLE = 12582912.0f;
constexpr int ROUNDED_BITS = 0x4b400000;  // the bits of that

// The word of the pixel that (x, y) lies in, or nothing outside of the image.
template <class Trail> WARPCAM_FN unsigned word_at(const Trail& trail, const unsigned* words, float x, float y)
{
    const unsigned column = unsigned(as_int(x + TO_WHOLE) - ROUNDED_BITS), row = unsigned(as_int(y + TO_WHOLE) - ROUNDED_BITS);
    return column < unsigned(trail.width) && row < unsigned(trail.height) ? words[row * trail.width + column] : 0u;
}

// Was the surface seen in the last image at (x, y), if nothing that is nearer than `threshold` hides it? The pixel there
// must show the shape, and so must one that has a quarter or more of what is interpolated there; of one of them it must
// be a part that is not nearer.
template <class Trail>
WARPCAM_FN bool was_seen(const Trail& trail, const unsigned* words, unsigned shape, float x, float y, float threshold)
{
    const unsigned one = word_at(trail, words, x + 0.25f, y + 0.25f), other = word_at(trail, words, x - 0.25f, y - 0.25f);
    const unsigned least = one < other ? one : other, greatest = one < other ? other : one;
    const int bits = depth_bits(threshold);
    const unsigned farthest = shape | DEPTHS, nearest = shape + unsigned(bits > 0 ? bits : 0);
    return least >= shape && greatest >= nearest && greatest <= farthest;
}

// Writes pixel (i, j), number `pixel` of all worlds'.
template <int TYPES, int LENS, int WANTED, class Trail, class Shapes>
WARPCAM_FN void put_flow(const Trail& trail, const FlowPlaces& places, const Shapes& shapes, const Camera& camera, const ViewRay<LENS>& seen,
                         const Hit& hit, int world, int i, int j, unsigned pixel)
{
    constexpr bool MOVES = WANTED & FLOW_MOVES;
    const int place = j * trail.width + i;
    float right = 0.0f, down = 0.0f;
    bool valid = false;
    if (hit.shape >= 0 && places.known != NEW) {
        const Motion<MOVES, Trail> motion(trail, world, hit.shape);
        const Row last = motion.row(3);  // x: scale of the depth that may hide, below 0: unknown; y: added to it; z: near
        const int corners = last.w >> 1;
        bool still = last.w & 1;
        Vec within { 0.0f, 0.0f, 0.0f };
        if constexpr (MOVES) {
            if (corners >= 0) {
                within = moved_within<TYPES>(trail, shapes, camera, seen, hit, corners, world);
                still = still && within.x == 0.0f && within.y == 0.0f && within.z == 0.0f;
            }
        }
        if (still) {
            if (WANTED & FLOW_VALID)
                valid = (places.words[place] ^ shape_bits(hit.shape)) <= DEPTHS;
        } else if (last.x >= 0.0f) {
            const float column = float(i), row = float(j);
            float x = motion.template then<LENS>(0, column, row, hit.depth);
            float y = motion.template then<LENS>(1, column, row, hit.depth);
            float depth = motion.template then<LENS>(2, column, row, hit.depth);
            if constexpr (MOVES) {
                if (corners >= 0) {
                    x += dot(to_vec(motion.row(4)), within);
                    y += dot(to_vec(motion.row(5)), within);
                    depth += dot(to_vec(motion.row(6)), within);
                }
            }
            if (LENS != PINHOLE || depth > 0.0f) {
                if (LENS == PINHOLE) {
                    const float rate = reciprocal(depth);
                    x *= rate;
                    y *= rate;
                }
                right = column - x;
                down = row - y;
                if (WANTED & FLOW_VALID) {
                    const float threshold = last.x * depth + last.y;
                    valid = depth >= last.z
                        && was_seen(trail, places.words, shape_bits(hit.shape), x, y, threshold);
                }
            }
        }
    }
    if (WANTED & FLOW) {
#if defined(__CUDA_ARCH__)
        reinterpret_cast<float2*>(trail.flow.data)[pixel] = make_float2(right, down);
#else
        trail.flow.data[2 * size_t(pixel)] = right;
        trail.flow.data[2 * size_t(pixel) + 1] = down;
#endif
    }
    if (WANTED & FLOW_VALID) {
        trail.flow_valid.data[pixel] = valid ? 1 : 0;
        places.kept[place] = kept_word(hit.shape, hit.depth);
    }
}

}  // namespace warpcam
