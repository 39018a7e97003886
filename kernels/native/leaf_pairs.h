// Leaves of triangle meshes that several rays of a warp have come to, on CUDA. Every lane tests one face for one of the
// rays: where few rays are at leaves, or leaves have many faces, a warp would else wait face after face.
#pragma once
#include "mask.h"
#include "waiting_rays.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// Bits of all lanes.
WARPCAM_FN unsigned bits_of_all(unsigned bits)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_or_sync(ALL, bits);
#else
    for (int step = LANES / 2; step > 0; step /= 2)
        bits |= __shfl_xor_sync(ALL, bits, step);
    return bits;
#endif
}

// Finds the ray's nearest hit among a leaf's faces, if it is before its hit so far.
template <int TYPES, class Meshes, class Ray>
WARPCAM_FN void meet_leaf(const Record& record, const Meshes& meshes, const Ray& ray, int leaf, float near,
                          float& depth, int& shape, int& face)
{
    const int code = -leaf - 1, first = code >> 4, end = first + (code & 15);
    const RayFrame frame = ray.template frame<TYPES>(record);
    const unsigned faces = wp::index(meshes.face_start, record.axis_z.w);
    constexpr int TOGETHER = faces_together(TYPES);
    for (int begin = first; begin < end; begin += TOGETHER) {
        Row corners[TOGETHER][3];
        load_faces(meshes.faces.data, faces, begin, end, corners);
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
}

// The same for all lanes whose `node` is a leaf, of the mesh at `slot` of the list; says whether the lane's ray hits one.
// `owners` is room for the warp.
template <int TYPES, class List, class Meshes, class Ray>
WARPCAM_FN bool meet_leaves(unsigned char (&owners)[LANES], const List& list, const Meshes& meshes, const Ray& ray,
                            int slot, int node, float near, float& depth, int& face)
{
    const int lane = threadIdx.x % LANES;
    const int code = node < 0 ? -node - 1 : 0, first = code >> 4, faces = code & 15;
    int end = faces;  // of the lane's pairs of a ray and a face
    for (int step = 1; step < LANES; step *= 2) {
        const int before = __shfl_up_sync(ALL, end, step);
        end += lane >= step ? before : 0;
    }
    const int begin = end - faces, pairs = __shfl_sync(ALL, end, LANES - 1);
    bool met = false;
    for (int window = 0; window < pairs; window += LANES) {
        // the lane that brought this lane's pair is the last that begins at or before it
        const bool begins = faces > 0 && begin < window + LANES && end > window;
        const int place = begin > window ? begin - window : 0;
        const unsigned places = bits_of_all(begins ? 1u << place : 0);
        if (begins)
            owners[place] = static_cast<unsigned char>(lane);
        __syncwarp();
        const int from = owners[LANES - 1 - __clz(places & ((2u << lane) - 1))];
        const bool mine = window + lane < pairs;
        Ray its = ray;
        its.x = __shfl_sync(ALL, ray.x, from);
        its.y = __shfl_sync(ALL, ray.y, from);
        const Record& record = list.records[__shfl_sync(ALL, slot, from)];
        const int number = __shfl_sync(ALL, first - begin, from) + window + lane;
        const float from_on = __shfl_sync(ALL, near, from), until = __shfl_sync(ALL, depth, from);
        float t = FAR_AWAY;
        if (mine) {
            const unsigned row = wp::index(meshes.face_start, record.axis_z.w) + unsigned(number * FACE_ROWS);
            const Row a = load(meshes.faces.data, row), b = load(meshes.faces.data, row + 1);
            const Row c = load(meshes.faces.data, row + 2);
            const RayFrame frame = its.template frame<TYPES>(record);
            t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                               project(frame, c.x, c.y, c.z), has_back<TYPES>(b.w));
            if (!(t < until && t > from_on && is_there<TYPES>(meshes, record, its.local(record), number, t)))
                t = FAR_AWAY;
        }
        for (unsigned hits = __ballot_sync(ALL, t < FAR_AWAY); hits; hits &= hits - 1) {
            const int hit = lowest_bit(hits);
            const float found = __shfl_sync(ALL, t, hit);
            const int its_face = __shfl_sync(ALL, number, hit);
            if (lane == __shfl_sync(ALL, from, hit) && found < depth) {
                depth = found;
                face = its_face;
                met = true;
            }
        }
    }
    return met;
}

}  // namespace warpcam
#endif
