// State kept from frame to frame for optical flow: a word a pixel of what was visible, and the layout of these words.
#pragma once
#include "flow/plane_history.h"

namespace warpcam {

// Flow outputs of a trace: bits of flags.py. FLOW_MOVES: some meshes move. FLOW_COMPACT: words have 16 bits.
// FLOW_LISTED: each block composes motions, of no more shapes than it lists, or copies those that the stage of views
// has composed. FLOW_WHOLE: a block draws a whole image. FLOW_NEAR: shared memory has room for the previous words of 16
// bits a pixel.
enum FlowOutput {
    FLOW = 1 << 24,
    FLOW_VALID = 1 << 25,
    FLOW_MOVES = 1 << 26,
    FLOW_COMPACT = 1 << 27,
    FLOW_LISTED = 1 << 28,
    FLOW_WHOLE = 1 << 29,
    FLOW_NEAR = 1 << 30
};
constexpr int FLOWS = FLOW | FLOW_VALID;

// Rows of Trail.motions that a shape has, and the last word of the fourth where it rests: see flow.py.
template <bool MOVES> constexpr int motion_rows() { return MOVES ? 7 : 4; }
constexpr int STILL = -1;

// A whole number near a float that is less than 2^22: the last bits of a float between 2^23 and 2^24.
constexpr float TO_WHOLE = 12582912.0f;

// Packed word of a pixel: shape in the upper bits, all ones where nothing is visible; depth in the lower bits. `last`:
// the fourth of the shape's rows.
template <bool SHORT> struct PackedVisibility;

// The depth is 16 bits of its float, five of the exponent, which is enough for 15 um to 65 km.
template <> struct PackedVisibility<false> {
    using Word = unsigned;
    static constexpr int DEPTH_BITS = 12, LEAST_DEPTH = 111 << 23;  // what is cut off the float, and bits of 2^-16 m
    static constexpr unsigned DEPTHS = 0xffffu;

    WARPCAM_DEVICE static Word word(int shape, float depth, const Float3Int&)
    {
        const unsigned bits = unsigned(as_int(depth) - LEAST_DEPTH) << (16 - DEPTH_BITS);
#if defined(__CUDA_ARCH__)
        return __byte_perm(bits, shape, 0x5432);
#else
        return unsigned(shape) << 16 | bits >> 16;
#endif
    }
    // By how much a word is above the least that a shape has: at most DEPTHS if it is of the shape.
    WARPCAM_DEVICE static unsigned above(unsigned word, int shape) { return word - (unsigned(shape) << 16); }
    WARPCAM_DEVICE static bool shows(unsigned word, int shape) { return shape >= 0 && above(word, shape) <= DEPTHS; }
    WARPCAM_DEVICE static bool rests(const Float3Int& last) { return last.w == STILL; }
    // Both of two words show the shape, and one of them a part that is not nearer than the point then might be.
    WARPCAM_DEVICE static bool show(unsigned one, unsigned other, int shape, const Float3Int& last, float depth)
    {
        const unsigned a = above(one, shape), b = above(other, shape), most = a > b ? a : b;
        constexpr int CUT = LEAST_DEPTH + (1 << DEPTH_BITS) - 1;  // the last bits are any
        return most <= DEPTHS && int(most << DEPTH_BITS) + CUT >= as_int(fma(last.x, depth, last.y));
    }
};

// The shape has eight bits; the depth is counted in steps of the shape's own, eight bits of which tell its parts apart.
template <> struct PackedVisibility<true> {
    using Word = unsigned short;

    WARPCAM_DEVICE static unsigned steps(float number) { return unsigned(as_int(number)); }
    WARPCAM_DEVICE static Word word(int shape, float depth, const Float3Int& last)
    {
        const unsigned bits = steps(fma(depth, as_float(last.w), TO_WHOLE));
#if defined(__CUDA_ARCH__)
        return static_cast<Word>(__byte_perm(bits, shape, 0x4440));
#else
        return static_cast<Word>((unsigned(shape) & 255u) << 8 | (bits & 255u));
#endif
    }
    WARPCAM_DEVICE static bool shows(unsigned word, int shape) { return (word ^ unsigned(shape) << 8) <= 255u; }
    WARPCAM_DEVICE static bool rests(const Float3Int& last) { return last.z < 0.0f; }
    WARPCAM_DEVICE static bool show(unsigned one, unsigned other, int shape, const Float3Int& last, float depth)
    {
        const unsigned a = one ^ unsigned(shape) << 8, b = other ^ unsigned(shape) << 8;
        const unsigned nearest = steps(fma(last.x, depth, last.y));
        return (a | b) <= 255u && ((a - nearest) & (b - nearest) & 128u) == 0u;
    }
};

// The word of a pixel, of a trace that writes none that it reads.
template <class Word> WARPCAM_DEVICE unsigned word_at(const Word* words, unsigned place)
{
#if defined(__CUDA_ARCH__)
    return __ldg(words + place);
#else
    return words[place];
#endif
}

WARPCAM_DEVICE void keep_word(unsigned* words, unsigned place, unsigned word)
{
#if defined(__CUDA_ARCH__)  // the compiler does not know that it is in global memory
    asm volatile("st.global.u32 [%0], %1;" ::"l"(words + place), "r"(word) : "memory");
#else
    words[place] = word;
#endif
}
WARPCAM_DEVICE void keep_word(unsigned short* words, unsigned place, unsigned short word)
{
#if defined(__CUDA_ARCH__)
    asm volatile("st.global.u16 [%0], %1;" ::"l"(words + place), "h"(word) : "memory");
#else
    words[place] = word;
#endif
}

// 1 or 0, of which the compiler makes no condition that it carries along.
WARPCAM_DEVICE unsigned settled(bool condition)
{
    unsigned number = condition;
#if defined(__CUDA_ARCH__)
    asm("" : "+r"(number));
#endif
    return number;
}

// FlowHistory.frame_state: what was seen is kept in the first or the second of two places, what is seen goes to the
// other; or nothing is known of what was. Values of views.py.
enum Known { SECOND = 1, FIRST = 2, NEW = 4 };

// Copies 16 bytes to shared memory, where they are once the thread has waited for its copies.
WARPCAM_DEVICE void copy_row(void* to, const void* from)
{
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(static_cast<unsigned>(__cvta_generic_to_shared(to))),
                 "l"(from)
                 : "memory");
#else
    *static_cast<Float3Int*>(to) = *static_cast<const Float3Int*>(from);
#endif
}

WARPCAM_DEVICE void await_rows()
{
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    asm volatile("cp.async.wait_all;" ::: "memory");
#endif
}

// The bits of a float that is not negative, rounded down, above another from 2^23 on.
WARPCAM_DEVICE unsigned bits_below(float number, float above)
{
#if defined(__CUDA_ARCH__)
    return __float_as_uint(__fadd_rd(number, above));
#else
    return unsigned(as_int(above)) + unsigned(number);
#endif
}
WARPCAM_DEVICE unsigned pixel_below(float number) { return bits_below(number, 8388608.0f) - 0x4b000000u; }

// History of one world: words of the previous image, the words to write, and the motions of shapes.
//
// WIDTH and HEIGHT: a block of CUDA threads draws a whole image of that size. NEAR: the previous words are in shared
// memory; they are loaded while shapes are listed, as a pixel that loaded its own words from global memory would wait
// for them. SHAPES: shared memory holds the motions of as many shapes, too. FLOORED: the block tests planes as a whole.
template <int WANTED, int WIDTH = 0, int HEIGHT = 0, int SHAPES = 0, bool NEAR = false, bool FLOORED = false>
struct VisibilityHistory {
    using Keeps = PackedVisibility<(WANTED & FLOW_COMPACT) != 0>;
    using Word = typename Keeps::Word;
    static constexpr int ROWS = motion_rows<(WANTED & FLOW_MOVES) != 0>();
    static constexpr bool WHOLE = WIDTH > 0, LISTED = SHAPES > 0, LOOKS_AT_FLOORS = FLOORED, WRITES_ALBEDO = false;

    const Word* words;
    Word* kept;
    const Float3Int* motions;
    alignas(16) Camera previous;  // as it was, where motions are listed
    alignas(16) Word near_words[NEAR ? NEAR_ROW * HEIGHT : 1];
    Float3Int near_motions[LISTED ? (SHAPES + 1) * ROWS : 1];  // the first of nothing
    typename FloorOf<FLOORED>::type floor;

    // The motion of a shape; `at` has its rows.
    struct Rows {
        const Float3Int* rows;
        WARPCAM_DEVICE Float3Int at(unsigned row) const
        {
            if constexpr (LISTED)
                return rows[row];
            else
                return load(rows, row);
        }
    };
    WARPCAM_DEVICE Rows of_shape(int shape) const
    {
        if constexpr (LISTED)
            return { near_motions + ROWS * (shape + 1) };
        const Float3Int* rows = motions + size_t(unsigned(shape < 0 ? 0 : shape)) * ROWS;
#if defined(__CUDA_ARCH__)
        asm("" : "+l"(rows));  // one address with four offsets
#endif
        return { rows };
    }

    template <class History> WARPCAM_DEVICE static int width(const History& history)
    {
        return WHOLE ? WIDTH : history.width;
    }
    template <class History> WARPCAM_DEVICE static int height(const History& history)
    {
        return WHOLE ? HEIGHT : history.height;
    }

    // Index of a pixel's word: strips of eight pixels' width, so that the words of a tile are neighbours.
    template <class History>
    WARPCAM_DEVICE static unsigned place_of(const History& history, unsigned column, unsigned row)
    {
        return (column & ~7u) * height(history) + (8u * row + (column & 7u));
    }
    // Previous word of a pixel, by its coordinates or by its index; indices count from the start of the image.
    template <class History>
    WARPCAM_DEVICE unsigned word_of(const History& history, unsigned column, unsigned row) const
    {
        if constexpr (NEAR)
            return near_words[NEAR_ROW * row + column];
        else
            return word_at(words, place_of(history, column, row));
    }
    template <class History>
    WARPCAM_DEVICE unsigned word_at_place(const History& history, float across, float along) const
    {
        if constexpr (NEAR) {
            const unsigned from_first =
                NEAR_BYTES * bits_below(along, ROW_START) + unsigned(sizeof(Word)) * bits_below(across, COLUMN_START);
            return *reinterpret_cast<const Word*>(reinterpret_cast<const char*>(near_words) + from_first);
        } else {
            return word_of(history, pixel_below(across), pixel_below(along));
        }
    }

    // Has the word on its way that a pixel that rests will need: it comes from far, and meanwhile the pixel is traced.
    template <class History> WARPCAM_DEVICE void expect(const History& history, int i, int j) const
    {
#if defined(__CUDA_ARCH__)
        if (!NEAR)
            asm volatile("prefetch.global.L1 [%0];" ::"l"(words + place_of(history, i, j)));
#endif
    }

    // For one thread.
    template <class History> WARPCAM_DEVICE void locate(const History& history, int world)
    {
        const bool in_first = wp::index(history.frame_state, world) == FIRST;
        const size_t first = size_t(world) * ((history.width + 7) / 8 * 8 * history.height);
        Word* one = reinterpret_cast<Word*>(history.first_words.data) + first;
        Word* other = reinterpret_cast<Word*>(history.second_words.data) + first;
        words = in_first ? one : other;
        kept = in_first ? other : one;
        if constexpr (FLOORED) {
            const size_t parts = size_t(world) * FlowFloor::parts_of(history.width, history.height);
            unsigned char* these = history.floor_first.data + parts;
            unsigned char* those = history.floor_second.data + parts;
            floor.parts_then = in_first ? these : those;
            floor.parts_now = in_first ? those : these;
        }
        if (!LISTED)
            motions = reinterpret_cast<const Float3Int*>(history.motions.data) + size_t(world) * history.columns * ROWS;
    }

    // The motion of a shape where the stage of views has composed it: of all shapes the first row, of all the second,
    // ...
    struct Composed {
        const Float3Int* rows;
        int columns;
        WARPCAM_DEVICE Float3Int at(unsigned row) const { return load(rows, row * columns); }
    };
    template <class History> WARPCAM_DEVICE static Composed composed(const History& history, int world, int shape)
    {
        const size_t first = size_t(unsigned(world * history.columns * ROWS + shape));
        return { reinterpret_cast<const Float3Int*>(history.motions.data) + first, history.columns };
    }

    // Has all these motions, of at most WARP_SIZE shapes, on their way; for all threads of a block.
    template <class History> WARPCAM_DEVICE void fetch_motions(const History& history, int world, unsigned thread)
    {
        static_assert(SHAPES <= WARP_SIZE && ROWS == THREADS / WARP_SIZE);
        const unsigned shape = thread % WARP_SIZE, row = thread / WARP_SIZE, columns = history.columns;
        if (shape < columns)
            copy_row(near_motions + (ROWS * (shape + 1) + row), reinterpret_cast<const Float3Int*>(history.motions.data)
                                                                    + ((world * ROWS + row) * columns + shape));
        if (thread == 0)  // of nothing, which rests
            near_motions[3] = { 0.0f, 0.0f, -1.0f, (WANTED & FLOW_COMPACT) ? 0 : STILL };
    }

    // Has all words on their way, if they are to be near; for all threads of a block.
    template <class Shapes, class History>
    WARPCAM_DEVICE void fetch(const Shapes& shapes, const History& history, int thread)
    {
        if constexpr (FLOORED && NEAR) {
            const int row = thread - WARP_SIZE;  // those who look for floors in them
            if (unsigned(row) < unsigned(HEIGHT)) {
                const auto shown = load_vector<FlowFloor::SIZE / FlowFloor::PART>(
                    floor.parts_then + row / FlowFloor::PART * (FlowFloor::SIZE / FlowFloor::PART));
                const unsigned both = FlowFloor::word(floor_of(shapes, history.columns)) * 0x00010001u;
                for (int k = 0; k < WIDTH / 8; ++k) {
                    Word* here = near_words + NEAR_ROW * row + 8 * k;
                    if (shown.at[k])
                        *reinterpret_cast<AlignedArray<unsigned, 4>*>(here) = { { both, both, both, both } };
                    else
                        copy_row(here, words + 8 * (HEIGHT * k + row));
                }
            }
        } else if (NEAR) {
            for (int i = thread; i < WIDTH * HEIGHT / 8; i += THREADS)
                copy_row(near_words + NEAR_ROW * (i % HEIGHT) + 8 * (i / HEIGHT), words + 8 * i);
        }
    }
};

}  // namespace warpcam
