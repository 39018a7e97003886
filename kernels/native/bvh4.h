// Triangle meshes behind one tile: each lane walks all of them in one loop and does not wait for its neighbours.
#pragma once
#include "triangle.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)
constexpr int NODE_ROWS = 8;  // child after child, so that four lanes load a node together
#else
constexpr int NODE_ROWS = 7;  // bound after bound, so that one vector has all four children's
#endif
constexpr int FACE_ROWS = 3;
constexpr int NO_NODE = 0x7fffffff;
constexpr int STACK = 48;

struct Hit {
    float depth;
    int shape;
    int face;
};

WARPCAM_FN Row load(const void* rows, unsigned index)
{
#if defined(__CUDA_ARCH__)
    const int4 bits = __ldg(static_cast<const int4*>(rows) + index);
    return { __int_as_float(bits.x), __int_as_float(bits.y), __int_as_float(bits.z), bits.w };
#else
    return static_cast<const Row*>(rows)[index];
#endif
}

// What a ray needs to test boxes: with t = plane * scale + near or far offset, lower planes are moved down and upper
// planes up by more than all rounding of the camera's and the mesh's coordinates.
struct Slabs {
    Vec scale, down, up;
};

WARPCAM_FN Slabs slabs(Vec o, Vec d, float extent)
{
    const Vec s { reciprocal(nonzero(d.x)), reciprocal(nonzero(d.y)), reciprocal(nonzero(d.z)) };
    const float distance = magnitude(o.x) + magnitude(o.y) + magnitude(o.z) + extent;
    const float pad = 1.0e-6f * distance;
    return { s,
             { -(o.x + pad) * s.x, -(o.y + pad) * s.y, -(o.z + pad) * s.z },
             { -(o.x - pad) * s.x, -(o.y - pad) * s.y, -(o.z - pad) * s.z } };
}

#if defined(__CUDA_ARCH__)
// Nearest front face of any mesh among some records, nearer than `hit`; with ANY, the first one found. `words` are these
// records as bits by rank, `stride` apart; `order` leads from a rank to its record. (For a CPU: see bvh4_cpu.h.)
template <bool ANY, class Meshes, class RayOf>
WARPCAM_FN void walk_meshes(const Meshes& meshes, const Record* records, const unsigned char* order,
                            const unsigned* words, int num_words, int stride, const RayOf& source, float near, Hit& hit)
{
    int stack[STACK];
    float entry[STACK];
    int height = 0, node = NO_NODE, word = 0, slot = 0;
    unsigned left = num_words > 0 ? words[0] : 0;
    unsigned nodes = 0, faces = 0;
    Slabs s {};
    while (true) {
        if (node == NO_NODE) {
            while (height > 0) {
                --height;
                if (entry[height] < hit.depth) {
                    node = stack[height];
                    break;
                }
            }
        }
        if (node == NO_NODE) {  // the mesh is done: on to the tile's next
            while (left == 0 && word + 1 < num_words)
                left = words[++word * stride];
            if (left == 0)
                return;
            slot = order[word * 32 + lowest_bit(left)];
            left &= left - 1;
            const Record& record = records[slot];
            if (as_float(record.size.w) >= hit.depth)
                return;
            const Ray ray = source.local(record);
            s = slabs(ray.origin, ray.direction, record.size.x);
            nodes = wp::index(meshes.node_start, record.axis_z.w);
            faces = wp::index(meshes.face_start, record.axis_z.w);
            node = 0;
        }
        while (node >= 0 && node != NO_NODE) {
            const unsigned at = nodes + unsigned(node * NODE_ROWS);
            const Row l0 = load(meshes.nodes.data, at), u0 = load(meshes.nodes.data, at + 1);
            const Row l1 = load(meshes.nodes.data, at + 2), u1 = load(meshes.nodes.data, at + 3);
            const Row l2 = load(meshes.nodes.data, at + 4), u2 = load(meshes.nodes.data, at + 5);
            const Row l3 = load(meshes.nodes.data, at + 6), u3 = load(meshes.nodes.data, at + 7);
            float best = FAR_AWAY;
            int next = NO_NODE;
#define WARPCAM_CHILD(LX, LY, LZ, UX, UY, UZ, CHILD) \
    { \
        const float x0 = LX * s.scale.x + s.down.x, x1 = UX * s.scale.x + s.up.x; \
        const float y0 = LY * s.scale.y + s.down.y, y1 = UY * s.scale.y + s.up.y; \
        const float z0 = LZ * s.scale.z + s.down.z, z1 = UZ * s.scale.z + s.up.z; \
        const float enter = upper(upper(lower(x0, x1), lower(y0, y1)), upper(lower(z0, z1), near)); \
        const float leave = lower(lower(upper(x0, x1), upper(y0, y1)), lower(upper(z0, z1), hit.depth)); \
        if (enter <= leave) { \
            const int child = CHILD; \
            if (enter < best) { \
                if (next != NO_NODE) { \
                    stack[height] = next; \
                    entry[height++] = best; \
                } \
                best = enter; \
                next = child; \
            } else { \
                stack[height] = child; \
                entry[height++] = enter; \
            } \
        } \
    }
            WARPCAM_CHILD(l0.x, l0.y, l0.z, u0.x, u0.y, u0.z, l0.w)
            WARPCAM_CHILD(l1.x, l1.y, l1.z, u1.x, u1.y, u1.z, l1.w)
            WARPCAM_CHILD(l2.x, l2.y, l2.z, u2.x, u2.y, u2.z, l2.w)
            WARPCAM_CHILD(l3.x, l3.y, l3.z, u3.x, u3.y, u3.z, l3.w)
#undef WARPCAM_CHILD
            node = next;
            while (node == NO_NODE && height > 0) {
                --height;
                if (entry[height] < hit.depth)
                    node = stack[height];
            }
        }
        if (node == NO_NODE)
            continue;
        const int code = -node - 1, first = code >> 4, end = first + (code & 15);
        const Record& record = records[slot];
        const RayFrame frame = source.frame(record);
        for (int face = first; face < end; ++face) {
            const unsigned at = faces + unsigned(face * FACE_ROWS);
            const Row a = load(meshes.faces.data, at), b = load(meshes.faces.data, at + 1);
            const Row c = load(meshes.faces.data, at + 2);
            const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                           project(frame, c.x, c.y, c.z));
            if (t < hit.depth && t > near) {
                hit.depth = t;
                hit.shape = record.axis_y.w;
                hit.face = face;
                if (ANY)
                    return;
            }
        }
        node = NO_NODE;
    }
}

#endif

}  // namespace warpcam
