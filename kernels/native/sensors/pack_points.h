// Points of images in lists of worlds: those that count, one after another in the order of their pixels. A block works
// on a world.
#pragma once
#include "core/vec3.h"
#include "core/warp.h"

namespace warpcam {

enum PointKind { GIVEN_POINTS, PINHOLE_DEPTH, ORTHOGRAPHIC_DEPTH };

// Places of a block's threads among those of them that keep something, batch after batch.
class BlockRanks {
public:
    // How many threads before this one keep something; the block's number of them goes to `total`.
    WARPCAM_DEVICE int rank(bool keeps, int& total)
    {
#if defined(__CUDA_ARCH__)
        constexpr int WARPS = THREADS / WARP_SIZE;
        // Two rows in turns: a warp may be a batch ahead of one that still adds up.
        WARPCAM_SHARED int counts[2][WARPS];
        const int warp = threadIdx.x / WARP_SIZE, lane = threadIdx.x % WARP_SIZE;
        const unsigned kept = __ballot_sync(FULL_WARP, keeps);
        if (lane == 0)
            counts[turn][warp] = __popc(kept);
        block_sync();
        int before = __popc(kept & (1u << lane) - 1);
        total = 0;
        for (int k = 0; k < WARPS; ++k) {
            const int count = counts[turn][k];
            before += k < warp ? count : 0;
            total += count;
        }
        turn ^= 1;
        return before;
#else
        total = keeps;
        return 0;
#endif
    }

private:
    int turn = 0;
};

// World and thread of a launch's index.
struct BlockPlace {
    int world, thread;
};

WARPCAM_DEVICE BlockPlace block_place(int index) { return { index / THREADS, index % THREADS }; }

// False for infinities and for what is no number.
WARPCAM_DEVICE bool is_usable(float value) { return abs(value) < MISS; }

// World frame [m]; infinite where there is none.
template <class Source> WARPCAM_DEVICE Vec3 source_point(const Source& source, int world, int pixel)
{
    const size_t place = size_t(world) * source.num_pixels + pixel;
    if (source.kind == GIVEN_POINTS) {
        const float* at = source.points.data + 3 * place;
        return { at[0], at[1], at[2] };
    }
    const float depth = source.points.data[place];
    const auto& view = source.views.data[world];
    if (!(depth > 0.0f && depth < MISS) || depth == view.miss)
        return { MISS, MISS, MISS };
    const int row = pixel / source.width, column = pixel - row * source.width;
    float x = mul_rn(float(column) + 0.5f - view.center[0], view.scale[0]);
    float y = mul_rn(view.center[1] - float(row) - 0.5f, view.scale[1]);
    if (source.kind == PINHOLE_DEPTH)
        x = mul_rn(x, depth), y = mul_rn(y, depth);
    const auto& m = view.rotation;
    const auto along = [&](int axis) {
        return view.origin[axis] + (mul_rn(m.data[axis][0], x) + mul_rn(m.data[axis][1], y))
               - mul_rn(m.data[axis][2], depth);
    };
    return { along(0), along(1), along(2) };
}

// The same place in the frame that the cloud is in.
template <class Crop> WARPCAM_DEVICE Vec3 in_frame(const Crop& crop, int world, Vec3 point)
{
    if (!crop.positions.data)
        return point;
    const auto& origin = crop.positions.data[world];
    const auto& m = crop.rotations.data[world];
    const float x = point.x - origin[0], y = point.y - origin[1], z = point.z - origin[2];
    const auto along = [&](int axis) {
        return mul_rn(m.data[0][axis], x) + mul_rn(m.data[1][axis], y) + mul_rn(m.data[2][axis], z);
    };
    return { along(0), along(1), along(2) };
}

template <class Source> WARPCAM_DEVICE bool is_excluded(const Source& source, int world, int pixel)
{
    const size_t place = size_t(world) * source.num_pixels + pixel;
    if (source.valid.data && !source.valid.data[place])
        return true;
    bool found = false;
    for (int k = 0; k < source.num_filters; ++k) {
        const int id = reinterpret_cast<const int*>(source.filters.data[2 * k])[place];
        const unsigned char* dropped = reinterpret_cast<const unsigned char*>(source.filters.data[2 * k + 1]);
        if (id >= 0 && id < source.filter_sizes.data[k])
            found |= dropped[id] != 0;
    }
    return found;
}

// Writes the points of one source that count behind those of the sources before it.
template <class Source, class Crop, class Candidates>
WARPCAM_DEVICE void pack_points(const Source& source, const Crop& crop, const Candidates& candidates, int index)
{
    const auto [world, thread] = block_place(index);
    if (!candidates.mask.data[world])
        return;
    const int capacity = candidates.pixels.shape[1];
    float* x = candidates.points.data + size_t(world) * 3 * capacity;
    int* pixels = candidates.pixels.data + size_t(world) * capacity;
    int count = source.first_pixel > 0 ? candidates.counts.data[world] : 0;
    BlockRanks ranks;
    for (int base = 0; base < source.num_pixels && count < capacity; base += THREADS) {
        const int pixel = base + thread;
        bool keeps = pixel < source.num_pixels;
        Vec3 point {};
        if (keeps) {
            point = source_point(source, world, pixel);
            keeps = is_usable(point.x) && is_usable(point.y) && is_usable(point.z);
        }
        if (keeps) {
            point = in_frame(crop, world, point);
            keeps = point.x >= crop.low[0] && point.x <= crop.high[0] && point.y >= crop.low[1]
                    && point.y <= crop.high[1] && point.z >= crop.low[2] && point.z <= crop.high[2]
                    && !is_excluded(source, world, pixel);
        }
        int total;
        const int place = count + ranks.rank(keeps, total);
        if (keeps && place < capacity) {
            x[place] = point.x;
            x[capacity + place] = point.y;
            x[2 * capacity + place] = point.z;
            pixels[place] = source.first_pixel + pixel;
        }
        count += total;
    }
    block_sync();  // all have read the count of the sources before
    if (thread == 0)
        candidates.counts.data[world] = min(count, capacity);
}

}  // namespace warpcam
