// Shadow rays at triangle meshes, on CUDA. Any face in the way will do, so that, unlike in mesh_queue.h, nothing is sorted
// and nothing remembered but where to go on.
#pragma once
#include "mask.h"
#include "shade_tile.h"
#include "waiting_rays.h"

namespace warpcam {
#if defined(__CUDA_ARCH__)

// The rays of one warp. What its lanes seldom need of their own rays is here too.
template <int WORDS> struct ShadowRays: WaitingRays<WORDS> {
    float x[LANES], y[LANES], z[LANES];  // where they begin
    unsigned short own[LANES];           // their pixels

    WARPCAM_FN Vec point() const
    {
        const int lane = threadIdx.x % LANES;
        return { x[lane], y[lane], z[lane] };
    }
};

// Is one of a leaf's faces in the way of the ray that runs from a point to the light?
template <int TYPES, class Meshes>
WARPCAM_FN bool meets_leaf(const Meshes& meshes, const Record& record, unsigned faces, int leaf, const Light& light,
                           Vec point, const Span& span)
{
    const int code = -leaf - 1, first = code >> 4, end = first + (code & 15);
    const WorldRay ray { point, ray_to(light, point) };
    const RayFrame frame = ray.template frame<TYPES>(record);
    constexpr int TOGETHER = faces_together(TYPES);
    bool met = false;
    for (int begin = first; begin < end && !met; begin += TOGETHER) {
        Row corners[TOGETHER][3];
        load_faces(meshes.faces.data, faces, begin, end, corners);
#pragma unroll
        for (int i = 0; i < TOGETHER; ++i) {
            const Row &a = corners[i][0], &b = corners[i][1], &c = corners[i][2];
            const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                           project(frame, c.x, c.y, c.z),
                                           (TYPES >> SHADING_BACKS & 1) || has_back<TYPES>(b.w));
            bool meets = (t > span.near) & (t < span.reach);
            if constexpr ((TYPES >> MASKED & 1) != 0)
                meets = meets && is_there<TYPES>(meshes, record, ray.local(record), face_of<TOGETHER>(begin, i, end), t);
            met |= meets;
        }
    }
    return met;
}

// Calls shade(pixel) for each ray that `next_tile` finds (see Supply) and that meets a front face, or any where backs
// shade, on its way to the light; start(pixel, span) is where it begins.
template <int TYPES, int WORDS, class List, class Meshes, class NextTile, class Start, class Shade>
WARPCAM_FN void cast_rays(ShadowRays<WORDS>& rays, const List& list, const Light& light, const Meshes& meshes,
                          const NextTile& next_tile, const Start& start, const Shade& shade)
{
    const int lane = threadIdx.x % LANES, words = (list.count + LANES - 1) / LANES;
    int stack[STACK];
    int word = 0, slot = 0, node = NO_NODE, height = 0;
    unsigned left = 0, nodes = 0;
    Span span {};
    NodeRay<by_child(TYPES)> boxes {};
    Supply supply { 0, 0, true };
    const auto take = [&](int ray) {
        const int pixel = rays.pixel[ray];
        const Vec point = start(pixel, span);
        rays.own[lane] = static_cast<unsigned short>(pixel);
        rays.x[lane] = point.x;
        rays.y[lane] = point.y;
        rays.z[lane] = point.z;
        word = 0;
        left = rays.take(ray, words);
        rays.go_on(words, word, left);
    };
    while (true) {
        const unsigned idles = __ballot_sync(ALL, node == NO_NODE && left == 0);
        if (supply.any() && (__popc(idles) >= FEW || idles == ALL))
            supply.hand_out(idles, next_tile, take);
        else if (idles == ALL)
            return;

        const unsigned between = __ballot_sync(ALL, node == NO_NODE && left != 0);  // on to their next meshes
        if (between && (__popc(between) >= FEW || !__any_sync(ALL, node != NO_NODE))) {
            if (node == NO_NODE && left != 0) {
                slot = word * LANES + lowest_bit(left);
                left &= left - 1;
                rays.go_on(words, word, left);
                const Record& record = list.records[slot];
                const Vec point = rays.point();
                const Ray local = WorldRay { point, ray_to(light, point) }.local(record);
                boxes.set(slabs(local.origin, local.direction, record.size.x));
                nodes = record.origin.w;
                node = 0;
            }
        }

        bool inner = node >= 0 && node != NO_NODE;
        unsigned stepping = __ballot_sync(ALL, inner);
        while (stepping) {
            if (inner) {
                float enter[4], leave[4];
                int child[4];
                boxes.meet(node_rows(meshes, nodes, node), span.near, span.reach, enter, leave, child);
                node = NO_NODE;
#pragma unroll
                for (int k = 0; k < 4; ++k)
                    if (enter[k] <= leave[k]) {
                        if (node != NO_NODE)
                            stack[height++] = node;
                        node = child[k];
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
            if (node < 0) {
                if (meets_leaf<TYPES>(meshes, list.records[slot], list.aims[slot].w, node, light, rays.point(), span)) {
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
