// Arithmetic on vectors, and functions that are quick on a GPU: about two units in the last place.
#pragma once
#include "core/warp.h"

namespace warpcam {

constexpr float PI = 3.14159265358979f;

// A function that is seldom called: inlined it would only crowd the instruction cache.
#if defined(__CUDA_ARCH__)
#define WARPCAM_NOINLINE __device__ __noinline__
#else
#define WARPCAM_NOINLINE __attribute__((noinline))
#endif

WARPCAM_DEVICE Vec3 operator+(Vec3 a, Vec3 b) { return { a.x + b.x, a.y + b.y, a.z + b.z }; }
WARPCAM_DEVICE Vec3 operator-(Vec3 a, Vec3 b) { return { a.x - b.x, a.y - b.y, a.z - b.z }; }
WARPCAM_DEVICE Vec3 operator-(Vec3 a) { return { -a.x, -a.y, -a.z }; }
WARPCAM_DEVICE Vec3 operator*(float s, Vec3 a) { return { s * a.x, s * a.y, s * a.z }; }
WARPCAM_DEVICE Vec3 mul(Vec3 a, Vec3 b) { return { a.x * b.x, a.y * b.y, a.z * b.z }; }
WARPCAM_DEVICE Vec3 div(Vec3 a, Vec3 b) { return { a.x / b.x, a.y / b.y, a.z / b.z }; }
WARPCAM_DEVICE Vec3 cross(Vec3 a, Vec3 b)
{
    return { a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}

template <class Value> WARPCAM_DEVICE Vec3 as_vec3(const Value& v) { return { v[0], v[1], v[2] }; }
WARPCAM_DEVICE Vec3 as_vec3(const Float3Int& row) { return { row.x, row.y, row.z }; }
WARPCAM_DEVICE Float3Int make_float3_int(Vec3 v, int w) { return { v.x, v.y, v.z, w }; }

// A component of a vector that stays in registers, and the vector along an axis.
WARPCAM_DEVICE float component(Vec3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }
WARPCAM_DEVICE Vec3 axis_vector(int axis, float value)
{
    return { axis == 0 ? value : 0.0f, axis == 1 ? value : 0.0f, axis == 2 ? value : 0.0f };
}

// 0 and the sign that Warp gives it count as positive.
WARPCAM_DEVICE float sign(float a) { return a < 0.0f ? -1.0f : 1.0f; }

// `a` between two bounds; NaN becomes the lower one.
WARPCAM_DEVICE float clamp(float a, float low, float high) { return min(max(a, low), high); }
WARPCAM_DEVICE int clamp(int a, int low, int high) { return a < low ? low : a > high ? high : a; }

#if defined(__CUDA_ARCH__)

WARPCAM_DEVICE float saturate(float a) { return __saturatef(a); }

WARPCAM_DEVICE float rsqrt(float a)  // of a normal number above zero
{
    float r;
    asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(a));
    return r;
}

WARPCAM_DEVICE float log2(float a)
{
    float r;
    asm("lg2.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(a));
    return r;
}

WARPCAM_DEVICE float pow(float base, float exponent)  // of a normal base above zero
{
    float r;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(exponent * log2(base)));
    return r;
}

WARPCAM_DEVICE float sin(float a) { return __sinf(a); }
WARPCAM_DEVICE float cos(float a) { return __cosf(a); }
WARPCAM_DEVICE float round_down(float a) { return floorf(a); }

#else

WARPCAM_DEVICE float saturate(float a) { return clamp(a, 0.0f, 1.0f); }
WARPCAM_DEVICE float rsqrt(float a) { return 1.0f / __builtin_sqrtf(a); }
WARPCAM_DEVICE float log2(float a) { return wp::log2(a); }
WARPCAM_DEVICE float pow(float base, float exponent) { return wp::pow(base, exponent); }
WARPCAM_DEVICE float sin(float a) { return wp::sin(a); }
WARPCAM_DEVICE float cos(float a) { return wp::cos(a); }
WARPCAM_DEVICE float round_down(float a) { return wp::floor(a); }

#endif

WARPCAM_DEVICE float exp2(float a) { return pow(2.0f, a); }
WARPCAM_DEVICE float fourth_power(float a) { return a * a * a * a; }
WARPCAM_DEVICE float atan2(float y, float x) { return wp::atan2(y, x); }
WARPCAM_DEVICE float acos(float a) { return wp::acos(a); }

// `saturate` is `a` between 0 and 1, and 0 for NaN.
constexpr float MIN_NORMAL = 1.0e-37f;  // its square root and its inverse are normal numbers

WARPCAM_DEVICE Vec3 normalized(Vec3 a) { return rsqrt(max(dot(a, a), MIN_NORMAL)) * a; }

// The nearest of 255 steps of [0, 1]; what lies outside is clipped, NaN is 0.
WARPCAM_DEVICE unsigned to_byte(float value)
{
    const float steps = saturate(value) * 255.0f + 0.5f;
#if defined(__CUDA_ARCH__)  // no number of this size has places after the point, and adding rounds down
    return static_cast<unsigned>(as_int(__fadd_rd(steps, 8388608.0f))) & 0xffu;
#else
    return static_cast<unsigned>(steps);
#endif
}

// A colour as the bytes R, G, B of a word, the fourth 0.
WARPCAM_DEVICE unsigned to_bytes(Vec3 color)
{
    return to_byte(color.x) | to_byte(color.y) << 8 | to_byte(color.z) << 16;
}

static WARPCAM_NOINLINE int remainder(int a, int b) { return a % b; }

// The element of a table that worlds may share: of world `world` modulo the table's rows.
template <class Array> WARPCAM_DEVICE auto per_world(const Array& table, int world, int i)
{
    const int rows = table.shape[0];
    const int row = world < rows ? world : rows == 1 ? 0 : remainder(world, rows);
    return *wp::address(table, row, i);
}

// True if any of the 32 pixels that a warp draws together is true. A CPU thread draws one pixel at a time.
WARPCAM_DEVICE bool warp_any(bool mine)
{
#if defined(__CUDA_ARCH__)
    return __any_sync(FULL_WARP, mine);
#else
    return mine;
#endif
}

}  // namespace warpcam
