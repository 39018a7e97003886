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

// Rows of Trail.motions that a shape has, and the last word of the fourth where it rests: see flow.py.
template <bool MOVES> constexpr int motion_rows() { return MOVES ? 7 : 4; }
constexpr int STILL = -1;

// What is kept of a pixel: above the shape, all ones where nothing is seen; below 16 bits of the depth's float, five of
// its exponent, which is enough for 15 um to 65 km.
constexpr int DEPTH_BITS = 12, LEAST_DEPTH = 111 << 23;  // what is cut off the float, and bits of 2^-16 m
constexpr unsigned DEPTHS = 0xffffu;
WARPCAM_FN unsigned kept_word(int shape, float depth)
{
    const unsigned bits = unsigned(as_int(depth) - LEAST_DEPTH) << (16 - DEPTH_BITS);
#if defined(__CUDA_ARCH__)
    return __byte_perm(bits, shape, 0x5432);
#else
    return unsigned(shape) << 16 | bits >> 16;
#endif
}

// The word of a pixel, of a trace that writes none that it reads.
WARPCAM_FN unsigned word_at(const unsigned* words, unsigned place)
{
#if defined(__CUDA_ARCH__)
    return __ldg(words + place);
#else
    return words[place];
#endif
}

WARPCAM_FN void keep_word(unsigned* words, unsigned place, unsigned word)
{
#if defined(__CUDA_ARCH__)  // the compiler does not know that it is in global memory
    asm volatile("st.global.u32 [%0], %1;" ::"l"(words + place), "r"(word) : "memory");
#else
    words[place] = word;
#endif
}

// 1 or 0, of which the compiler makes no condition that it carries along.
WARPCAM_FN unsigned settled(bool condition)
{
    unsigned number = condition;
#if defined(__CUDA_ARCH__)
    asm("" : "+r"(number));
#endif
    return number;
}

// By how much a word is above the least that a shape has: at most DEPTHS if it is of the shape.
WARPCAM_FN unsigned above(unsigned word, int shape) { return word - (unsigned(shape) << 16); }

// Trail.known: what was seen is kept in the first or the second of two places, what is seen goes to the other; or nothing
// is known of what was. Values of views.py.
enum Known { SECOND = 1, FIRST = 2, NEW = 4 };

// What the last images showed and where these are kept, of all worlds; the former of one world; how its shapes have moved.
struct FlowPlaces {
    const unsigned* all_words;
    unsigned* kept;
    const unsigned* words;
    const void* motions;
};

template <bool MOVES, class Trail> WARPCAM_FN FlowPlaces flow_places(const Trail& trail, int world)
{
    const bool in_first = wp::index(trail.known, world) == FIRST;
    unsigned* last = in_first ? trail.kept_first.data : trail.kept_second.data;
    return { last, in_first ? trail.kept_second.data : trail.kept_first.data,
             last + size_t(world) * (trail.width * trail.height),
             trail.motions.data + size_t(world) * trail.columns * motion_rows<MOVES>() };
}

// Has the word on its way that a pixel that rests will need: it comes from far, and meanwhile the pixel is traced.
WARPCAM_FN void expect_flow(const FlowPlaces& places, int place)
{
#if defined(__CUDA_ARCH__)
    asm volatile("prefetch.global.L1 [%0];" ::"l"(places.words + place));
#endif
}

// Row i of the place then in homogeneous pixels, of what pixel (x, y) sees: Trail.motions of flow.py.
template <int LENS> WARPCAM_FN float then(const Row& by, float x, float y, float depth)
{
    const float last = as_float(by.w);
    if (LENS == PINHOLE)
        return depth * (by.x * x + (by.y * y + by.z)) + last;
    return by.x * x + (by.y * y + (by.z * depth + last));
}

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

// Places in an image are counted in steps of 1 / 64 pixel: the last bits of a float between 2^17 and 2^18.
constexpr int STEP_BITS = 6, STEPS = 1 << STEP_BITS;
constexpr float TO_STEPS = 196608.0f;
constexpr int NO_STEPS = 0x48400000;  // the bits of that

// Along one axis the two pixels that have a quarter or more of what is interpolated at a place, mostly the same one.
struct Beside {
    unsigned steps;  // to the place from a quarter of a pixel before the middle of the image's first

    // The place is x * scale.
    WARPCAM_FN Beside(float x, float scale) : steps(as_int(muladd(x, scale, TO_STEPS + 0.25f)) - NO_STEPS) { }
    WARPCAM_FN bool inside(int pixels) const { return steps < unsigned(STEPS * pixels - STEPS / 2); }
    WARPCAM_FN unsigned one() const { return steps >> STEP_BITS; }
    WARPCAM_FN unsigned other() const { return (steps + STEPS / 2) >> STEP_BITS; }
};

// Was the surface seen in the last image at a place inside of it, if nothing that is nearer than `threshold` hides it?
// The pixel there must show the shape, and so must one that has a quarter or more of what is interpolated there; of one
// of them it must be a part that is not nearer.
template <class Trail>
WARPCAM_FN bool was_seen(const Trail& trail, const unsigned* words, int shape, const Beside& x, const Beside& y,
                         float threshold)
{
    const unsigned one = above(word_at(words, y.one() * trail.width + x.one()), shape);
    const unsigned other = above(word_at(words, y.other() * trail.width + x.other()), shape);
    const unsigned most = one > other ? one : other;
    constexpr int LAST = LEAST_DEPTH + (1 << DEPTH_BITS) - 1;  // of what is cut off
    return most <= DEPTHS && int(most << DEPTH_BITS) + LAST >= as_int(threshold);
}

// Writes pixel (i, j), number `pixel` of all worlds'.
template <int TYPES, int LENS, int WANTED, class Trail, class Shapes>
WARPCAM_FN void put_flow(const Trail& trail, const FlowPlaces& places, const Shapes& shapes, const Camera& camera, const ViewRay<LENS>& seen,
                         const Hit& hit, int world, int i, int j, unsigned pixel)
{
    constexpr bool MOVES = WANTED & FLOW_MOVES;
    float right = 0.0f, down = 0.0f;
    unsigned valid = 0;
    if (hit.shape >= 0) {
        const Row* rows = static_cast<const Row*>(places.motions) + size_t(unsigned(hit.shape)) * motion_rows<MOVES>();
#if defined(__CUDA_ARCH__)
        asm("" : "+l"(rows));  // one address with four offsets
#endif
        const Row last = load(rows, 3);  // x: scale of the depth that may hide; y: added to it; z: near
        bool still = MOVES ? last.w & 1 : last.w == STILL;
        const int corners = last.w >> 1;
        Vec within { 0.0f, 0.0f, 0.0f };
        if constexpr (MOVES) {
            if (corners >= 0) {
                within = moved_within<TYPES>(trail, shapes, camera, seen, hit, corners, world);
                still = still && within.x == 0.0f && within.y == 0.0f && within.z == 0.0f;
            }
        }
        if (still) {
            if (WANTED & FLOW_VALID)
                valid = settled(above(word_at(places.all_words, pixel), hit.shape) <= DEPTHS);
        } else {
            const float column = float(i), row = float(j);
            float x = then<LENS>(load(rows, 0), column, row, hit.depth);
            float y = then<LENS>(load(rows, 1), column, row, hit.depth);
            float depth = then<LENS>(load(rows, 2), column, row, hit.depth);
            if constexpr (MOVES) {
                if (corners >= 0) {
                    x += dot(to_vec(load(rows, 4)), within);
                    y += dot(to_vec(load(rows, 5)), within);
                    depth += dot(to_vec(load(rows, 6)), within);
                }
            }
            if (LENS != PINHOLE || depth > 0.0f) {
                const float rate = LENS == PINHOLE ? reciprocal(depth) : 1.0f;
                right = muladd(-x, rate, column);
                down = muladd(-y, rate, row);
                if (WANTED & FLOW_VALID) {
                    const Beside across(x, rate), along(y, rate);
                    if (depth >= last.z && across.inside(trail.width) && along.inside(trail.height))
                        valid = settled(was_seen(trail, places.words, hit.shape, across, along,
                                                 muladd(last.x, depth, last.y)));
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
        trail.flow_valid.data[pixel] = static_cast<unsigned char>(valid);
        keep_word(places.kept, pixel, kept_word(hit.shape, hit.depth));
    }
}

}  // namespace warpcam
