// What is kept from frame to frame for the flow: a word a pixel of what was seen, and where these words lie.
#pragma once
#include "hits.h"
#include "prepare.h"

namespace warpcam {

// What a trace writes of it: bits of visibility.py. FLOW_MOVES: some meshes move. FLOW_BRIEF: words of 16 bits.
// FLOW_LISTED: there are no more shapes than a block lists, and no meshes move; each block composes their motions.
enum FlowOutput { FLOW = 1 << 24, FLOW_VALID = 1 << 25, FLOW_MOVES = 1 << 26, FLOW_BRIEF = 1 << 27, FLOW_LISTED = 1 << 28 };
constexpr int FLOWS = FLOW | FLOW_VALID;

// Rows of Trail.motions that a shape has, and the last word of the fourth where it rests: see flow.py.
template <bool MOVES> constexpr int motion_rows() { return MOVES ? 7 : 4; }
constexpr int STILL = -1;

// A whole number near a float that is less than 2^22: the last bits of a float between 2^23 and 2^24.
constexpr float TO_WHOLE = 12582912.0f;

// What is kept of a pixel: above the shape, all ones where nothing is seen; below its depth. `last`: the fourth of the
// shape's rows.
template <bool BRIEF> struct Kept;

// The depth is 16 bits of its float, five of the exponent, which is enough for 15 um to 65 km.
template <> struct Kept<false> {
    using Word = unsigned;
    static constexpr int DEPTH_BITS = 12, LEAST_DEPTH = 111 << 23;  // what is cut off the float, and bits of 2^-16 m
    static constexpr unsigned DEPTHS = 0xffffu;

    WARPCAM_FN static Word word(int shape, float depth, const Row&)
    {
        const unsigned bits = unsigned(as_int(depth) - LEAST_DEPTH) << (16 - DEPTH_BITS);
#if defined(__CUDA_ARCH__)
        return __byte_perm(bits, shape, 0x5432);
#else
        return unsigned(shape) << 16 | bits >> 16;
#endif
    }
    // By how much a word is above the least that a shape has: at most DEPTHS if it is of the shape.
    WARPCAM_FN static unsigned above(unsigned word, int shape) { return word - (unsigned(shape) << 16); }
    WARPCAM_FN static bool shows(unsigned word, int shape) { return above(word, shape) <= DEPTHS; }
    WARPCAM_FN static bool rests(const Row& last) { return last.w == STILL; }
    // Both of two words show the shape, and one of them a part that is not nearer than the point then might be.
    WARPCAM_FN static bool show(unsigned one, unsigned other, int shape, const Row& last, float depth)
    {
        const unsigned a = above(one, shape), b = above(other, shape), most = a > b ? a : b;
        constexpr int CUT = LEAST_DEPTH + (1 << DEPTH_BITS) - 1;  // the last bits are any
        return most <= DEPTHS && int(most << DEPTH_BITS) + CUT >= as_int(muladd(last.x, depth, last.y));
    }
};

// The shape has eight bits; the depth is counted in steps of the shape's own, eight bits of which tell its parts apart.
template <> struct Kept<true> {
    using Word = unsigned short;

    WARPCAM_FN static unsigned steps(float number) { return unsigned(as_int(number)); }
    WARPCAM_FN static Word word(int shape, float depth, const Row& last)
    {
        const unsigned bits = steps(muladd(depth, as_float(last.w), TO_WHOLE));
#if defined(__CUDA_ARCH__)
        return static_cast<Word>(__byte_perm(bits, shape, 0x4440));
#else
        return static_cast<Word>((unsigned(shape) & 255u) << 8 | (bits & 255u));
#endif
    }
    WARPCAM_FN static bool shows(unsigned word, int shape) { return (word ^ unsigned(shape) << 8) <= 255u; }
    WARPCAM_FN static bool rests(const Row& last) { return last.z < 0.0f; }
    WARPCAM_FN static bool show(unsigned one, unsigned other, int shape, const Row& last, float depth)
    {
        const unsigned a = one ^ unsigned(shape) << 8, b = other ^ unsigned(shape) << 8;
        const unsigned nearest = steps(muladd(last.x, depth, last.y + TO_WHOLE));
        return (a | b) <= 255u && ((a - nearest) & (b - nearest) & 128u) == 0u;
    }
};

// Words of an image lie in strips of eight pixels' width, so that those of a tile are neighbours.
template <class Trail> WARPCAM_FN unsigned place_of(const Trail& trail, unsigned column, unsigned row)
{
    return (column & ~7u) * trail.height + (8u * row + (column & 7u));
}

// The word of a pixel, of a trace that writes none that it reads.
template <class Word> WARPCAM_FN unsigned word_at(const Word* words, unsigned place)
{
#if defined(__CUDA_ARCH__)
    return __ldg(words + place);
#else
    return words[place];
#endif
}

WARPCAM_FN void keep_word(unsigned* words, unsigned place, unsigned word)
{
#if defined(__CUDA_ARCH__)  // the compiler does not know that it is in global memory
    asm volatile("st.global.u32 [%0], %1;" ::"l"(words + place), "r"(word) : "memory");
#else
    words[place] = word;
#endif
}
WARPCAM_FN void keep_word(unsigned short* words, unsigned place, unsigned short word)
{
#if defined(__CUDA_ARCH__)
    asm volatile("st.global.u16 [%0], %1;" ::"l"(words + place), "h"(word) : "memory");
#else
    words[place] = word;
#endif
}

// 1 or 0, of which the compiler makes no condition that it carries along.
WARPCAM_FN unsigned settled(bool condition)
{
    unsigned number = condition;
#if defined(__CUDA_ARCH__)
    asm("" : "+r"(number));
#endif
    return number;
}

// Trail.known: what was seen is kept in the first or the second of two places, what is seen goes to the other; or nothing
// is known of what was. Values of views.py.
enum Known { SECOND = 1, FIRST = 2, NEW = 4 };

// Copies 16 bytes to shared memory, where they are once the thread has waited for its copies.
WARPCAM_FN void copy_row(void* to, const void* from)
{
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(static_cast<unsigned>(__cvta_generic_to_shared(to))), "l"(from) : "memory");
#else
    *static_cast<Row*>(to) = *static_cast<const Row*>(from);
#endif
}

WARPCAM_FN void await_rows()
{
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    asm volatile("cp.async.wait_all;" ::: "memory");
#endif
}

// Places in an image are counted in steps of 1 / 64 pixel: the last bits of a float between 2^17 and 2^18.
constexpr int STEP_BITS = 6, STEPS = 1 << STEP_BITS;
constexpr float TO_STEPS = 196608.0f;
constexpr int NO_STEPS = 0x48400000;  // the bits of that

// Of places that have both of their pixels among the first ones: as many steps.
WARPCAM_FN unsigned within(int pixels) { return unsigned(STEPS * pixels - STEPS / 2); }

// Along one axis the two pixels that have a quarter or more of what is interpolated at a place, mostly the same one.
struct Beside {
    unsigned steps;  // to the place from a quarter of a pixel before the middle of the image's first

    // The place is x * scale.
    WARPCAM_FN Beside(float x, float scale) : steps(as_int(muladd(x, scale, TO_STEPS + 0.25f)) - NO_STEPS) { }
    WARPCAM_FN explicit Beside(unsigned count) : steps(count) { }
    WARPCAM_FN unsigned one() const { return steps >> STEP_BITS; }
    WARPCAM_FN unsigned other() const { return (steps + STEPS / 2) >> STEP_BITS; }
};

// Shapes that a block lists at most where it has room in shared memory for words beside their motions.
constexpr int MOST_NEAR = 64;

// Of one world: what the last image showed, where what this one shows is kept, and how its shapes have moved.
// WIDTH and HEIGHT: a block of CUDA threads has the words of its region in shared memory, if these have 16 bits. They are on
// their way while shapes are listed: memory is far, and a pixel that asked for its own words would wait for them. SHAPES:
// it has the motions of as many shapes.
template <int WANTED, int WIDTH = 0, int HEIGHT = 0, int SHAPES = 0> struct FlowPlaces {
    using Keeps = Kept<(WANTED & FLOW_BRIEF) != 0>;
    using Word = typename Keeps::Word;
    static constexpr int ROWS = motion_rows<(WANTED & FLOW_MOVES) != 0>();
#if defined(__CUDA_ARCH__)
    static constexpr bool NEAR = WIDTH > 0 && (WANTED & FLOW_VALID) && (WANTED & FLOW_BRIEF);
#else
    static constexpr bool NEAR = false;
#endif
    static constexpr bool LISTED = SHAPES > 0;

    const Word* words;
    Word* kept;
    const Row* motions;
    // Steps (flow.h) to the region, and of the places whose two pixels along an axis lie in what of it is in the image.
    struct alignas(16) Bounds {
        unsigned left, top, width, height;
    } bounds;
    alignas(16) Camera then;  // as it was, where motions are listed
    alignas(16) Word near_words[NEAR ? WIDTH * HEIGHT : 8];
    Row near_motions[LISTED ? SHAPES * ROWS : 1];

    // Where in `near_words` a pixel of the region stands: those of a tile are in different banks.
    WARPCAM_FN static unsigned near_place(unsigned column, unsigned row)
    {
        return row * WIDTH + (column ^ (row << 3 & 24u & (WIDTH - 1)));
    }

    // The motion of a shape; `at` has its rows.
    struct Rows {
        const Row* rows;
        WARPCAM_FN Row at(unsigned row) const
        {
            if constexpr (LISTED)
                return rows[row];
            else
                return load(rows, row);
        }
    };
    WARPCAM_FN Rows of_shape(int shape) const
    {
        if constexpr (LISTED)
            return { near_motions + ROWS * shape };
        const Row* rows = motions + size_t(unsigned(shape)) * ROWS;
#if defined(__CUDA_ARCH__)
        asm("" : "+l"(rows));  // one address with four offsets
#endif
        return { rows };
    }

    // What was seen at pixel (i, j), whose word is kept at `place`.
    WARPCAM_FN unsigned word_of(int i, int j, unsigned place) const
    {
        if constexpr (NEAR)
            return near_words[near_place(unsigned(i) & (WIDTH - 1), unsigned(j) & (HEIGHT - 1))];
        else
            return word_at(words, place);
    }

    // Has the word on its way that a pixel that rests will need: it comes from far, and meanwhile the pixel is traced.
    template <class Trail> WARPCAM_FN void expect(const Trail& trail, int i, int j) const
    {
#if defined(__CUDA_ARCH__)
        if (!NEAR)
            asm volatile("prefetch.global.L1 [%0];" ::"l"(words + place_of(trail, i, j)));
#endif
    }

    // For one thread.
    template <class Trail> WARPCAM_FN void locate(const Trail& trail, int world)
    {
        const bool in_first = wp::index(trail.known, world) == FIRST;
        const size_t first = size_t(world) * ((trail.width + 7) / 8 * 8 * trail.height);
        Word* one = reinterpret_cast<Word*>(trail.kept_first.data) + first;
        Word* other = reinterpret_cast<Word*>(trail.kept_second.data) + first;
        words = in_first ? one : other;
        kept = in_first ? other : one;
        if (!LISTED)
            motions = reinterpret_cast<const Row*>(trail.motions.data) + size_t(world) * trail.columns * ROWS;
    }

    // Has on its way what is kept near; for all threads of a block.
    template <class Trail> WARPCAM_FN void fetch(const Trail& trail, const Region& region, int thread)
    {
        if (NEAR) {
            if (thread == 0)
                bounds = { unsigned(STEPS * region.left), unsigned(STEPS * region.top),
                           within(lower_int(WIDTH, trail.width - region.left)),
                           within(lower_int(HEIGHT, trail.height - region.top)) };
            for (int i = thread; i < WIDTH / 8 * HEIGHT; i += THREADS) {
                const int strip = i / (HEIGHT > 0 ? HEIGHT : 1) * 8, row = i % (HEIGHT > 0 ? HEIGHT : 1);
                if (region.left + strip < trail.width && region.top + row < trail.height)
                    copy_row(near_words + near_place(strip, row), words + place_of(trail, region.left + strip, region.top + row));
            }
        }
    }
};

}  // namespace warpcam
