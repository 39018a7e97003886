// From the visibility buffer to images: a block draws one region of one view.
#pragma once
#include "corners.h"
#include "haze.h"
#include "hits.h"
#include "mapping.h"
#include "physical.h"
#include "mirror_plane.h"
#include "peel.h"
#include "reflected.h"
#include "shade.h"
#include "texels.h"
#include "variety.h"
#include "veils.h"

namespace warpcam {

// The structs of types.py that a pixel needs.
template <class Frame_, class Images_, class Shapes_, class Meshes_, class Fields_, class Materials_, class Textures_,
          class Background_>
struct Scene {
    const Frame_& frame;
    const Images_& images;
    const Shapes_& shapes;
    const Meshes_& meshes;
    const Fields_& fields;
    const Materials_& materials;
    const Textures_& textures;
    const Background_& background;
};
template <class... Structs> Scene(const Structs&...) -> Scene<Structs...>;

// What physical.h reads beside.
template <class Scene_> WARPCAM_FN None physical_of(const Scene_&) { return {}; }
template <class Scene_, class Physical_>
WARPCAM_FN const Physical_& physical_of(const PhysicalScene<Scene_, Physical_>& scene)
{
    return scene.physical;
}

// Where a warp sees anything at all, its pixels that see nothing do as one of the others does, so that all its threads
// go the same way; what they find is not used. False where it sees nothing.
WARPCAM_FN bool follow(bool hit, Hit& found)
{
#if defined(__CUDA_ARCH__)
    const unsigned hits = __ballot_sync(ALL, hit);
    if (hits != ALL && hits != 0u) {
        const int leader = lowest_bit(hits);
        const int shape = __shfl_sync(ALL, found.shape, leader);
        const int face = __shfl_sync(ALL, found.face, leader);
        const float depth = __shfl_sync(ALL, found.depth, leader);
        if (!hit)
            found = { depth, shape, face };
    }
    return hits != 0u;
#else
    return hit;
#endif
}

// The texture's colour at a hit; white where there is none.
template <int TYPES, int LENS, class Looks, class Meshes, class Textures>
WARPCAM_FN Vec texture_color(const Looks& look, const Meshes& meshes, const Textures& textures, const Camera& camera,
                             float x, float y, const Surface& surface, Vec ray, float depth)
{
    const Layout& layout = look.layout;
    if (layout.image.levels <= 0)
        return { 1.0f, 1.0f, 1.0f };
    const Pose& pose = look.pose;
    const float stretch = LENS == PINHOLE ? depth : 1.0f;
    const Vec right = LENS == RAYS ? pose.local(step_right<LENS>(camera, x, y, depth))
                                   : stretch * camera.scale_x * Vec { pose.axis_x.x, pose.axis_y.x, pose.axis_z.x };
    const Vec down = LENS == RAYS ? pose.local(step_down<LENS>(camera, x, y, depth))
                                  : -stretch * camera.scale_y * Vec { pose.axis_x.y, pose.axis_y.y, pose.axis_z.y };
    if (layout.cube) {
        const CubeMapping mapping = map_cube<TYPES>(pose, layout, surface);
        return sample_cube(textures.texels.data, layout.image, mapping.direction,
                           times(mapping.scale, slide(right, ray, surface.normal)),
                           times(mapping.scale, slide(down, ray, surface.normal)));
    }
    Footprint at = footprint_2d<TYPES>(pose, layout, meshes, surface, ray, right, down);
    shift(look, at.u, at.v);
    return sample_2d(textures.texels.data, layout.image, at.u, at.v, at.right, at.down);
}

// What a surface shows.
struct Shown {
    Vec normal;
    Vec albedo, linear, display;
};

template <int TYPES, int LENS, int IMAGES, int FACTS, class Looks, class List, class Scene_>
WARPCAM_FN void resolve_surface(const Looks& look, const List& lights, const Scene_& scene, const Camera& camera,
                                float x, float y, const Hit& found, int shadow, Shown& shown)
{
    using Wants = Wanted<IMAGES, FACTS>;
    const float depth = found.depth;
    Surface surface;
    Vec place, ray;  // in the camera's frame; in the shape's
    if constexpr (Wants::SURFACE) {
        const Pose& pose = look.pose;
        place = LENS == PINHOLE ? Vec { depth * x, depth * y, -depth } : Vec { x, y, -depth };
        ray = LENS == PINHOLE ? pose.local({ x, y, -1.0f }) : pose.local({ 0.0f, 0.0f, -1.0f });
        if constexpr (LENS == RAYS) {
            place = depth * ViewRay<LENS> { x, y }.direction();
            ray = pose.local(ViewRay<LENS> { x, y }.direction());
        }
        const Vec local = pose.eye() + (LENS != ORTHOGRAPHIC ? depth * ray : pose.local(place));
        surface = surface_at<TYPES>(pose, scene.meshes, scene.fields, found.face, local, ray);
    }
    if constexpr (Wants::TURNED) {
        shown.normal = look.turn.world(surface.normal);
        if (dot(surface.normal, ray) > 0.0f)
            shown.normal = -shown.normal;
    }
    Vec texture { 1.0f, 1.0f, 1.0f };
    if constexpr (Wants::TEXTURED)
        texture = texture_color<TYPES, LENS>(look, scene.meshes, scene.textures, camera, x, y, surface, ray, depth);
    if constexpr (Wants::COATED)
        texture = decoded(texture);
    if constexpr ((IMAGES & ALBEDO) != 0) {
        shown.albedo = times(clip(to_vec(look.finish.color)), texture);
        if constexpr (Wants::COATED)
            shown.albedo = encoded(shown.albedo);
    }
    if constexpr (Wants::LIT && Wants::COATED) {
        shown.linear = shade_physically<TYPES, LENS, FACTS>(look, lights, scene, camera, x, y, surface, place, ray,
                                                            depth, texture, shadow);
        shown.display = encoded(shown.linear);
    } else if constexpr (Wants::LIT) {
        constexpr bool SHADOWS = FACTS & HAS_SHADOWS;
        OnCorners on;
        on.inside = false;
        if constexpr (lit_by_corners<List>(SHADOWS)) {
            on.inside = found.shape == lights.grid.shape;
            if (any_lane(on.inside))
                on = on_corners(lights.grid, surface.local, on.inside);
        }
        Lit lit;
        if (any_lane(!on.inside)) {
            Facet facet;
            facet_at<TYPES>(look, scene.meshes, surface, place, facet, !on.inside);
            const bool three = (TYPES & (1 << PLANE | 1 << HEIGHT_FIELD | 1 << BOX | 1 << MESH)) && any_lane(facet.three);
            lit = three ? illuminate<3, SHADOWS>(lights, facet, look.finish, shadow)
                        : illuminate<1, SHADOWS>(lights, facet, look.finish, shadow);
        }
        if constexpr (lit_by_corners<List>(SHADOWS))
            if (any_lane(on.inside)) {
                const Vec light = light_from_corners(lights.grid, on, shadow);
                lit.display = on.inside ? light : lit.display;
            }
        shown.linear = times(lit.linear, texture);
        shown.display = times(lit.display, texture);
    }
}

// What the trace found at a pixel.
template <int TYPES, int IMAGES, int FACTS, class Frame_> WARPCAM_FN Hit find(const Frame_& frame, const Pixel& pixel)
{
    Hit found { 0.0f, -1, 0 };
    if (pixel.inside) {
        found.shape = frame.shape.data[pixel.at];
        if (Wanted<IMAGES, FACTS>::SURFACE)
            found.depth = frame.depth.data[pixel.at];
        if (Wanted<IMAGES, FACTS>::SURFACE && (TYPES & (1 << MESH | 1 << HEIGHT_FIELD)))
            found.face = frame.face.data[pixel.at];
    }
    return found;
}

template <int TYPES, class Wants, class Scene_>
WARPCAM_FN Look<TYPES, Wants> look_of(const Scene_& scene, const Camera& camera, int world, int id)
{
    auto look = load_look<TYPES, Wants>(scene.shapes, scene.materials, physical_of(scene), scene.textures,
                                        scene.meshes, scene.fields, camera, scene.frame.horizon, world, id);
    if constexpr (Wants::DIMMED)
        dim(look.finish, wp::index(scene.frame.mirrors, world).strength);
    load_shift(look, scene, world, id);
    return look;
}

// A look that was kept without what few shapes have a use for.
template <class Seen, class Scene_>
WARPCAM_FN auto completed(const Seen& seen, int slot, const Scene_& scene, int world, int id)
{
    using Wants = typename Seen::Wants;
    constexpr int TYPES = Seen::TYPES;
    const auto& bare = seen.looks[slot];
    Look<TYPES, Wants> look;
    look.pose = bare.pose;
    look.finish = bare.finish;
    look.turn = bare.turn;
    bool more = Wants::MAPPED;
    if constexpr (Wants::TEXTURED) {
        look.layout.image.levels = 0;
        more |= bare.finish.color.w >= 0;
    }
    if constexpr (Wants::FACETED && (TYPES >> PLANE & 1)) {
        look.cells.u.step = 0.0f;
        more |= bare.pose.type() == PLANE;
    }
    if (more) {
        load_rest(look, scene.shapes, scene.materials, scene.textures, scene.meshes, scene.fields, scene.frame.horizon,
                  world, id);
        load_shift(look, scene, world, id);
    }
    return look;
}

// A shape's look, as it is kept or made anew.
template <int TYPES, int CAPACITY, class Wants, class Looks, class List, class Scene_>
WARPCAM_FN auto kept_look(const Looks* looks, const List& lights, const Scene_& scene, const Camera& camera, int world,
                          int id)
{
    if constexpr (CAPACITY > 0) {
        return looks[scene.shapes.places.data[id]];
    } else if constexpr (CAPACITY < 0) {
        using Own = typename Looks::Wants;
        if constexpr (HasCorners<List>::VALUE)
            if (id == lights.grid.shape)
                return looks->plane;
        const int mark = Looks::MARKED ? looks->marks[scene.shapes.places.data[id]] : 0;
        return mark > 0 ? completed(*looks, mark - 1, scene, world, id)
                        : look_of<TYPES, Own>(scene, camera, world, id);
    } else {
        return look_of<TYPES, Wants>(scene, camera, world, id);
    }
}

// CAPACITY: the looks a block keeps, one for each shape that may be visible; 0 if they are made anew for each pixel, less
// if `looks` are SeenLooks.
template <int TYPES, int LENS, int CAPACITY, int IMAGES, int FACTS, class Looks, class List, class Scene_>
WARPCAM_FN void resolve_hit(const Looks* looks, const List& lights, const Scene_& scene, const Camera& camera,
                            int world, float x, float y, const Hit& found, int shadow, Shown& shown)
{
    using Wants = Wanted<IMAGES, FACTS>;
    if constexpr (CAPACITY > 0)
        resolve_surface<TYPES, LENS, IMAGES, FACTS>(looks[scene.shapes.places.data[found.shape]], lights, scene,
                                                    camera, x, y, found, shadow, shown);
    else
        resolve_surface<TYPES, LENS, IMAGES, FACTS>(
            kept_look<TYPES, CAPACITY, Wants>(looks, lights, scene, camera, world, found.shape), lights, scene, camera, x,
            y, found, shadow, shown);
    if constexpr (Wants::LIT)
        expose<FACTS>(scene, world, shown.linear, shown.display);
}

// Covers what is seen of a pixel with the transparent shapes before it. Returns how much is still seen of it.
template <int TYPES, int LENS, int CAPACITY, int IMAGES, int FACTS, class Looks, class List, class Scene_,
          class Veils_>
WARPCAM_FN float resolve_veils(const Looks* looks, const List& lights, const Scene_& scene, const Camera& camera,
                               const Veils_& veils, const Region& region, int world, const Pixel& pixel, float x,
                               float y, const Hit& solid, Shown& shown)
{
    const float limit = solid.shape >= 0 ? solid.depth : camera.far;
    const bool takes_part = pixel.inside && !((FACTS & MIRRORED) && solid.shape == -1);
    const ViewRay<LENS> ray { x, y };
    float near = camera.near;
    int column = (pixel.column - region.left) / TILE_WIDTH;
    const int row = (pixel.row - region.top) / TILE_HEIGHT;
    if constexpr ((FACTS & MIRRORED) != 0) {
        near = plane_of(wp::index(scene.frame.mirrors, world)).depth(ray);
        column = region.width / TILE_WIDTH - 1 - column;
    }
    if constexpr ((FACTS & PHYSICAL) != 0) {
        const auto paint = [&](bool met, Hit hit, Vec& light) {
            Shown sheet;
            follow(met, hit);
            resolve_hit<TYPES, LENS, CAPACITY, IMAGES & (RGB | RGBA | HDR), FACTS & ~HAS_SHADOWS>(
                looks, lights, scene, camera, world, x, y, hit, 0, sheet);
            light = sheet.linear;
            float alpha = opacity(scene.shapes, scene.materials, world, hit.shape);
            if constexpr ((TYPES >> MASKED & 1) && (FACTS & HAS_MAPS))
                alpha *= mapped_opacity<TYPES, LENS>(
                    kept_look<TYPES, CAPACITY, Wanted<IMAGES, FACTS>>(looks, lights, scene, camera, world, hit.shape), scene,
                    camera, world, x, y, hit);
            return alpha;
        };
        Peeled peeled { { 0.0f, 0.0f, 0.0f }, 1.0f };
        peel<TYPES>(veils, scene, ray, near, takes_part ? limit : -1.0f, column, row, paint, peeled);
        if (peeled.left < 1.0f) {
            shown.linear = peeled.light + peeled.left * shown.linear;
            shown.display = encoded(shown.linear);
        }
        return peeled.left;
    } else {
        Covered covered(shown.linear, clip(shown.display));
        const auto shade = [&](bool met, Hit hit, Vec& linear, Vec& display) {
            Shown sheet;
            follow(met, hit);
            resolve_hit<TYPES, LENS, CAPACITY, IMAGES & (RGB | RGBA | HDR), FACTS & ~HAS_SHADOWS>(looks, lights, scene, camera, world, x,
                                                                                 y, hit, 0, sheet);
            linear = sheet.linear;
            display = sheet.display;
        };
        cover<TYPES>(veils, scene, ray, near, takes_part ? limit : -1.0f, column, row, shade, covered);
        shown.linear = covered.final_linear();
        shown.display = covered.final_display();
        return covered.left * covered.left;
    }
}

template <int TYPES, int LENS, int CAPACITY, int IMAGES, int FACTS, class Looks, class List, class Scene_,
          class Veils_, class Camera_>
WARPCAM_FN void resolve_pixel(const Looks* looks, const List& lights, const Scene_& scene, const Camera_& camera,
                              const Veils_& veils, const Region& region, int world, const Pixel& pixel, Hit found)
{
    using Wants = Wanted<IMAGES, FACTS>;
    constexpr bool IN_QUADS = FACTS & QUADS;
    const auto& frame = scene.frame;
    const auto& images = scene.images;
    const int column = FACTS & MIRRORED ? frame.width - 1 - pixel.column : pixel.column;
    const float x = ray_x<LENS>(camera, column), y = ray_y<LENS>(camera, pixel.row);
    const bool hit = found.shape >= 0;
    const Hit solid = found;
    Shown shown;
    bool drawn = false;
    if constexpr (lit_by_corners<List>(FACTS & HAS_SHADOWS) && !(IMAGES & (NORMALS | ALBEDO))) {
        drawn = draw_floor<Wants::TEXTURED>(lights.grid, frame, scene.textures, found, pixel.at, x, y, shown.display);
        if (drawn) {
            shown.linear = shown.display;
            expose<FACTS>(scene, world, shown.linear, shown.display);
        }
    }
    if (!drawn && (Wants::SURFACE || Wants::COLORED) && follow(hit, found)) {
        const int shadow = (FACTS & HAS_SHADOWS) && Wants::LIT && hit ? frame.shadow.data[pixel.at] : 0;
        resolve_hit<TYPES, LENS, CAPACITY, IMAGES, FACTS>(looks, lights, scene, camera, world, x, y, found, shadow, shown);
    }
    const Vec black { 0.0f, 0.0f, 0.0f };
    if (IMAGES & NORMALS)
        put_vec<IN_QUADS>(images.normals, pixel, hit ? shown.normal : black);
    if (IMAGES & ALBEDO)
        put_bytes<IN_QUADS>(images.albedo, pixel, hit ? to_bytes(shown.albedo) : 0u);
    if (Wants::LIT) {
        bool seen = hit;
        Mist mist { 0.0f, 0.0f };
        if constexpr ((FACTS & HAZY) != 0 && LENS != ORTHOGRAPHIC) {
            const Vec ray = turned(camera.rotation, ViewRay<LENS> { x, y }.direction());
            seen = hit && solid.depth < skybox_depth(ray, frame.haze.radius);
            mist = haze_of(scene, camera, world, ray);
        }
        if (!seen) {
            shown.linear = shown.display = FACTS & MIRRORED
                ? black
                : background_color<LENS, FACTS>(scene.textures, background_of<FACTS>(scene, world), camera, x, y);
            if constexpr (Wants::COATED) {
                shown.linear = decoded(shown.linear);
                if constexpr ((FACTS & HAS_SKYBOX) != 0) {
                    shown.linear = times(lights.sky.gain, shown.linear);
                    shown.display = encoded(shown.linear);
                }
            }
            expose<FACTS>(scene, world, shown.linear, shown.display);
        }
        if constexpr ((FACTS & REFLECTS) != 0)
            if (seen && found.shape == wp::index(frame.mirrors, world).shape)
                add_mirrored<IMAGES>(images, pixel.at, shown.linear, shown.display);
        if constexpr ((FACTS & HAZY) != 0)
            if (mist.density > 0.0f && !(seen && solid.depth < mist.depth)) {
                const Vec haze = exposed<FACTS>(scene, world, mist.density * to_vec(frame.haze.color));
                shown.linear = (1.0f - mist.density) * shown.linear + haze;
                shown.display = (1.0f - mist.density) * clip(shown.display) + haze;
            }
        unsigned alpha = hit ? 0xff000000u : 0u;
        if constexpr ((FACTS & VEILED) != 0) {
            const float left = resolve_veils<TYPES, LENS, CAPACITY, IMAGES, FACTS>(looks, lights, scene, camera, veils,
                                                                                   region, world, pixel, x, y, solid,
                                                                                   shown);
            alpha = hit ? alpha : to_byte(1.0f - left) << 24;
        }
        const unsigned word = to_bytes(shown.display);
        if (IMAGES & HDR)
            put_vec<IN_QUADS>(images.hdr, pixel, shown.linear);
        if (IMAGES & RGB)
            put_bytes<IN_QUADS>(images.rgb, pixel, word);
        if (IMAGES & RGBA)
            put_word(images.rgba, pixel, word | alpha);
    }
}

#if defined(__CUDA_ARCH__)
// The pixel of a thread in one of a region's tiles, row after row.
template <int WIDTH, int FACTS, class Frame_>
WARPCAM_FN void go_to(Pixel& pixel, const Frame_& frame, unsigned first, int left, int top, unsigned tile)
{
    left += tile % (WIDTH / TILE_WIDTH) * TILE_WIDTH;
    top += tile / (WIDTH / TILE_WIDTH) * TILE_HEIGHT;
    pixel.column = left + unsigned(pixel.lane) % TILE_WIDTH;
    pixel.row = top + unsigned(pixel.lane) / TILE_WIDTH;
    pixel.width = frame.width - left;
    pixel.height = frame.height - top;
    pixel.at = first + pixel.row * frame.width + pixel.column;
    pixel.inside = (FACTS & WHOLE_REGIONS) || (pixel.column < frame.width && pixel.row < frame.height);
}

// Keeps the looks of the shapes that a region shows. The threads of a block share the work.
template <int WIDTH, int HEIGHT, int FACTS, int ROOM, class Seen, class Scene_>
WARPCAM_FN void gather_looks(Seen& seen, const Scene_& scene, const Camera& camera, int world, unsigned first, int left,
                             int top, int thread)
{
    const int total = scene.shapes.drawn.shape[0];
    for (int place = thread; place < total; place += THREADS)
        seen.marks[place] = 0;
    if (thread == 0)
        seen.count = 0;
    block_barrier();
    Pixel pixel;
    pixel.lane = thread % LANES;
#pragma unroll 1
    for (unsigned tile = unsigned(thread) / LANES; tile < WIDTH / TILE_WIDTH * (HEIGHT / TILE_HEIGHT);
         tile += THREADS / LANES) {
        go_to<WIDTH, FACTS>(pixel, scene.frame, first, left, top, tile);
        const int id = pixel.inside ? scene.frame.shape.data[pixel.at] : -1;
        if (id >= 0 && id != scene.frame.plane)
            seen.marks[scene.shapes.places.data[id]] = 1;
    }
    block_barrier();
#pragma unroll 1
    for (int place = thread; place < total; place += THREADS) {
        if (!seen.marks[place])
            continue;
        const int slot = atomicAdd(&seen.count, 1);
        seen.marks[place] = slot < ROOM ? slot + 1 : 0;
        if (slot < ROOM)
            seen.looks[slot] = look_of<Seen::TYPES, Bare<typename Seen::Wants>>(scene, camera, world,
                                                                               wp::index(scene.shapes.drawn, place));
    }
}

#endif

// The look of the plane whose corners are kept.
template <int KEPT, class Held, class Scene_> WARPCAM_FN const auto& plane_look(const Held* looks, const Scene_& scene)
{
    if constexpr (KEPT > 0)
        return looks[scene.frame.plane >= 0 ? wp::index(scene.shapes.places, scene.frame.plane) : 0];
    else
        return looks->plane;
}

// Draws one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
// VEILS: how many shapes may be transparent.
template <int TYPES, int LENS, int CAPACITY, int WIDTH, int HEIGHT, int IMAGES, int FACTS, int VEILS = 0, class Scene_,
          class Lights>
WARPCAM_FN void resolve(const Scene_& scene, const Lights& lights, int index)
{
    using Wants = Wanted<IMAGES, FACTS>;
    using Looks = Look<TYPES, Wants>;
    using Sheets = typename Kept<VEILS != 0, Veils<VEILS != 0 ? VEILS : 1>>::type;
    constexpr int ROOM = 44032 - (VEILS != 0 ? int(sizeof(Sheets)) : 0);
    constexpr int KEPT = CAPACITY * int(sizeof(Looks)) <= ROOM && (Wants::SURFACE || Wants::COLORED) ? CAPACITY : 0;
    constexpr bool SHADOWS = FACTS & HAS_SHADOWS;
    constexpr int CORNERS = Wants::FACETED && (TYPES >> PLANE & 1) && LENS == PINHOLE && !(IMAGES & HDR)
        ? corner_room(WIDTH * HEIGHT, ROOM - KEPT * int(sizeof(Looks)) - 1024)
        : 0;
    // Where not all looks can be kept, some are.
    constexpr bool SOME = KEPT == 0 && (CAPACITY > 0 || CORNERS > 0) && (Wants::SURFACE || Wants::COLORED);
    constexpr int PLACES = CAPACITY > 0 ? CAPACITY : 1, BARE = sizeof(Look<TYPES, Bare<Wants>>);
    constexpr int LEFT = (ROOM - 2048 - CORNERS * int(sizeof(float)) - 2 * PLACES) / BARE;
    constexpr int SEEN = CAPACITY > 0 && LEFT > 1 ? (LEFT < CAPACITY ? LEFT : CAPACITY) : 1;
    using Held = typename Either<SOME, SeenLooks<TYPES, Wants, PLACES, SEEN>, Looks>::type;
    constexpr int HELD = SOME ? -1 : KEPT;
    WARPCAM_SHARED Held looks[KEPT > 0 ? KEPT : 1];
    using Lit_ = typename Either<(CORNERS > 0), LitCorners<CORNERS, SHADOWS>, LightList>::type;
    WARPCAM_SHARED typename Either<(FACTS & PHYSICAL) != 0, LampList, Lit_>::type list;
    WARPCAM_SHARED Camera kept_camera;
    WARPCAM_SHARED Sheets veils;
    const auto& frame = scene.frame;
    const int thread = index % THREADS;
    int world;
    const Region region = region_of<WIDTH, HEIGHT, (TYPES >> MOVING & 1) != 0>(frame, index / THREADS, world);
    if (!wp::index(frame.mask, world))
        return;
    const int left = region.left, top = region.top;
    const unsigned first = unsigned(world) * frame.width * frame.height;
    const Camera camera = load_camera(wp::index(frame.views, world));
    if (thread == 0)
        kept_camera = camera;
    if (Wants::LIT && thread >= THREADS - TEAM)
        gather_lights<SHADOWS>(lights, camera, world, headlight_of<FACTS>(world), thread - (THREADS - TEAM), list);
    if constexpr ((FACTS & MIRRORED) != 0) {
        const auto mirror = wp::index(frame.mirrors, world);
        if (mirror.shape < 0)
            return;
        if (thread == THREADS - TEAM && headlight_shines(lights))
            list.lights[0].place = to_row(to_vec(mirror.headlight), 0);
    }
    if constexpr (VEILS != 0) {
        Region seen = region;
        Vec eye = camera.origin;
        int mirror = -1;
        if constexpr ((FACTS & MIRRORED) != 0) {  // its columns run the other way
            const auto at = wp::index(frame.mirrors, world);
            seen.left = frame.width - region.left - region.width;
            eye = to_vec(at.eye);
            mirror = at.shape;
        }
        gather_veils<TYPES, LENS, (FACTS & PHYSICAL) == 0>(veils, scene, camera, seen, eye, mirror, world, thread);
    }
#if defined(__CUDA_ARCH__)
    if constexpr (KEPT > 0)
        for (int i = thread; i < scene.shapes.drawn.shape[0]; i += THREADS) {
            const int id = wp::index(scene.shapes.drawn, i);
            looks[i] = look_of<TYPES, Wants>(scene, camera, world, id);
        }
    if constexpr (SOME) {
        if (thread == 0 && frame.plane >= 0)
            looks->plane = look_of<TYPES, Wants>(scene, camera, world, frame.plane);
        if constexpr (Held::MARKED)
            gather_looks<WIDTH, HEIGHT, FACTS, SEEN>(*looks, scene, camera, world, first, left, top, thread);
    }
    block_barrier();
#else
    bool made[KEPT > 0 ? KEPT : 1] = {};
    if constexpr (VEILS != 0 && KEPT > 0)
        for (int slot = 0; slot < veils.count; ++slot) {
            const int place = wp::index(scene.shapes.places, veils.ids[slot]);
            looks[place] = look_of<TYPES, Wants>(scene, camera, world, veils.ids[slot]);
            made[place] = true;
        }
    if constexpr (CORNERS > 0 && KEPT > 0)
        if (frame.plane >= 0) {
            const int place = wp::index(scene.shapes.places, frame.plane);
            looks[place] = look_of<TYPES, Wants>(scene, camera, world, frame.plane);
            made[place] = true;
        }
    if constexpr (SOME)
        if (frame.plane >= 0)
            looks->plane = look_of<TYPES, Wants>(scene, camera, world, frame.plane);
#endif
    if constexpr (CORNERS > 0) {
        const Looks& look = plane_look<KEPT>(looks, scene);
        if (thread < TEAM)
            choose_corners(list.grid, list, look, camera, region, frame, FACTS & MIRRORED, thread);
        block_barrier();
        light_corners(list.grid, list, look, thread);
        block_barrier();
    }
    Pixel pixel;
#if defined(__CUDA_ARCH__)
    WARPCAM_SHARED float4 lanes[THREADS / LANES][3 * LANES / 4];
    constexpr unsigned TILES = WIDTH / TILE_WIDTH * (HEIGHT / TILE_HEIGHT), STEP = THREADS / LANES;
    const unsigned warp = unsigned(thread) / LANES;
    pixel.lane = unsigned(thread) % LANES;
    pixel.row_of_lanes = reinterpret_cast<float*>(lanes[warp]);
    go_to<WIDTH, FACTS>(pixel, frame, first, left, top, warp);
    Hit next = find<TYPES, IMAGES, FACTS>(frame, pixel);
#pragma unroll 1
    for (unsigned tile = warp; tile < TILES; tile += STEP) {
        const Hit found = next;
        if (tile + STEP < TILES) {  // ask for the next tile's pixels before this one's are drawn
            go_to<WIDTH, FACTS>(pixel, frame, first, left, top, tile + STEP);
            next = find<TYPES, IMAGES, FACTS>(frame, pixel);
        }
        go_to<WIDTH, FACTS>(pixel, frame, first, left, top, tile);
        if ((FACTS & WHOLE_REGIONS) || (pixel.width > 0 && pixel.height > 0)) {
            if constexpr (LENS == RAYS)
                resolve_pixel<TYPES, LENS, HELD, IMAGES, FACTS>(looks, list, scene,
                    camera_at(kept_camera, pixel.column, pixel.row), veils, region, world, pixel, found);
            else
                resolve_pixel<TYPES, LENS, HELD, IMAGES, FACTS>(looks, list, scene, kept_camera, veils, region, world, pixel, found);
        }
    }
#else
    pixel.inside = true;
    for (pixel.row = top; pixel.row < lower_int(top + HEIGHT, frame.height); ++pixel.row)
        for (pixel.column = left; pixel.column < lower_int(left + WIDTH, frame.width); ++pixel.column) {
            pixel.at = first + pixel.row * frame.width + pixel.column;
            const Hit found = find<TYPES, IMAGES, FACTS>(frame, pixel);
            const int place = KEPT > 0 && found.shape >= 0 ? wp::index(scene.shapes.places, found.shape) : 0;
            if constexpr (KEPT > 0)
                if (found.shape >= 0 && !made[place]) {
                    looks[place] = look_of<TYPES, Wants>(scene, camera, world, found.shape);
                    made[place] = true;
                }
            if constexpr (LENS == RAYS)
                resolve_pixel<TYPES, LENS, HELD, IMAGES, FACTS>(looks, list, scene,
                    camera_at(kept_camera, pixel.column, pixel.row), veils, region, world, pixel, found);
            else
                resolve_pixel<TYPES, LENS, HELD, IMAGES, FACTS>(looks, list, scene, kept_camera, veils, region, world, pixel, found);
        }
#endif
}

}  // namespace warpcam
