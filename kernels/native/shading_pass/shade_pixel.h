// From what was found at a pixel to what its images show.
#pragma once
#include "shading/haze.h"
#include "shading/appearance_cache.h"
#include "shading_pass/depth_peeling.h"
#include "shading/mirror_composite.h"
#include "shading_pass/mujoco_transparency.h"

namespace warpcam {

// Results of the trace and of the shadow pass at a pixel.
struct PixelHit : Hit {
    int shadow;  // where FLAGS have SEPARATE_PLANE_PATH; otherwise it is asked for when the pixel is drawn
};

template <class Types, int IMAGES, int FLAGS, class Frame_>
WARPCAM_DEVICE PixelHit find(const Frame_& frame, const Pixel& pixel)
{
    PixelHit found { { 0.0f, -1, 0 }, 0 };
    if (pixel.inside) {
        found.shape = frame.shape.data[pixel.at];
        if (ShadingNeeds<IMAGES, FLAGS>::SURFACE)
            found.depth = frame.depth.data[pixel.at];
        if (ShadingNeeds<IMAGES, FLAGS>::SURFACE && Types::has_any(MESH, HEIGHT_FIELD))
            found.face = stored_face<Types>(frame.face.data[pixel.at]);
        if (ShadingNeeds<IMAGES, FLAGS>::LIT && (FLAGS & HAS_SHADOWS) && (FLAGS & SEPARATE_PLANE_PATH))
            found.shadow = frame.shadow.data[pixel.at];
    }
    return found;
}

// CAPACITY: the looks a block keeps, one for each shape that may be visible; 0 if they are made anew for each pixel,
// less if `looks` are SeenLooks.
template <class Types, int LENS, int CAPACITY, int IMAGES, int FLAGS, class Appearances, class List, class Scene_,
          class Shadow>
WARPCAM_DEVICE void resolve_hit(const Appearances* looks, const List& lights, const Scene_& scene, const Camera& camera,
                                int world, float x, float y, const Hit& found, const Shadow& shadow, ShadedPixel& shown)
{
    using Wants = ShadingNeeds<IMAGES, FLAGS>;
    if constexpr (CAPACITY > 0)
        resolve_surface<Types, LENS, IMAGES, FLAGS>(looks[scene.shapes.places.data[found.shape]], lights, scene, camera,
                                                    x, y, found, shadow, shown);
    else
        resolve_surface<Types, LENS, IMAGES, FLAGS>(
            cached_appearance<Types, CAPACITY, Wants>(looks, lights, scene, camera, world, found.shape), lights, scene,
            camera, x, y, found, shadow, shown);
    if constexpr (Wants::LIT)
        expose<FLAGS>(scene, world, shown.linear, shown.display);
}

// Covers what is seen of a pixel with the transparent shapes before it, nearer than `limit`. Returns how much is still
// seen of it.
template <class Types, int LENS, int CAPACITY, int IMAGES, int FLAGS, class Appearances, class List, class Scene_,
          class TransparentShapes_>
WARPCAM_DEVICE float resolve_transparent(const Appearances* looks, const List& lights, const Scene_& scene,
                                         const Camera& camera, const TransparentShapes_& transparent_shapes,
                                         const Region& region, int world, const Pixel& pixel, float x, float y,
                                         const Hit& solid, float limit, ShadedPixel& shown)
{
    const bool takes_part = pixel.inside && !((FLAGS & MIRROR_VIEW) && solid.shape == -1);
    const CameraRay<LENS> ray { x, y };
    float near = camera.near;
    int column = (pixel.column - region.left) / TILE_WIDTH;
    const int row = (pixel.row - region.top) / TILE_HEIGHT;
    if constexpr ((FLAGS & MIRROR_VIEW) != 0) {
        near = plane_of(wp::index(scene.frame.mirrors, world)).depth(ray);
        column = region.width / TILE_WIDTH - 1 - column;
    }
    if constexpr ((FLAGS & PHYSICAL) != 0) {
        const auto shade_layer = [&](bool met, Hit hit, Vec3& light) {
            ShadedPixel layer;
            fill_inactive_lanes(met, hit);
            constexpr int UNSHADED = FLAGS & ~VISIBILITY_FLAGS;
            resolve_hit<Types, LENS, CAPACITY, IMAGES&(RGB | RGBA | HDR), UNSHADED>(
                looks, lights, scene, camera, world, x, y, hit, Visibility<UNSHADED, Vec3> {}, layer);
            light = layer.linear;
            float alpha = opacity(scene.shapes, scene.materials, world, hit.shape);
            if constexpr (Types::has(ALPHA_TESTED) && (FLAGS & HAS_MAPS))
                alpha *= mapped_opacity<Types, LENS>(cached_appearance<Types, CAPACITY, ShadingNeeds<IMAGES, FLAGS>>(
                                                         looks, lights, scene, camera, world, hit.shape),
                                                     scene, camera, world, x, y, hit);
            return alpha;
        };
        Composite peeled { { 0.0f, 0.0f, 0.0f }, 1.0f };
        peel<Types>(transparent_shapes, scene, ray, near, takes_part ? limit : -1.0f, column, row, shade_layer, peeled);
        if (peeled.left < 1.0f) {
            shown.linear = peeled.light + peeled.left * shown.linear;
            shown.display = display_color<FLAGS>(shown.linear);
        }
        return peeled.left;
    } else {
        MujocoBlend covered(shown.linear, clip(shown.display));
        const auto shade = [&](bool met, Hit hit, Vec3& linear, Vec3& display) {
            ShadedPixel layer;
            fill_inactive_lanes(met, hit);
            resolve_hit<Types, LENS, CAPACITY, IMAGES&(RGB | RGBA | HDR), FLAGS & ~HAS_SHADOWS>(
                looks, lights, scene, camera, world, x, y, hit, 0, layer);
            linear = layer.linear;
            display = layer.display;
            if constexpr (Types::has(TEXTURE_ALPHA) && ShadingNeeds<IMAGES, FLAGS>::TEXTURED)
                return texture_alpha<Types, LENS>(cached_appearance<Types, CAPACITY, ShadingNeeds<IMAGES, FLAGS>>(
                                                      looks, lights, scene, camera, world, hit.shape),
                                                  scene, camera, x, y, hit);
            return 1.0f;
        };
        Hit first { limit, -1, -1 };
        const auto note = [&](const Hit& hit, float opacity) {
            if constexpr ((FLAGS & WRITE_BACK_TRANSPARENT) != 0)
                if (opacity >= NOTEWORTHY && hit.depth < first.depth
                    && wp::index(scene.shapes.types, hit.shape) != PLANE)
                    first = hit;
        };
        cover<Types, (FLAGS & PLANE_STRIPS) == 0>(transparent_shapes, scene, ray, near, takes_part ? limit : -1.0f,
                                                  column, row, shade, note, covered);
        if constexpr ((FLAGS & WRITE_BACK_TRANSPARENT) != 0)
            if (first.shape >= 0) {
                scene.frame.shape.data[pixel.at] = first.shape;
                scene.frame.depth.data[pixel.at] = first.depth;
                if constexpr (Types::has_any(MESH, HEIGHT_FIELD))
                    scene.frame.face.data[pixel.at] = first.face;
            }
        shown.linear = covered.final_linear();
        shown.display = covered.final_display();
        return covered.left * covered.left;
    }
}

// Shows what is behind everything.
template <int LENS, int FLAGS, bool PBR, class List, class Scene_, class Camera_>
WARPCAM_DEVICE void show_background(const List& lights, const Scene_& scene, const Camera_& camera, int world, float x,
                                    float y, ShadedPixel& shown)
{
    const Vec3 black { 0.0f, 0.0f, 0.0f };
    shown.linear = shown.display =
        FLAGS & MIRROR_VIEW ? black
                            : background_color<LENS, FLAGS>(scene.textures, background_of<FLAGS>(scene, world), camera,
                                                            scene.frame.horizon, x, y);
    if constexpr (PBR) {
        shown.linear = srgb_to_linear(shown.linear);
        if constexpr ((FLAGS & HAS_SKYBOX) != 0)
            shown.linear = mul(lights.sky.gain, shown.linear);
        if constexpr ((FLAGS & (HAS_SKYBOX | TONE_FLAGS)) != 0)
            shown.display = display_color<FLAGS>(shown.linear);
    }
}

// `shaded`: what the pixel shows, a ShadedPixel, where that is known.
template <class Types, int LENS, int CAPACITY, int IMAGES, int FLAGS, class Appearances, class List, class Scene_,
          class TransparentShapes_, class Camera_, class... Shaded_>
WARPCAM_INLINED void resolve_pixel(const Appearances* looks, const List& lights, const Scene_& scene,
                                   const Camera_& camera, const TransparentShapes_& transparent_shapes,
                                   const Region& region, int world, const Pixel& pixel, PixelHit found,
                                   const Shaded_&... shaded)
{
    constexpr bool IS_SHADED = sizeof...(Shaded_) > 0;
    using Wants = ShadingNeeds<IMAGES, FLAGS>;
    constexpr bool IN_QUADS = FLAGS & STORE_QUADS;
    const auto& frame = scene.frame;
    const auto& images = scene.images;
    const int column = FLAGS & MIRROR_VIEW ? frame.width - 1 - pixel.column : pixel.column;
    const float x = ray_x<LENS>(camera, column), y = ray_y<LENS>(camera, pixel.row);
    const bool hit = found.shape >= 0;
    const Hit solid = found;
    const auto shadow = [&] {
        if constexpr (!Wants::LIT || !(FLAGS & HAS_SHADOWS))
            return 0;
        else if constexpr ((FLAGS & SEPARATE_PLANE_PATH) != 0)
            return found.shadow;
        else
            return hit ? int(frame.shadow.data[pixel.at]) : 0;
    };
    const auto visibility = [&] {
        if constexpr (Wants::PBR && Wants::LIT)
            return visibility_of<FLAGS>(frame, hit ? size_t(pixel.at) : size_t(0), shadow());
        else
            return shadow();
    };
    ShadedPixel shown;
    bool drawn = false;
    Vec3 apart;
    Vec3& floor = FLAGS & SEPARATE_PLANE_PATH ? apart : shown.display;
    if constexpr (!IS_SHADED && lit_by_corners<List>(FLAGS & HAS_SHADOWS) && !(IMAGES & (NORMALS | ALBEDO)))
        drawn = draw_floor<Wants::TEXTURED, (FLAGS & SEPARATE_PLANE_PATH) != 0,
                           (FLAGS & (SEPARATE_PLANE_PATH | PLANE_STRIPS)) != 0>(lights.grid, scene.textures, found,
                                                                                shadow, x, y, floor);
    if constexpr (IS_SHADED)
        shown = (shaded, ...);
    else if (((FLAGS & SEPARATE_PLANE_PATH) || !drawn) && (Wants::SURFACE || Wants::COLORED)
             && fill_inactive_lanes(hit && !drawn, found))
        resolve_hit<Types, LENS, CAPACITY, IMAGES, FLAGS>(looks, lights, scene, camera, world, x, y, found,
                                                          visibility(), shown);
    if (drawn) {
        shown.linear = shown.display = floor;
        expose<FLAGS>(scene, world, shown.linear, shown.display);
    }
    const Vec3 black { 0.0f, 0.0f, 0.0f };
    if (IMAGES & NORMALS)
        put_vec<IN_QUADS>(images.normals, pixel, hit ? shown.normal : black);
    if (IMAGES & ALBEDO)
        put_bytes<IN_QUADS>(images.albedo, pixel, hit ? to_bytes(shown.albedo) : 0u);
    if (Wants::LIT) {
        bool seen = hit;
        HazeSample haze_sample { 0.0f, 0.0f };
        float sky = camera.far;
        if constexpr ((FLAGS & HAS_HAZE) != 0 && LENS != ORTHOGRAPHIC) {
            const Vec3 ray = transform(camera.rotation, CameraRay<LENS> { x, y }.direction());
            sky = skybox_depth(ray, frame.haze.radius);
            seen = hit && solid.depth < sky;
            Vec3 eye = camera.origin;
            if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
                eye = eye + transform(camera.rotation, CameraRay<LENS> { x, y }.offset_ray().start);
            haze_sample = haze_of(scene, eye, world, ray);
        }
        if (!seen) {
            if constexpr ((FLAGS & SHOWS_ENVIRONMENT) != 0) {
                shown.linear = environment_at<LENS>(load_environment(scene.physical.environments, world), camera, x, y);
                shown.display = display_color<FLAGS>(shown.linear);
            } else {
                show_background<LENS, FLAGS, Wants::PBR>(lights, scene, camera, world, x, y, shown);
            }
            expose<FLAGS>(scene, world, shown.linear, shown.display);
        }
        if constexpr ((FLAGS & HAS_MIRROR) != 0)
            if (seen && solid.shape == wp::index(frame.mirrors, world).shape)
                add_mirrored<IMAGES>(images, pixel.at, shown.linear, shown.display);
        if constexpr ((FLAGS & HAS_REFLECTIONS) != 0)
            if (seen)
                mix_reflections<FLAGS>(scene, world, pixel.at, shown.linear, shown.display);
        if constexpr ((FLAGS & HAS_HAZE) != 0)
            if (haze_sample.density > 0.0f && !(seen && solid.depth < haze_sample.depth)) {
                const Vec3 haze = exposed<FLAGS>(scene, world, haze_sample.density * as_vec3(frame.haze.color));
                shown.linear = (1.0f - haze_sample.density) * shown.linear + haze;
                shown.display = (1.0f - haze_sample.density) * clip(shown.display) + haze;
            }
        unsigned alpha = hit ? 0xff000000u : 0u;
        if constexpr ((FLAGS & HAS_TRANSPARENT) != 0) {
            float limit = hit ? solid.depth : camera.far;
            if constexpr ((FLAGS & HAS_HAZE) != 0)
                limit = min(sky, haze_sample.density > 0.0f ? min(limit, haze_sample.depth)
                                                            : limit);  // these hide what is behind them
            const float left = resolve_transparent<Types, LENS, CAPACITY, IMAGES, FLAGS>(
                looks, lights, scene, camera, transparent_shapes, region, world, pixel, x, y, solid, limit, shown);
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

}  // namespace warpcam
