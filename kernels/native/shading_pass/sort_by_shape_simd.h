// Pixels of a few rows sorted by the shape that they show, on a CPU.
#pragma once
#include "core/simd8.h"
#include "shading/appearance.h"

namespace warpcam {

// Pixels by shape. Those that see nothing are a shape of their own, -1.
template <int SIZE> struct Sorted {
    static constexpr unsigned HASH_SLOTS = 2 * SIZE;
    short order[SIZE + SIMD_WIDTH];  // pixels, group after group; with room for what is written too many
    int shapes[SIZE + 1], ends[SIZE + 1];  // by group, the first of nothing; where its pixels end
    short places[SIZE + 1];  // by group: how many runs it has, then where its next goes
    short table[HASH_SLOTS];      // groups by a hash of their shape; -1: free
    struct Run {
        short group, first, end;  // pixels of one row
    } runs[SIZE], in_order[SIZE];
    int count;

    int find(int shape)
    {
        unsigned slot = (unsigned(shape) * 0x9e3779b1u >> 16) % HASH_SLOTS;
        for (; table[slot] >= 0; slot = (slot + 1) % HASH_SLOTS)
            if (shapes[table[slot]] == shape)
                return table[slot];
        table[slot] = short(count);
        shapes[count] = shape;
        ends[count] = places[count] = 0;
        return count++;
    }

    // The pixels of rows that are `width` long; a row has room for WIDTH.
    template <int WIDTH, class Array>
    WARPCAM_NOINLINE_CPU void sort(const Array& ids, size_t first, int pitch, int width, int rows)
    {
        for (unsigned slot = 0; slot < HASH_SLOTS; ++slot)
            table[slot] = -1;
        count = 0;
        int total = 0, last = -1, group = find(-1);
        for (int row = 0; row < rows; ++row) {
            const auto* const line = ids.data + first + size_t(row) * pitch;
            short begins[WIDTH + 1];  // of its runs
            int number = 0;
            for (int column = 0; column < width;) {
                unsigned long long changes = 0;  // pixels that show another shape than the one before, of 64
                const int base = column, end = min(width, base + 64);
                for (; column + SIMD_WIDTH <= end; column += SIMD_WIDTH) {
                    const Int8 own = load8(line + column);
                    const Int8 before = column == 0 ? __builtin_shufflevector(own, ~own, 8, 0, 1, 2, 3, 4, 5, 6)
                                                    : load8(line + column - 1);
                    changes |= static_cast<unsigned long long>(movemask(own != before)) << (column - base);
                }
                for (; column < end; ++column)
                    if (column == 0 || line[column] != line[column - 1])
                        changes |= 1ull << (column - base);
                for (; changes; changes &= changes - 1)
                    begins[number++] = short(base + __builtin_ctzll(changes));
            }
            begins[number] = short(width);
            for (int run = 0; run < number; ++run) {
                const int column = begins[run], end = begins[run + 1];
                const auto id = line[column];
                const int shape = id < 0 ? -1 : int(id);
                if (shape != last)
                    group = find(shape);
                last = shape;
                runs[total++] = { short(group), short(row * WIDTH + column), short(row * WIDTH + end) };
                ends[group] += end - column;
                ++places[group];
            }
        }
        for (int g = 0, pixels = 0, place = 0; g < count; ++g) {
            ends[g] = pixels += ends[g];
            const int its = places[g];
            places[g] = short(place);
            place += its;
        }
        for (int i = 0; i < total; ++i)
            in_order[places[runs[i].group]++] = runs[i];
        short* to = order;
        for (int i = 0; i < total; ++i) {
            int k = in_order[i].first;
            const int end = in_order[i].end;
            for (short* at = to; k < end;
                 k += SIMD_WIDTH, at += SIMD_WIDTH) {  // what it writes too many is written over by the next
                typedef short Shorts __attribute__((ext_vector_type(SIMD_WIDTH)));
                const Shorts pixels = short(k) + Shorts { 0, 1, 2, 3, 4, 5, 6, 7 };
                __builtin_memcpy(at, &pixels, sizeof pixels);
            }
            to += end - in_order[i].first;
        }
    }
};

}  // namespace warpcam
