// Watertight ray-triangle test.
#pragma once
#include "camera/shape_record.h"

namespace warpcam {

// In the ray's frame the image of a corner depends on the corner only, and the sign of each edge function is exact, so
// that two triangles with a common edge or corner leave no gap (the idea of Woop et al., JCGT 2013, with the camera's
// axes in place of their shear).
struct Corner {
    float x, y;
    Vec3 offset;  // from the ray's origin
};

WARPCAM_DEVICE Corner project(const RayFrame& frame, float x, float y, float z)
{
    const Vec3 v { x - frame.origin.x, y - frame.origin.y, z - frame.origin.z };
    return { fma(frame.across.x, v.x, fma(frame.across.y, v.y, mul_rn(frame.across.z, v.z))),
             fma(frame.up.x, v.x, fma(frame.up.y, v.y, mul_rn(frame.up.z, v.z))), v };
}

// Twice the signed area of (0, a, b), of the exact sign or, where the two products round to the same number, zero. It
// is the same but for its sign for (0, b, a); a zero counts as inside on both sides of an edge.
WARPCAM_DEVICE float edge(const Corner& a, const Corner& b) { return mul_rn(a.x, b.y) - mul_rn(a.y, b.x); }

// Planar depth at which the ray enters the triangle through its front (counterclockwise) side, or through either with
// `both`; MISS if it does not.
WARPCAM_DEVICE float enter_triangle(const RayFrame& frame, const Corner& a, const Corner& b, const Corner& c, bool both)
{
    const float wc = edge(a, b), wa = edge(b, c), wb = edge(c, a);
    const float total = wa + wb + wc;
    if (wa < 0.0f || wb < 0.0f || wc < 0.0f || !(total > 0.0f))
        if (!both || wa > 0.0f || wb > 0.0f || wc > 0.0f || !(total < 0.0f))
            return MISS;
    const float depth =
        wa * dot(frame.depth, a.offset) + wb * dot(frame.depth, b.offset) + wc * dot(frame.depth, c.offset);
    return depth * rcp(total);
}

}  // namespace warpcam
