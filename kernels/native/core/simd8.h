// Eight numbers at once, on a CPU.
#pragma once
#include "core/vec3.h"

namespace warpcam {

constexpr int SIMD_WIDTH = 8;
typedef float Float8 __attribute__((ext_vector_type(SIMD_WIDTH)));
typedef int Int8 __attribute__((ext_vector_type(SIMD_WIDTH)));

inline Float8 min(Float8 a, Float8 b) { return a < b ? a : b; }
inline Float8 max(Float8 a, Float8 b) { return a > b ? a : b; }
inline Int8 min(Int8 a, Int8 b) { return a < b ? a : b; }
inline Int8 max(Int8 a, Int8 b) { return a > b ? a : b; }
inline Float8 abs(Float8 a) { return __builtin_elementwise_abs(a); }
inline Float8 sqrt(Float8 a) { return __builtin_elementwise_sqrt(a); }
inline Float8 rcp(Float8 a) { return 1.0f / a; }
inline Float8 avoid_zero(Float8 a) { return abs(a) < 1.0e-18f ? (Float8)1.0e-18f : a; }

// Reciprocal square root of normal numbers above zero, to about two units in the last place: an estimate and one Newton
// step.
inline Float8 rsqrt(Float8 a)
{
#if defined(__AVX__)
    const Float8 r = __builtin_ia32_rsqrtps256(a);
    return r * (1.5f - 0.5f * a * (r * r));
#else
    return 1.0f / sqrt(a);
#endif
}
inline Float8 round_down(Float8 a) { return __builtin_elementwise_floor(a); }
inline Float8 sign(Float8 a) { return a < 0.0f ? (Float8)-1.0f : (Float8)1.0f; }
inline Float8 clamp(Float8 a, Float8 low, Float8 high) { return min(max(a, low), high); }
inline Int8 clamp(Int8 a, Int8 low, Int8 high) { return min(max(a, low), high); }
inline Float8 saturate(Float8 a) { return clamp(a, (Float8)0.0f, (Float8)1.0f); }
inline Float8 fraction(Float8 a) { return saturate(a - round_down(a)); }
inline Float8 to_floats(Int8 a) { return __builtin_convertvector(a, Float8); }
inline Int8 to_int(Float8 a) { return __builtin_convertvector(a, Int8); }  // towards 0

inline Float8 fma(Float8 a, Float8 b, Float8 c)
{
#if defined(__FMA__)
    return __builtin_elementwise_fma(a, b, c);
#else
    return a * b + c;
#endif
}

// Eight numbers of any kind that follow each other, as whole ones.
template <class Value> inline Int8 load8(const Value* from)
{
    typedef Value Values __attribute__((ext_vector_type(SIMD_WIDTH)));
    Values values;
    __builtin_memcpy(&values, from, sizeof values);
    return __builtin_convertvector(values, Int8);
}

template <class Value> inline void store8(Value* to, Int8 from)
{
    typedef Value Values __attribute__((ext_vector_type(SIMD_WIDTH)));
    const Values values = __builtin_convertvector(from, Values);
    __builtin_memcpy(to, &values, sizeof values);
}

// True if an element is true (all ones).
inline bool any(Int8 truth)
{
#if defined(__AVX__)
    return __builtin_ia32_movmskps256((Float8)truth) != 0;
#else
    return __builtin_reduce_or(truth) != 0;
#endif
}

// Bit mask of the elements that are true.
inline unsigned movemask(Int8 truth)
{
#if defined(__AVX__)
    return unsigned(__builtin_ia32_movmskps256((Float8)truth));
#else
    unsigned bits = 0;
    for (int k = 0; k < SIMD_WIDTH; ++k)
        bits |= truth[k] ? 1u << k : 0u;
    return bits;
#endif
}

inline float reduce_min(Float8 a)
{
    typedef float Four __attribute__((ext_vector_type(4)));
    typedef float Two __attribute__((ext_vector_type(2)));
    const Four four = a.lo < a.hi ? a.lo : a.hi;
    const Two two = four.lo < four.hi ? four.lo : four.hi;
    return two.x < two.y ? two.x : two.y;
}

// Places that are loaded from: written to memory and read as numbers, which takes fewer instructions than to take them
// out of a vector one by one.
struct Places8 {
    unsigned at[SIMD_WIDTH];
    explicit Places8(Int8 places)
    {
        __builtin_memcpy(at, &places, sizeof at);
#if defined(__x86_64__)
        asm("" : "+m"(at));  // else the compiler does that
#endif
    }
};

// One by one: on many processors quicker than their instructions for it.
inline Float8 build_shape_list(const float* entries, Int8 at)
{
    return { entries[at[0]], entries[at[1]], entries[at[2]], entries[at[3]],
             entries[at[4]], entries[at[5]], entries[at[6]], entries[at[7]] };
}

inline Int8 build_shape_list(const int* entries, Int8 at)
{
    return { entries[at[0]], entries[at[1]], entries[at[2]], entries[at[3]],
             entries[at[4]], entries[at[5]], entries[at[6]], entries[at[7]] };
}

struct Float8x4 {
    Float8 a, b, c, d;
};

// Rows of four, transposed: `skip` behind each place.
inline Float8x4 columns_of(const float* const (&rows)[SIMD_WIDTH], int skip)
{
    typedef float Four __attribute__((ext_vector_type(4)));
    Float8 pairs[4];  // rows k and k + 4
    for (int k = 0; k < 4; ++k) {
        Four a, b;
        __builtin_memcpy(&a, rows[k] + skip, sizeof a);
        __builtin_memcpy(&b, rows[k + 4] + skip, sizeof b);
        pairs[k] = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
    }
    const Float8 low01 = __builtin_shufflevector(pairs[0], pairs[1], 0, 8, 1, 9, 4, 12, 5, 13);
    const Float8 low23 = __builtin_shufflevector(pairs[2], pairs[3], 0, 8, 1, 9, 4, 12, 5, 13);
    const Float8 high01 = __builtin_shufflevector(pairs[0], pairs[1], 2, 10, 3, 11, 6, 14, 7, 15);
    const Float8 high23 = __builtin_shufflevector(pairs[2], pairs[3], 2, 10, 3, 11, 6, 14, 7, 15);
    return { __builtin_shufflevector(low01, low23, 0, 1, 8, 9, 4, 5, 12, 13),
             __builtin_shufflevector(low01, low23, 2, 3, 10, 11, 6, 7, 14, 15),
             __builtin_shufflevector(high01, high23, 0, 1, 8, 9, 4, 5, 12, 13),
             __builtin_shufflevector(high01, high23, 2, 3, 10, 11, 6, 7, 14, 15) };
}

inline Float8x4 gather_float4(const float* rows, Int8 at)
{
    const float* places[SIMD_WIDTH];
    for (int k = 0; k < SIMD_WIDTH; ++k)
        places[k] = rows + 4 * size_t(unsigned(at[k]));
    return columns_of(places, 0);
}

// Each entry, and the one after it.
inline void gather_pairs(const int* entries, Int8 at, Int8& first, Int8& second)
{
    typedef int Two __attribute__((ext_vector_type(2)));
    Two pairs[SIMD_WIDTH];
    const Places8 places(at);
    for (int k = 0; k < SIMD_WIDTH; ++k)
        __builtin_memcpy(pairs + k, entries + places.at[k], sizeof(Two));
    const auto four = [&](int k) {
        const auto low = __builtin_shufflevector(pairs[k], pairs[k + 1], 0, 1, 2, 3);
        return __builtin_shufflevector(low, __builtin_shufflevector(pairs[k + 4], pairs[k + 5], 0, 1, 2, 3), 0, 1, 2, 3,
                                       4, 5, 6, 7);
    };
    const Int8 even = four(0), odd = four(2);
    first = __builtin_shufflevector(even, odd, 0, 2, 8, 10, 4, 6, 12, 14);
    second = __builtin_shufflevector(even, odd, 1, 3, 9, 11, 5, 7, 13, 15);
}

// Entries of a table of 16.
inline Int8 look_up(const int* table, Int8 at)
{
#if defined(__AVX2__)
    typedef int Whole __attribute__((vector_size(32)));
    Whole low, high;
    __builtin_memcpy(&low, table, sizeof low);
    __builtin_memcpy(&high, table + SIMD_WIDTH, sizeof high);
#if defined(__AVX512VL__)
    return (Int8)__builtin_ia32_vpermi2vard256(low, (Whole)at, high);
#else
    const Int8 below = (Int8)__builtin_ia32_permvarsi256(low, (Whole)at);
    return at < SIMD_WIDTH ? below : (Int8)__builtin_ia32_permvarsi256(high, (Whole)at);
#endif
#else
    return build_shape_list(table, at);
#endif
}

// Base-2 logarithm of normal numbers above zero: to two units in the last place of 1, or of the result where it is
// larger.
inline Float8 log2(Float8 a)
{
    constexpr int HALF_ROOT = 0x3f3504f3;  // bits of the square root of a half, where the fractions begin
    const Int8 bits = (Int8)a - HALF_ROOT;
    const Float8 part = (Float8)((bits & 0x7fffff) + HALF_ROOT), s = (part - 1.0f) / (part + 1.0f), square = s * s;
    const Float8 series = 2.885390082f + square * (0.961796694f + square * (0.577078016f + square * 0.412198583f));
    return to_floats(bits >> 23) + s * series;
}

// Never so small that products with it are not normal numbers: these would take a hundred times longer.
inline Float8 exp2(Float8 a)
{
    a = clamp(a, (Float8)-64.0f, (Float8)127.0f);
    const Float8 whole = round_down(a + 0.5f), x = a - whole;
    const Float8 series =
        1.0f
        + x
              * (0.693147182f
                 + x
                       * (0.240226507f
                          + x * (0.0555041087f + x * (0.00961812911f + x * (0.00133335581f + x * 0.00015403530f)))));
    return series * (Float8)((to_int(whole) + 127) << 23);
}

inline Float8 pow(Float8 base, float exponent)
{
    const int whole = exponent >= 1.0f && exponent <= 1024.0f ? int(exponent) : 0;
    if (float(whole) != exponent)
        return exp2(exponent * log2(base));
    // by squares, of what is large enough for them to be normal numbers, too: 2^(-64 / exponent), 6 % above it at most
    base = max(base, (Float8) __builtin_bit_cast(float, 0x3f800000 - int(64.0f / exponent * 0x800000)));
    Float8 product = whole & 1 ? base : (Float8)1.0f;
    for (int left = whole >> 1; left; left >>= 1) {
        base *= base;
        product = left & 1 ? product * base : product;
    }
    return product;
}

inline Float8 fourth_power(Float8 a) { return (a * a) * (a * a); }

// Abramowitz and Stegun 4.4.49, to 2e-8 of its tangent.
inline Float8 atan2(Float8 y, Float8 x)
{
    constexpr float SERIES[] = { -0.3333314528f, 0.1999355085f, -0.1420889944f, 0.1065626393f,
                                 -0.0752896400f, 0.0429096138f, -0.0161657367f, 0.0028662257f };
    const Float8 up = abs(y), side = abs(x), most = max(up, side);
    const Float8 rate = min(up, side) / max(most, (Float8)MIN_NORMAL), square = rate * rate;
    Float8 sum = 0.0f;
    for (int n = 7; n >= 0; --n)
        sum = square * (SERIES[n] + sum);
    Float8 angle = rate + rate * sum;
    angle = up > side ? 0.5f * PI - angle : angle;
    return sign(y) * (x < 0.0f ? PI - angle : angle);
}

inline Float8 acos(Float8 a) { return atan2(sqrt(max(1.0f - a * a, (Float8)0.0f)), a); }

// Eight vectors.
struct Vec3x8 {
    Float8 x, y, z;
};

inline Vec3x8 operator+(Vec3x8 a, Vec3x8 b) { return { a.x + b.x, a.y + b.y, a.z + b.z }; }
inline Vec3x8 operator-(Vec3x8 a, Vec3x8 b) { return { a.x - b.x, a.y - b.y, a.z - b.z }; }
inline Vec3x8 operator-(Vec3x8 a) { return { -a.x, -a.y, -a.z }; }
inline Vec3x8 operator*(Float8 s, Vec3x8 a) { return { s * a.x, s * a.y, s * a.z }; }
inline Vec3x8 mul(Vec3x8 a, Vec3x8 b) { return { a.x * b.x, a.y * b.y, a.z * b.z }; }
inline Float8 dot(Vec3x8 a, Vec3x8 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3x8 cross(Vec3x8 a, Vec3x8 b)
{
    return { a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}
inline Vec3x8 select(Int8 truth, Vec3x8 a, Vec3x8 b)
{
    return { truth ? a.x : b.x, truth ? a.y : b.y, truth ? a.z : b.z };
}
inline Vec3x8 normalized(Vec3x8 a) { return rsqrt(max(dot(a, a), (Float8)MIN_NORMAL)) * a; }
inline Vec3x8 clip(Vec3x8 a) { return { saturate(a.x), saturate(a.y), saturate(a.z) }; }
inline Vec3x8 div(Vec3x8 a, Vec3x8 b) { return { a.x / b.x, a.y / b.y, a.z / b.z }; }
inline Vec3x8 axis_vector(Int8 axis, Float8 value)
{
    const Float8 none = 0.0f;
    return { axis == 0 ? value : none, axis == 1 ? value : none, axis == 2 ? value : none };
}
inline Float8 component(Vec3x8 v, Int8 axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

// Broadcasts a vector to eight lanes.
inline Vec3x8 broadcast(Vec3 v) { return { (Float8)v.x, (Float8)v.y, (Float8)v.z }; }

// One of them.
inline Vec3 get_lane(const Vec3x8& v, int k) { return { v.x[k], v.y[k], v.z[k] }; }

inline void set_lane(Vec3x8& v, int k, Vec3 value)
{
    v.x[k] = value.x;
    v.y[k] = value.y;
    v.z[k] = value.z;
}

// Colours as the bytes R, G, B of words.
inline Int8 to_bytes(Vec3x8 color)
{
    const Vec3x8 steps { saturate(color.x) * 255.0f + 0.5f, saturate(color.y) * 255.0f + 0.5f,
                         saturate(color.z) * 255.0f + 0.5f };
    return to_int(steps.x) | to_int(steps.y) << 8 | to_int(steps.z) << 16;
}

}  // namespace warpcam
