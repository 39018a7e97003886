// Pixels with edges that a block smooths together, on CUDA: what their samples may hit, and what they hit.
#pragma once
#include "traversal/mesh_closest_hit.h"
#include "antialiasing/neighbor_shapes.h"
#include "antialiasing/samples.h"
#include "antialiasing/sample_color.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// Most pixels that a block resolves together: at the end its warps wait for the one whose rays take longest. The blocks
// of a multiprocessor have room for so many: antialiasing.py.
template <class Types> constexpr int most_together()
{
    return Types::has(HEIGHT_FIELD) ? 384 : Types::has(MESH) ? 440 : 320;
}

// Hit of a sample in scenes with meshes.
struct SampleHit {
    float depth;
    int face;
};

template <bool LARGE> struct ListedBits {
    using type = unsigned;
};
template <> struct ListedBits<false> {
    using type = unsigned short;
};

// A pixel with an edge: its place in the region, and what edge() says of it in the lowest bits. Without meshes and
// height fields regions have half as many rows, so that 16 bits hold it.
template <class Types> struct ListedPixel {
    static constexpr int SHIFT = SAMPLES + 1;
    static constexpr bool LARGE = Types::has(MESH) || Types::has(HEIGHT_FIELD);
    typename ListedBits<LARGE>::type bits;

    WARPCAM_DEVICE int place() const { return int(bits >> SHIFT); }
    WARPCAM_DEVICE unsigned edge() const { return bits & ((1u << SHIFT) - 1); }
};

// Pixels that a block smooths together.
template <class Types> struct SampleBatch {
    static constexpr bool HAS_MESH = Types::has(MESH), HAS_FIELD = Types::has(HEIGHT_FIELD);
    static constexpr int MOST = most_together<Types>();

    const ListedPixel<Types>* pixels;
    NearBits own[MOST];                       // the shapes around
    Band meshes[HAS_MESH ? MOST : 1], fields[HAS_FIELD ? MOST : 1];
    unsigned char ground[HAS_FIELD ? MOST : 1];  // the record of what is_behind(), not traced, or NEAR_SHAPES
    // Samples to trace: 4 * the pixel's number + the sample's. Samples whose rays are likely to take long fill the
    // array from the front, and start first; the others fill it from the back.
    unsigned short samples[SAMPLES * MOST];
    unsigned char shown[SAMPLES * MOST];  // by which of the pixels around; where there are meshes first what was hit
    SampleHit hits[HAS_MESH ? SAMPLES * MOST : 1];  // of the samples
    int before, after;                        // of `samples`: how many at the front, and at the back
    int next;                                 // which comes next

    WARPCAM_DEVICE int place(int pixel) const { return pixels[pixel].place(); }
    WARPCAM_DEVICE int total() const { return before + after; }
    WARPCAM_DEVICE int index(int number) const
    {
        return number < before ? number : SAMPLES * MOST - 1 - (number - before);
    }
    WARPCAM_DEVICE unsigned short sample(int number) const { return samples[index(number)]; }
    WARPCAM_DEVICE unsigned short& sample(int number) { return samples[index(number)]; }
};

// The records as trace_rays() reads a list.
struct Ranked {
    struct Itself {
        WARPCAM_DEVICE int operator[](int rank) const { return rank; }
    };
    const ShapeRecord* records;
    Itself order;
    int count;
};

// The nearest hit of the lane's ray among the shapes in `own` that are in `walked`.
template <class Types, int LENS, class HeightFields>
WARPCAM_DEVICE void trace_own(const ShapeRecord* records, unsigned walked, unsigned own, const CameraRay<LENS>& ray,
                              float near, const HeightFields& fields, const Band& ground, Hit& hit)
{
    for (; walked; walked &= walked - 1) {
        const int rank = ctz(walked);
        const ShapeRecord& record = records[rank];
        const bool mine = own >> rank & 1;
        if (Types::has(HEIGHT_FIELD) && record.axis_x.w == HEIGHT_FIELD) {
            if (mine) {
                Hit within { min(hit.depth, ground.last), -1, -1 };
                walk_height_field(fields, record, ray, max(near, ground.first), within);
                if (within.shape >= 0)
                    hit = within;
            }
            __syncwarp();
        } else {
            const float t = intersect_any<Types::ANALYTIC>(record, ray.local(record));
            if (mine && t < hit.depth && t > near) {
                hit.depth = t;
                hit.shape = record.axis_y.w;
            }
        }
    }
}

// Finds what may be hit by the samples of a pixel whose shapes are listed, and lists these samples.
template <class Types, int LENS, class Centres>
WARPCAM_DEVICE void list_samples(SampleBatch<Types>& batch, int pixel, const NearShapes& list, const Camera& camera,
                                 const EdgeTester<LENS, Centres>& seen, const Region& region)
{
    const int place = batch.place(pixel), i = region.left + place % 64, j = region.top + place / 64;
    NearBits own {};
    Band on_meshes = NOWHERE, on_fields = NOWHERE, others = NOWHERE;
    int ground = NEAR_SHAPES;
    unsigned meshes_at = 0, fields_at = 0, others_at = 0;  // which of the nine pixels around show them, by bit
    bool sky = false, several = false;
    const auto include = [&](int k, int rank) {
#pragma unroll
        for (int w = 0; w < NEAR_WORDS; ++w) {
            const unsigned bit = rank / WARP_SIZE == w ? 1u << rank % WARP_SIZE : 0;
            own[w] |= bit;
            if (SampleBatch<Types>::HAS_MESH)
                meshes_at |= unsigned((bit & list.meshes[w]) != 0) << k;
            if (SampleBatch<Types>::HAS_FIELD && bit) {
                const bool is_field = bit & list.fields[w];
                fields_at |= unsigned(is_field) << k;
                others_at |= unsigned(!is_field) << k;
                several |= is_field && ground < NEAR_SHAPES && ground != rank;
                ground = is_field ? rank : ground;
            }
        }
    };
    if constexpr (Centres::PLACED) {
        int ids[9];
#pragma unroll
        for (int k = 0; k < 9; ++k)
            ids[k] = seen.shape(seen.around(i, j, k));
#pragma unroll
        for (int k = 0; k < 9; ++k) {
            sky |= ids[k] < 0;
            include(k, ids[k] < 0 ? NEAR_SHAPES : list.place_of_byte(ids[k]));
        }
    } else {
        int before = -1, rank = NEAR_SHAPES;
#pragma unroll 1
        for (int k = 0; k < 9; ++k) {
            const int id = seen.shape(seen.around(i, j, k));
            sky |= id < 0;
            if (id < 0)
                continue;
            if (id != before)
                rank = list.place(id);
            before = id;
            include(k, rank);
        }
    }
    if (SampleBatch<Types>::HAS_MESH || SampleBatch<Types>::HAS_FIELD)
#pragma unroll
        for (int k = 0; k < 9; ++k) {
            const float depth = seen.depth(seen.around(i, j, k));
            if (SampleBatch<Types>::HAS_MESH && (meshes_at >> k & 1))
                on_meshes.include(depth);
            if (SampleBatch<Types>::HAS_FIELD && (fields_at >> k & 1))
                on_fields.include(depth);
            if (SampleBatch<Types>::HAS_FIELD && (others_at >> k & 1))
                others.include(depth);
        }
    if (SampleBatch<Types>::HAS_FIELD) {
        const bool behind = !several && is_behind<LENS>(on_fields, others, sky, pixel_width<LENS>(camera));
        batch.ground[pixel] = static_cast<unsigned char>(behind ? ground : NEAR_SHAPES);
        for (int w = 0; w < NEAR_WORDS; ++w)
            own[w] &= behind ? ~list.fields[w] : ~0u;
    }
    for (int w = 0; w < NEAR_WORDS; ++w)
        batch.own[pixel][w] = own[w];
    if (SampleBatch<Types>::HAS_MESH)
        batch.meshes[pixel] = on_meshes.template widened<LENS>(pixel_width<LENS>(camera));
    if (SampleBatch<Types>::HAS_FIELD)
        batch.fields[pixel] = on_fields.template widened<LENS>(pixel_width<LENS>(camera));
    int meshes = 0;
    for (int w = 0; w < NEAR_WORDS; ++w)
        meshes += __popc(own[w] & list.meshes[w]);
    const bool early = meshes > 1;
    const unsigned samples = batch.pixels[pixel].edge() & EVERY_SAMPLE;
    int at = atomicAdd(early ? &batch.before : &batch.after, __popc(samples));
    at = early ? at : SAMPLES * batch.MOST - 1 - at;
    for (int sample = 0; sample < SAMPLES; ++sample) {
        batch.shown[SAMPLES * pixel + sample] = ITSELF;
        if (samples >> sample & 1) {
            batch.samples[at] = static_cast<unsigned short>(SAMPLES * pixel + sample);
            at += early ? 1 : -1;
        }
    }
}

// Traces the samples of a batch; each warp takes 32 at a time.
template <class Types, int LENS, int IMAGES, class Rays, class Meshes, class HeightFields, class Centres>
WARPCAM_DEVICE void trace_samples(SampleBatch<Types>& batch, const NearShapes& list, Rays& waiting,
                                  const Meshes& meshes, const HeightFields& fields, const Camera& camera,
                                  const EdgeTester<LENS, Centres>& seen, const Region& region)
{
    constexpr bool HAS_MESH = SampleBatch<Types>::HAS_MESH, HAS_FIELD = SampleBatch<Types>::HAS_FIELD;
    const int lane = threadIdx.x % WARP_SIZE, words = (list.count + WARP_SIZE - 1) / WARP_SIZE;
    const float near = camera.near;
    const auto ray_of = [&](int sample) {
        const int pixel = sample / SAMPLES, at = batch.place(pixel);
        const CameraRay<LENS> ray =
            sample_ray<LENS>(camera, region.left + at % 64, region.top + at / 64, sample % SAMPLES);
        return ClippedRay<LENS> { ray, HAS_MESH ? max(near, batch.meshes[HAS_MESH ? pixel : 0].first) : near };
    };
    const auto show = [&](int sample, const Hit& hit) {
        const int at = batch.place(sample / SAMPLES), i = region.left + at % 64, j = region.top + at / 64;
        const int its = sample % SAMPLES;
        const int ground = HAS_FIELD ? batch.ground[HAS_FIELD ? sample / SAMPLES : 0] : NEAR_SHAPES;
        batch.shown[sample] = static_cast<unsigned char>(
            hit.shape < 0
                ? seen.nearest(i, j, its, ground < NEAR_SHAPES ? list.records[ground].origin.w : -1)
                : shown_sample<Types, IMAGES>(seen, meshes, camera, i, j, its, hit.depth, hit.face,
                                              list.records[hit.shape], batch.pixels[sample / SAMPLES].edge()));
    };
    // where there are meshes, which pixel shows a sample is asked when all have been traced: for all of them at once
    const auto store = [&](int sample, const Hit& hit) {
        if constexpr (HAS_MESH) {
            batch.hits[sample] = { hit.depth, hit.face };
            batch.shown[sample] = static_cast<unsigned char>(hit.shape < 0 ? NEAR_SHAPES : hit.shape);
        } else {
            show(sample, hit);
        }
    };
    const auto next_rays = [&](int& found) {
        const int first = __shfl_sync(FULL_WARP, lane == 0 ? atomicAdd(&batch.next, WARP_SIZE) : 0, 0);
        const int total = batch.total();
        if (first >= total)
            return false;
        const bool active = first + lane < total;
        const int sample = batch.sample(active ? first + lane : first), pixel = sample / SAMPLES;
        const auto ray = ray_of(sample);
        Hit hit { camera.far, -1, -1 };
        NearBits around, met {};
#pragma unroll
        for (int w = 0; w < NEAR_WORDS; ++w) {
            around[w] = active ? batch.own[pixel][w] : 0;
            if (w < words)
                trace_own<Types, LENS>(list.records + w * WARP_SIZE, warp_reduce_or(around[w]) & ~list.meshes[w],
                                       around[w], ray, near, fields, batch.fields[HAS_FIELD ? pixel : 0], hit);
        }
        if (active)
            store(sample, hit);
        if constexpr (HAS_MESH) {
            const float until = min(hit.depth, batch.meshes[pixel].last);
            bool meets = false;
#pragma unroll
            for (int w = 0; w < NEAR_WORDS; ++w) {
                met[w] = around[w] & list.meshes[w];
                meets |= met[w] != 0;
            }
            const unsigned meeting = __ballot_sync(FULL_WARP, meets);
            const int at = waiting.put(meeting, met, words, sample);
            if (meets)
                waiting.depth[at] = until;
            __syncwarp();
            found = __popc(meeting);
        }
        return true;
    };
    if constexpr (HAS_MESH) {
        trace_rays<Types>(waiting, Ranked { list.records, {}, list.count }, meshes, near, next_rays, ray_of, store);
        block_sync();
        if constexpr (Centres::PLACED) {
            show_samples<Types, IMAGES>(batch, list, meshes, camera, seen, region);
            return;
        }
        for (int k = threadIdx.x; k < batch.total(); k += THREADS) {
            const int sample = batch.sample(k), shape = batch.shown[sample];
            show(sample, Hit { batch.hits[sample].depth, shape < NEAR_SHAPES ? shape : -1, batch.hits[sample].face });
        }
    } else {
        int none;
        while (next_rays(none)) {
        }
    }
}

}  // namespace warpcam
#endif
