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
};

// A shape in view as 64 bits that sort by depth, of shapes at one place the later first: the bits of its least depth,
// its place among the drawn ones from the end, its first and last cell across and down.
struct ShapeInView {
    static constexpr unsigned PLACES = 0xffffu;

    unsigned long long key;

    WARPCAM_DEVICE static ShapeInView of(int nearest, int place, const TileRect& cells)
    {
        const unsigned rect = cells.left | cells.top << 4 | cells.right << 8 | cells.bottom << 12;
        return { (unsigned long long)(nearest & 0x7fffffff) << 32 | (PLACES - unsigned(place)) << 16 | rect };
    }
    WARPCAM_DEVICE float nearest() const { return as_float(int(key >> 32)); }
    WARPCAM_DEVICE int place() const { return int(PLACES - (unsigned(key) >> 16)); }
    WARPCAM_DEVICE bool touches(const TileRect& cells) const
    {
        const int rect = int(key);
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

// Sorts so many keys, with room up to the next power of two, by a block.
WARPCAM_DEVICE void sort_keys(unsigned long long* keys, int count, int thread)
{
    int size = 1;
    while (size < count)
        size *= 2;
    for (int i = count + thread; i < size; i += THREADS)
        keys[i] = ~0ull;
    block_sync();
    for (int run = 2; run <= size; run *= 2)
        for (int step = run / 2; step > 0; step /= 2) {
            for (int i = thread; i < size / 2; i += THREADS) {
                const int low = (i & ~(step - 1)) << 1 | (i & (step - 1)), high = low + step;
                const unsigned long long a = keys[low], b = keys[high];
                if ((a > b) == ((low & run) == 0)) {
                    keys[low] = b;
                    keys[high] = a;
                }
            }
            block_sync();
        }
}

// The place of each thread that is `chosen` among those of the block that are, in the threads' order, from `begin` on;
// makes that the place after the last. `counts`: room for a number of each warp. The block meets.
WARPCAM_DEVICE int place_among(bool chosen, int& begin, int* counts, int thread)
{
    const unsigned votes = __ballot_sync(FULL_WARP, chosen);
    if (thread % WARP_SIZE == 0)
        counts[thread / WARP_SIZE] = __popc(votes);
    block_sync();
    int place = begin + __popc(votes & ((1u << thread % WARP_SIZE) - 1u));
    for (int warp = 0; warp < THREADS / WARP_SIZE; ++warp) {
        place += warp < thread / WARP_SIZE ? counts[warp] : 0;
        begin += counts[warp];
    }
    return place;
}

// Lists the shapes of one view; `index` counts worlds, then threads of the block. ROOM: shapes that are sorted
// together, a power of two.
template <class Types, int LENS, int ROOM, class Shapes, class Materials, class Meshes, class HeightFields, class Views,
          class Stage>
WARPCAM_DEVICE void list_in_view(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                                 const HeightFields& fields, const Views& views, const Stage& stage, int index)
{
    WARPCAM_SHARED unsigned long long keys[ROOM];
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
        sort_keys(keys, count, thread);
        for (int i = thread; i < count; i += THREADS)
            words[1 + written + i] = keys[i];
        sorted = written == 0 ? count : sorted;
        written += count;
        count = 0;
        block_sync();
    };
    for (int begin = 0; begin < total; begin += THREADS) {
        if (count + THREADS > ROOM)
            flush();
        const int place = begin + thread;
        ShapeInView listed { 0 };
        bool seen = false;
        if (place < total) {
            const int id = wp::index(shapes.drawn, place);
            ShapeRecord record;
            TileRect rect;
            const Visible found = setup_shape<Types, LENS>(load_shape(shapes, world, id), camera,
                                                           { 0, 0, stage.width, stage.height }, meshes, fields, record,
                                                           rect, cells.width, cells.height);
            if (found == BROKEN)
                broken = 1;
            const bool unseen = found == SEEN || found == FORMLESS ? transparent(shapes, materials, world, id) : true;
            if (found == FORMLESS && !unseen)
                stage.faults.data[world] = 1;
            seen = found == SEEN && !unseen;
            listed = ShapeInView::of(record.size.w, place, rect);
        }
        const int at = place_among(seen, count, counts[begin / THREADS & 1], thread);
        if (seen)
            keys[at] = listed.key;
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
