// Eight numbers at once, on a CPU.
#pragma once
#include "core/vec3.h"

namespace warpcam {

constexpr int PACKET = 8;
typedef float Floats __attribute__((ext_vector_type(PACKET)));
typedef int Ints __attribute__((ext_vector_type(PACKET)));

inline Floats lower(Floats a, Floats b) { return a < b ? a : b; }
inline Floats upper(Floats a, Floats b) { return a > b ? a : b; }
inline Ints lower(Ints a, Ints b) { return a < b ? a : b; }
inline Ints upper(Ints a, Ints b) { return a > b ? a : b; }
inline Floats magnitude(Floats a) { return __builtin_elementwise_abs(a); }
inline Floats root(Floats a) { return __builtin_elementwise_sqrt(a); }
inline Floats reciprocal(Floats a) { return 1.0f / a; }
inline Floats nonzero(Floats a) { return magnitude(a) < 1.0e-18f ? (Floats)1.0e-18f : a; }

// Of normal numbers above zero, to about two units in the last place: an estimate and one of Newton's steps.
inline Floats inverse_root(Floats a)
{
#if defined(__AVX__)
    const Floats r = __builtin_ia32_rsqrtps256(a);
    return r * (1.5f - 0.5f * a * (r * r));
#else
    return 1.0f / root(a);
#endif
}
inline Floats round_down(Floats a) { return __builtin_elementwise_floor(a); }
inline Floats sign(Floats a) { return a < 0.0f ? (Floats)-1.0f : (Floats)1.0f; }
inline Floats between(Floats a, Floats low, Floats high) { return lower(upper(a, low), high); }
inline Ints between(Ints a, Ints low, Ints high) { return lower(upper(a, low), high); }
inline Floats saturated(Floats a) { return between(a, (Floats)0.0f, (Floats)1.0f); }
inline Floats fraction(Floats a) { return saturated(a - round_down(a)); }
inline Floats to_floats(Ints a) { return __builtin_convertvector(a, Floats); }
inline Ints to_whole(Floats a) { return __builtin_convertvector(a, Ints); }  // towards 0

inline Floats muladd(Floats a, Floats b, Floats c)
{
#if defined(__FMA__)
    return __builtin_elementwise_fma(a, b, c);
#else
    return a * b + c;
#endif
}

// Eight numbers of any kind that follow each other, as whole ones.
template <class Value> inline Ints load_eight(const Value* from)
{
    typedef Value Values __attribute__((ext_vector_type(PACKET)));
    Values values;
    __builtin_memcpy(&values, from, sizeof values);
    return __builtin_convertvector(values, Ints);
}

template <class Value> inline void store_eight(Value* to, Ints from)
{
    typedef Value Values __attribute__((ext_vector_type(PACKET)));
    const Values values = __builtin_convertvector(from, Values);
    __builtin_memcpy(to, &values, sizeof values);
}

// Is an element true (all ones)?
inline bool any_of(Ints truth)
{
#if defined(__AVX__)
    return __builtin_ia32_movmskps256((Floats)truth) != 0;
#else
    return __builtin_reduce_or(truth) != 0;
#endif
}

// The same of each, a bit.
inline unsigned bits_of(Ints truth)
{
#if defined(__AVX__)
    return unsigned(__builtin_ia32_movmskps256((Floats)truth));
#else
    unsigned bits = 0;
    for (int k = 0; k < PACKET; ++k)
        bits |= truth[k] ? 1u << k : 0u;
    return bits;
#endif
}

inline float least_of(Floats a)
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
    unsigned at[PACKET];
    explicit Places8(Ints places)
    {
        __builtin_memcpy(at, &places, sizeof at);
#if defined(__x86_64__)
        asm("" : "+m"(at));  // else the compiler does that
#endif
    }
};

// One by one: on many processors quicker than their instructions for it.
inline Floats gather(const float* entries, Ints at)
{
    return { entries[at[0]], entries[at[1]], entries[at[2]], entries[at[3]],
             entries[at[4]], entries[at[5]], entries[at[6]], entries[at[7]] };
}

inline Ints gather(const int* entries, Ints at)
{
    return { entries[at[0]], entries[at[1]], entries[at[2]], entries[at[3]],
             entries[at[4]], entries[at[5]], entries[at[6]], entries[at[7]] };
}

struct Columns {
    Floats a, b, c, d;
};

// Rows of four, transposed: `skip` behind each place.
inline Columns columns_of(const float* const (&rows)[PACKET], int skip)
{
    typedef float Four __attribute__((ext_vector_type(4)));
    Floats pairs[4];  // rows k and k + 4
    for (int k = 0; k < 4; ++k) {
        Four a, b;
        __builtin_memcpy(&a, rows[k] + skip, sizeof a);
        __builtin_memcpy(&b, rows[k + 4] + skip, sizeof b);
        pairs[k] = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
    }
    const Floats low01 = __builtin_shufflevector(pairs[0], pairs[1], 0, 8, 1, 9, 4, 12, 5, 13);
    const Floats low23 = __builtin_shufflevector(pairs[2], pairs[3], 0, 8, 1, 9, 4, 12, 5, 13);
    const Floats high01 = __builtin_shufflevector(pairs[0], pairs[1], 2, 10, 3, 11, 6, 14, 7, 15);
    const Floats high23 = __builtin_shufflevector(pairs[2], pairs[3], 2, 10, 3, 11, 6, 14, 7, 15);
    return { __builtin_shufflevector(low01, low23, 0, 1, 8, 9, 4, 5, 12, 13),
             __builtin_shufflevector(low01, low23, 2, 3, 10, 11, 6, 7, 14, 15),
             __builtin_shufflevector(high01, high23, 0, 1, 8, 9, 4, 5, 12, 13),
             __builtin_shufflevector(high01, high23, 2, 3, 10, 11, 6, 7, 14, 15) };
}

inline Columns gather_rows(const float* rows, Ints at)
{
    const float* places[PACKET];
    for (int k = 0; k < PACKET; ++k)
        places[k] = rows + 4 * size_t(unsigned(at[k]));
    return columns_of(places, 0);
}

// Each entry, and the one after it.
inline void gather_pairs(const int* entries, Ints at, Ints& first, Ints& second)
{
    typedef int Two __attribute__((ext_vector_type(2)));
    Two pairs[PACKET];
    const Places8 places(at);
    for (int k = 0; k < PACKET; ++k)
        __builtin_memcpy(pairs + k, entries + places.at[k], sizeof(Two));
    const auto four = [&](int k) {
        const auto low = __builtin_shufflevector(pairs[k], pairs[k + 1], 0, 1, 2, 3);
        return __builtin_shufflevector(low, __builtin_shufflevector(pairs[k + 4], pairs[k + 5], 0, 1, 2, 3), 0, 1, 2, 3,
                                       4, 5, 6, 7);
    };
    const Ints even = four(0), odd = four(2);
    first = __builtin_shufflevector(even, odd, 0, 2, 8, 10, 4, 6, 12, 14);
    second = __builtin_shufflevector(even, odd, 1, 3, 9, 11, 5, 7, 13, 15);
}

// Entries of a table of 16.
inline Ints look_up(const int* table, Ints at)
{
#if defined(__AVX2__)
    typedef int Whole __attribute__((vector_size(32)));
    Whole low, high;
    __builtin_memcpy(&low, table, sizeof low);
    __builtin_memcpy(&high, table + PACKET, sizeof high);
#if defined(__AVX512VL__)
    return (Ints)__builtin_ia32_vpermi2vard256(low, (Whole)at, high);
#else
    const Ints below = (Ints)__builtin_ia32_permvarsi256(low, (Whole)at);
    return at < PACKET ? below : (Ints)__builtin_ia32_permvarsi256(high, (Whole)at);
#endif
#else
    return gather(table, at);
#endif
}

// Of normal numbers above zero: to two units in the last place of 1, or of itself where it is more.
inline Floats logarithm2(Floats a)
{
    constexpr int HALF_ROOT = 0x3f3504f3;  // bits of the square root of a half, where the fractions begin
    const Ints bits = (Ints)a - HALF_ROOT;
    const Floats part = (Floats)((bits & 0x7fffff) + HALF_ROOT), s = (part - 1.0f) / (part + 1.0f), square = s * s;
    const Floats series = 2.885390082f + square * (0.961796694f + square * (0.577078016f + square * 0.412198583f));
    return to_floats(bits >> 23) + s * series;
}

// Never so small that products with it are not normal numbers: these would take a hundred times longer.
inline Floats power_of_two(Floats a)
{
    a = between(a, (Floats)-64.0f, (Floats)127.0f);
    const Floats whole = round_down(a + 0.5f), x = a - whole;
    const Floats series =
        1.0f
        + x
              * (0.693147182f
                 + x
                       * (0.240226507f
                          + x * (0.0555041087f + x * (0.00961812911f + x * (0.00133335581f + x * 0.00015403530f)))));
    return series * (Floats)((to_whole(whole) + 127) << 23);
}

inline Floats power(Floats base, float exponent)
{
    const int whole = exponent >= 1.0f && exponent <= 1024.0f ? int(exponent) : 0;
    if (float(whole) != exponent)
        return power_of_two(exponent * logarithm2(base));
    // by squares, of what is large enough for them to be normal numbers, too: 2^(-64 / exponent), 6 % above it at most
    base = upper(base, (Floats)__builtin_bit_cast(float, 0x3f800000 - int(64.0f / exponent * 0x800000)));
    Floats product = whole & 1 ? base : (Floats)1.0f;
    for (int left = whole >> 1; left; left >>= 1) {
        base *= base;
        product = left & 1 ? product * base : product;
    }
    return product;
}

inline Floats fourth_power(Floats a) { return (a * a) * (a * a); }

// Abramowitz and Stegun 4.4.49, to 2e-8 of its tangent.
inline Floats atan2(Floats y, Floats x)
{
    constexpr float SERIES[] = { -0.3333314528f, 0.1999355085f,  -0.1420889944f, 0.1065626393f,
                                 -0.0752896400f, 0.0429096138f, -0.0161657367f, 0.0028662257f };
    const Floats up = magnitude(y), side = magnitude(x), most = upper(up, side);
    const Floats rate = lower(up, side) / upper(most, (Floats)TINY), square = rate * rate;
    Floats sum = 0.0f;
    for (int n = 7; n >= 0; --n)
        sum = square * (SERIES[n] + sum);
    Floats angle = rate + rate * sum;
    angle = up > side ? 0.5f * PI - angle : angle;
    return sign(y) * (x < 0.0f ? PI - angle : angle);
}

inline Floats acos(Floats a) { return atan2(root(upper(1.0f - a * a, (Floats)0.0f)), a); }

// Eight vectors.
struct Vecs {
    Floats x, y, z;
};

inline Vecs operator+(Vecs a, Vecs b) { return { a.x + b.x, a.y + b.y, a.z + b.z }; }
inline Vecs operator-(Vecs a, Vecs b) { return { a.x - b.x, a.y - b.y, a.z - b.z }; }
inline Vecs operator-(Vecs a) { return { -a.x, -a.y, -a.z }; }
inline Vecs operator*(Floats s, Vecs a) { return { s * a.x, s * a.y, s * a.z }; }
inline Vecs times(Vecs a, Vecs b) { return { a.x * b.x, a.y * b.y, a.z * b.z }; }
inline Floats dot(Vecs a, Vecs b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vecs cross(Vecs a, Vecs b)
{
    return { a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}
inline Vecs chosen(Ints truth, Vecs a, Vecs b)
{
    return { truth ? a.x : b.x, truth ? a.y : b.y, truth ? a.z : b.z };
}
inline Vecs normalized(Vecs a) { return inverse_root(upper(dot(a, a), (Floats)TINY)) * a; }
inline Vecs clip(Vecs a) { return { saturated(a.x), saturated(a.y), saturated(a.z) }; }
inline Vecs divided(Vecs a, Vecs b) { return { a.x / b.x, a.y / b.y, a.z / b.z }; }
inline Vecs axis_vector(Ints axis, Floats value)
{
    const Floats none = 0.0f;
    return { axis == 0 ? value : none, axis == 1 ? value : none, axis == 2 ? value : none };
}
inline Floats component(Vecs v, Ints axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

// The same vector eight times.
inline Vecs eight_of(Vec v) { return { (Floats)v.x, (Floats)v.y, (Floats)v.z }; }

// One of them.
inline Vec one_of(const Vecs& v, int k) { return { v.x[k], v.y[k], v.z[k] }; }

inline void put_one(Vecs& v, int k, Vec value)
{
    v.x[k] = value.x;
    v.y[k] = value.y;
    v.z[k] = value.z;
}

// Colours as the bytes R, G, B of words.
inline Ints to_bytes(Vecs color)
{
    const Vecs steps { saturated(color.x) * 255.0f + 0.5f, saturated(color.y) * 255.0f + 0.5f,
                       saturated(color.z) * 255.0f + 0.5f };
    return to_whole(steps.x) | to_whole(steps.y) << 8 | to_whole(steps.z) << 16;
}

}  // namespace warpcam
