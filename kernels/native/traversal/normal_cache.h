// What pixels take of the shape that they show alone, where CUDA blocks write normals.
#pragma once
#include "traversal/infinite_plane.h"

namespace warpcam {

template <int SLOTS> struct ShapeFacings;
template <> struct ShapeFacings<0> { };

#if defined(__CUDA_ARCH__)
constexpr float BENT = 2.0f;

// By slot, the first of nothing. Normal in the world; x: BENT where it differs from place to place; w: shape id.
template <int SLOTS> struct ShapeFacings {
    Row rows[SLOTS + 1];
    Row endless[3];  // the endless floor's, as it is stored over and over: the words of three times 16 bytes

    // For one thread.
    WARPCAM_FN void begin() { rows[0] = { 0.0f, 0.0f, 0.0f, -1 }; }

    // For the thread that has a slot's record.
    template <int TYPES> WARPCAM_FN void note(int slot, const Record& record, int id, const Camera& camera)
    {
        Row row { BENT, 0.0f, 0.0f, id };
        if ((TYPES >> PLANE & 1) && record.axis_x.w == PLANE) {
            const Vec n = turned(camera.rotation, normalized(to_vec(record.axis_z)));
            row = to_row(n, id);
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
