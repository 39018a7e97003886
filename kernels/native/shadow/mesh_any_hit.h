// Shadow rays at triangle meshes, on CUDA. Any face in the way will do, so that, unlike in
// traversal/mesh_closest_hit.h, nothing is sorted and nothing remembered but where to go on.
#pragma once
#include "traversal/cooperative_leaf_test.h"
#include "shadow/shadow_tile.h"
#include "traversal/ray_queue.h"

namespace warpcam {
#if defined(__CUDA_ARCH__)

// The rays of one warp. What its lanes seldom need of their own rays is here too. Boxes: what they need at every node.
template <int WORDS, class Boxes> struct ShadowRays : RayQueue<WORDS> {
    struct Start {
        float x[WARP_SIZE], y[WARP_SIZE], z[WARP_SIZE];

        WARPCAM_DEVICE Vec3 at(int ray) const { return { x[ray], y[ray], z[ray] }; }
        WARPCAM_DEVICE void put(int ray, Vec3 point)
        {
            x[ray] = point.x;
            y[ray] = point.y;
            z[ray] = point.z;
        }
    };

    // Stores lanes' traversal state in shared memory, if it has room, while their warp looks for rays: in registers it
    // would be spilled, and reloaded at every node.
    static constexpr bool KEEPS = WORDS <= 2;
    static constexpr int PARTS = sizeof(Boxes) / sizeof(float);

    Start waiting_start;                // of the rays that wait
    Span waiting_span[WARP_SIZE];
    Start start;                        // of the lanes' own
    Span span[WARP_SIZE];
    unsigned short own[WARP_SIZE];          // their pixels
    float frame[12][WARP_SIZE];             // see RayFrame, for the mesh that the lane is at
    int walk[KEEPS ? 3 : 1][WARP_SIZE];     // a lane's node, how many wait behind it, its mesh's place in the list
    float boxes[KEEPS ? PARTS : 1][WARP_SIZE];
    unsigned char owners[WARP_SIZE];

    WARPCAM_DEVICE void keep_walk(int node, int height, int slot)
    {
        if constexpr (KEEPS) {
            const int lane = threadIdx.x % WARP_SIZE;
            walk[0][lane] = node;
            walk[1][lane] = height;
            walk[2][lane] = slot;
        }
    }

    WARPCAM_DEVICE void keep_boxes(const Boxes& ray)
    {
        if constexpr (KEEPS) {
#pragma unroll
            for (int k = 0; k < PARTS; ++k)
                boxes[k][threadIdx.x % WARP_SIZE] = reinterpret_cast<const float*>(&ray)[k];
        }
    }

    // Both as they were kept, boxes when the lane's ray came to its mesh.
    WARPCAM_DEVICE void go_on_walking(int& node, int& height, int& slot, Boxes& ray) const
    {
        if constexpr (KEEPS) {
            const int lane = threadIdx.x % WARP_SIZE;
            node = walk[0][lane];
            height = walk[1][lane];
            slot = walk[2][lane];
#pragma unroll
            for (int k = 0; k < PARTS; ++k)
                reinterpret_cast<float*>(&ray)[k] = boxes[k][lane];
        }
    }

    // Queues waiting rays, as put() above does, with the start of the lane's ray.
    WARPCAM_DEVICE void put(unsigned found, const unsigned* met, int words, int place, Vec3 point, const Span& its_span)
    {
        const int at = RayQueue<WORDS>::put(found, met, words, place);
        if (found >> threadIdx.x % WARP_SIZE & 1) {
            waiting_start.put(at, point);
            waiting_span[at] = its_span;
        }
    }

    WARPCAM_DEVICE void put_frame(const RayFrame& f)
    {
        const int lane = threadIdx.x % WARP_SIZE;
        const Vec3 parts[4] = { f.origin, f.across, f.up, f.depth };
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            frame[3 * k][lane] = parts[k].x;
            frame[3 * k + 1][lane] = parts[k].y;
            frame[3 * k + 2][lane] = parts[k].z;
        }
    }

    WARPCAM_DEVICE RayFrame frame_of(int lane) const
    {
        return { { frame[0][lane], frame[1][lane], frame[2][lane] },
                 { frame[3][lane], frame[4][lane], frame[5][lane] },
                 { frame[6][lane], frame[7][lane], frame[8][lane] },
                 { frame[9][lane], frame[10][lane], frame[11][lane] } };
    }
};

// True if a face of the lane's leaf, if its `node` is one, blocks its ray to the light. All lanes test faces for all.
template <class Types, class Rays, class List, class Meshes>
WARPCAM_DEVICE bool meets_leaves(Rays& rays, const List& list, const LightView& light, const Meshes& meshes, int slot,
                                 int node)
{
    const RayFacePairs pairs(node, warp_reduce_add(RayFacePairs::faces_of(node)));
    bool met = false;
    for (int window = 0; window < pairs.count; window += WARP_SIZE) {
        int start;
        const int from = pairs.owner(rays.owners, window, start), number = pairs.face(window, from);
        const int its_slot = __shfl_sync(FULL_WARP, slot, from);
        bool meets = false;
        if (window + threadIdx.x % WARP_SIZE < pairs.count) {
            const unsigned row = unsigned(list.aims[its_slot].w) + unsigned(number * FACE_ROWS);
            const Float3Int a = load(meshes.faces.data, row), b = load(meshes.faces.data, row + 1);
            const Float3Int c = load(meshes.faces.data, row + 2);
            const RayFrame frame = rays.frame_of(from);
            const float t =
                enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                               project(frame, c.x, c.y, c.z), (Types::has(SHADING_BACKS)) || has_back<Types>(b.w));
            const Span span = rays.span[from];
            meets = (t > span.near) & (t < span.reach);
            if constexpr (Types::has(ALPHA_TESTED)) {
                const Vec3 point = rays.start.at(from);
                const ShapeRecord& record = list.records[its_slot];
                meets = meets
                        && is_there<Types>(meshes, record, WorldRay { point, ray_to(light, point) }.local(record),
                                           number, t);
            }
        }
        met |= (__ballot_sync(FULL_WARP, meets) & pairs.places(window)) != 0;
    }
    return met;
}

// Calls shade(pixel) for each ray that `next_tile` finds (see Supply) and that meets a front face, or any where backs
// shade, on its way to the light.
template <class Types, int WORDS, class Boxes, class List, class Meshes, class NextTile, class Shade>
WARPCAM_DEVICE void cast_rays(ShadowRays<WORDS, Boxes>& rays, const List& list, const LightView& light,
                              const Meshes& meshes, const NextTile& next_tile, const Shade& shade)
{
    const int lane = threadIdx.x % WARP_SIZE, words = WORDS == 1 ? 1 : (list.count + WARP_SIZE - 1) / WARP_SIZE;
    const float far =
        light.distant ? MAX_RAY_T : 1.0f;  // nodes are visited up to here; only faces must lie within the span
    int stack[STACK];
    int word = 0, slot = 0, node = NO_NODE, height = 0;
    unsigned left = 0, nodes = 0;
    Boxes boxes {};
    PendingWork supply { 0, 0, true };
    const auto take = [&](int ray) {
        rays.own[lane] = rays.pixel[ray];
        rays.start.put(lane, rays.waiting_start.at(ray));
        rays.span[lane] = rays.waiting_span[ray];
        word = 0;
        left = rays.take(ray, words);
        rays.go_on(words, word, left);
    };
    while (true) {
        const unsigned idles = __ballot_sync(FULL_WARP, node == NO_NODE && left == 0);
        if (supply.any() && (__popc(idles) >= MIN_ACTIVE_LANES || idles == FULL_WARP)) {
            rays.keep_walk(node, height, slot);
            supply.hand_out(idles, next_tile, take);
            rays.go_on_walking(node, height, slot, boxes);
            nodes = list.records[slot].origin.w;
        } else if (idles == FULL_WARP) {
            return;
        }

        const unsigned between = __ballot_sync(FULL_WARP, node == NO_NODE && left != 0);  // on to their next meshes
        if (between && (__popc(between) >= MIN_ACTIVE_LANES || !__any_sync(FULL_WARP, node != NO_NODE))) {
            if (node == NO_NODE && left != 0) {
                slot = (WORDS == 1 ? 0 : word * WARP_SIZE) + ctz(left);
                left &= left - 1;
                rays.go_on(words, word, left);
                const ShapeRecord& record = list.records[slot];
                const Vec3 point = rays.start.at(lane);
                const WorldRay ray { point, ray_to(light, point) };
                const Ray local = ray.local(record);
                rays.put_frame(ray.template frame<Types>(record));
                boxes.set(local.origin, local.direction, record.size.x);
                rays.keep_boxes(boxes);
                nodes = record.origin.w;
                node = 0;
            }
        }

        bool inner = node >= 0 && node != NO_NODE;
        unsigned stepping = __ballot_sync(FULL_WARP, inner);
        while (stepping) {
            if (inner) {
                float enter[4], t_far[4];
                int child[4];
                boxes.test(node_rows<Types>(meshes, nodes, node), 0.0f, far, enter, t_far, child);
                node = NO_NODE;
#pragma unroll
                for (int k = 0; k < 4; ++k) {  // without branches
                    const bool met = enter[k] <= t_far[k], waits = k > 0 && met && node != NO_NODE;
                    if (waits)
                        stack[height] = node;
                    height += waits ? 1 : 0;
                    node = met ? child[k] : node;
                }
                if (node == NO_NODE && height > 0)
                    node = stack[--height];
            }
            inner = node >= 0 && node != NO_NODE;
            stepping = __ballot_sync(FULL_WARP, inner);
            if (__popc(stepping) < 2 * MIN_ACTIVE_LANES)
                break;
        }

        const unsigned leaves = __ballot_sync(FULL_WARP, node < 0);
        if (leaves && (__popc(leaves) >= MIN_ACTIVE_LANES / 2 || !stepping)) {
            __syncwarp();  // frames that one lane writes another may read
            const bool met = meets_leaves<Types>(rays, list, light, meshes, slot, node);
            if (node < 0) {
                if (met) {
                    shade(rays.own[lane]);
                    left = 0;
                    height = 0;
                }
                node = height > 0 ? stack[--height] : NO_NODE;
            }
        }
    }
}

#endif
}  // namespace warpcam
