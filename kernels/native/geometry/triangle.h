// Watertight ray-triangle test.
#pragma once
#include "camera/shape_record.h"

namespace warpcam {

// In the ray's frame the image of a corner depends on the corner only, and the sign of each edge function is exact, so
// that two triangles with a common edge or corner leave no gap (the idea of Woop et al., JCGT 2013, with the camera's
// axes in place of their shear).
struct Corner {
    float x, y;
    Vec offset;  // from the ray's origin
};

WARPCAM_FN Corner project(const RayFrame& frame, float x, float y, float z)
{
    const Vec v { x - frame.origin.x, y - frame.origin.y, z - frame.origin.z };
    return { muladd(frame.across.x, v.x, muladd(frame.across.y, v.y, product(frame.across.z, v.z))),
             muladd(frame.up.x, v.x, muladd(frame.up.y, v.y, product(frame.up.z, v.z))), v };
}

// Twice the signed area of (0, a, b), of the exact sign or, where the two products round to the same number, zero. It
// is the same but for its sign for (0, b, a); a zero counts as inside on both sides of an edge.
WARPCAM_FN float edge(const Corner& a, const Corner& b) { return product(a.x, b.y) - product(a.y, b.x); }

// Planar depth at which the ray enters the triangle through its front (counterclockwise) side, or through either with
// `both`; FAR_AWAY if it does not.
WARPCAM_FN float enter_triangle(const RayFrame& frame, const Corner& a, const Corner& b, const Corner& c, bool both)
{
    const float wc = edge(a, b), wa = edge(b, c), wb = edge(c, a);
    const float total = wa + wb + wc;
    if (wa < 0.0f || wb < 0.0f || wc < 0.0f || !(total > 0.0f))
        if (!both || wa > 0.0f || wb > 0.0f || wc > 0.0f || !(total < 0.0f))
            return FAR_AWAY;
    const float depth = wa * dot(frame.depth, a.offset) + wb * dot(frame.depth, b.offset)
        + wc * dot(frame.depth, c.offset);
    return depth * reciprocal(total);
}

}  // namespace warpcam
