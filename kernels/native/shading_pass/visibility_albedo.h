// The trace with albedo. Shapes of one colour show a word that the block keeps of each; a floor's texture is looked up
// where it is hit; what else has a texture is looked up when all tiles are drawn, 32 pixels at once. For CUDA,
// pinholes, and scenes without meshes and height fields.
#pragma once
#include "shading/plane_shading.h"
#include "shading/appearance_cache.h"
#include "traversal/visibility.h"

namespace warpcam {

// Part of Scene that an appearance needs.
struct Unlit {
    float horizon;
};
template <class Shapes, class Meshes, class HeightFields, class Materials, class Textures> struct AlbedoScene {
    Unlit frame;
    const Shapes& shapes;
    const Meshes& meshes;
    const HeightFields& fields;
    const Materials& materials;
    const Textures& textures;
};

// Shared memory of the albedo writer. FLAGS: of shading/appearance.h.
template <class Types, int FLAGS, int CAPACITY, int WIDTH, int HEIGHT, bool WHOLE_> struct AlbedoWriter {
    static constexpr bool WHOLE = WHOLE_, WRITES_ALBEDO = true, LOOKS_AT_FLOORS = false;
    using Wants = ShadingNeeds<ALBEDO, FLAGS>;
    using Appearances = ShapeAppearance<Types, Wants>;
    static constexpr bool TEXTURED = Wants::TEXTURED, FLOORS = TEXTURED && Types::has(PLANE);
    static constexpr bool MIPS = FLAGS & HAS_MIPS;  // floors have textures that are mipmapped, else atlases
    static constexpr int WARPS = THREADS / WARP_SIZE, ACROSS = WIDTH / TILE_WIDTH,
                         TILES = ACROSS * (HEIGHT / TILE_HEIGHT);
    static constexpr int CACHED = TEXTURED && CAPACITY <= WARP_SIZE ? CAPACITY : 0;  // looks
    static_assert(TILES <= WARPS * WARP_SIZE);
    // In place of a colour's bytes: the floor's texture; a texture that is looked up later.
    static constexpr unsigned ON_FLOOR = 1u << 30, LATER = 1u << 31;

    struct alignas(8) Slot {
        unsigned color;
        int id;
    };
    template <int TILES_PER_WARP> struct Slots {
        Slot at[TILES_PER_WARP];
    };

    unsigned words[CAPACITY];  // by place among the drawn shapes
    Slot slots[CAPACITY + 1];  // the first of nothing
    unsigned later[TEXTURED ? TILES : 1];  // pixels of each tile
    unsigned short queue[TEXTURED ? WARPS : 1][2 * WARP_SIZE];  // numbers of such
    Appearances looks[CACHED > 0 ? CACHED : 1];
    unsigned endless;  // the endless floor's word
    BareGrid floor;  // its shape: -1 where there is none that is looked up at once
    Float3Int u, v;  // by x and y of a ray at depth 1, and without them; w: bits of the eye's [images]
    Float3Int color;  // of the floor, of 255; w: bits of its coarsest level
    float right[FLOORS ? HEIGHT : 1], down[FLOORS ? WIDTH : 1];  // levels at depth 1, by row and by column

    template <class Shapes, class Meshes, class HeightFields, class Materials, class Textures>
    WARPCAM_DEVICE static auto scene_of(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                                        const Materials& materials, const Textures& textures)
    {
        using Scene_ = AlbedoScene<Shapes, Meshes, HeightFields, Materials, Textures>;
        return Scene_ { { 0.0f }, shapes, meshes, fields, materials, textures };
    }

    // Loads what shapes look like, while the block's first threads list them.
    template <class Scene_> WARPCAM_DEVICE void begin(const Scene_& scene, const Camera& camera, const Region& region,
                                                      int plane, int world, int thread)
    {
        if constexpr (TEXTURED)
            for (int tile = thread; tile < TILES; tile += THREADS)
                later[tile] = 0u;
        if constexpr (FLOORS)
            if (thread >= THREADS - WARP_SIZE)
                see(scene, camera, region, plane, world, thread % WARP_SIZE);
        for (int i = (thread + THREADS / 2) % THREADS; i < scene.shapes.drawn.shape[0]; i += THREADS) {
            const int id = wp::index(scene.shapes.drawn, i);
            const ResolvedMaterial material = load_material<Wants::MATERIAL>(scene.shapes, scene.materials, world, id);
            words[i] = !TEXTURED || !is_texture(scene.textures, material.color.w) ? to_bytes(as_vec3(material.color))
                       : FLOORS && id == plane                                    ? ON_FLOOR
                                                                                  : LATER;
        }
    }

    // By one warp, which draws fewer tiles for it: they are needed when all are drawn.
    template <class Scene_>
    WARPCAM_DEVICE void load_looks(const Scene_& scene, const Camera& camera, int world, int thread)
    {
        if constexpr (CACHED > 0)
            if (const int i = thread - (THREADS - WARP_SIZE); i >= 0 && i < scene.shapes.drawn.shape[0])
                looks[i] = load_appearance_for<Types, Wants>(scene, camera, world, wp::index(scene.shapes.drawn, i));
    }

    // Computes what pixels of the plane share; by one warp.
    template <class Scene_> WARPCAM_DEVICE void see(const Scene_& scene, const Camera& camera, const Region& region,
                                                    int plane, int world, int lane)
    {
        if (lane == 0)
            floor.shape = -1;
        if (plane < 0)
            return;
        const Appearances look = load_appearance_for<Types, Wants>(scene, camera, world, plane);
        unsigned long long atlas = 0;
        if constexpr (!MIPS)
            atlas = atlas_of(scene.textures, look.material.color.w);
        else if (is_texture(scene.textures, look.material.color.w))
            atlas = wp::index(scene.textures.mips, look.material.color.w);
        if constexpr (MIPS) {
            if (lane == 0) {
                view_floor(floor.view, look, camera);
                floor.view.atlas = atlas;
                floor.color = clip(as_vec3(look.material.color));
                floor.shape = plane;
            }
        } else {
            see_floor(floor, look, camera, plane, atlas, lane);
        }
        __syncwarp();
        const FloorView& view = floor.view;
        const Float3Int ax = view.axis_x, ay = view.axis_y, az = view.axis_z, place = view.place;
        if (lane == 0) {
            u = { place.x * ax.x, place.x * ax.y, -place.x * ax.z, as_int(fma(place.x, as_float(ax.w), place.z)) };
            v = { place.y * ay.x, place.y * ay.y, -place.y * ay.z,
                  as_int(fma(place.y, as_float(ay.w), as_float(place.w))) };
            color = make_float3_int(255.0f * floor.color, as_int(float(view.count - 1)));
            if (!view.plain || view.count == 0 || !view.atlas)
                floor.shape = -1;
        }
        // A step on the texture changes along the other direction alone: see FloorView and StripPlan.
        const float rate = rcp(avoid_zero(as_float(az.w)));
        const auto level = [&](const Float3Int& step, float x, float y) {
            const float z = az.x * x + az.y * y - az.z;
            const float du = rate * (step.x * z - step.y * (ax.x * x + ax.y * y - ax.z));
            const float dv = rate * (step.z * z - as_float(step.w) * (ay.x * x + ay.y * y - ay.z));
            return 0.5f * log2(max(du * du + dv * dv, MIN_NORMAL));
        };
        for (int row = lane; row < HEIGHT; row += WARP_SIZE)
            right[row] = level(view.right, 0.0f, image_y(camera, float(region.top + row)));
        for (int column = lane; column < WIDTH; column += WARP_SIZE)
            down[column] = level(view.down, image_x(camera, float(region.left + column)), 0.0f);
    }

    // Gives slots their shapes' words, once these are listed.
    template <class List> WARPCAM_DEVICE void face(const List& list, int thread, int threads)
    {
        for (int slot = threads - 2 - thread; slot < list.count; slot += threads) {
            unsigned word = slot < 0 ? 0u : words[list.records[slot].axis_z.w];
            if (FLOORS && word == ON_FLOOR && floor.shape < 0)
                word = LATER;
            slots[slot + 1] = { word, slot < 0 ? -1 : list.ids[slot] };
            if (slot >= 0 && is_endless(list.records[slot]))
                endless = word;
        }
    }

    template <int TILES_PER_WARP> WARPCAM_DEVICE Slots<TILES_PER_WARP> slots_of(const Hit (&hits)[TILES_PER_WARP]) const
    {
        Slots<TILES_PER_WARP> found;
        for (int k = 0; k < TILES_PER_WARP; ++k)
            found.at[k] = slots[hits[k].shape + 1];
        return found;
    }

    // Writes what a warp's tiles show; the lane's first pixel is (i, j).
    template <class TraceTarget_, class Ray_, int TILES_PER_WARP>
    WARPCAM_DEVICE void write_albedo(const TraceTarget_& trace_target, int i, int j, const Ray_ (&rays)[TILES_PER_WARP],
                                     const Hit (&hits)[TILES_PER_WARP], const Slots<TILES_PER_WARP>& found)
    {
        unsigned shown[TILES_PER_WARP], all = 0u;
        for (int k = 0; k < TILES_PER_WARP; ++k) {
            shown[k] = found.at[k].color;
            all |= shown[k];
        }
        if (FLOORS && warp_any(all & ON_FLOOR))
            sample_plane<false>(i - trace_target.region.left, j - trace_target.region.top, rays, hits, shown);
        if (TEXTURED && warp_any(all & LATER))
            postpone(trace_target, i, j, shown);
        store(trace_target, i, j, shown);
    }

    // Writes pixels whose hits are all on the infinite plane.
    template <class TraceTarget_, class Ray_, int TILES_PER_WARP>
    WARPCAM_DEVICE void write_plane_albedo(const TraceTarget_& trace_target, int i, int j,
                                           const Ray_ (&rays)[TILES_PER_WARP], const Hit (&hits)[TILES_PER_WARP])
    {
        const unsigned word = endless;
        unsigned shown[TILES_PER_WARP];
        for (int k = 0; k < TILES_PER_WARP; ++k)
            shown[k] = word;
        if (FLOORS && word == ON_FLOOR)
            sample_plane<true>(i - trace_target.region.left, j - trace_target.region.top, rays, hits, shown);
        else if (TEXTURED && word == LATER)
            postpone(trace_target, i, j, shown);
        store(trace_target, i, j, shown);
    }

    // Notes the pixels whose texture is looked up later.
    template <class TraceTarget_, int TILES_PER_WARP>
    WARPCAM_DEVICE void postpone(const TraceTarget_& trace_target, int i, int j,
                                 const unsigned (&shown)[TILES_PER_WARP])
    {
        const int tile =
            (j - trace_target.region.top) / TILE_HEIGHT * ACROSS + (i - trace_target.region.left) / TILE_WIDTH;
        for (int k = 0; k < TILES_PER_WARP; ++k) {
            const unsigned pixels = __ballot_sync(FULL_WARP, shown[k] & LATER);
            if (threadIdx.x % WARP_SIZE == 0)
                later[tile + k * ACROSS] = pixels;
        }
    }

    template <class TraceTarget_, int TILES_PER_WARP>
    WARPCAM_DEVICE void store(const TraceTarget_& trace_target, int i, int j,
                              const unsigned (&shown)[TILES_PER_WARP]) const
    {
        // Four neighbours store their twelve bytes as three words.
        const int piece = threadIdx.x & 3;
        const unsigned bytes = piece == 0 ? 0x4210 : piece == 1 ? 0x5421 : 0x6542;
        unsigned char* image = trace_target.target.albedo.data + piece;
        unsigned joined[TILES_PER_WARP];
        for (int k = 0; k < TILES_PER_WARP; ++k)
            joined[k] = __byte_perm(shown[k], __shfl_down_sync(FULL_WARP, shown[k], 1), bytes);
        if (piece < 3)
            for (int k = 0; k < TILES_PER_WARP; ++k)
                *reinterpret_cast<unsigned*>(image + 3 * size_t(trace_target.at(i, j, k))) = joined[k];
    }

    // EVERY: all hits are on it.
    template <bool ALL_LANES, class Ray_, int TILES_PER_WARP>
    WARPCAM_DEVICE void sample_plane(int column, int row, const Ray_ (&rays)[TILES_PER_WARP],
                                     const Hit (&hits)[TILES_PER_WARP], unsigned (&shown)[TILES_PER_WARP])
    {
        const Float3Int across = u, along = v, own_color = color;
        const float own = down[column], coarsest = as_float(own_color.w);
        const float start_u = across.x * rays[0].x + across.z, start_v = along.x * rays[0].x + along.z;
        const unsigned long long atlas = floor.view.atlas;
        for (int k = 0; k < TILES_PER_WARP; ++k) {
            const float depth = hits[k].depth;
            const float at_u = fma(depth, across.y * rays[k].y + start_u, as_float(across.w));
            const float at_v = fma(depth, along.y * rays[k].y + start_v, as_float(along.w));
            const float steps = max(own, right[row + k * TILE_HEIGHT]);
            Vec3 texel;
            if constexpr (MIPS) {
                texel = look_up(atlas, at_u, at_v, 2.0f * log2(depth) + steps);
            } else {
                const float detail = min(max(2.0f * log2(depth) + steps, 0.0f), coarsest);
                const float base = __fadd_rd(detail, WHOLE_NUMBERS);
                const int level = as_int(base) - as_int(WHOLE_NUMBERS);
                texel = sample_atlas(atlas, floor.view.levels[level], floor.view.levels[level + 1], at_u, at_v,
                                     detail - (base - WHOLE_NUMBERS));
            }
            const unsigned red = unsigned(as_int(fma(texel.x, own_color.x, WHOLE_NUMBERS)));
            const unsigned green = unsigned(as_int(fma(texel.y, own_color.y, WHOLE_NUMBERS)));
            const unsigned blue = unsigned(as_int(fma(texel.z, own_color.z, WHOLE_NUMBERS)));
            const unsigned word = __byte_perm(__byte_perm(red, green, 0x0040), blue, 0x6410);
            shown[k] = ALL_LANES || shown[k] == ON_FLOOR ? word : shown[k];
        }
    }

    // Looks up what was left, once all tiles are drawn.
    template <class Scene_, class Target> WARPCAM_DEVICE void finish(const Scene_& scene, const Target& target,
                                                                     const Camera& camera, const Region& region,
                                                                     int world, int thread)
    {
        if constexpr (TEXTURED) {
            const int lane = thread % WARP_SIZE, warp = thread / WARP_SIZE;
            unsigned short* own = queue[warp];
            const unsigned mine = warp + lane * WARPS < TILES ? later[warp + lane * WARPS] : 0u;
            unsigned tiles = __ballot_sync(FULL_WARP, mine != 0u);
            int waiting = 0;
            while (tiles || waiting > 0) {
                while (tiles && waiting < WARP_SIZE) {
                    const int bit = ctz(tiles);
                    const unsigned pixels = __shfl_sync(FULL_WARP, mine, bit);
                    tiles &= tiles - 1;
                    if (pixels >> lane & 1u)
                        own[waiting + __popc(pixels & ((1u << lane) - 1u))] =
                            static_cast<unsigned short>((warp + bit * WARPS) * WARP_SIZE + lane);
                    waiting += __popc(pixels);
                }
                __syncwarp();
                const unsigned pixel = own[lane < waiting ? lane : 0], moved = own[WARP_SIZE + lane];
                const int tile = pixel / WARP_SIZE, place = pixel % WARP_SIZE;
                const int i = region.left + tile % ACROSS * TILE_WIDTH + place % TILE_WIDTH;
                const int j = region.top + tile / ACROSS * TILE_HEIGHT + place / TILE_WIDTH;
                const unsigned at = (unsigned(world) * target.height + j) * target.width + i;
                const unsigned word =
                    color_at(scene, camera, world, i, j, { target.depth.data[at], target.shape.data[at], -1 });
                if (lane < waiting)
                    for (int k = 0; k < 3; ++k)
                        target.albedo.data[3 * size_t(at) + k] = static_cast<unsigned char>(word >> 8 * k);
                __syncwarp();
                own[lane] = static_cast<unsigned short>(moved);
                __syncwarp();
                waiting -= min(waiting, WARP_SIZE);
            }
        }
    }

    template <class Scene_>
    WARPCAM_DEVICE unsigned color_at(const Scene_& scene, const Camera& camera, int world, int i, int j, const Hit& hit)
    {
        const CameraRay<PINHOLE> ray = view_ray<PINHOLE>(camera, i, j);
        ShadedPixel shown;
        if constexpr (CACHED > 0)
            resolve_surface<Types, PINHOLE, ALBEDO, FLAGS>(looks[wp::index(scene.shapes.places, hit.shape)], None {},
                                                           scene, camera, ray.x, ray.y, hit, 0, shown);
        else
            resolve_surface<Types, PINHOLE, ALBEDO, FLAGS>(
                load_appearance_for<Types, Wants>(scene, camera, world, hit.shape), None {}, scene, camera, ray.x,
                ray.y, hit, 0, shown);
        return to_bytes(shown.albedo);
    }
};

// Draws as draw() does, in scenes of no more shapes than a list holds. Types: including the bits that only colours
// need.
template <class Types, int CAPACITY, int WIDTH, int HEIGHT, int OUTPUTS, int FLAGS, class Shapes, class Materials,
          class Meshes, class HeightFields, class Views, class Target>
WARPCAM_DEVICE void draw_with_albedo(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                                     const HeightFields& fields, const Views& views, const Target& target, int index)
{
    using Room = AlbedoWriter<Types, FLAGS, CAPACITY, WIDTH, HEIGHT, (OUTPUTS & FLOW_WHOLE) != 0>;
    draw_with<SceneTypes<Types::ANALYTIC, Types::FEATURES & 1 << PLANES_FROM_BEHIND>, PINHOLE, CAPACITY, false, WIDTH,
              HEIGHT, OUTPUTS, Room>(shapes, materials, meshes, fields, views, target, index);
}

}  // namespace warpcam
