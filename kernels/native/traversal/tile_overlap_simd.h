// Tests which tiles shapes overlap, 32 shapes at once, on a CPU.
#pragma once
#include "camera/shape_record.h"

namespace warpcam {

// The tiles that so many shapes touch, part by part.
template <int CAPACITY> struct TileParts {
    static constexpr int SIZE = (CAPACITY + 31) / 32 * 32;
    signed char left[SIZE], top[SIZE], right[SIZE], bottom[SIZE];

    void put(int rank, const TileRect& box)
    {
        left[rank] = box.left;
        top[rank] = box.top;
        right[rank] = box.right;
        bottom[rank] = box.bottom;
    }
};

// Bit mask of the spans, of 32 from `first` on out of `count`, that contain a number.
inline unsigned spans_around(const signed char* from, const signed char* to, int first, int count, int number)
{
    typedef signed char Bytes __attribute__((ext_vector_type(32)));
    Bytes low, high;
    __builtin_memcpy(&low, from + first, sizeof low);
    __builtin_memcpy(&high, to + first, sizeof high);
    const Bytes own = static_cast<signed char>(number);
    const auto around = (low <= own) & (high >= own);
    const unsigned there = count - first >= 32 ? ~0u : (1u << (count - first)) - 1u;
#if defined(__AVX2__)
    typedef char Whole __attribute__((vector_size(32)));
    return static_cast<unsigned>(__builtin_ia32_pmovmskb256((Whole)around)) & there;
#else
    unsigned bits = 0;
    for (int k = 0; k < 32; ++k)
        bits |= (around[k] ? 1u : 0u) << k;
    return bits & there;
#endif
}

}  // namespace warpcam
