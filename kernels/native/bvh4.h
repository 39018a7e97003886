// Triangle meshes behind one tile: each lane walks all of them in one loop and does not wait for its neighbours.
#pragma once
#include "triangle.h"

namespace warpcam {

constexpr int NODE_ROWS = 7, FACE_ROWS = 3;
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
// Nearest front face of any mesh among a tile's records, nearer than `hit`; with ANY, the first one found. `words` are
// the tile's mesh records as bits by rank, `order` leads from a rank to its record.
template <bool ANY, class Meshes, class RayOf>
WARPCAM_FN void walk_meshes(const Meshes& meshes, const Record* records, const unsigned char* order,
                            const unsigned* words, int num_words, const RayOf& source, float near, Hit& hit)
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
                left = words[++word];
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
            const Row lx = load(meshes.nodes.data, at), ly = load(meshes.nodes.data, at + 1);
            const Row lz = load(meshes.nodes.data, at + 2), ux = load(meshes.nodes.data, at + 3);
            const Row uy = load(meshes.nodes.data, at + 4), uz = load(meshes.nodes.data, at + 5);
            const Row children = load(meshes.nodes.data, at + 6);
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
            WARPCAM_CHILD(lx.x, ly.x, lz.x, ux.x, uy.x, uz.x, as_int(children.x))
            WARPCAM_CHILD(lx.y, ly.y, lz.y, ux.y, uy.y, uz.y, as_int(children.y))
            WARPCAM_CHILD(lx.z, ly.z, lz.z, ux.z, uy.z, uz.z, as_int(children.z))
            WARPCAM_CHILD(as_float(lx.w), as_float(ly.w), as_float(lz.w), as_float(ux.w), as_float(uy.w),
                          as_float(uz.w), children.w)
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
