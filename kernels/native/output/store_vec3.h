// Three numbers of each pixel of a warp's tiles, stored by 16 bytes. For CUDA.
#pragma once
#include "output/hit_attributes.h"
#include "camera/shape_record.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// Computes the points of pixels of one column, as point_of() does, and shares what they have in common. MISSES: some
// pixels have hit nothing.
template <bool MISSES, int LENS, int TILES_PER_WARP>
WARPCAM_DEVICE void find_points(const Camera& camera, const CameraRay<LENS> (&rays)[TILES_PER_WARP],
                                const Hit (&hits)[TILES_PER_WARP], Vec3 (&points)[TILES_PER_WARP])
{
    const Mat3& m = camera.rotation;
    const Vec3 right { m.at[0][0], m.at[1][0], m.at[2][0] }, up { m.at[0][1], m.at[1][1], m.at[2][1] };
    const Vec3 back { m.at[0][2], m.at[1][2], m.at[2][2] };
    const Vec3 start = LENS == PINHOLE ? rays[0].x * right - back : camera.origin + rays[0].x * right;
    for (int k = 0; k < TILES_PER_WARP; ++k) {
        const Vec3 along = start + rays[k].y * up;
        points[k] = has_table(LENS)   ? point_of(hits[k], camera, rays[k])
                    : LENS == PINHOLE ? camera.origin + hits[k].depth * along
                                      : along - hits[k].depth * back;
        const bool missed = MISSES && hits[k].shape < 0;
        points[k] = { missed ? infinity() : points[k].x, missed ? infinity() : points[k].y,
                      missed ? infinity() : points[k].z };
    }
}

// Stores piece_of(k), 16 bytes of a row of the k-th tile, by each lane; the last two of a row have none.
template <class TraceTarget_, class Piece>
WARPCAM_DEVICE void store_pieces(const TraceTarget_& trace_target, float* image, int i, int j, const Piece& piece_of)
{
    const int piece = threadIdx.x % TILE_WIDTH;
    const bool tiled = TraceTarget_::TILES_INSIDE;
    const int width = tiled ? TILE_WIDTH : min(trace_target.target.width - (i - piece), TILE_WIDTH);
    char* place = nullptr;
    for (int k = 0; k < TraceTarget_::TILES_PER_WARP; ++k) {
        if (TraceTarget_::WHOLE && k > 0) {
            place += 12 * TILE_HEIGHT * trace_target.region.width;
        } else {
            size_t bytes = 12 * size_t(trace_target.at(i, j, k));
            asm("" : "+l"(bytes));  // or the compiler adds `piece`, which is the same for all tiles, to it
            place = reinterpret_cast<char*>(image + piece) + bytes;
        }
        if (4 * piece < 3 * width && (tiled || j + k * TILE_HEIGHT < trace_target.target.height))
            *reinterpret_cast<Float3Int*>(place) = piece_of(k);
    }
}

// Stores three numbers of each pixel; `row_of_lanes` is room for those of a warp's tiles.
template <class TraceTarget_, int TILES_PER_WARP>
WARPCAM_DEVICE void store_vectors(const TraceTarget_& trace_target, float* image, int i, int j,
                                  const Vec3 (&values)[TILES_PER_WARP], float* row_of_lanes)
{
    const int lane = threadIdx.x % WARP_SIZE;
    float* lanes = row_of_lanes + 3 * lane;
    for (int k = 0; k < TILES_PER_WARP; ++k) {
        lanes[3 * WARP_SIZE * k] = values[k].x;
        lanes[3 * WARP_SIZE * k + 1] = values[k].y;
        lanes[3 * WARP_SIZE * k + 2] = values[k].z;
    }
    __syncwarp();
    store_pieces(trace_target, image, i, j, [&](int k) {
        return *reinterpret_cast<const Float3Int*>(lanes + 3 * WARP_SIZE * k + lane % TILE_WIDTH);
    });
    __syncwarp();
}

}  // namespace warpcam
#endif
