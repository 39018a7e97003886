// Farthest point sampling: each next point is the one that is farthest from all that were picked before.
//
// Points lie in chunks of neighbours in an image, each with its box and the greatest distance of a point of it from what
// was picked. A chunk whose box is farther from a new pick than that is left as it is, which is exact: rounding is
// monotonic, so no point of the box is nearer in floats either. A block works on a world, each warp on chunks of its own.
#pragma once
#include "sensors/pack_points.h"

namespace warpcam {

constexpr int MAX_CHUNKS = 1024;  // that a block holds in shared memory
constexpr float PICKED = -1.0f;  // distance of points that were picked

// Boxes and farthest points of chunks, each in a slot of its own. Squared distances are compared as the bits of floats.
struct PointChunks {
    float low[3][MAX_CHUNKS], high[3][MAX_CHUNKS];
    int farthest[MAX_CHUNKS], place[MAX_CHUNKS];
};

// Points of a world by coordinate, and squared distances from what was picked [m^2].
struct PointLists {
    const float *x, *y, *z;
    float* distances;
    int count, size;  // of points, and of points in a chunk
};

WARPCAM_DEVICE float squared_length(float x, float y, float z) { return mul_rn(x, x) + mul_rn(y, y) + mul_rn(z, z); }

// No more than the squared distance of any point of a chunk.
WARPCAM_DEVICE float squared_gap(const PointChunks& chunks, int slot, Vec3 point)
{
    const float x = max(max(chunks.low[0][slot] - point.x, point.x - chunks.high[0][slot]), 0.0f);
    const float y = max(max(chunks.low[1][slot] - point.y, point.y - chunks.high[1][slot]), 0.0f);
    const float z = max(max(chunks.low[2][slot] - point.z, point.z - chunks.high[2][slot]), 0.0f);
    return squared_length(x, y, z);
}

#if defined(__CUDA_ARCH__)

constexpr int NUM_WARPS = THREADS / WARP_SIZE;
constexpr int WARP_SLOTS = MAX_CHUNKS / NUM_WARPS;  // a warp's are beside each other

// Neighbours, which change together, belong to different warps.
WARPCAM_DEVICE int slot_of(int chunk) { return chunk % NUM_WARPS * WARP_SLOTS + chunk / NUM_WARPS; }
WARPCAM_DEVICE int chunk_of(int slot) { return slot % WARP_SLOTS * NUM_WARPS + slot / WARP_SLOTS; }

WARPCAM_DEVICE float warp_min(float value)
{
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        value = min(value, __shfl_xor_sync(FULL_WARP, value, step));
    return value;
}

// The greatest of the lanes' distances, and the first place of it.
WARPCAM_DEVICE void warp_farthest(int& farthest, int& place)
{
    const int own = farthest;
    farthest = -warp_reduce_min(-own);
    place = warp_reduce_min(own == farthest ? place : 0x7fffffff);
}

// For a warp.
WARPCAM_DEVICE void start_chunk(PointChunks& chunks, const PointLists& lists, int slot)
{
    const int lane = threadIdx.x % WARP_SIZE, begin = chunk_of(slot) * lists.size;
    const int end = min(begin + lists.size, lists.count);
    const float* axes[3] = { lists.x, lists.y, lists.z };
    for (int i = begin + lane; i < end; i += WARP_SIZE)
        lists.distances[i] = MISS;
    for (int axis = 0; axis < 3; ++axis) {
        float low = MISS, high = -MISS;
        for (int i = begin + lane; i < end; i += WARP_SIZE) {
            low = min(low, axes[axis][i]);
            high = max(high, axes[axis][i]);
        }
        low = warp_min(low), high = -warp_min(-high);
        if (lane == 0)
            chunks.low[axis][slot] = low, chunks.high[axis][slot] = high;
    }
    if (lane == 0)
        chunks.farthest[slot] = as_int(MISS), chunks.place[slot] = begin;
}

// For a warp.
WARPCAM_DEVICE void update_chunk(PointChunks& chunks, const PointLists& lists, int slot, int pick, Vec3 point)
{
    const int lane = threadIdx.x % WARP_SIZE, begin = chunk_of(slot) * lists.size;
    const int end = min(begin + lists.size, lists.count);
    int farthest = as_int(PICKED), place = begin;
    for (int i = begin + lane; i < end; i += WARP_SIZE) {
        const float now = squared_length(lists.x[i] - point.x, lists.y[i] - point.y, lists.z[i] - point.z);
        const float distance = i == pick ? PICKED : min(lists.distances[i], now);
        lists.distances[i] = distance;
        if (as_int(distance) > farthest)
            farthest = as_int(distance), place = i;
    }
    warp_farthest(farthest, place);
    if (lane == 0)
        chunks.farthest[slot] = farthest, chunks.place[slot] = place;
}

// Each warp's farthest point, for the picks that are made in turns.
struct WarpPicks {
    int farthest[2][NUM_WARPS], place[2][NUM_WARPS];
};

WARPCAM_DEVICE int next_pick(PointChunks& chunks, WarpPicks& found, const PointLists& lists, int num_chunks, int pick,
                             int turn)
{
    const int lane = threadIdx.x % WARP_SIZE, warp = threadIdx.x / WARP_SIZE, own = slot_of(pick / lists.size);
    const Vec3 point { lists.x[pick], lists.y[pick], lists.z[pick] };
    int farthest = as_int(PICKED), place = 0x7fffffff;
    for (int round = 0; round < WARP_SLOTS; round += WARP_SIZE) {
        const int first = warp * WARP_SLOTS + round, slot = first + lane;
        if (chunk_of(first) >= num_chunks)
            break;
        const bool there = chunk_of(slot) < num_chunks;
        const bool changes = there && (slot == own || as_int(squared_gap(chunks, slot, point)) < chunks.farthest[slot]);
        for (unsigned changed = __ballot_sync(FULL_WARP, changes); changed; changed &= changed - 1)
            update_chunk(chunks, lists, first + ctz(changed), pick, point);
        __syncwarp();
        if (there
            && (chunks.farthest[slot] > farthest || (chunks.farthest[slot] == farthest && chunks.place[slot] < place)))
            farthest = chunks.farthest[slot], place = chunks.place[slot];
    }
    warp_farthest(farthest, place);
    if (lane == 0)
        found.farthest[turn][warp] = farthest, found.place[turn][warp] = place;
    block_sync();
    farthest = found.farthest[turn][0], place = found.place[turn][0];
    for (int k = 1; k < NUM_WARPS; ++k) {
        const int other = found.farthest[turn][k], there = found.place[turn][k];
        if (other > farthest || (other == farthest && there < place))
            farthest = other, place = there;
    }
    return place;
}

#else

WARPCAM_DEVICE void start_chunk(PointChunks& chunks, const PointLists& lists, int chunk)
{
    const int begin = chunk * lists.size, end = min(begin + lists.size, lists.count);
    const float* axes[3] = { lists.x, lists.y, lists.z };
    for (int axis = 0; axis < 3; ++axis) {
        float low = MISS, high = -MISS;
        for (int i = begin; i < end; ++i) {
            low = min(low, axes[axis][i]);
            high = max(high, axes[axis][i]);
        }
        chunks.low[axis][chunk] = low, chunks.high[axis][chunk] = high;
    }
    for (int i = begin; i < end; ++i)
        lists.distances[i] = MISS;
    chunks.farthest[chunk] = as_int(MISS), chunks.place[chunk] = begin;
}

WARPCAM_DEVICE void update_chunk(PointChunks& chunks, const PointLists& lists, int chunk, int pick, Vec3 point)
{
    const int begin = chunk * lists.size, count = min(lists.size, lists.count - begin);
    const float* __restrict x = lists.x + begin, * __restrict y = lists.y + begin, * __restrict z = lists.z + begin;
    float* __restrict distances = lists.distances + begin;
    if (pick / lists.size == chunk)
        distances[pick - begin] = PICKED;
    int farthest = as_int(PICKED);
    for (int i = 0; i < count; ++i) {
        const float distance = min(distances[i], squared_length(x[i] - point.x, y[i] - point.y, z[i] - point.z));
        distances[i] = distance;
        farthest = max(farthest, as_int(distance));
    }
    int place = 0;
    while (as_int(distances[place]) != farthest)
        ++place;
    chunks.farthest[chunk] = farthest, chunks.place[chunk] = begin + place;
}

WARPCAM_DEVICE int next_pick(PointChunks& chunks, const PointLists& lists, int num_chunks, int pick)
{
    const Vec3 point { lists.x[pick], lists.y[pick], lists.z[pick] };
    // Loops of one step each, which are vectorised.
    float gaps[MAX_CHUNKS];
    for (int chunk = 0; chunk < num_chunks; ++chunk)
        gaps[chunk] = squared_gap(chunks, chunk, point);
    gaps[pick / lists.size] = PICKED;
    for (int chunk = 0; chunk < num_chunks; ++chunk)
        if (as_int(gaps[chunk]) < chunks.farthest[chunk])
            update_chunk(chunks, lists, chunk, pick, point);
    int farthest = as_int(PICKED), first = 0;
    for (int chunk = 0; chunk < num_chunks; ++chunk)
        farthest = max(farthest, chunks.farthest[chunk]);
    while (chunks.farthest[first] != farthest)
        ++first;
    return chunks.place[first];
}

#endif

// Writes which candidates are picked, the first of them at first, in worlds that have more than are wanted.
template <class Candidates, class Picks>
WARPCAM_DEVICE void pick_farthest(const Candidates& candidates, const Picks& picks, int index)
{
    const auto [world, thread] = block_place(index);
    const int count = candidates.counts.data[world], wanted = picks.shape[1];
    if (!candidates.mask.data[world] || count <= wanted)
        return;
    WARPCAM_SHARED PointChunks chunks;
    const size_t capacity = candidates.pixels.shape[1];
    const float* x = candidates.points.data + world * 3 * capacity;
    float* distances = reinterpret_cast<float*>(candidates.work.data + world * capacity);
    const int step = WARP_SIZE * MAX_CHUNKS, size = WARP_SIZE * ((count + step - 1) / step);
    const PointLists lists { x, x + capacity, x + 2 * capacity, distances, count, size };
    const int num_chunks = (count + size - 1) / size;
    int* picked = picks.data + size_t(world) * wanted;
    int pick = 0;
#if defined(__CUDA_ARCH__)
    WARPCAM_SHARED WarpPicks found;
    const int lane = thread % WARP_SIZE, warp = thread / WARP_SIZE;
    for (int chunk = warp; chunk < num_chunks; chunk += NUM_WARPS)
        start_chunk(chunks, lists, slot_of(chunk));
    block_sync();
    for (int k = 0; k < wanted; ++k) {
        if (k > 0)
            pick = next_pick(chunks, found, lists, num_chunks, pick, k & 1);
        if (thread == 0)
            picked[k] = pick;
    }
#else
    for (int chunk = 0; chunk < num_chunks; ++chunk)
        start_chunk(chunks, lists, chunk);
    for (int k = 0; k < wanted; ++k) {
        if (k > 0)
            pick = next_pick(chunks, lists, num_chunks, pick);
        picked[k] = pick;
    }
#endif
}

}  // namespace warpcam
