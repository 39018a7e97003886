// Parts of an image: what one thread block draws, and which tiles of that a shape may touch.
#pragma once
#include "camera/ray_table.h"

namespace warpcam {

// A block of an image that one thread block draws.
struct Region {
    int left, top, width, height;  // pixels; width and height are multiples of the tile's
};

// Tiles of a region, counted from its corner, inclusive; empty when left > right.
struct alignas(4) TileRect {
    signed char left, top, right, bottom;
};

// A box from which one addition tells whether it has a tile: it counts from each of its sides, and from 128.
struct PackedTileRect {
    static constexpr unsigned NONE = 0x40404040u;  // has no tile

    unsigned counts;

    WARPCAM_DEVICE static unsigned of(const TileRect& box)
    {
        return unsigned(128 - box.left) | unsigned(128 - box.top) << 8 | unsigned(128 + box.right) << 16
               | unsigned(128 + box.bottom) << 24;
    }
    // Sum of steps for any of a block of tiles, in so many columns and rows from the first.
    WARPCAM_DEVICE static unsigned steps(int column, int row, int columns, int rows)
    {
        return unsigned(column * (1 - (1 << 16)) + row * ((1 << 8) - (1 << 24)) + (columns - 1) + ((rows - 1) << 8));
    }
    WARPCAM_DEVICE bool touches(unsigned steps) const { return (~(counts + steps) & 0x80808080u) == 0u; }
};

// Part of an image, and its world, that a thread block draws; `block` counts worlds, then parts. OUTWARDS: parts in the
// middle of all images come first, as they take longest, so that the last blocks are short and all multiprocessors have
// as many of each kind; for launches of one row of blocks: see visibility.py.
template <bool OUTWARDS> WARPCAM_DEVICE int part_of(int block, int columns, int rows, int& world)
{
    const int parts = columns * rows;
#if defined(__CUDA_ARCH__)
    if constexpr (OUTWARDS) {
        const int mine = int(blockIdx.x), worlds = int(gridDim.x) / parts, rank = mine / worlds, step = rank / columns;
        world = (block - mine) / parts + mine % worlds;
        return (rows / 2 + (step % 2 ? -(step + 1) / 2 : step / 2)) * columns + rank % columns;
    }
#endif
    world = block / parts;
    return block % parts;
}

// The block of an image that a thread block draws; see part_of.
template <int WIDTH, int HEIGHT, bool OUTWARDS = false, class Target>
WARPCAM_DEVICE Region region_of(const Target& target, int block, int& world)
{
    const int columns = (target.width + WIDTH - 1) / WIDTH, rows = (target.height + HEIGHT - 1) / HEIGHT;
    const int part = part_of<OUTWARDS>(block, columns, rows, world);
    Region region { part % columns * WIDTH, part / columns * HEIGHT, WIDTH, HEIGHT };
    region.width = min(WIDTH, (target.width - region.left + TILE_WIDTH - 1) / TILE_WIDTH * TILE_WIDTH);
    region.height = min(HEIGHT, (target.height - region.top + TILE_HEIGHT - 1) / TILE_HEIGHT * TILE_HEIGHT);
    return region;
}

}  // namespace warpcam
