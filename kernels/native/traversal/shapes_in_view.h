// The shapes that a view may show, nearest first: what blocks of the trace choose from in scenes of many.
#pragma once
#include "geometry/shape_state.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

// An image as 16x16 cells, of which each shape in view has a rectangle.
struct Cells {
    static constexpr int ACROSS = 16;

    int width, height;  // of a cell [pixels]

    WARPCAM_DEVICE static Cells of(int width, int height)
    {
        return { (width + ACROSS - 1) / ACROSS, (height + ACROSS - 1) / ACROSS };
    }
    // First and last cell, across and down, of a region of an image of that size.
    WARPCAM_DEVICE static TileRect of(const Region& region, int width, int height)
    {
        const Cells size = of(width, height);
        const auto cell = [](int pixel, int length) { return static_cast<signed char>(pixel / length); };
        return { cell(region.left, size.width), cell(region.top, size.height),
                 cell(min(region.left + region.width, width) - 1, size.width),
                 cell(min(region.top + region.height, height) - 1, size.height) };
    }
};

// A shape in view: bits of a depth that it reaches at least, its place among the drawn ones, its first and last cell
// across and down.
struct ShapeInView {
    unsigned long long word;

    WARPCAM_DEVICE static unsigned place_and_cells(int place, const TileRect& cells)
    {
        return unsigned(place) << 16 | cells.left | cells.top << 4 | cells.right << 8 | cells.bottom << 12;
    }
    WARPCAM_DEVICE float nearest() const { return as_float(int(word >> 32)); }
    WARPCAM_DEVICE int place() const { return int(unsigned(word) >> 16); }
    WARPCAM_DEVICE bool touches(const TileRect& cells) const
    {
        const int rect = int(word);
        return (rect & 15) <= cells.right && (rect >> 8 & 15) >= cells.left && (rect >> 4 & 15) <= cells.bottom
               && (rect >> 12 & 15) >= cells.top;
    }
};

// The list of one world: a first word, whose upper half is how many shapes there are and whose lower half how many of
// the first of them are sorted, and the shapes.
struct ListInView {
    const unsigned long long* words;

    template <class Lists> WARPCAM_DEVICE static ListInView of(const Lists& lists, int world)
    {
        return { reinterpret_cast<const unsigned long long*>(lists.data) + size_t(world) * 2 * lists.shape[1] };
    }
    WARPCAM_DEVICE int count() const { return int(*words >> 32); }
    WARPCAM_DEVICE int sorted() const { return int(unsigned(*words)); }
    WARPCAM_DEVICE ShapeInView at(int index) const { return { words[1 + index] }; }
};

// Shapes to be sorted by depth, by a block; of those at one depth the later first. ROOM: a power of two.
template <int ROOM> struct DepthOrder {
    static constexpr int SLOT_BITS = 12, DROPPED = 31 - (32 - SLOT_BITS);  // bits of a depth that keys have no room for
    static constexpr unsigned LAST = (1u << SLOT_BITS) - 1u;
    static_assert(ROOM >= 2 * WARP_SIZE && ROOM <= 1 << SLOT_BITS);

    unsigned keys[ROOM];  // the depth's first bits, the slot from the end
    unsigned shapes[ROOM];  // by slot

    WARPCAM_DEVICE void put(int slot, int nearest, unsigned shape)
    {
        keys[slot] = unsigned(nearest & 0x7fffffff) >> DROPPED << SLOT_BITS | (LAST - unsigned(slot));
        shapes[slot] = shape;
    }
    WARPCAM_DEVICE unsigned long long at_rank(int rank) const
    {
        const unsigned key = keys[rank];
        return (unsigned long long)(key >> SLOT_BITS << DROPPED) << 32 | shapes[LAST - (key & LAST)];
    }

    // Bitonic: runs of up to 64 keys by a warp alone, which has two a lane.
    WARPCAM_DEVICE void sort(int count, int thread)
    {
        constexpr int ALONE = 2 * WARP_SIZE;
        int size = ALONE;
        while (size < count)
            size *= 2;
        for (int i = count + thread; i < size; i += THREADS)
            keys[i] = ~0u;
        block_sync();
        sort_alone(2, ALONE, size, thread);
        for (int run = 2 * ALONE; run <= size; run *= 2) {
            for (int step = run / 2; step >= ALONE; step /= 2) {
                for (int i = thread; i < size / 2; i += THREADS) {
                    const int low = (i & ~(step - 1)) << 1 | (i & (step - 1)), high = low + step;
                    const unsigned a = keys[low], b = keys[high];
                    if ((a > b) == ((low & run) == 0)) {
                        keys[low] = b;
                        keys[high] = a;
                    }
                }
                block_sync();
            }
            sort_alone(run, run, size, thread);
        }
    }

private:
    // The steps within 64 keys of the runs from `first` to `last`.
    WARPCAM_DEVICE void sort_alone(int first, int last, int size, int thread)
    {
        const int lane = thread % WARP_SIZE;
        for (int begin = thread / WARP_SIZE * 2 * WARP_SIZE; begin < size; begin += 2 * THREADS) {
            unsigned low = keys[begin + lane], high = keys[begin + WARP_SIZE + lane];
            for (int run = first; run <= last; run *= 2) {
                const bool up = ((begin + lane) & run) == 0, up_too = ((begin + WARP_SIZE + lane) & run) == 0;
                if (run > WARP_SIZE) {
                    const unsigned a = umin(low, high), b = umax(low, high);
                    low = up ? a : b;
                    high = up ? b : a;
                }
                for (int step = min(run / 2, WARP_SIZE / 2); step > 0; step /= 2) {
                    const bool first_of_two = (lane & step) == 0;
                    const unsigned a = __shfl_xor_sync(FULL_WARP, low, step),
                                   b = __shfl_xor_sync(FULL_WARP, high, step);
                    low = first_of_two == up ? umin(low, a) : umax(low, a);
                    high = first_of_two == up_too ? umin(high, b) : umax(high, b);
                }
            }
            keys[begin + lane] = low;
            keys[begin + WARP_SIZE + lane] = high;
        }
        block_sync();
    }
};

// Lists the shapes of one view; `index` counts worlds, then threads of the block. ROOM: shapes that are sorted
// together, a power of two.
template <class Types, int LENS, int ROOM, class Shapes, class Materials, class Meshes, class HeightFields, class Views,
          class Stage>
WARPCAM_DEVICE void list_in_view(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                                 const HeightFields& fields, const Views& views, const Stage& stage, int index)
{
    WARPCAM_SHARED DepthOrder<ROOM> order;
    WARPCAM_SHARED int counts[2][THREADS / WARP_SIZE], broken;
    const int thread = index % THREADS, world = warp_uniform(index / THREADS);
    if (!wp::index(stage.mask, world))
        return;
    const Camera camera = load_camera(wp::index(views, world));
    if (thread == 0)
        broken = 0;
    block_sync();
    unsigned long long* const words =
        reinterpret_cast<unsigned long long*>(stage.lists.data) + size_t(world) * 2 * stage.lists.shape[1];
    const Cells cells = Cells::of(stage.width, stage.height);
    const int total = abs(camera.origin.x) < MISS ? shapes.drawn.shape[0] : 0;
    int written = 0, count = 0, sorted = 0;
    const auto flush = [&] {
        order.sort(count, thread);
        for (int rank = thread; rank < count; rank += THREADS)
            words[1 + written + rank] = order.at_rank(rank);
        sorted = written == 0 ? count : sorted;
        written += count;
        count = 0;
        block_sync();
    };
    for (int begin = 0; begin < total; begin += THREADS) {
        if (count + THREADS > ROOM)
            flush();
        const int place = begin + thread;
        bool seen = false;
        ShapeRecord record;
        TileRect rect {};
        if (place < total) {
            const int id = wp::index(shapes.drawn, place);
            const Visible found =
                setup_shape<Types, LENS>(load_shape(shapes, world, id), camera, { 0, 0, stage.width, stage.height },
                                         meshes, fields, record, rect, cells.width, cells.height);
            if (found == BROKEN)
                broken = 1;
            const bool unseen = found == SEEN || found == FORMLESS ? transparent(shapes, materials, world, id) : true;
            if (found == FORMLESS && !unseen)
                stage.faults.data[world] = 1;
            seen = found == SEEN && !unseen;
        }
        const int slot = place_among(seen, count, counts[begin / THREADS & 1], thread);
        if (seen)
            order.put(slot, record.size.w, ShapeInView::place_and_cells(place, rect));
    }
    block_sync();
    flush();
    if (thread == 0) {
        if (broken)  // nothing of this world can be trusted
            stage.faults.data[world] = 1;
        words[0] = broken ? 0 : (unsigned long long)unsigned(written) << 32 | unsigned(sorted);
    }
}

#endif

}  // namespace warpcam
