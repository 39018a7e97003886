// How far what a pixel sees has moved in the image since its world was last drawn, and whether it was seen then.
//
// flow.py has composed, for each shape of a world, what takes a point seen now to where it was then, less the point
// itself: so what rests is at rest exactly, and small motion is exact. What was seen then is kept in a word a pixel.
#pragma once
#include "hits.h"

namespace warpcam {

// What a trace writes of it: bits of visibility.py. FLOW_MOVES: some meshes move.
enum FlowOutput { FLOW = 1 << 24, FLOW_VALID = 1 << 25, FLOW_MOVES = 1 << 26 };
constexpr int FLOWS = FLOW | FLOW_VALID;

constexpr float ENOUGH = 0.75f;  // share of what is interpolated at the place then that must show the same shape

// What is kept of a pixel: above the shape, below 16 bits of the depth's float, five of its exponent; 0: nothing.
constexpr int DEPTH_BITS = 12, LEAST_DEPTH = 111 << 23;  // what is cut off the float, and bits of 2^-16 m
WARPCAM_FN unsigned shape_bits(int shape) { return unsigned(shape + 1) << 16; }
WARPCAM_FN unsigned kept_word(int shape, float depth)
{
    const int bits = (as_int(depth) - LEAST_DEPTH) >> DEPTH_BITS;
    return shape < 0 ? 0u : shape_bits(shape) | unsigned(between(bits, 0, 0xffff));
}
WARPCAM_FN float kept_depth(unsigned word) { return as_float(int((word & 0xffffu) << DEPTH_BITS) + LEAST_DEPTH); }

// How a shape has moved, from rows of Trail.motions; see flow.py. In pixels right of and below the principal point, with
// metres along the optical axis: a plane's worth of rates by column, row and 1, then what does not grow with depth.
struct Moved {
    Row right, down, nearer;
    float reach, slack;  // by how much what was seen may be nearer than the place then: part, [m]; reach < 0: unknown
    int corners;  // first corner then, of a mesh that moves, or -1
};

template <bool MOVES, class Trail> WARPCAM_FN Moved load_moved(const Trail& trail, int world, int shape)
{
    const unsigned row = (unsigned(world) * trail.columns + shape) * (MOVES ? 7 : 4);
    const void* rows = trail.motions.data;
    const Row last = load(rows, row + 3);
    return { load(rows, row), load(rows, row + 1), load(rows, row + 2), last.x, last.y, as_int(last.z) };
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

// Was the surface seen in the last image at (x, y), where its depth was `depth`? Of the four pixels around enough must
// show the same shape, and not all of them something of it that is nearer.
template <class Trail>
WARPCAM_FN bool was_seen(const Trail& trail, const Moved& moved, const unsigned* words, int shape, float x, float y,
                         float depth)
{
    const int last_column = trail.width - 1, last_row = trail.height - 1;
    if (!(x >= -0.5f && x <= float(last_column) + 0.5f && y >= -0.5f && y <= float(last_row) + 0.5f))
        return false;
    const int column = int(x + 1.0f) - 1, row = int(y + 1.0f) - 1;  // rounded down
    const float u = x - float(column), v = y - float(row);
    float share = 0.0f, farthest = 0.0f;
    for (int k = 0; k < 4; ++k) {
        const int i = between(column + (k & 1), 0, last_column), j = between(row + (k >> 1), 0, last_row);
        const unsigned word = words[unsigned(j * trail.width + i)];
        if ((word ^ shape_bits(shape)) < 0x10000u) {
            share += (k & 1 ? u : 1.0f - u) * (k >> 1 ? v : 1.0f - v);
            farthest = upper(farthest, kept_depth(word));
        }
    }
    return share >= ENOUGH && depth <= farthest + moved.reach * farthest + moved.slack;
}

// Writes pixel (i, j), number `pixel` of all worlds' and `place` of its own world's.
template <int TYPES, int LENS, int WANTED, class Trail, class Shapes>
WARPCAM_FN void put_flow(const Trail& trail, const Shapes& shapes, const Camera& camera, const ViewRay<LENS>& seen,
                         const Hit& hit, int world, int i, int j, unsigned pixel)
{
    constexpr bool MOVES = WANTED & FLOW_MOVES;
    const Row range = load(trail.changes.data, 2 * unsigned(world) + 1);  // nearest and farthest then, what is known
    const int known = range.w;  // 1, 2: where what was seen is kept; 0: nothing is known
    float right = 0.0f, down = 0.0f;
    bool valid = false;
    if (hit.shape >= 0 && known != 0) {
        const Moved moved = load_moved<MOVES>(trail, world, hit.shape);
        if (moved.reach >= 0.0f) {
            const Row lens = load(trail.changes.data, 2 * unsigned(world));
            const float x = float(i) + 0.5f - camera.center_x, y = float(j) + 0.5f - camera.center_y;
            const float near = LENS == PINHOLE ? hit.depth : 1.0f, far = LENS == PINHOLE ? 0.0f : hit.depth;
            const auto along = [&](const Row& by) {
                const float constant = as_float(by.w);
                if (LENS == PINHOLE)
                    return near * (by.x * x + by.y * y + by.z) + constant;
                return by.x * x + by.y * y + (by.z * far + constant);
            };
            float shift_x = along(moved.right), shift_y = along(moved.down), nearer = along(moved.nearer);
            if constexpr (MOVES) {
                if (moved.corners >= 0) {
                    const Vec within = moved_within<TYPES>(trail, shapes, camera, seen, hit, moved.corners, world);
                    const unsigned row = (unsigned(world) * trail.columns + hit.shape) * 7 + 4;
                    shift_x += dot(to_vec(load(trail.motions.data, row)), within);
                    shift_y += dot(to_vec(load(trail.motions.data, row + 1)), within);
                    nearer += dot(to_vec(load(trail.motions.data, row + 2)), within);
                }
            }
            const float depth = hit.depth - nearer;
            if (LENS != PINHOLE || depth > 0.0f) {
                const float zoom_x = lens.z * x, zoom_y = as_float(lens.w) * y;
                if (LENS == PINHOLE) {
                    const float rate = reciprocal(depth);
                    shift_x = (shift_x + (x - zoom_x) * nearer) * rate;
                    shift_y = (shift_y + (y - zoom_y) * nearer) * rate;
                }
                right = lens.x + zoom_x - shift_x;
                down = lens.y + zoom_y - shift_y;
                if (WANTED & FLOW_VALID) {
                    const auto* kept = known == 1 ? trail.kept_first.data : trail.kept_second.data;
                    const unsigned* words = kept + unsigned(world) * unsigned(trail.width * trail.height);
                    valid = depth >= range.x && depth <= range.y
                        && was_seen(trail, moved, words, hit.shape, float(i) - right, float(j) - down, depth);
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
        (known == 1 ? trail.kept_second : trail.kept_first).data[pixel] = kept_word(hit.shape, hit.depth);
    }
}

}  // namespace warpcam
