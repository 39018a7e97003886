// Faces of meshes that rest in 32 bytes instead of 48, on CUDA: what a ray needs to test one, which then lies in one sector of
// a cache's line.
//
// Coordinates are whole numbers of 23 bits, steps of a 2^22th of the mesh's extent: as exact as the coordinates are beside
// it. Eight words have the first eight in their lower bytes; the upper bytes of the first three are the ninth, and that of
// the fourth says whether the face has a back.
#pragma once
#include "mask.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

constexpr int SHORT_FACE_ROWS = 2;
constexpr float FACE_STEPS = 4194296.0f, MIDDLE_STEP = 4194304.0f;  // of an extent, and the number of 0

// Such a number as the lowest bits of this one is a whole number, greater by 2^23.
WARPCAM_FN float step_of(unsigned word) { return as_float((word & 0xffffffu) | 0x4b000000u); }

// How many steps a unit of length has in a mesh's frame. Records that are made for samples keep it where others have the
// mesh's number, which none but masks ask for.
constexpr bool keeps_steps(int types) { return !(types >> MASKED & 1); }
WARPCAM_FN float steps_of(float extent) { return FACE_STEPS * reciprocal(extent); }
template <int TYPES> WARPCAM_FN void keep_steps(Record& record)
{
    if (!by_child(TYPES) && keeps_steps(TYPES) && is_mesh<TYPES>(record))
        record.axis_z.w = as_int(steps_of(record.size.x));
}

// Where a ray enters its face, or FAR_AWAY; as meet_face() has it.
template <int TYPES, class Meshes, class Ray>
WARPCAM_FN float meet_short_face(const Record& record, const Meshes& meshes, const Ray& ray, int face)
{
    const unsigned number = unsigned(as_int(record.size.z)) / FACE_ROWS + unsigned(face);
    const uint4* const rows = reinterpret_cast<const uint4*>(meshes.short_faces.data) + SHORT_FACE_ROWS * size_t(number);
    const uint4 one = __ldg(rows), two = __ldg(rows + 1);
    RayFrame frame = ray.template frame<TYPES>(record);
    const float steps = keeps_steps(TYPES) ? as_float(record.axis_z.w) : steps_of(record.size.x);
    const auto origin = [&](float o) { return o * steps + (8388608.0f + MIDDLE_STEP); };
    frame.origin = { origin(frame.origin.x), origin(frame.origin.y), origin(frame.origin.z) };
    const unsigned last = __byte_perm(__byte_perm(one.x, one.y, 0x0073), one.z, 0x0710);
    const Corner a = project(frame, step_of(one.x), step_of(one.y), step_of(one.z));
    const Corner b = project(frame, step_of(one.w), step_of(two.x), step_of(two.y));
    const Corner c = project(frame, step_of(two.z), step_of(two.w), step_of(last));
    const float steps_to = enter_triangle(frame, a, b, c, has_back<TYPES>(int(one.w >> 24)));
    const float t = steps_to < FAR_AWAY ? steps_to * reciprocal(steps) : FAR_AWAY;
    return t < FAR_AWAY && is_there<TYPES>(meshes, record, ray.local(record), face, t) ? t : FAR_AWAY;
}

}  // namespace warpcam
#endif
