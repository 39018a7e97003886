// What the walks of triangle meshes share: mesh_queue.h and mesh_shadows.h on CUDA, bvh4_cpu.h on a CPU.
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
constexpr int STACK = 48;  // three children of a node wait at each of a tree's levels, which are at most 16

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

// So many faces of a leaf are loaded before the first is tested: memory is waited for less often, in more registers.
constexpr int faces_together(int types) { return types >> MOVING & 1 ? 2 : 1; }

// The i-th of them; behind the end the last is taken again.
template <int TOGETHER> WARPCAM_FN int face_of(int begin, int i, int end)
{
    return TOGETHER == 1 ? begin : lower_int(begin + i, end - 1);
}

// Loads their corners; `first` is the mesh's first row.
template <int TOGETHER>
WARPCAM_FN void load_faces(const void* rows, unsigned first, int begin, int end, Row (&corners)[TOGETHER][3])
{
#pragma unroll
    for (int i = 0; i < TOGETHER; ++i) {
        const unsigned at = first + unsigned(face_of<TOGETHER>(begin, i, end) * FACE_ROWS);
#pragma unroll
        for (int k = 0; k < 3; ++k)
            corners[i][k] = load(rows, at + k);
    }
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

}  // namespace warpcam
