// Normals that pixels take from their shape alone, on CUDA.
#pragma once
#include "traversal/infinite_plane.h"

namespace warpcam {

template <int HITS_NAME_SLOTS> struct NormalCache;
template <> struct NormalCache<0> {};

#if defined(__CUDA_ARCH__)
constexpr float NORMAL_VARIES = 2.0f;

// By slot, the first of nothing. Normal in the world; x: NORMAL_VARIES where it differs from place to place; w: shape
// id.
template <int HITS_NAME_SLOTS> struct NormalCache {
    Float3Int rows[HITS_NAME_SLOTS + 1];
    Float3Int endless[3];  // the endless floor's, as it is stored over and over: the words of three times 16 bytes

    // For one thread.
    WARPCAM_DEVICE void begin() { rows[0] = { 0.0f, 0.0f, 0.0f, -1 }; }

    // For the thread that has a slot's record.
    template <class Types> WARPCAM_DEVICE void note(int slot, const ShapeRecord& record, int id, const Camera& camera)
    {
        Float3Int row { NORMAL_VARIES, 0.0f, 0.0f, id };
        if (Types::has(PLANE) && record.axis_x.w == PLANE) {
            const Vec3 n = transform(camera.rotation, normalized(as_vec3(record.axis_z)));
            row = make_float3_int(n, id);
            if (is_endless(record)) {
                endless[0] = { n.x, n.y, n.z, as_int(n.x) };
                endless[1] = { n.y, n.z, n.x, as_int(n.y) };
                endless[2] = { n.z, n.x, n.y, as_int(n.z) };
            }
        }
        rows[slot + 1] = row;
    }
};
#endif

}  // namespace warpcam
