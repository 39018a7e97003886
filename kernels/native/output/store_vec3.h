// Three numbers of each pixel of a warp's tiles, stored by 16 bytes. For CUDA.
#pragma once
#include "output/hit_attributes.h"
#include "camera/shape_record.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// As point_of(), of pixels of one column: what they share is worked out once. MISSES: not all have hit a shape.
template <bool MISSES, int LENS, int TALL>
WARPCAM_FN void find_points(const Camera& camera, const ViewRay<LENS> (&rays)[TALL], const Hit (&hits)[TALL],
                            Vec (&points)[TALL])
{
    const Matrix& m = camera.rotation;
    const Vec right { m.at[0][0], m.at[1][0], m.at[2][0] }, up { m.at[0][1], m.at[1][1], m.at[2][1] };
    const Vec back { m.at[0][2], m.at[1][2], m.at[2][2] };
    const Vec start = LENS == PINHOLE ? rays[0].x * right - back : camera.origin + rays[0].x * right;
    for (int k = 0; k < TALL; ++k) {
        const Vec along = start + rays[k].y * up;
        points[k] = has_table(LENS) ? point_of(hits[k], camera, rays[k])
            : LENS == PINHOLE    ? camera.origin + hits[k].depth * along
                                 : along - hits[k].depth * back;
        const bool missed = MISSES && hits[k].shape < 0;
        points[k] = { missed ? infinity() : points[k].x, missed ? infinity() : points[k].y,
                      missed ? infinity() : points[k].z };
    }
}

// Stores piece_of(k), 16 bytes of a row of the k-th tile, by each lane; the last two of a row have none.
template <class Canvas_, class Piece>
WARPCAM_FN void store_pieces(const Canvas_& canvas, float* image, int i, int j, const Piece& piece_of)
{
    const int piece = threadIdx.x % TILE_WIDTH;
    const bool tiled = Canvas_::TILES_INSIDE;
    const int width = tiled ? TILE_WIDTH : lower_int(canvas.target.width - (i - piece), TILE_WIDTH);
    char* place = nullptr;
    for (int k = 0; k < Canvas_::TALL; ++k) {
        if (Canvas_::WHOLE && k > 0) {
            place += 12 * TILE_HEIGHT * canvas.region.width;
        } else {
            size_t bytes = 12 * size_t(canvas.at(i, j, k));
            asm("" : "+l"(bytes));  // or the compiler adds `piece`, which is the same for all tiles, to it
            place = reinterpret_cast<char*>(image + piece) + bytes;
        }
        if (4 * piece < 3 * width && (tiled || j + k * TILE_HEIGHT < canvas.target.height))
            *reinterpret_cast<Row*>(place) = piece_of(k);
    }
}

// Stores three numbers of each pixel; `row_of_lanes` is room for those of a warp's tiles.
template <class Canvas_, int TALL>
WARPCAM_FN void store_threes(const Canvas_& canvas, float* image, int i, int j, const Vec (&values)[TALL],
                             float* row_of_lanes)
{
    const int lane = threadIdx.x % LANES;
    float* lanes = row_of_lanes + 3 * lane;
    for (int k = 0; k < TALL; ++k) {
        lanes[3 * LANES * k] = values[k].x;
        lanes[3 * LANES * k + 1] = values[k].y;
        lanes[3 * LANES * k + 2] = values[k].z;
    }
    __syncwarp();
    store_pieces(canvas, image, i, j, [&](int k) {
        return *reinterpret_cast<const Row*>(lanes + 3 * LANES * k + lane % TILE_WIDTH);
    });
    __syncwarp();
}

}  // namespace warpcam
#endif
