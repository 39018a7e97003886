// What each instance would cover of an image if nothing else were there: its own shapes are traced alone.
//
// Rays, shapes and culls are those of the trace. The shapes are listed once for a large part of the image; what they touch
// of it is traced window by window, with the same list if one window holds it. A window's covered pixels are bits in
// shared memory, so that shapes may come in several passes.
#pragma once
#include "traversal/visibility.h"

namespace warpcam {

constexpr int COVER_SIZE = 64;  // pixels of a window's side
constexpr int COVER_WORDS = COVER_SIZE * COVER_SIZE / 32, ROW_WORDS = COVER_SIZE / 32;
// Pixels of a part whose shapes are listed together: with a table of rays as few as its cones are looked at together.
constexpr int part_width(int lens) { return has_table(lens) ? COVER_SIZE : 8 * COVER_SIZE; }
constexpr int part_height(int lens) { return has_table(lens) ? COVER_SIZE : 4 * COVER_SIZE; }
constexpr int EXTENT_NUMBERS = 5;  // left, top, right, bottom, pixels; warpcam/labeling/kernels.py has the same

WARPCAM_DEVICE int leading_zeros(unsigned bits)
{
#if defined(__CUDA_ARCH__)
    return __clz(int(bits));
#else
    return bits ? __builtin_clz(bits) : 32;
#endif
}

WARPCAM_DEVICE int bits_in(unsigned bits)
{
#if defined(__CUDA_ARCH__)
    return __popc(bits);
#else
    return __builtin_popcount(bits);
#endif
}

// Extends an extent, {left, top, right, bottom, pixels}, half-open, by pixels of a box. Threads of a block or of several
// may do so at once; on a CPU one thread alone has an instance.
WARPCAM_DEVICE void extend(int* extent, int left, int top, int right, int bottom, int pixels)
{
#if defined(__CUDA_ARCH__)
    atomicMin(extent, left);
    atomicMin(extent + 1, top);
    atomicMax(extent + 2, right);
    atomicMax(extent + 3, bottom);
    atomicAdd(extent + 4, pixels);
#else
    extent[0] = min(extent[0], left);
    extent[1] = min(extent[1], top);
    extent[2] = max(extent[2], right);
    extent[3] = max(extent[3], bottom);
    extent[4] += pixels;
#endif
}

// Target of the trace: a bit for each pixel of a window.
template <class Types, int LENS> struct CoverTarget {
    static constexpr int VECTOR_OUTPUTS = 0, TILES_PER_WARP = 1, TILE_COLUMNS_PER_WARP = 1, part = 0, parts = 1;
    static constexpr bool WHOLE = false, STORES_MUCH = true, APART = false, BARE_FLOORS = false, PUTS_BARE = false,
                          FROM_VIEW = false, PROJECTS = false;

    const Camera& camera;
    Region region;  // tiles that are traced
    int left, top;  // of the window whose bits these are
    int width, height;  // of the image
    unsigned* covered;  // COVER_WORDS

    WARPCAM_DEVICE unsigned* word(int i, int j) const { return covered + (j - top) * ROW_WORDS + (i - left) / 32; }
    WARPCAM_DEVICE unsigned bit(int i) const { return 1u << (i - left) % 32; }

    WARPCAM_DEVICE CameraRay<LENS> ray(int i, int j) const { return view_ray<LENS>(camera, i, j); }

    // Rays outside of the image, without a direction, or of pixels that are covered hit nothing.
    WARPCAM_DEVICE Hit start(int i, int j, bool) const
    {
        bool traced = i < width && j < height;
        if constexpr (has_table(LENS))
            traced = traced && !sees_nothing(ray(i, j));
        return { traced && !(*word(i, j) & bit(i)) ? camera.far : -1.0f, -1, -1 };
    }

    WARPCAM_DEVICE void write_hit(int i, int j, const Hit& hit, bool) const
    {
        if (hit.shape < 0)
            return;
#if defined(__CUDA_ARCH__)
        atomicOr(word(i, j), bit(i));
#else
        *word(i, j) |= bit(i);
#endif
    }

    WARPCAM_DEVICE bool write_seen_plane(int, int, const Hit (&)[1], int) const { return false; }
    WARPCAM_DEVICE void put_tiles(int i, int j, const CameraRay<LENS> (&)[1], const Hit (&hits)[1], bool first_pass,
                                  float*) const
    {
        write_hit(i, j, hits[0], first_pass);
    }
};

// Tiles of a region, counted from its corner, that the listed shapes touch, of which there is at least one.
template <int CAPACITY> WARPCAM_DEVICE TileRect touched_tiles(const ShapeList<CAPACITY>& list)
{
    TileRect all = list.touched[0];
    for (int slot = 1; slot < list.count; ++slot) {
        const TileRect& one = list.touched[slot];
        all = { one.left < all.left ? one.left : all.left, one.top < all.top ? one.top : all.top,
                one.right > all.right ? one.right : all.right, one.bottom > all.bottom ? one.bottom : all.bottom };
    }
    return all;
}

WARPCAM_DEVICE Region region_of_tiles(const Region& region, const TileRect& tiles)
{
    return { region.left + tiles.left * TILE_WIDTH, region.top + tiles.top * TILE_HEIGHT,
             (tiles.right - tiles.left + 1) * TILE_WIDTH, (tiles.bottom - tiles.top + 1) * TILE_HEIGHT };
}

// Counts the listed shapes' tiles from another tile's corner. For all threads of the block, when all have read them, and
// before the list is sorted, in which each thread reads what it has written here.
template <int CAPACITY>
WARPCAM_DEVICE void count_tiles_from(ShapeList<CAPACITY>& list, const TileRect& corner, int thread)
{
    const auto less = [](signed char a, signed char b) { return static_cast<signed char>(a - b); };
    for (int slot = thread; slot < list.count; slot += THREADS) {
        TileRect& one = list.touched[slot];
        one = { less(one.left, corner.left), less(one.top, corner.top), less(one.right, corner.left),
                less(one.bottom, corner.top) };
    }
}

// Adds what is covered of a window to an extent; for all threads of the block.
WARPCAM_DEVICE void add_covered(const unsigned* covered, const Region& region, int* extent, int thread)
{
    for (int row = thread; row < region.height; row += THREADS) {
        const unsigned low = covered[ROW_WORDS * row], high = covered[ROW_WORDS * row + 1];
        if ((low | high) == 0u)
            continue;
        const int left = low ? ctz(low) : 32 + ctz(high),
                  right = high ? 64 - leading_zeros(high) : 32 - leading_zeros(low);
        extend(extent, region.left + left, region.top + row, region.left + right, region.top + row + 1,
               bits_in(low) + bits_in(high));
    }
}

// Sets the pixels of a mask, (height, width) of bytes, that are covered of a window; for all threads of the block.
template <class Masks> WARPCAM_DEVICE void write_covered(const unsigned* covered, const Region& region,
                                                         const Masks& masks, int world, int instance, int thread)
{
    for (int word = thread; word < ROW_WORDS * region.height; word += THREADS) {
        if (covered[word] == 0u)
            continue;
        const int row = word / ROW_WORDS, left = word % ROW_WORDS * 32;
        auto* pixels = wp::address(masks, world, instance, region.top + row, region.left);
        for (unsigned bits = covered[word]; bits != 0u; bits &= bits - 1u)
            pixels[left + ctz(bits)] = 1;
    }
}

// Extends the extent of one instance in one view by what its shapes cover of some of the image's windows. `index` counts
// worlds, then instances, then parts, then (CUDA) threads of the block. `cover`: Cover of
// warpcam/labeling/kernels.py. With MASKS it sets the instance's mask, too.
template <class Types, int LENS, int CAPACITY, bool MASKS, class Shapes, class Materials, class Meshes,
          class HeightFields, class Views, class Cover>
WARPCAM_DEVICE void cover_instance(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                                   const HeightFields& fields, const Views& views, const Cover& cover, int index)
{
    WARPCAM_SHARED ShapeList<CAPACITY> list;
    alignas(16) WARPCAM_SHARED Camera camera;
    WARPCAM_SHARED unsigned covered[COVER_WORDS];
    WARPCAM_SHARED int extent[EXTENT_NUMBERS];
    const int thread = index % THREADS, block = index / THREADS, instances = cover.extents.shape[1];
    const int part = block % cover.parts, one = block / cover.parts, instance = one % instances,
              world = one / instances;
    const auto& starts = cover.members.starts;
    const int row = starts.shape[0] == 1 ? 0 : world;
    const int first = wp::index(starts, row, instance), count = wp::index(starts, row, instance + 1) - first;
    if (!wp::index(cover.mask, world) || count == 0)
        return;
    Shapes own = shapes;  // of which the instance's alone are drawn
    own.drawn.data = wp::address(cover.members.columns, row, first);
    own.drawn.shape[0] = count;
    if (thread == 0) {
        camera = load_camera(wp::index(views, world));
        extent[0] = extent[1] = 0x7fffffff;
        extent[2] = extent[3] = extent[4] = 0;
    }
    block_sync();
    if (!(abs(camera.origin.x) < MISS))
        return;
    const auto hidden = [&](int id, bool formless) { return formless || transparent(shapes, materials, world, id); };
    const auto list_shapes = [&](const Region& region, int begin) {
        if (thread == 0)
            begin_list(list);
        block_sync();
        return build_shape_list<Types, LENS, false, false>(list, begin, own, meshes, fields, hidden, camera, region,
                                                           world, thread);
    };
    // Of the image, up to so many pixels from a corner on, in whole tiles.
    const auto region_at = [&](int left, int top, int width, int height) {
        return Region { left, top, min(width, (cover.width - left + TILE_WIDTH - 1) / TILE_WIDTH * TILE_WIDTH),
                        min(height, (cover.height - top + TILE_HEIGHT - 1) / TILE_HEIGHT * TILE_HEIGHT) };
    };
    constexpr int WIDTH = part_width(LENS), HEIGHT = part_height(LENS);
    const int across = (cover.width + WIDTH - 1) / WIDTH, image_parts = across * ((cover.height + HEIGHT - 1) / HEIGHT);
    int windows = 0;  // so far: the blocks of an instance take turns
    for (int number = 0; number < image_parts; ++number) {
        const Region whole = region_at(number % across * WIDTH, number / across * HEIGHT, WIDTH, HEIGHT);
        const bool has_all = list_shapes(whole, 0) == count;
        if (list.broken)  // the world shows nothing
            return;
        Region rest = whole;
        if (has_all)
            rest = list.count > 0 ? region_of_tiles(whole, touched_tiles(list)) : Region { 0, 0, 0, 0 };
        const int columns = (rest.width + COVER_SIZE - 1) / COVER_SIZE,
                  count_windows = columns * ((rest.height + COVER_SIZE - 1) / COVER_SIZE);
        bool is_listed = has_all && count_windows == 1;
        block_sync();
        for (int k = 0; k < count_windows; ++k) {
            if (windows++ % cover.parts != part)
                continue;
            const int left = k % columns * COVER_SIZE, top = k / columns * COVER_SIZE;
            const Region window { rest.left + left, rest.top + top, min(COVER_SIZE, rest.width - left),
                                  min(COVER_SIZE, rest.height - top) };
            for (int word = thread; word < COVER_WORDS; word += THREADS)
                covered[word] = 0u;
            int begin = is_listed ? count : 0;
            do {
                if (!is_listed)
                    begin = list_shapes(window, begin);
                if (list.broken)
                    return;
                if (list.count > 0) {
                    const TileRect tiles = touched_tiles(list);
                    const Region& listed = is_listed ? whole : window;
                    const CoverTarget<Types, LENS> target { camera,      region_of_tiles(listed, tiles),
                                                            window.left, window.top,
                                                            cover.width, cover.height,
                                                            covered };
                    block_sync();
                    count_tiles_from(list, tiles, thread);
                    sort_by_depth(list, thread, [](int, int) {});
                    block_sync();
                    draw_tiles<Types, LENS>(list, target, meshes, fields, true);
                }
                block_sync();
                is_listed = false;
            } while (begin < count);
            add_covered(covered, window, extent, thread);
            if constexpr (MASKS)
                write_covered(covered, window, cover.masks, world, instance, thread);
            block_sync();
        }
    }
    if (thread == 0 && extent[4] > 0)
        extend(wp::address(cover.extents, world, instance, 0), extent[0], extent[1], extent[2], extent[3], extent[4]);
}

}  // namespace warpcam
