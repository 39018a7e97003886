// Shadow rays at triangle meshes, on CUDA. Rays wait in a queue of the block until there are enough of them to fill its
// lanes; then each lane walks a ray, and takes another when it is done. Any face in the way will do, so nothing is sorted
// and nothing remembered but where to go on.
#pragma once
#include "shade_tile.h"

namespace warpcam {
#if defined(__CUDA_ARCH__)

// WORDS: 32 casters of the list each.
template <int WORDS> struct ShadowRays {
    static constexpr int SIZE = WORDS > 2 ? 256 : 512;

    int count, next;               // rays in the queue; the first that nobody has taken
    unsigned meshes[WORDS][SIZE];  // bits by slot: meshes whose windows the point lies in
    unsigned short pixel[SIZE];    // row * 64 + column in the region

    // Is there room for one more tile of each warp?
    WARPCAM_FN bool has_room() const { return *const_cast<const volatile int*>(&count) <= SIZE - THREADS; }
};

// Puts the rays of a tile for which `keep` holds into the queue.
template <int WORDS>
WARPCAM_FN void enqueue(ShadowRays<WORDS>& rays, int words, bool keep, const unsigned* met, int pixel)
{
    const int lane = threadIdx.x % LANES;
    const unsigned kept = __ballot_sync(ALL, keep);
    if (!kept)
        return;
    int at = 0;
    if (lane == 0)
        at = atomicAdd(&rays.count, __popc(kept));
    at = __shfl_sync(ALL, at, 0) + __popc(kept & ((1u << lane) - 1));
    if (keep) {
        for (int word = 0; word < words; ++word)
            rays.meshes[word][at] = met[word];
        rays.pixel[at] = static_cast<unsigned short>(pixel);
    }
}

// Calls shade(pixel) for each ray of the queue that meets a front face on its way to the light; point_of(pixel) is where
// it begins. All warps of the block come here together.
template <int CAPACITY, int WORDS, class Meshes, class Start, class Shade>
WARPCAM_FN void cast_queue(ShadowRays<WORDS>& rays, const CasterList<CAPACITY>& list, const Meshes& meshes,
                           const Start& start, const Shade& shade)
{
    constexpr int FEW = 8;  // lanes; fewer wait for company before they do what the others do not need
    const int lane = threadIdx.x % LANES, words = (list.count + 31) / 32, count = rays.count;
    int stack[STACK];
    int entry = 0, word = 0, slot = 0, node = NO_NODE, height = 0;
    unsigned left = 0, nodes = 0;
    Span span {};
    WorldRay ray {};
    Slabs s {};
    bool more = true;  // rays in the queue
    while (true) {
        const unsigned idles = __ballot_sync(ALL, node == NO_NODE && left == 0);
        if (more && (__popc(idles) >= FEW || idles == ALL)) {
            int next = 0;
            if (lane == 0)
                next = atomicAdd(&rays.next, __popc(idles));
            next = __shfl_sync(ALL, next, 0);
            more = next + __popc(idles) < count;
            const int mine = next + __popc(idles & ((1u << lane) - 1));
            if ((idles >> lane & 1) && mine < count) {
                entry = mine;
                start(rays.pixel[entry], ray, span);
                word = 0;
                left = rays.meshes[0][entry];
                while (left == 0 && word + 1 < words)
                    left = rays.meshes[++word][entry];
            }
        } else if (idles == ALL) {
            return;
        }

        const unsigned between = __ballot_sync(ALL, node == NO_NODE && left != 0);  // on to their next meshes
        if (between && (__popc(between) >= FEW || !__any_sync(ALL, node != NO_NODE))) {
            if (between >> lane & 1) {
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
        }

        bool inner = node >= 0 && node != NO_NODE;
        unsigned stepping = __ballot_sync(ALL, inner);
        while (stepping) {
            if (inner) {
                const unsigned at = nodes + unsigned(node * NODE_ROWS);
                node = NO_NODE;
#pragma unroll
                for (int k = 0; k < 4; ++k) {
                    const Row low = load(meshes.nodes.data, at + 2 * k), high = load(meshes.nodes.data, at + 2 * k + 1);
                    const float x0 = low.x * s.scale.x + s.down.x, x1 = high.x * s.scale.x + s.up.x;
                    const float y0 = low.y * s.scale.y + s.down.y, y1 = high.y * s.scale.y + s.up.y;
                    const float z0 = low.z * s.scale.z + s.down.z, z1 = high.z * s.scale.z + s.up.z;
                    const float enter = upper(upper(lower(x0, x1), lower(y0, y1)), upper(lower(z0, z1), span.near));
                    const float leave = lower(lower(upper(x0, x1), upper(y0, y1)), lower(upper(z0, z1), span.reach));
                    if (enter <= leave) {
                        if (node != NO_NODE)
                            stack[height++] = node;
                        node = low.w;
                    }
                }
                if (node == NO_NODE && height > 0)
                    node = stack[--height];
            }
            inner = node >= 0 && node != NO_NODE;
            stepping = __ballot_sync(ALL, inner);
            if (__popc(stepping) < 2 * FEW)
                break;
        }

        const unsigned leaves = __ballot_sync(ALL, node < 0);
        if (leaves && (__popc(leaves) >= FEW || !stepping)) {
            bool blocked = false;
            if (node < 0) {
                const int code = -node - 1, first = code >> 4, end = first + (code & 15);
                const RayFrame frame = ray.frame(list.records[slot]);
                const unsigned faces = list.aims[slot].w;
                for (int face = first; face < end && !blocked; ++face) {
                    const unsigned at = faces + unsigned(face * FACE_ROWS);
                    const Row a = load(meshes.faces.data, at), b = load(meshes.faces.data, at + 1);
                    const Row c = load(meshes.faces.data, at + 2);
                    const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                                   project(frame, c.x, c.y, c.z));
                    blocked = (t > span.near) & (t < span.reach);
                }
                node = height > 0 ? stack[--height] : NO_NODE;
                if (blocked) {
                    shade(rays.pixel[entry]);
                    left = 0;
                    height = 0;
                    node = NO_NODE;
                }
            }
        }
    }
}

#endif
}  // namespace warpcam
