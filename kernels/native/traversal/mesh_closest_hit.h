// Triangle meshes behind a region's pixels, on CUDA.
#pragma once
#include "traversal/cooperative_leaf_test.h"
#include "traversal/trace_tile.h"
#include "traversal/ray_queue.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// The rays of one warp.
template <int WORDS> struct MeshRays : RayQueue<WORDS> {
    static constexpr bool ANY = false;     // the nearest of a mesh's faces
    static constexpr bool PAIRED = false;  // each lane tests the faces of its own ray
    float depth[WARP_SIZE];  // of the waiting rays' nearest hits so far
};

// Rays of a warp that has few: its lanes test faces for each other, see traversal/cooperative_leaf_test.h.
template <int WORDS> struct PairedMeshRays : MeshRays<WORDS> {
    static constexpr bool PAIRED = true;
    PairRoom room;
};

// Rays for which distance matters between meshes, not within one: any face that is hit will do.
template <int WORDS> struct AnyMeshRays : MeshRays<WORDS> {
    static constexpr bool ANY = true, PAIRED = true;
    AnyPairRoom room;
};

// Rays for a list of this capacity. Where there are many meshes, of few faces each, a ray hits about as many faces as
// it tests.
template <int CAPACITY, bool PAIRED = (CAPACITY <= 64)> struct MeshRaysOf {
    using type = PairedMeshRays<(CAPACITY + WARP_SIZE - 1) / WARP_SIZE>;
};
template <int CAPACITY> struct MeshRaysOf<CAPACITY, false> {
    using type = MeshRays<(CAPACITY + WARP_SIZE - 1) / WARP_SIZE>;
};

// A node that waits, and where the ray enters it: loaded and stored at once.
struct alignas(8) Pending {
    int node;
    float enter;

    WARPCAM_DEVICE int before(float depth) const
    {
        const Pending one = *this;
        return one.enter < depth ? one.node : NO_NODE;
    }
};

template <bool ANY> struct PendingOf {
    using type = Pending;
};
template <> struct PendingOf<true> {
    using type = int;
};

constexpr int A_FEW_MESHES = 3;  // that rays try one after another at once

// Finds the rays of a tile that meet meshes before their hits and lets them wait; nobody waits yet. Returns how many.
// meshes_of(word): those of a word of ranks that touch the tile.
template <class Types, int LENS, int CAPACITY, int WORDS, class Meshes, class MeshesOf>
WARPCAM_DEVICE int find_rays(MeshRays<WORDS>& rays, const ShapeList<CAPACITY>& list, int column, int row,
                             const CameraRay<LENS>& ray, float near, const Meshes& meshes, float depth,
                             const MeshesOf& meshes_of)
{
    const int lane = threadIdx.x % WARP_SIZE, words = (list.count + WARP_SIZE - 1) / WARP_SIZE;
    unsigned met[WORDS] {};
    bool any = false;
    for (int word = 0; word < words; ++word) {
        unsigned mask = meshes_of(word);
        if (LENS == PINHOLE && __popc(mask) > A_FEW_MESHES) {  // a lane a mesh, before the rays try one after another
            const TileRays tile = rays_of_tile(ray);
            bool may = mask >> lane & 1;
            if (may) {
                const ShapeRecord& record = list.at_rank(word * WARP_SIZE + lane);
                const auto low = wp::index(meshes.bounds_min, record.axis_z.w),
                           high = wp::index(meshes.bounds_max, record.axis_z.w);
                may = may_meet_box(record, { low[0], low[1], low[2] }, { high[0], high[1], high[2] }, tile);
            }
            mask = __ballot_sync(FULL_WARP, may);
        }
        met[word] = find_meshes(mask, list.records, list.order + word * WARP_SIZE, ray, near, meshes, depth);
        any |= met[word] != 0;
    }
    const unsigned found = __ballot_sync(FULL_WARP, any);
    const int place = (row * TILE_HEIGHT + lane / TILE_WIDTH) * 64 + column * TILE_WIDTH + lane % TILE_WIDTH;
    const int at = rays.put(found, met, words, place);
    if (any)
        rays.depth[at] = depth;
    __syncwarp();
    return __popc(found);
}

// Traces all rays that `next_tile` finds (see Supply) and stores what they hit: store(pixel, hit). `ray_of(pixel)` is a
// pixel's ray. `list` has the shapes that they meet: see ShapeList.
template <class Types, class Rays, class List, class Meshes, class NextTile, class RayOf, class Store>
WARPCAM_DEVICE void trace_rays(Rays& rays, const List& list, const Meshes& meshes, float near,
                               const NextTile& next_tile, const RayOf& ray_of, const Store& store)
{
    const int lane = threadIdx.x % WARP_SIZE, words = (list.count + WARP_SIZE - 1) / WARP_SIZE;
    // Traversal stack of the lane. Where any face will do, a ray's depth stays as it is during traversal: then the
    // stack holds nodes alone, and the last one is in a register before it is needed.
    typename PendingOf<Rays::ANY>::type stack[STACK + Rays::ANY];
    int pixel = 0, word = 0, slot = 0, node = NO_NODE, height = 0, last = NO_NODE, shape = -1, face = -1;
    unsigned left = 0, nodes = 0;
    float depth = 0.0f;
    auto ray = ray_of(0);
    NodeRay<by_child<Types>()> boxes {};
    PendingWork supply { 0, 0, true };
    const auto take = [&](int waiting) {
        pixel = rays.pixel[waiting];
        ray = ray_of(pixel);
        near = near_of(ray, near);
        depth = rays.depth[waiting];
        word = 0;
        left = rays.take(waiting, words);
        rays.go_on(words, word, left);
    };
    const auto pop = [&] {
        if constexpr (Rays::ANY) {
            if (node == NO_NODE && last != NO_NODE) {
                node = last;
                last = stack[--height];
            }
        } else {
            while (node == NO_NODE && height > 0)
                node = stack[--height].before(depth);
        }
    };
    while (true) {
        const unsigned idles = __ballot_sync(FULL_WARP, node == NO_NODE && left == 0);
        if (supply.any() && (__popc(idles) >= MIN_ACTIVE_LANES || idles == FULL_WARP)) {
            if ((idles >> lane & 1) && shape >= 0) {
                store(pixel, Hit { depth, shape, face });
                shape = -1;
            }
            supply.hand_out(idles, next_tile, take);
        } else if (idles == FULL_WARP) {
            if (shape >= 0)
                store(pixel, Hit { depth, shape, face });
            return;
        }

        const unsigned between = __ballot_sync(FULL_WARP, node == NO_NODE && left != 0);  // on to their next meshes
        if (between && (Rays::ANY || __popc(between) >= MIN_ACTIVE_LANES || !__any_sync(FULL_WARP, node != NO_NODE))) {
            if (between >> lane & 1) {
                slot = list.order[word * WARP_SIZE + ctz(left)];
                left &= left - 1;
                rays.go_on(words, word, left);
                const ShapeRecord& record = list.records[slot];
                if (as_float(record.size.w) < depth) {
                    const Ray local = ray.local(record);
                    boxes.set(local.origin, local.direction, record.size.x);
                    nodes = as_int(record.size.y);
                    node = 0;
                } else {
                    left = 0;  // what follows is farther still
                }
            }
        }

        bool inner = node >= 0 && node != NO_NODE;
        unsigned stepping = __ballot_sync(FULL_WARP, inner);
        while (stepping) {
            if (inner) {
                float enter[4], t_far[4], best = MISS;
                int child[4];
                boxes.test(node_rows<Types>(meshes, nodes, node), near, depth, enter, t_far, child);
                node = NO_NODE;
#pragma unroll
                for (int k = 0; k < 4; ++k) {  // without branches
                    const bool met = enter[k] <= t_far[k], nearer = met && enter[k] < best;
                    const int other = nearer ? node : child[k];
                    const bool waits = k > 0 && met && other != NO_NODE;
                    if constexpr (Rays::ANY) {
                        if (waits)
                            stack[height] = last;
                        last = waits ? other : last;
                    } else if (waits) {
                        stack[height] = { other, nearer ? best : enter[k] };
                    }
                    height += waits ? 1 : 0;
                    node = nearer ? child[k] : node;
                    best = nearer ? enter[k] : best;
                }
                pop();
            }
            inner = node >= 0 && node != NO_NODE;
            stepping = __ballot_sync(FULL_WARP, inner);
            if (__popc(stepping) < 2 * MIN_ACTIVE_LANES)
                break;
        }

        const int faces = Rays::PAIRED ? warp_reduce_add(RayFacePairs::faces_of(node)) : 0;
        const bool enough =
            Rays::PAIRED ? faces >= MIN_LEAF_PAIRS : __popc(__ballot_sync(FULL_WARP, node < 0)) >= MIN_ACTIVE_LANES;
        if (enough || (!stepping && __any_sync(FULL_WARP, node < 0))) {
            int left_of_leaf = NO_NODE;
            bool ends = false;
            if constexpr (Rays::PAIRED)
                if (meet_leaves<Types>(rays.room, list, meshes, ray, slot, node, faces, near, stepping != 0, depth,
                                       face, left_of_leaf)) {
                    shape = list.records[slot].axis_y.w;
                    ends = Rays::ANY;
                }
            if (node < 0) {
                if constexpr (!Rays::PAIRED)
                    test_leaf<Types>(list.records[slot], meshes, ray, node, near, depth, shape, face);
                node = left_of_leaf;  // also of a ray that ends: or what it hits would hang on the other lanes
                height = ends ? 0 : height;
                last = ends ? NO_NODE : last;
                pop();
            }
        }
    }
}

}  // namespace warpcam
#endif
