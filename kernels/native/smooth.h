// Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.
//
// A block finds the edges of one region and lists their pixels. A warp then takes 32 of them: what their samples may hit
// are the shapes that are seen in the pixels around, which are few, so that a list of shapes is made for each 32 pixels
// and nothing else is traced. A sample has the colour of the nearest pixel that shows the same surface: nothing is lit
// anew, whatever made the image.
#pragma once
#include "edges.h"
#include "mesh_queue.h"
#include "opacity.h"

namespace warpcam {

// Images: bits in the order of antialias.py.
constexpr int SMOOTH_RGB = 1, SMOOTH_RGBA = 2, SMOOTH_HDR = 4;

// Rows of a region are 64 pixels apart in a pixel's place.
WARPCAM_FN int place_of(const Region& region, int i, int j) { return (j - region.top) * 64 + (i - region.left); }

template <int CHANNELS>
WARPCAM_FN void mean_of_bytes(const unsigned char* image, unsigned char* mean, unsigned pixel,
                              const unsigned (&shown)[SAMPLES])
{
    for (int k = 0; k < CHANNELS; ++k) {
        int total = SAMPLES / 2;
        for (int sample = 0; sample < SAMPLES; ++sample)
            total += image[CHANNELS * size_t(shown[sample]) + k];
        mean[CHANNELS * size_t(pixel) + k] = static_cast<unsigned char>(total / SAMPLES);
    }
}

// Writes a pixel's means; they become the image's when all of them are known.
template <int IMAGES, class Target>
WARPCAM_FN void put_means(const Target& target, unsigned pixel, const unsigned (&shown)[SAMPLES])
{
    if (IMAGES & SMOOTH_RGB)
        mean_of_bytes<3>(target.rgb.data, target.mean_rgb.data, pixel, shown);
    if (IMAGES & SMOOTH_RGBA)
        mean_of_bytes<4>(target.rgba.data, target.mean_rgba.data, pixel, shown);
    if (IMAGES & SMOOTH_HDR)
        for (int k = 0; k < 3; ++k) {
            float total = 0.0f;
            for (int sample = 0; sample < SAMPLES; ++sample)
                total += target.hdr.data[3 * size_t(shown[sample]) + k];
            target.mean_hdr.data[3 * size_t(pixel) + k] = total / float(SAMPLES);
        }
}

// The record of a shape for the samples of a region's pixels, some of which lie a little outside of it.
template <int TYPES, int LENS, class Shapes, class Meshes, class HeightFields>
WARPCAM_FN bool sample_record(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                              const Camera& camera, const Region& region, int world, int id, Record& record)
{
    TileBox tiles;
    const Region wider { region.left - TILE_WIDTH, region.top - TILE_HEIGHT, region.width + 2 * TILE_WIDTH,
                         region.height + 2 * TILE_HEIGHT };
    return prepare<TYPES, LENS>(load_shape(shapes, world, id), camera, wider, meshes, fields, record, tiles) == SEEN;
}

template <int LENS> WARPCAM_FN ViewRay<LENS> sample_ray(const Camera& camera, int i, int j, int sample)
{
    const Offset offset = sample_offset(sample);
    return { image_x(camera, float(i) + offset.right), image_y(camera, float(j) + offset.down) };
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

WARPCAM_FN unsigned bits_of_all(unsigned bits)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_or_sync(ALL, bits);
#else
    for (int step = LANES / 2; step > 0; step /= 2)
        bits |= __shfl_xor_sync(ALL, bits, step);
    return bits;
#endif
}

// What the samples of a warp's pixels are traced against, and what they hit.
struct Batch {
    Record records[LANES];  // nearest first
    float depth[SAMPLES][LANES];
    int shape[SAMPLES][LANES];
};

// Shapes of a batch, as bits by their places among its records.
struct Near {
    unsigned own;     // those around the lane's pixel
    unsigned meshes;  // those that are meshes
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

// Makes the records of the warp's shapes, a lane each, -1 for none. `own` are bits by lane.
template <int TYPES, int LENS, class Shapes, class Meshes, class HeightFields>
WARPCAM_FN Near list_near(Batch& batch, const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                          const Camera& camera, const Region& region, int world, int id, unsigned own)
{
    const int lane = threadIdx.x % LANES;
    Record record;
    const bool seen = id >= 0
        && sample_record<TYPES, LENS>(shapes, meshes, fields, camera, region, world, id, record);
    const unsigned listed = __ballot_sync(ALL, seen);
    const float key = seen ? as_float(record.size.w) : 0.0f;
    int rank = 0;
    for (unsigned left = listed; left; left &= left - 1) {  // the lanes have the ids in descending order
        const int from = lowest_bit(left);
        const float other = __shfl_sync(ALL, key, from);
        rank += other < key || (other == key && from < lane);
    }
    if (seen)
        batch.records[rank] = record;
    Near near { 0, bits_of_all(seen && is_mesh<TYPES>(record) ? 1u << rank : 0) };
    for (unsigned left = listed; left; left &= left - 1) {
        const int from = lowest_bit(left);
        near.own |= (own >> from & 1) << __shfl_sync(ALL, rank, from);
    }
    __syncwarp();
    return near;
}

// The nearest hit of the lane's ray among the shapes in `own` that are in `walked`.
template <int TYPES, int LENS, class HeightFields>
WARPCAM_FN void trace_own(const Record* records, unsigned walked, unsigned own, const ViewRay<LENS>& ray, float near,
                          const HeightFields& fields, Hit& hit)
{
    for (; walked; walked &= walked - 1) {
        const int rank = lowest_bit(walked);
        const Record& record = records[rank];
        const bool mine = own >> rank & 1;
        if ((TYPES >> HEIGHT_FIELD & 1) && record.axis_x.w == HEIGHT_FIELD) {
            if (mine)
                walk_height_field(fields, record, ray, near, hit);
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

// Smooths the edges of a region.
template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, class Shapes, class Meshes, class HeightFields,
          class Target>
WARPCAM_FN void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                              const Target& target, const Camera& camera, const Seen<LENS, Target>& seen,
                              const Region& region, int world)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1;
    constexpr int WARPS = THREADS / LANES;
    WARPCAM_SHARED unsigned short listed[WIDTH * HEIGHT];
    WARPCAM_SHARED int count, next;
    WARPCAM_SHARED Batch batches[WARPS];
    WARPCAM_SHARED MeshRays<1> waiting[HAS_MESH ? WARPS : 1];
    const int lane = threadIdx.x % LANES, warp = threadIdx.x / LANES;
    if (threadIdx.x == 0)
        count = next = 0;
    block_barrier();

    const int across = region.width / TILE_WIDTH, tiles = across * (region.height / TILE_HEIGHT);
    for (int tile = warp; tile < tiles; tile += WARPS) {
        const int i = region.left + tile % across * TILE_WIDTH + lane % TILE_WIDTH;
        const int j = region.top + tile / across * TILE_HEIGHT + lane / TILE_WIDTH;
        const bool inside = i < target.width && j < target.height, edge = inside && seen.edge(i, j);
        if (inside)
            target.edges.data[seen.at(i, j)] = edge;
        const unsigned found = __ballot_sync(ALL, edge);
        if (found) {
            const int begin = __shfl_sync(ALL, lane == 0 ? atomicAdd(&count, __popc(found)) : 0, 0);
            if (edge)
                listed[begin + __popc(found & ((1u << lane) - 1))]
                    = static_cast<unsigned short>(place_of(region, i, j));
        }
    }
    block_barrier();

    Batch& batch = batches[warp];
    const float near = camera.near;
    while (true) {
        const int begin = __shfl_sync(ALL, lane == 0 ? atomicAdd(&next, LANES) : 0, 0);
        if (begin >= count)
            return;
        const int pixels = lower_int(count - begin, LANES);
        const int place = listed[begin + lower_int(lane, pixels - 1)];
        const int i = region.left + place % 64, j = region.top + place / 64;
        int around[9];
#pragma unroll
        for (int k = 0; k < 9; ++k)
            around[k] = lane < pixels ? seen.shape_near(i + k % 3 - 1, j + k / 3 - 1) : -1;
        for (int sample = 0; sample < SAMPLES; ++sample) {
            batch.depth[sample][lane] = camera.far;
            batch.shape[sample][lane] = -1;
        }
        const auto next_id = [&] {
            int id = around[0];
#pragma unroll
            for (int k = 1; k < 9; ++k)
                id = around[k] > id ? around[k] : id;
            return greatest(id);
        };
        int id = next_id();
        while (id >= 0) {  // 32 shapes at a time
            int mine = -1, shapes_near = 0;
            unsigned own = 0;
            for (; id >= 0 && shapes_near < LANES; ++shapes_near, id = next_id()) {
                bool seen_here = false;
#pragma unroll
                for (int k = 0; k < 9; ++k) {
                    seen_here |= around[k] == id;
                    around[k] = around[k] == id ? -1 : around[k];
                }
                own |= unsigned(seen_here) << shapes_near;
                mine = lane == shapes_near ? id : mine;
            }
            const Near shapes_around
                = list_near<TYPES, LENS>(batch, shapes, meshes, fields, camera, region, world, mine, own);
            // a ray: sample * LANES + pixel of the batch
            const auto ray_of = [&](int ray) {
                const int at = listed[begin + lower_int(ray % LANES, pixels - 1)];
                return sample_ray<LENS>(camera, region.left + at % 64, region.top + at / 64, ray / LANES);
            };
            int first = 0;  // pixel; eight of them at once, a lane a sample
            const auto next_rays = [&](int& found) {
                if (first >= pixels)
                    return false;
                const int pixel = first + lane / SAMPLES, sample = lane % SAMPLES;
                first += LANES / SAMPLES;
                const unsigned around_it = __shfl_sync(ALL, shapes_around.own, pixel);
                const auto ray = ray_of(sample * LANES + pixel);
                Hit hit { batch.depth[sample][pixel], batch.shape[sample][pixel], -1 };
                trace_own<TYPES>(batch.records, bits_of_all(around_it) & ~shapes_around.meshes, around_it, ray, near,
                                 fields, hit);
                batch.depth[sample][pixel] = hit.depth;
                batch.shape[sample][pixel] = hit.shape;
                if (HAS_MESH) {
                    unsigned met = 0;
                    for (unsigned left = bits_of_all(around_it) & shapes_around.meshes; left; left &= left - 1) {
                        const int rank = lowest_bit(left);
                        const Record& record = batch.records[rank];
                        if ((around_it >> rank & 1) && as_float(record.size.w) < hit.depth
                            && meets_mesh(meshes, record, ray.local(record), near, hit.depth))
                            met |= 1u << rank;
                    }
                    MeshRays<1>& rays = waiting[HAS_MESH ? warp : 0];
                    const unsigned meeting = __ballot_sync(ALL, met != 0);
                    const int at = rays.put(meeting, &met, 1, sample * LANES + pixel);
                    if (met)
                        rays.depth[at] = hit.depth;
                    __syncwarp();
                    found = __popc(meeting);
                }
                return true;
            };
            if (HAS_MESH) {
                const auto store = [&](int ray, const Hit& hit) {
                    batch.depth[ray / LANES][ray % LANES] = hit.depth;
                    batch.shape[ray / LANES][ray % LANES] = hit.shape;
                };
                trace_rays<TYPES>(waiting[HAS_MESH ? warp : 0], Ranked { batch.records, {}, LANES }, meshes, near,
                                  next_rays, ray_of, store);
            } else {
                int none;
                while (next_rays(none)) { }
            }
            __syncwarp();
        }
        if (lane < pixels) {
            unsigned shown[SAMPLES];
            for (int sample = 0; sample < SAMPLES; ++sample)
                shown[sample] = seen.shown(i, j, sample_offset(sample), batch.depth[sample][lane],
                                           batch.shape[sample][lane]);
            put_means<IMAGES>(target, seen.at(i, j), shown);
        }
        __syncwarp();
    }
}

#else

constexpr int BATCH = LANES / SAMPLES;  // pixels

// From where on the rays see one shape: nowhere if it is not around their pixel.
struct OwnNear {
    float own[LANES];

    float at(int lane) const { return own[lane]; }
};

// A shape that is seen around some pixels of a batch.
struct NearShape {
    Record record;
    int id;
    bool around[BATCH];
};

struct Column {
    int i, j;
};

// Smooths a few pixels.
template <int TYPES, int LENS, int IMAGES, class Shapes, class Meshes, class HeightFields, class Target>
inline void smooth_pixels(const Column* listed, int pixels, const Shapes& shapes, const Meshes& meshes,
                          const HeightFields& fields, const Target& target, const Camera& camera,
                          const Seen<LENS, Target>& seen, const Region& region, int world)
{
    NearShape near[9 * BATCH];
    const NearShape* order[9 * BATCH];
    int found = 0, count = 0;
    for (int pixel = 0; pixel < pixels; ++pixel)
        for (int k = 0; k < 9; ++k) {
            const int id = seen.shape_near(listed[pixel].i + k % 3 - 1, listed[pixel].j + k / 3 - 1);
            int slot = 0;
            while (slot < found && near[slot].id != id)
                ++slot;
            if (id < 0)
                continue;
            if (slot == found) {
                near[found++].id = id;
                for (int other = 0; other < BATCH; ++other)
                    near[slot].around[other] = false;
            }
            near[slot].around[pixel] = true;
        }
    for (int slot = 0; slot < found; ++slot) {
        NearShape& one = near[slot];
        if (!sample_record<TYPES, LENS>(shapes, meshes, fields, camera, region, world, one.id, one.record))
            continue;
        int rank = count++;  // nearest first; of shapes at one place the later
        const float key = as_float(one.record.size.w);
        for (; rank > 0; --rank) {
            const float other = as_float(order[rank - 1]->record.size.w);
            if (other < key || (other == key && order[rank - 1]->id > one.id))
                break;
            order[rank] = order[rank - 1];
        }
        order[rank] = &one;
    }
    Rays rays;
    for (int lane = 0; lane < LANES; ++lane) {
        const Column at = listed[lower_int(lane / SAMPLES, pixels - 1)];
        const ViewRay<LENS> ray = sample_ray<LENS>(camera, at.i, at.j, lane % SAMPLES);
        rays.x[lane] = ray.x;
        rays.y[lane] = ray.y;
        rays.depth[lane] = lane / SAMPLES < pixels ? camera.far : -1.0f;
        rays.shape[lane] = rays.face[lane] = -1;
    }
    for (int meshes_now = 0; meshes_now < 2; ++meshes_now)
        for (int rank = 0; rank < count; ++rank) {
            const NearShape& one = *order[rank];
            if ((one.record.axis_x.w == MESH) != (meshes_now == 1))
                continue;
            OwnNear from;
            for (int lane = 0; lane < LANES; ++lane)
                from.own[lane] = one.around[lane / SAMPLES] ? camera.near : FAR_AWAY;
            if (meshes_now == 0)
                trace_record<TYPES, LENS>(one.record, from, fields, rays);
            else if (TYPES >> MESH & 1)
                trace_mesh<TYPES, LENS>(meshes, one.record, from, rays);
        }
    for (int pixel = 0; pixel < pixels; ++pixel) {
        const Column at = listed[pixel];
        unsigned shown[SAMPLES];
        for (int sample = 0; sample < SAMPLES; ++sample) {
            const int lane = pixel * SAMPLES + sample;
            shown[sample] = seen.shown(at.i, at.j, sample_offset(sample), rays.depth[lane], rays.shape[lane]);
        }
        put_means<IMAGES>(target, seen.at(at.i, at.j), shown);
    }
}

template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, class Shapes, class Meshes, class HeightFields,
          class Target>
inline void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Target& target,
                          const Camera& camera, const Seen<LENS, Target>& seen, const Region& region, int world)
{
    Column listed[BATCH];
    int count = 0;
    const int right = lower_int(region.left + region.width, target.width);
    const int bottom = lower_int(region.top + region.height, target.height);
    const auto smooth = [&] {
        if (count)
            smooth_pixels<TYPES, LENS, IMAGES>(listed, count, shapes, meshes, fields, target, camera, seen, region,
                                               world);
        count = 0;
    };
    for (int j = region.top; j < bottom; ++j)
        for (int i = region.left; i < right; ++i) {
            const bool edge = seen.edge(i, j);
            target.edges.data[seen.at(i, j)] = edge;
            if (edge)
                listed[count++] = { i, j };
            if (count == BATCH)
                smooth();
        }
    smooth();
}

#endif

// Smooths the edges of one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, class Shapes, class Meshes, class HeightFields,
          class Views, class Target>
WARPCAM_FN void smooth(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Views& views,
                       const Target& target, int index)
{
    alignas(16) WARPCAM_SHARED Camera camera;
    int world;
    const Region region = region_of<WIDTH, HEIGHT>(target, index / THREADS, world);
    if (!wp::index(target.mask, world))
        return;
    if (index % THREADS == 0)
        camera = load_camera(wp::index(views, world));
    block_barrier();
    const Seen<LENS, Target> seen { target, unsigned(world) * target.height * target.width, camera.scale_x,
                                    camera.scale_y };
    smooth_region<TYPES, LENS, WIDTH, HEIGHT, IMAGES>(shapes, meshes, fields, target, camera, seen, region, world);
}

}  // namespace warpcam
