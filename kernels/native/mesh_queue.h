// Triangle meshes behind a region's pixels, on CUDA.
#pragma once
#include "mask.h"
#include "tiles.h"
#include "waiting_rays.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// The rays of one warp.
template <int WORDS> struct MeshRays: WaitingRays<WORDS> {
    float depth[LANES];  // of the waiting rays' nearest hits so far
};

// Finds the rays of a tile that meet meshes before their hits and lets them wait; nobody waits yet. Returns how many.
template <int TYPES, int LENS, int CAPACITY, int WORDS, class Meshes>
WARPCAM_FN int find_rays(MeshRays<WORDS>& rays, const ShapeList<CAPACITY>& list, int column, int row,
                         const ViewRay<LENS>& ray, float near, const Meshes& meshes, float depth)
{
    const int lane = threadIdx.x % LANES, words = (list.count + LANES - 1) / LANES;
    unsigned met[WORDS];
    bool any = false;
    for (int word = 0; word < words; ++word) {
        const int rank = word * LANES + lane;
        const bool mine = rank < list.count && touches(list.tiles[rank], column, row)
            && is_mesh<TYPES>(list.records[list.order[rank]]);
        met[word] = find_meshes(__ballot_sync(ALL, mine), list.records, list.order + word * LANES, ray, near, meshes,
                                depth);
        any |= met[word] != 0;
    }
    const unsigned found = __ballot_sync(ALL, any);
    const int place = (row * TILE_HEIGHT + lane / TILE_WIDTH) * 64 + column * TILE_WIDTH + lane % TILE_WIDTH;
    const int at = rays.put(found, met, words, place);
    if (any)
        rays.depth[at] = depth;
    __syncwarp();
    return __popc(found);
}

// Traces all rays that `next_tile` finds (see Supply) and stores what they hit: store(pixel, hit). `ray_of(pixel)` is a
// pixel's ray. `list` has the shapes that they meet: see ShapeList.
template <int TYPES, int WORDS, class List, class Meshes, class NextTile, class RayOf, class Store>
WARPCAM_FN void trace_rays(MeshRays<WORDS>& rays, const List& list, const Meshes& meshes, float near,
                           const NextTile& next_tile, const RayOf& ray_of, const Store& store)
{
    const int lane = threadIdx.x % LANES, words = (list.count + LANES - 1) / LANES;
    int stack[STACK];
    float entries[STACK];
    int pixel = 0, word = 0, slot = 0, node = NO_NODE, height = 0, shape = -1, face = -1;
    unsigned left = 0, nodes = 0;
    float depth = 0.0f;
    auto ray = ray_of(0);
    Slabs s {};
    Supply supply { 0, 0, true };
    const auto take = [&](int waiting) {
        pixel = rays.pixel[waiting];
        ray = ray_of(pixel);
        near = near_of(ray, near);
        depth = rays.depth[waiting];
        word = 0;
        left = rays.take(waiting, words);
        rays.go_on(words, word, left);
    };
    while (true) {
        const unsigned idles = __ballot_sync(ALL, node == NO_NODE && left == 0);
        if (supply.any() && (__popc(idles) >= FEW || idles == ALL)) {
            if ((idles >> lane & 1) && shape >= 0) {
                store(pixel, Hit { depth, shape, face });
                shape = -1;
            }
            supply.hand_out(idles, next_tile, take);
        } else if (idles == ALL) {
            if (shape >= 0)
                store(pixel, Hit { depth, shape, face });
            return;
        }

        const unsigned between = __ballot_sync(ALL, node == NO_NODE && left != 0);  // on to their next meshes
        if (between && (__popc(between) >= FEW || !__any_sync(ALL, node != NO_NODE))) {
            if (between >> lane & 1) {
                slot = list.order[word * LANES + lowest_bit(left)];
                left &= left - 1;
                rays.go_on(words, word, left);
                const Record& record = list.records[slot];
                if (as_float(record.size.w) < depth) {
                    const Ray local = ray.local(record);
                    s = slabs(local.origin, local.direction, record.size.x);
                    nodes = wp::index(meshes.node_start, record.axis_z.w);
                    node = 0;
                } else {
                    left = 0;  // what follows is farther still
                }
            }
        }

        bool inner = node >= 0 && node != NO_NODE;
        unsigned stepping = __ballot_sync(ALL, inner);
        while (stepping) {
            if (inner) {
                const unsigned at = nodes + unsigned(node * NODE_ROWS);
                float best = FAR_AWAY;
                node = NO_NODE;
#pragma unroll
                for (int k = 0; k < 4; ++k) {
                    const Row low = load(meshes.nodes.data, at + 2 * k), high = load(meshes.nodes.data, at + 2 * k + 1);
                    const float x0 = low.x * s.scale.x + s.down.x, x1 = high.x * s.scale.x + s.up.x;
                    const float y0 = low.y * s.scale.y + s.down.y, y1 = high.y * s.scale.y + s.up.y;
                    const float z0 = low.z * s.scale.z + s.down.z, z1 = high.z * s.scale.z + s.up.z;
                    const float enter = upper(upper(lower(x0, x1), lower(y0, y1)), upper(lower(z0, z1), near));
                    const float leave = lower(lower(upper(x0, x1), upper(y0, y1)), lower(upper(z0, z1), depth));
                    if (enter <= leave) {
                        const bool nearer = enter < best;
                        if (node != NO_NODE) {
                            stack[height] = nearer ? node : low.w;
                            entries[height++] = nearer ? best : enter;
                        }
                        node = nearer ? low.w : node;
                        best = nearer ? enter : best;
                    }
                }
                while (node == NO_NODE && height > 0)
                    if (entries[--height] < depth)
                        node = stack[height];
            }
            inner = node >= 0 && node != NO_NODE;
            stepping = __ballot_sync(ALL, inner);
            if (__popc(stepping) < 2 * FEW)
                break;
        }

        const unsigned leaves = __ballot_sync(ALL, node < 0);
        if (leaves && (__popc(leaves) >= FEW || !stepping)) {
            if (node < 0) {
                const int code = -node - 1, first = code >> 4, end = first + (code & 15);
                const Record& record = list.records[slot];
                const RayFrame frame = ray.template frame<TYPES>(record);
                const unsigned faces = wp::index(meshes.face_start, record.axis_z.w);
                constexpr int TOGETHER = faces_together(TYPES);
                for (int begin = first; begin < end; begin += TOGETHER) {
                    Row corners[TOGETHER][3];
#pragma unroll
                    for (int i = 0; i < TOGETHER; ++i) {
                        const unsigned at = faces + unsigned(face_of<TOGETHER>(begin, i, end) * FACE_ROWS);
#pragma unroll
                        for (int k = 0; k < 3; ++k)
                            corners[i][k] = load(meshes.faces.data, at + k);
                    }
#pragma unroll
                    for (int i = 0; i < TOGETHER; ++i) {
                        const int f = face_of<TOGETHER>(begin, i, end);
                        const Row &a = corners[i][0], &b = corners[i][1], &c = corners[i][2];
                        const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z),
                                                       project(frame, b.x, b.y, b.z), project(frame, c.x, c.y, c.z),
                                                       has_back<TYPES>(b.w));
                        if (t < depth && t > near && is_there<TYPES>(meshes, record, ray.local(record), f, t)) {
                            depth = t;
                            shape = record.axis_y.w;
                            face = f;
                        }
                    }
                }
                node = NO_NODE;
                while (node == NO_NODE && height > 0)
                    if (entries[--height] < depth)
                        node = stack[height];
            }
        }
    }
}

}  // namespace warpcam
#endif
