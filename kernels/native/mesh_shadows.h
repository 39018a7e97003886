// Shadow rays at triangle meshes, on CUDA. As in mesh_queue.h rays wait in a queue of the block. But four lanes share a
// ray: each tests one child of a node. Any face in the way will do, so that nothing is sorted and nothing remembered
// but where to go on.
#pragma once
#include "ray_queue.h"
#include "shade_tile.h"

namespace warpcam {
#if defined(__CUDA_ARCH__)

constexpr int GROUP = 4;  // lanes that share a ray, as many as a node has children
constexpr int GROUPS = LANES / GROUP;

template <int WORDS> struct ShadowRays: RayQueue<WORDS> {
    int stacks[THREADS / LANES][STACK][GROUPS];
};

struct LeafTest {
    bool done;  // the ray's leaf has been tested
    bool met;   // and has a face in the ray's way
};

// Tests the faces of leaves, those of up to four rays at once, each with eight lanes. The same in the four lanes of a
// ray are the point where it begins, the slot of its mesh, and its leaf, if `node` is one.
template <int TYPES, class List, class Meshes>
WARPCAM_FN LeafTest test_leaves(const List& list, const Light& light, const Meshes& meshes, Vec point,
                                float near, int slot, int node)
{
    constexpr int EIGHT = 8;
    const int lane = threadIdx.x % LANES;
    const unsigned leaders = __ballot_sync(ALL, node < 0 && lane % GROUP == 0);
    unsigned left = leaders;
    int source = -1;  // the lane whose ray's leaf this lane helps with
    for (int eighth = 0; eighth < LANES / EIGHT && left; ++eighth, left &= left - 1)
        if (lane / EIGHT == eighth)
            source = lowest_bit(left);
    const int from = source < 0 ? 0 : source;
    const WorldRay ray { { __shfl_sync(ALL, point.x, from), __shfl_sync(ALL, point.y, from),
                           __shfl_sync(ALL, point.z, from) }, {} };
    const float start = __shfl_sync(ALL, near, from);
    const int caster = __shfl_sync(ALL, slot, from), code = -__shfl_sync(ALL, node, from) - 1;
    bool met = false;
    if (source >= 0 && lane % EIGHT < (code & 15)) {
        const RayFrame frame = WorldRay { ray.point, ray_to(light, ray.point) }.template frame<TYPES>(list.records[caster]);
        for (int face = lane % EIGHT; face < (code & 15); face += EIGHT) {
            const unsigned at = list.aims[caster].w + unsigned(((code >> 4) + face) * FACE_ROWS);
            const Row a = load(meshes.faces.data, at), b = load(meshes.faces.data, at + 1);
            const Row c = load(meshes.faces.data, at + 2);
            const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                           project(frame, c.x, c.y, c.z));
            met |= (t > start) & (t < reach_of(light, ray.point, start));
        }
    }
    const unsigned all_met = __ballot_sync(ALL, met);
    const int mine = __popc(leaders & ((1u << (lane & ~(GROUP - 1))) - 1));  // of the eights
    const bool done = node < 0 && mine < LANES / EIGHT;
    return { done, done && (all_met >> mine * EIGHT & 255u) };
}

// Calls shade(pixel) for each ray of the queue that meets a front face on its way to the light; start(pixel, span) is
// where it begins. All warps of the block come here together.
template <int TYPES, int WORDS, class List, class Meshes, class Start, class Shade>
WARPCAM_FN void cast_queue(ShadowRays<WORDS>& rays, const List& list, const Light& light,
                           const Meshes& meshes, const Start& start, const Shade& shade)
{
    constexpr int FEW = 3 * GROUP;     // lanes; while rays can still step, fewer wait for others
    constexpr int ENOUGH = 4 * GROUP;  // lanes that step; fewer wait until others have been looked after
    const int lane = threadIdx.x % LANES, member = lane % GROUP, first_lane = lane - member;
    const int words = (list.count + 31) / 32, count = rays.count;
    int(*stack)[GROUPS] = reinterpret_cast<int(*)[GROUPS]>(&rays.stacks[threadIdx.x / LANES][0][lane / GROUP]);
    // the same in all lanes of a group
    int entry = 0, word = 0, slot = 0, node = NO_NODE, height = 0;
    unsigned left = 0, nodes = 0;
    Span span {};
    Vec point {};
    Slabs s {};
    bool more = true;  // rays in the queue
    while (true) {
        const bool idle = node == NO_NODE && left == 0;
        const unsigned idles = __ballot_sync(ALL, idle);
        const bool stuck = !__any_sync(ALL, node >= 0 && node != NO_NODE);  // no ray can step
        if (more && (__popc(idles) >= FEW || (idles && stuck))) {
            const int next = rays.take(__popc(idles) / GROUP);
            more = next + __popc(idles) / GROUP < count;
            const int mine = next + __popc(idles & ((1u << first_lane) - 1)) / GROUP;
            if (idle && mine < count) {
                entry = mine;
                point = start(rays.pixel[entry], span);
                word = 0;
                left = rays.meshes[0][entry];
                rays.go_on(entry, words, word, left);
            }
        } else if (idles == ALL) {
            return;
        }
        const bool between = node == NO_NODE && left != 0;
        const unsigned all_between = __ballot_sync(ALL, between);
        if (between && (stuck || __popc(all_between) >= FEW)) {  // on to the ray's next mesh
            slot = word * 32 + lowest_bit(left);
            left &= left - 1;
            rays.go_on(entry, words, word, left);
            const Record& record = list.records[slot];
            const Ray local = WorldRay { point, ray_to(light, point) }.local(record);
            s = slabs(local.origin, local.direction, record.size.x);
            nodes = record.origin.w;
            node = 0;
        }

        bool inner = node >= 0 && node != NO_NODE;
        unsigned stepping = __ballot_sync(ALL, inner);
        while (stepping) {
            int child = 0;
            bool met = false;
            if (inner) {
                const unsigned at = nodes + unsigned(node * NODE_ROWS + member * 2);
                const Row low = load(meshes.nodes.data, at), high = load(meshes.nodes.data, at + 1);
                const float x0 = low.x * s.scale.x + s.down.x, x1 = high.x * s.scale.x + s.up.x;
                const float y0 = low.y * s.scale.y + s.down.y, y1 = high.y * s.scale.y + s.up.y;
                const float z0 = low.z * s.scale.z + s.down.z, z1 = high.z * s.scale.z + s.up.z;
                const float enter = upper(upper(lower(x0, x1), lower(y0, y1)), upper(lower(z0, z1), span.near));
                met = enter <= lower(lower(upper(x0, x1), upper(y0, y1)), lower(upper(z0, z1), span.reach));
                child = low.w;
            }
            const unsigned group_met = __ballot_sync(ALL, met) >> first_lane & 15u;
            const unsigned others = group_met & (group_met - 1);
            const int chosen = __shfl_sync(ALL, child, lowest_bit(group_met | 8u), GROUP);
            if (others >> member & 1)
                stack[height + __popc(others & ((1u << member) - 1))][0] = child;
            __syncwarp();
            if (inner) {
                height += __popc(others);
                node = group_met ? chosen : height > 0 ? stack[--height][0] : NO_NODE;
            }
            inner = node >= 0 && node != NO_NODE;
            stepping = __ballot_sync(ALL, inner);
            if (__popc(stepping) < ENOUGH)
                break;
        }

        const unsigned leaves = __ballot_sync(ALL, node < 0);
        if (leaves && (__popc(leaves) >= FEW || !stepping)) {
            const LeafTest leaf = test_leaves<TYPES>(list, light, meshes, point, span.near, slot, node);
            if (leaf.met) {
                if (member == 0)
                    shade(rays.pixel[entry]);
                left = 0;
                height = 0;
                node = NO_NODE;
            } else if (leaf.done) {
                node = height > 0 ? stack[--height][0] : NO_NODE;
            }
        }
    }
}

#endif
}  // namespace warpcam
