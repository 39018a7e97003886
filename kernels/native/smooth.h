// Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.
//
// One kernel finds the edges of a group's images and lists shares of up to 32 pixels of a region. The warps of another
// take one share after another, so that none waits for others: what the samples of a share may hit are the shapes that
// are seen in the pixels around, which are few, so that a list of shapes is made for each share and nothing else is
// traced. Samples on a side where there is no edge are not traced either. A sample has the colour of the nearest pixel
// that shows the same surface: nothing is lit anew, whatever made the image.
#pragma once
#include "mesh_queue.h"
#include "samples.h"
#include "smooth_cpu.h"

namespace warpcam {

// How regions are shared out among a GPU's warps: their width and height, and the shares that one can have.
constexpr int SHARED_OUT = 32, MOST_SHARES = SHARED_OUT * SHARED_OUT / LANES;
// Of a target's shares: how many there are, how many are taken, and where the first stands: its region's number among
// those of all worlds * MOST_SHARES + its own among the region's.
constexpr int FOUND = 0, TAKEN = 1, FIRST_SHARE = 2;

template <int LENS, class Target>
WARPCAM_FN Seen<LENS, Target> seen_by(const Target& target, const Camera& camera, int world)
{
    return { target, unsigned(world) * target.height * target.width, pixel_width<LENS>(camera), camera.scale_y };
}

#if defined(__CUDA_ARCH__)

WARPCAM_FN int greatest(int value)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_max_sync(ALL, value);
#else
    for (int step = LANES / 2; step > 0; step /= 2)
        value = max(value, __shfl_xor_sync(ALL, value, step));
    return value;
#endif
}

// A share's pixels, and what their samples hit. A sample: 32 * its number + its pixel.
template <int TYPES> struct Share {
    static constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    alignas(16) Camera camera;
    Region region;
    int world;
    int pixels, total;  // how many are there, and how many samples are traced
    float depth[SAMPLES * LANES];
    int shape[SAMPLES * LANES];  // in the end: the pixel of the image that shows it
    int face[HAS_MESH ? SAMPLES * LANES : 1];
    unsigned char traced[SAMPLES * LANES];  // the samples that are
    unsigned short listed[LANES];  // the pixels: their places and which of their samples are traced
    unsigned own[LANES];  // the shapes around each, as bits by their places among the records
    Band meshes[HAS_MESH ? LANES : 1], fields[HAS_FIELD ? LANES : 1];  // of each pixel

    WARPCAM_FN Place at(int pixel) const
    {
        const int place = listed[lower_int(pixel, pixels - 1)] >> SAMPLES;
        return { region.left + place % 64, region.top + place / 64 };
    }
};

// The shares that a warp has under way: where rays walk through meshes, the last ones of a share do so beside the first
// ones of the next. Each has its part of the records, nearest first where there are meshes.
template <int TYPES> struct Batch {
    static constexpr int SHARES = TYPES >> MESH & 1 ? 2 : 1, SHAPES = LANES / SHARES;
    alignas(16) Record records[LANES];
    Share<TYPES> shares[SHARES];
};

// The rays of its samples. A lane's own is of the share that it holds, -1 if it has none.
struct ShareRays : PairedMeshRays<1> {
    signed char holds[LANES];

    WARPCAM_FN void note(unsigned idles)
    {
        if (idles >> threadIdx.x % LANES & 1)
            holds[threadIdx.x % LANES] = -1;
    }
    WARPCAM_FN bool busy(int share) const { return __any_sync(ALL, holds[threadIdx.x % LANES] == share); }
    WARPCAM_FN unsigned take(int ray, int words)
    {
        holds[threadIdx.x % LANES] = static_cast<signed char>(pixel[ray] / (SAMPLES * LANES));
        return PairedMeshRays<1>::take(ray, words);
    }
};

// The records as trace_rays() reads a list.
struct Ranked {
    struct Itself {
        WARPCAM_FN int operator[](int rank) const { return rank; }
    };
    const Record* records;
    Itself order;
    int count;
};

// Makes the records of a share's shapes, a lane each, -1 for none, from a place on. `own` are bits by lane: says which
// records are around the lane's pixel, by their places, and returns which are meshes.
template <int TYPES, int LENS, class Shapes, class Meshes, class HeightFields>
WARPCAM_FN unsigned list_near(Record* records, int place, const Shapes& shapes, const Meshes& meshes,
                              const HeightFields& fields, const Share<TYPES>& share, int id, unsigned& own)
{
    const int lane = threadIdx.x % LANES;
    Record record;
    const bool seen = id >= 0
        && sample_record<TYPES, LENS>(shapes, meshes, fields, share.camera, share.region, share.world, id, record);
    const unsigned listed = __ballot_sync(ALL, seen);
    int rank = lane;
    if (TYPES >> MESH & 1) {  // the lanes have the ids in descending order
        const float key = seen ? as_float(record.size.w) : 0.0f;
        rank = 0;
        for (unsigned left = listed; left; left &= left - 1) {
            const int from = lowest_bit(left);
            const float other = __shfl_sync(ALL, key, from);
            rank += other < key || (other == key && from < lane);
        }
    }
    rank += place;
    if (seen)
        records[rank] = record;
    own &= listed;
    unsigned are_meshes = 0;
    if (TYPES >> MESH & 1) {
        are_meshes = bits_of_all(seen && is_mesh<TYPES>(record) ? 1u << rank : 0);
        unsigned by_rank = 0;
        for (unsigned left = listed; left; left &= left - 1) {
            const int from = lowest_bit(left);
            by_rank |= (own >> from & 1) << __shfl_sync(ALL, rank, from);
        }
        own = by_rank;
    }
    __syncwarp();
    return are_meshes;
}

// The nearest hit of the lane's ray among the shapes in `own` that are in `walked`.
template <int TYPES, int LENS, class HeightFields>
WARPCAM_FN void trace_own(const Record* records, unsigned walked, unsigned own, const ViewRay<LENS>& ray, float near,
                          const HeightFields& fields, const Band& ground, Hit& hit)
{
    for (; walked; walked &= walked - 1) {
        const int rank = lowest_bit(walked);
        const Record& record = records[rank];
        const bool mine = own >> rank & 1;
        if ((TYPES >> HEIGHT_FIELD & 1) && record.axis_x.w == HEIGHT_FIELD) {
            if (mine) {
                Hit within { lower(hit.depth, ground.last), -1, -1 };
                walk_height_field(fields, record, ray, upper(near, ground.first), within);
                if (within.shape >= 0)
                    hit = within;
            }
            __syncwarp();
        } else {
            const float t = enter_any<analytic_types(TYPES)>(record, ray.local(record));
            if (mine && t < hit.depth && t > near) {
                hit.depth = t;
                hit.shape = record.axis_y.w;
            }
        }
    }
}

// Of the pixels with an edge in a region, those of one of its equal shares: lists their places and samples, and returns
// how many they are.
template <class Target>
WARPCAM_FN int list_share(unsigned short (&listed)[LANES], const Target& target, unsigned first, const Region& region,
                          int share)
{
    const int lane = threadIdx.x % LANES, across = region.width / TILE_WIDTH;
    const int tiles = across * (region.height / TILE_HEIGHT);
    const auto samples_at = [&](int tile, int& place) {
        const int column = tile % across * TILE_WIDTH + lane % TILE_WIDTH;
        const int row = tile / across * TILE_HEIGHT + lane / TILE_WIDTH;
        const int i = region.left + column, j = region.top + row;
        place = row * 64 + column;
        return i < target.width && j < target.height ? target.edges.data[first + unsigned(j * target.width + i)] : 0;
    };
    int total = 0, before = 0, place;
#pragma unroll 4
    for (int tile = 0; tile < tiles; ++tile)
        total += __popc(__ballot_sync(ALL, samples_at(tile, place) != 0));
    const int shares = (total + LANES - 1) / LANES, size = (total + shares - 1) / shares, begin = share * size;
#pragma unroll 4
    for (int tile = 0; tile < tiles; ++tile) {
        const int samples = samples_at(tile, place);
        const unsigned found = __ballot_sync(ALL, samples != 0);
        const int rank = before + __popc(found & ((1u << lane) - 1)) - begin;
        if (samples && rank >= 0 && rank < size)
            listed[rank] = static_cast<unsigned short>(place << SAMPLES | samples);
        before += __popc(found);
    }
    __syncwarp();
    return lower_int(size, total - begin);
}

// Begins with a share: which samples of its listed pixels are traced.
template <int TYPES, int LENS, class Target>
WARPCAM_FN void begin_share(Share<TYPES>& share, const Seen<LENS, Target>& seen)
{
    const int lane = threadIdx.x % LANES;
    const Place at = share.at(lane);
    const unsigned samples = lane < share.pixels ? share.listed[lane] & EVERY_SAMPLE : 0;
    int traced = 0, total = 0;  // before this lane's, and all
    for (int sample = 0; sample < SAMPLES; ++sample) {
        const unsigned lanes = __ballot_sync(ALL, samples >> sample & 1);
        traced += __popc(lanes & ((1u << lane) - 1));
        total += __popc(lanes);
    }
    for (int sample = 0; sample < SAMPLES; ++sample) {
        const bool needed = samples >> sample & 1;
        share.depth[sample * LANES + lane] = share.camera.far;
        share.shape[sample * LANES + lane] = needed ? -1 : int(seen.at(at.right, at.down));
        if (needed)
            share.traced[traced++] = static_cast<unsigned char>(sample * LANES + lane);
    }
    if (lane == 0)
        share.total = total;
    __syncwarp();
}

// Lists the shapes around a share's pixels whose ids are below `id`, as many as there is room for: their records begin at
// `place`. Returns which are meshes; `id` becomes the last of them, 0 if none is left.
template <int TYPES, int LENS, class Shapes, class Meshes, class HeightFields, class Target>
WARPCAM_FN unsigned list_shapes(Batch<TYPES>& batch, Share<TYPES>& share, int place, const Shapes& shapes,
                                const Meshes& meshes, const HeightFields& fields, const Seen<LENS, Target>& seen, int& id)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    const int lane = threadIdx.x % LANES;
    const Place at = share.at(lane);
    int around[9];
#pragma unroll
    for (int k = 0; k < 9; ++k) {
        const int its = lane < share.pixels ? seen.shape(seen.around(at.right, at.down, k)) : -1;
        around[k] = its < id ? its : -1;
    }
    const auto next_id = [&] {
        int next = around[0];
#pragma unroll
        for (int k = 1; k < 9; ++k)
            next = around[k] > next ? around[k] : next;
        return greatest(next);
    };
    int mine = -1, count = 0, next = next_id();
    unsigned own = 0;
    Band on_meshes = NOWHERE, on_fields = NOWHERE;
    for (; next >= 0 && count < Batch<TYPES>::SHAPES; ++count, next = next_id()) {
        const int type = HAS_MESH || HAS_FIELD ? wp::index(shapes.types, next) : 0;
        bool seen_here = false;
#pragma unroll
        for (int k = 0; k < 9; ++k) {
            const bool same = around[k] == next;
            seen_here |= same;
            around[k] = same ? -1 : around[k];
            if (HAS_MESH && same && type == MESH)
                on_meshes.include(seen.depth(seen.around(at.right, at.down, k)));
            if (HAS_FIELD && same && type == HEIGHT_FIELD)
                on_fields.include(seen.depth(seen.around(at.right, at.down, k)));
        }
        own |= unsigned(seen_here) << count;
        mine = lane == count ? next : mine;
        id = next;
    }
    id = next < 0 ? 0 : id;
    const float width = pixel_width<LENS>(share.camera);
    if (HAS_MESH)
        share.meshes[lane] = on_meshes.widened<LENS>(width);
    if (HAS_FIELD)
        share.fields[lane] = on_fields.widened<LENS>(width);
    const unsigned are_meshes = list_near<TYPES, LENS>(batch.records, place, shapes, meshes, fields, share, mine, own);
    share.own[lane] = HAS_MESH ? own : own << place;
    __syncwarp();
    return are_meshes;
}

// Writes what the pixels of a share are to show, all of whose samples are traced.
template <int TYPES, int LENS, int IMAGES, class Shapes, class Meshes, class HeightFields, class Target>
WARPCAM_FN void finish_share(Share<TYPES>& share, const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                             const Target& target)
{
    const int lane = threadIdx.x % LANES;
    const Seen<LENS, Target> seen = seen_by<LENS>(target, share.camera, share.world);
    __syncwarp();
    for (int k = lane; k < share.total; k += LANES) {
        const int sample = share.traced[k];
        const Place at = share.at(sample % LANES);
        share.shape[sample] = int(shown_sample<TYPES, IMAGES>(
            seen, shapes, meshes, fields, share.camera, share.region, share.world, at.right, at.down, sample / LANES,
            share.depth[sample], share.shape[sample], TYPES >> MESH & 1 ? share.face[TYPES >> MESH & 1 ? sample : 0] : -1));
    }
    __syncwarp();
    if (lane < share.pixels) {
        const Place at = share.at(lane);
        unsigned shown[SAMPLES];
        for (int sample = 0; sample < SAMPLES; ++sample)
            shown[sample] = unsigned(share.shape[sample * LANES + lane]);
        put_means<IMAGES>(target, seen.at(at.right, at.down), shown);
    }
    __syncwarp();
}

// Smooths the pixels of all shares that the warp gets; next_share(share) lists one, false if none is left.
template <int TYPES, int LENS, int IMAGES, class Shapes, class Meshes, class HeightFields, class Target, class NextShare>
WARPCAM_FN void smooth_shares(Batch<TYPES>& batch, ShareRays& waiting, const Shapes& shapes, const Meshes& meshes,
                              const HeightFields& fields, const Target& target, const NextShare& next_share)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    constexpr int SHARES = Batch<TYPES>::SHARES, SHAPES = Batch<TYPES>::SHAPES, EACH = SAMPLES * LANES;
    const int lane = threadIdx.x % LANES;
    int current = 0, first = 0, total = 0, id = 0, before = 0;  // before: shares that are not finished, by bit
    unsigned mesh_bits = 0;
    if (HAS_MESH) {
        waiting.holds[lane] = -1;
        batch.shares[0].pixels = 1;  // for the rays that lanes begin with
    }
    __syncwarp();
    const auto ray_of = [&](int code) {
        const Share<TYPES>& share = batch.shares[SHARES > 1 ? code / EACH : 0];
        const int sample = code % EACH, pixel = sample % LANES;
        const Place at = share.at(pixel);
        const ViewRay<LENS> ray = sample_ray<LENS>(share.camera, at.right, at.down, sample / LANES);
        const float near = share.camera.near;
        return ClippedRay<LENS> { ray, HAS_MESH ? upper(near, share.meshes[HAS_MESH ? pixel : 0].first) : near };
    };
    const auto next_rays = [&](int& found) {
        while (first >= total) {
            if (id > 0) {  // more shapes than there is room for
                if (HAS_MESH && waiting.busy(current)) {
                    found = LATER;
                    return true;
                }
            } else {
                const int other = SHARES - 1 - current;
                if (HAS_MESH && waiting.busy(other)) {
                    found = LATER;
                    return true;
                }
                if (before >> other & 1)
                    finish_share<TYPES, LENS, IMAGES>(batch.shares[other], shapes, meshes, fields, target);
                before &= ~(1 << other);
                if (!next_share(batch.shares[other]))
                    return false;
                current = other;
                before |= 1 << current;
                begin_share<TYPES, LENS>(batch.shares[current],
                                         seen_by<LENS>(target, batch.shares[current].camera, batch.shares[current].world));
                id = 0x7fffffff;
            }
            Share<TYPES>& share = batch.shares[current];
            first = 0;
            total = share.total;
            mesh_bits = list_shapes<TYPES, LENS>(batch, share, current * SHAPES, shapes, meshes, fields,
                                                 seen_by<LENS>(target, share.camera, share.world), id);
        }
        Share<TYPES>& share = batch.shares[current];
        const bool active = first + lane < total;
        const int sample = share.traced[active ? first + lane : first], pixel = sample % LANES;
        first += LANES;
        const unsigned around_it = active ? share.own[pixel] : 0, together = bits_of_all(around_it);
        const auto ray = ray_of(current * EACH + sample);
        Hit hit { share.depth[sample], share.shape[sample], -1 };
        trace_own<TYPES, LENS>(batch.records, together & ~mesh_bits, around_it, ray, share.camera.near, fields,
                               share.fields[HAS_FIELD ? pixel : 0], hit);
        if (active) {
            share.depth[sample] = hit.depth;
            share.shape[sample] = hit.shape;
        }
        if (HAS_MESH) {
            const float until = lower(hit.depth, share.meshes[HAS_MESH ? pixel : 0].last);
            unsigned met = 0;
            for (unsigned left = together & mesh_bits; left; left &= left - 1) {
                const int rank = lowest_bit(left);
                const Record& record = batch.records[rank];
                if ((around_it >> rank & 1) && as_float(record.size.w) < until
                    && meets_mesh(meshes, record, ray.local(record), ray.near, until))
                    met |= 1u << rank;
            }
            const unsigned meeting = __ballot_sync(ALL, met != 0);
            const int at = waiting.put(meeting, &met, 1, current * EACH + sample);
            if (met)
                waiting.depth[at] = until;
            __syncwarp();
            found = __popc(meeting);
        }
        return true;
    };
    if (HAS_MESH) {
        const auto store = [&](int code, const Hit& hit) {
            Share<TYPES>& share = batch.shares[SHARES > 1 ? code / EACH : 0];
            share.depth[code % EACH] = hit.depth;
            share.shape[code % EACH] = hit.shape;
            share.face[HAS_MESH ? code % EACH : 0] = hit.face;
        };
        trace_rays<TYPES>(waiting, Ranked { batch.records, {}, LANES }, meshes, 0.0f, next_rays, ray_of, store);
    } else {
        int none;
        while (next_rays(none)) { }
    }
    if (before)
        finish_share<TYPES, LENS, IMAGES>(batch.shares[current], shapes, meshes, fields, target);
}

#endif

// Finds the edges of one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, class Shapes, class Views, class Target>
WARPCAM_FN void find_edges(const Shapes& shapes, const Views& views, const Target& target, int index)
{
    int world;
    const Region region = region_of<WIDTH, HEIGHT>(target, index / THREADS, world);
    if (!wp::index(target.mask, world))
        return;
    const Seen<LENS, Target> seen = seen_by<LENS>(target, load_camera(wp::index(views, world)), world);
    const auto sided = [&](int shape) { return has_sides<TYPES>(shapes, shape); };
#if defined(__CUDA_ARCH__)
    static_assert(WIDTH == SHARED_OUT && HEIGHT == SHARED_OUT);
    WARPCAM_SHARED int count;
    const int thread = index % THREADS, lane = thread % LANES;
    if (thread == 0)
        count = 0;
    block_barrier();
    constexpr int ROWS = HEIGHT / (THREADS / LANES);  // of a warp
    for (int row = 0; row < ROWS; ++row) {
        const int i = region.left + lane, j = region.top + thread / LANES * ROWS + row;
        const bool inside = i < target.width && j < target.height;
        const unsigned samples = inside ? seen.template edge<IMAGES>(i, j, sided) : 0;
        if (inside)
            target.edges.data[seen.at(i, j)] = static_cast<unsigned char>(samples);
        const unsigned found = __ballot_sync(ALL, samples != 0);
        if (found && lane == 0)
            atomicAdd(&count, __popc(found));
    }
    block_barrier();
    if (thread == 0 && count > 0) {
        const int shares = (count + LANES - 1) / LANES, begin = atomicAdd(&target.shares.data[FOUND], shares);
        for (int k = 0; k < shares; ++k)
            target.shares.data[FIRST_SHARE + begin + k] = index / THREADS * MOST_SHARES + k;
    }
#else
    for (int j = region.top; j < lower_int(region.top + region.height, target.height); ++j)
        for (int i = region.left; i < lower_int(region.left + region.width, target.width); ++i)
            target.edges.data[seen.at(i, j)] = static_cast<unsigned char>(seen.template edge<IMAGES>(i, j, sided));
#endif
}

// Smooths the edges that find_edges() has found: those of one region of one view (CPU), or all together (CUDA).
template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, class Shapes, class Meshes, class HeightFields,
          class Views, class Target>
WARPCAM_FN void smooth(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Views& views,
                       const Target& target, int index)
{
#if defined(__CUDA_ARCH__)
    constexpr int WARPS = THREADS / LANES;
    WARPCAM_SHARED Batch<TYPES> batches[WARPS];
    WARPCAM_SHARED ShareRays waiting[TYPES >> MESH & 1 ? WARPS : 1];
    const int lane = threadIdx.x % LANES, warp = threadIdx.x / LANES;
    const auto next_share = [&](Share<TYPES>& share) {
        const int number = __shfl_sync(ALL, lane == 0 ? atomicAdd(&target.shares.data[TAKEN], 1) : 0, 0);
        if (number >= target.shares.data[FOUND])
            return false;
        const int code = target.shares.data[FIRST_SHARE + number];
        int world;
        const Region region = region_of<WIDTH, HEIGHT>(target, code / MOST_SHARES, world);
        const unsigned first = unsigned(world) * target.height * target.width;
        const int pixels = list_share(share.listed, target, first, region, code % MOST_SHARES);
        if (lane == 0) {
            share.camera = load_camera(wp::index(views, world));
            share.region = region;
            share.world = world;
            share.pixels = pixels;
        }
        __syncwarp();
        return true;
    };
    smooth_shares<TYPES, LENS, IMAGES>(batches[warp], waiting[TYPES >> MESH & 1 ? warp : 0], shapes, meshes, fields,
                                       target, next_share);
#else
    int world;
    const Region region = region_of<WIDTH, HEIGHT>(target, index, world);
    if (!wp::index(target.mask, world))
        return;
    const Camera camera = load_camera(wp::index(views, world));
    smooth_region<TYPES, LENS, WIDTH, HEIGHT, IMAGES>(shapes, meshes, fields, target, camera,
                                                      seen_by<LENS>(target, camera, world), region, world);
#endif
}

}  // namespace warpcam
