// Types and helpers of functions that are written once, for one place and for a packet of eight on a CPU.
//
// Such a function is a template of its vectors: Vec3 with float, int and bool, or Vec3x8 with Float8, Int8 and Int8.
// Numbers that the eight share enter products as a Number: only then is the product added to without being rounded
// first, in both.
#pragma once
#if defined(__CUDA_ARCH__)
#include "core/vec3.h"
#else
#include "core/simd8.h"
#endif

namespace warpcam {

template <class Vector> using NumberOf = decltype(Vector::x);
template <class Vector> using MaskOf = decltype(NumberOf<Vector>() < NumberOf<Vector>());
template <class Vector> using IntOf = decltype(MaskOf<Vector>() + 0);

// Broadcasts a vector to each lane.
template <class Vector> WARPCAM_DEVICE Vector broadcast(Vec3 v)
{
    using Number = NumberOf<Vector>;
    return { (Number)v.x, (Number)v.y, (Number)v.z };
}

WARPCAM_DEVICE bool any(bool truth) { return truth; }
WARPCAM_DEVICE Vec3 select(bool truth, Vec3 a, Vec3 b)
{
    return { truth ? a.x : b.x, truth ? a.y : b.y, truth ? a.z : b.z };
}

}  // namespace warpcam
