// Shadow rays at triangle meshes, on CUDA. As in mesh_rays.h rays wait in a queue of their warp and four lanes share a
// ray; but any face in the way will do, so that nothing is sorted and nothing remembered but where to go on.
#pragma once
#include "shade_tile.h"

namespace warpcam {
#if defined(__CUDA_ARCH__)

constexpr int SHADOW_QUEUE = 64;  // rays of a warp

// Of one warp. WORDS: 32 casters of the list each.
template <int WORDS> struct ShadowRays {
    Row points[SHADOW_QUEUE];  // where rays begin, from the camera, along the world's axes; w: bits of Span::near
    unsigned meshes[WORDS][SHADOW_QUEUE];  // bits by slot: meshes whose windows the point lies in
    unsigned short pixel[SHADOW_QUEUE];
    int stack[STACK][LANES / 4];
};

// Draws the next number of a counter in shared memory, for one lane.
WARPCAM_FN int draw_number(int& counter)
{
    int number;
    asm volatile("atom.shared.add.u32 %0, [%1], 1;"
                 : "=r"(number)
                 : "r"(static_cast<unsigned>(__cvta_generic_to_shared(&counter)))
                 : "memory");
    return number;
}

// Keeps the lanes' rays for which `keep` holds. The queue has room for a tile, and `meshes` is filled in from `count`
// on, lane by lane.
template <int WORDS>
WARPCAM_FN void enqueue(ShadowRays<WORDS>& rays, int& count, int words, bool keep, Vec p, float near, int pixel)
{
    const int lane = threadIdx.x % LANES;
    const unsigned kept = __ballot_sync(0xffffffffu, keep);
    if (!kept)
        return;
    const int at = count + __popc(kept & ((1u << lane) - 1));
    for (int word = 0; word < words; ++word) {
        const unsigned met = rays.meshes[word][count + lane];
        __syncwarp();
        if (keep)
            rays.meshes[word][at] = met;
    }
    if (keep) {
        rays.points[at] = { p.x, p.y, p.z, __float_as_int(near) };
        rays.pixel[at] = static_cast<unsigned short>(pixel);
    }
    count += __popc(kept);
    __syncwarp();
}

// Calls shade(pixel) for each of the `count` rays of the queue that meets a front face on its way to the light.
template <int CAPACITY, int WORDS, class Meshes, class Shade>
WARPCAM_FN void cast_queue(ShadowRays<WORDS>& rays, int count, const CasterList<CAPACITY>& list, const Light& light,
                           const Meshes& meshes, const Shade& shade)
{
    constexpr unsigned ALL = 0xffffffffu;
    constexpr int MIN_LANES = 16;  // fewer than this at inner nodes wait until leaves have been tested
    const int lane = threadIdx.x % LANES, member = lane % 4, first_lane = lane - member;
    const int words = (list.count + 31) / 32;
    int(*stack)[LANES / 4] = reinterpret_cast<int(*)[LANES / 4]>(&rays.stack[0][lane / 4]);
    int next = 0;  // ray of the queue, the same in all lanes; the rest is the same in the four lanes of a group
    int entry = 0, word = 0, slot = 0, node = NO_NODE, height = 0;
    unsigned left = 0, nodes = 0;
    float near = 0.0f, reach = 0.0f;
    WorldRay ray {};
    Slabs s {};
    while (true) {
        const bool idle = node == NO_NODE && left == 0;
        const unsigned idles = __ballot_sync(ALL, idle);
        if (idles) {
            if (idle) {
                entry = next + __popc(idles & ((1u << first_lane) - 1)) / 4;
                if (entry < count) {
                    const Row p = rays.points[entry];
                    ray.point = { p.x, p.y, p.z };
                    ray.direction = ray_to(light, ray.point);
                    near = __int_as_float(p.w);
                    reach = light.distant ? FAR_AWAY : 1.0f - near;
                    word = 0;
                    left = rays.meshes[0][entry];
                    while (left == 0 && word + 1 < words)
                        left = rays.meshes[++word][entry];
                }
            }
            next += __popc(idles) / 4;
            if (!__any_sync(ALL, left != 0 || node != NO_NODE))
                return;
        }
        if (node == NO_NODE && left != 0) {  // on to the ray's next mesh
            slot = word * 32 + lowest_bit(left);
            left &= left - 1;
            while (left == 0 && word + 1 < words)
                left = rays.meshes[++word][entry];
            const Record& record = list.records[slot];
            const Ray local = ray.local(record);
            s = slabs(local.origin, local.direction, record.size.x);
            nodes = record.origin.w;
            node = 0;
        }

        bool inner = node >= 0 && node != NO_NODE;
        while (__popc(__ballot_sync(ALL, inner)) >= MIN_LANES || (__any_sync(ALL, inner) && !__any_sync(ALL, node < 0))) {
            int child = 0;
            bool met = false;
            if (inner) {
                const unsigned at = nodes + unsigned(node * NODE_ROWS + member * 2);
                const Row low = load(meshes.nodes.data, at), high = load(meshes.nodes.data, at + 1);
                const float x0 = low.x * s.scale.x + s.down.x, x1 = high.x * s.scale.x + s.up.x;
                const float y0 = low.y * s.scale.y + s.down.y, y1 = high.y * s.scale.y + s.up.y;
                const float z0 = low.z * s.scale.z + s.down.z, z1 = high.z * s.scale.z + s.up.z;
                const float enter = upper(upper(lower(x0, x1), lower(y0, y1)), upper(lower(z0, z1), near));
                met = enter <= lower(lower(upper(x0, x1), upper(y0, y1)), lower(upper(z0, z1), reach));
                child = low.w;
            }
            const unsigned group_met = __ballot_sync(ALL, met) >> first_lane & 15u;
            const int first_met = __shfl_sync(ALL, child, lowest_bit(group_met | 16u) & 3, 4);
            const unsigned others = group_met & (group_met - 1);
            if (met && (others >> member & 1))
                stack[height + __popc(others & ((1u << member) - 1))][0] = child;
            __syncwarp();
            if (inner) {
                height += __popc(others);
                node = group_met ? first_met : height > 0 ? stack[--height][0] : NO_NODE;
            }
            inner = node >= 0 && node != NO_NODE;
        }

        const bool leaf = node < 0;
        if (__any_sync(ALL, leaf)) {
            bool blocked = false;
            if (leaf) {
                const int code = -node - 1, first = code >> 4, end = first + (code & 15);
                const Record& record = list.records[slot];
                const RayFrame frame = ray.frame(record);
                const unsigned faces = list.aims[slot].w;
                for (int f = first + member; f < end; f += 4) {
                    const unsigned at = faces + unsigned(f * FACE_ROWS);
                    const Row a = load(meshes.faces.data, at), b = load(meshes.faces.data, at + 1);
                    const Row c = load(meshes.faces.data, at + 2);
                    const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                                   project(frame, c.x, c.y, c.z));
                    blocked |= (t > near) & (t < reach);
                }
            }
            const unsigned group_blocked = __ballot_sync(ALL, blocked) >> first_lane & 15u;
            if (leaf) {
                if (group_blocked) {
                    if (member == 0)
                        shade(rays.pixel[entry]);
                    left = 0;
                    height = 0;
                    node = NO_NODE;
                } else {
                    node = height > 0 ? stack[--height][0] : NO_NODE;
                }
            }
        }
    }
}

#endif
}  // namespace warpcam
