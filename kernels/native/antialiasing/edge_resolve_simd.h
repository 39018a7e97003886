// Smooth edges on a CPU: a region's pixels that have one are listed, and their samples traced shape by shape, many
// together.
#pragma once
#include "antialiasing/samples.h"
#include "traversal/trace_tile.h"

#if !defined(__CUDA_ARCH__)
#include "antialiasing/pixel_cache_simd.h"

namespace warpcam {

constexpr int EDGES_TOGETHER = 512;   // pixels that are smoothed together
constexpr int SHAPES_TOGETHER = 128;  // and what is seen around them, at most
typedef float Quad __attribute__((ext_vector_type(SAMPLES)));  // of a pixel's samples
typedef int IntQuad __attribute__((ext_vector_type(SAMPLES)));

// From where on the rays see one shape: nowhere if they are not to be traced.
struct OwnNear {
    float own[WARP_SIZE];

    float at(int lane) const { return own[lane]; }
};

// A pixel with an edge. Pixels around it are bits by number, see PixelSource::around().
struct Edge {
    struct Shape {
        short slot;
        unsigned short pixels;  // that show it
    };
    int i, j;
    unsigned samples;  // to trace, and PLAIN
    int count;         // of shapes
    Shape shapes[AROUND];
    unsigned background;  // pixels that show what is seen where nothing is hit
    bool behind;          // which is a height field, that is not traced
    Band on_meshes, on_fields;
};

// The samples of a pixel: their rays, and the nearest that these have hit so far; a shape by its slot.
struct SampleHits {
    Quad x, y, depth;
    IntQuad shape, face;
};

// The shapes that are seen around some pixels.
struct ShapesAround {
    static constexpr unsigned SIZE = 4 * SHAPES_TOGETHER;
    ShapeRecord records[SHAPES_TOGETHER];
    int ids[SHAPES_TOGETHER], pixels[SHAPES_TOGETHER];  // how many see it
    short table[SIZE];  // slots by a hash of their shape; -1: free
    int count;

    void clear()
    {
        for (short& slot : table)
            slot = -1;
        count = 0;
    }

    int find(int id)
    {
        unsigned at = (unsigned(id) * 0x9e3779b1u >> 16) % SIZE;
        for (; table[at] >= 0; at = (at + 1) % SIZE)
            if (ids[table[at]] == id)
                return table[at];
        table[at] = short(count);
        ids[count] = id;
        pixels[count] = 0;
        return count++;
    }
};

template <class Types, int LENS, int IMAGES, class Shapes, class Meshes, class HeightFields, class Centres>
struct EdgeResolver {
    static constexpr bool HAS_MESH = Types::has(MESH), HAS_FIELD = Types::has(HEIGHT_FIELD);

    const Shapes& shapes;
    const Meshes& meshes;
    const HeightFields& fields;
    const EdgeTester<LENS, Centres>& seen;
    const Camera& camera;
    const Region& region;
    int world;
    int count = 0;
    int near[SAMPLES][AROUND];  // pixels around one by number, the nearest to each sample first
    ShapesAround around;
    Edge edges[EDGES_TOGETHER];
    SampleHits hits[EDGES_TOGETHER];
    short sorted[AROUND * EDGES_TOGETHER];  // the pixels around which shapes are seen, shape after shape

    EdgeResolver(const Shapes& shapes_, const Meshes& meshes_, const HeightFields& fields_,
                 const EdgeTester<LENS, Centres>& seen_, const Camera& camera_, const Region& region_, int world_)
        : shapes(shapes_), meshes(meshes_), fields(fields_), seen(seen_), camera(camera_), region(region_),
          world(world_)
    {
        around.clear();
        for (int sample = 0; sample < SAMPLES; ++sample)
            for (int k = 0; k < AROUND; ++k)
                near[sample][k] = number_of(near_sample(sample_offset(sample), k));
    }

    // Lists a pixel, if it has an edge.
    void look_at(int i, int j)
    {
        const auto sided = [&](int shape) { return has_sides<Types>(shapes, shape); };
        const unsigned samples = seen.template edge<IMAGES>(i, j, sided);
        if (!samples)
            return;
        if (count == EDGES_TOGETHER || around.count + AROUND > SHAPES_TOGETHER)
            smooth();
        Edge& edge = edges[count];
        edge.i = i;
        edge.j = j;
        edge.samples = samples;
        edge.count = 0;
        find_shapes(edge);
        SampleHits& its = hits[count++];
        for (int sample = 0; sample < SAMPLES; ++sample) {
            const CameraRay<LENS> ray = sample_ray<LENS>(camera, i, j, sample);
            its.x[sample] = ray.x;
            its.y[sample] = ray.y;
        }
        its.depth = camera.far;
        its.shape = its.face = -1;
    }

    // Finds the shapes seen around a pixel.
    void find_shapes(Edge& edge)
    {
        const NineIds nine = seen.centres.nine_ids(edge.i, edge.j);
        Band others = NOWHERE;
        unsigned empty = 0, ground = 0;
        bool several = false;
        edge.on_meshes = edge.on_fields = NOWHERE;
        for (unsigned left = (1u << AROUND) - 1; left;) {
            const int id = nine[ctz(left)];
            const unsigned own = nine.which_are(id), pixels = own & nine.inside;
            left &= ~own;
            if (id < 0) {
                empty = pixels;
                continue;
            }
            const int slot = around.find(id);
            ++around.pixels[slot];
            edge.shapes[edge.count++] = { static_cast<short>(slot), static_cast<unsigned short>(pixels) };
            if constexpr (HAS_MESH || HAS_FIELD) {
                const int type = wp::index(shapes.types, id);
                Band& band = type == MESH ? edge.on_meshes : type == HEIGHT_FIELD ? edge.on_fields : others;
                for (unsigned its = pixels; its; its &= its - 1)
                    band.include(seen.depth(seen.around(edge.i, edge.j, ctz(its))));
                several |= type == HEIGHT_FIELD && ground != 0;
                ground = type == HEIGHT_FIELD ? pixels : ground;
            }
        }
        if constexpr (HAS_MESH)
            if (HAS_FIELD && edge.on_meshes.last > 0.0f) {
                others.include(edge.on_meshes.first);
                others.include(edge.on_meshes.last);
            }
        edge.behind =
            HAS_FIELD && ground && !several && is_behind<LENS>(edge.on_fields, others, empty != 0, seen.scale_x);
        edge.background = edge.behind ? ground : empty;
        edge.on_meshes = edge.on_meshes.template widened<LENS>(seen.scale_x);
        edge.on_fields = edge.on_fields.template widened<LENS>(seen.scale_x);
    }

    // Makes the records of the shapes around; their slots as they are to be traced: meshes and height fields last, and
    // as NearShapes::prepare_all() has them.
    int setup_shape(short* order)
    {
        float keys[SHAPES_TOGETHER];
        int ranks = 0;
        const auto stage = [&](int slot) {
            const int type = around.records[slot].axis_x.w;
            return type == MESH ? 2 : type == HEIGHT_FIELD ? 1 : 0;
        };
        for (int slot = 0; slot < around.count; ++slot) {
            ShapeRecord& record = around.records[slot];
            if (!sample_record<Types, LENS>(shapes, meshes, fields, camera, region, world, around.ids[slot], record))
                continue;
            record.axis_y.w = slot;
            keys[slot] = HAS_MESH ? as_float(record.size.w) : 0.0f;
            int rank = ranks++;
            for (; rank > 0; --rank) {
                const int other = order[rank - 1], behind = stage(slot) - stage(other);
                if (behind > 0 || (behind == 0 && keys[other] < keys[slot])
                    || (behind == 0 && keys[other] == keys[slot] && around.ids[other] > around.ids[slot]))
                    break;
                order[rank] = order[rank - 1];
            }
            order[rank] = static_cast<short>(slot);
        }
        return ranks;
    }

    // Traces the samples of a few pixels against one shape.
    void trace(const ShapeRecord& record, const short* pixels, int some)
    {
        const int type = record.axis_x.w;
        const bool mesh = HAS_MESH && type == MESH, field = HAS_FIELD && type == HEIGHT_FIELD;
        Rays rays;
        OwnNear from;
        const auto put = [](auto* to, const auto& its, int n) { __builtin_memcpy(to + n * SAMPLES, &its, sizeof its); };
        const auto get = [](const auto* of, int n) {
            typedef decltype(+*of) Number __attribute__((ext_vector_type(SAMPLES)));
            Number its;
            __builtin_memcpy(&its, of + n * SAMPLES, sizeof its);
            return its;
        };
        for (int n = 0; n < WARP_SIZE / SAMPLES; ++n) {
            const Edge& edge = edges[pixels[min(n, some - 1)]];
            const SampleHits& its = hits[pixels[min(n, some - 1)]];
            const Band& band = mesh ? edge.on_meshes : edge.on_fields;
            const bool there = n < some && !(field && edge.behind), slow = mesh || field;
            const IntQuad traced = (int(there ? edge.samples : 0) & IntQuad { 1, 2, 4, 8 }) != 0, none = -1;
            const Quad last = slow ? band.last : MISS, never = MISS;
            const Quad begin = slow ? max(camera.near, band.first) : camera.near;
            put(rays.x, its.x, n);
            put(rays.y, its.y, n);
            put(rays.depth, its.depth < last ? its.depth : last, n);
            put(rays.shape, none, n);
            put(rays.face, none, n);
            put(from.own, traced ? begin : never, n);
        }
        if (mesh)
            trace_mesh<Types, LENS, true>(meshes, record, from, rays);
        else
            trace_record<Types, LENS>(record, from, fields, rays);
        for (int n = 0; n < some; ++n) {
            SampleHits& its = hits[pixels[n]];
            const IntQuad hit = get(rays.shape, n) >= 0;
            its.depth = hit ? get(rays.depth, n) : its.depth;
            its.shape = hit ? get(rays.shape, n) : its.shape;
            its.face = hit ? get(rays.face, n) : its.face;
        }
    }

    // Selects, from a set of pixels, the nearest to a sample; the centre pixel if the set is empty.
    int nearest(int sample, unsigned pixels) const
    {
        for (int k = 0; pixels && k < AROUND; ++k)
            if (pixels >> near[sample][k] & 1)
                return near[sample][k];
        return ITSELF;
    }

    int shown(const Edge& edge, const SampleHits& its, int sample) const
    {
        if (!(edge.samples >> sample & 1))
            return ITSELF;
        const int slot = its.shape[sample];
        if (slot < 0)
            return nearest(sample, edge.background);
        int at = 0;
        while (edge.shapes[at].slot != slot)
            ++at;
        const unsigned pixels = edge.shapes[at].pixels;
        const ShapeRecord& record = around.records[slot];
        const auto show = [&](bool sided, const auto& normal_cost) {
            if (!sided)
                return nearest(sample, pixels);
            unsigned left = 0;
            for (int k = 0; k < AROUND; ++k)
                left |= (pixels >> near[sample][k] & 1) << k;
            return seen.template select<IMAGES>(left, edge.i, edge.j, sample_offset(sample), its.depth[sample], true,
                                                normal_cost);
        };
        return shown_sample<Types>(seen, meshes, camera, edge.i, edge.j, sample, its.depth[sample], its.face[sample],
                                   record, edge.samples, show);
    }

    // Smooths the pixels that are listed.
    void smooth()
    {
        short order[SHAPES_TOGETHER];
        const int ranks = setup_shape(order);
        int ends[SHAPES_TOGETHER];  // by slot, of its pixels
        for (int slot = 0, end = 0; slot < around.count; ++slot) {
            ends[slot] = end;
            end += around.pixels[slot];
        }
        for (int n = 0; n < count; ++n)
            for (int k = 0; k < edges[n].count; ++k)
                sorted[ends[edges[n].shapes[k].slot]++] = static_cast<short>(n);
        for (int rank = 0; rank < ranks; ++rank) {
            const int slot = order[rank], its = around.pixels[slot];
            const short* const pixels = sorted + ends[slot] - its;
            for (int from = 0; from < its; from += WARP_SIZE / SAMPLES)
                trace(around.records[slot], pixels + from, min(WARP_SIZE / SAMPLES, its - from));
        }
        for (int n = 0; n < count; ++n) {
            const Edge& edge = edges[n];
            unsigned by[SAMPLES];
            for (int sample = 0; sample < SAMPLES; ++sample)
                by[sample] = seen.around(edge.i, edge.j, shown(edge, hits[n], sample));
            put_means<IMAGES>(seen.centres, seen.centres.of_images(edge.i, edge.j), by);
        }
        count = 0;
        around.clear();
    }
};

template <class Types, int LENS, int WIDTH, int HEIGHT, int IMAGES, bool BY_WORDS, bool IN_PLACE, class Shapes,
          class Meshes, class HeightFields, class Target>
inline void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Target& target,
                          const Camera& camera, const Region& region, int world)
{
    using Centres = CentresAtHand<IMAGES, WIDTH, HEIGHT, Target>;
    const Centres centres(target, unsigned(world) * target.height * target.width, region);
    const EdgeTester<LENS, Centres> seen { centres, pixel_width<LENS>(camera), camera.scale_y };
    EdgeResolver<Types, LENS, IMAGES, Shapes, Meshes, HeightFields, Centres> smoother(shapes, meshes, fields, seen,
                                                                                      camera, region, world);
    const int right = min(region.left + region.width, target.width);
    const int bottom = min(region.top + region.height, target.height);
    for (int j = region.top; j < bottom; ++j)
        for (int i = region.left; i < right; i += SIMD_WIDTH) {
            unsigned maybe = centres.template maybe_edges<LENS>(i, j, seen.scale_x, seen.scale_y);
            maybe &= (1u << min(right - i, SIMD_WIDTH)) - 1u;
            for (; maybe; maybe &= maybe - 1)
                smoother.look_at(i + ctz(maybe), j);
        }
    smoother.smooth();
}

}  // namespace warpcam
#endif
