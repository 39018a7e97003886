// Surfaces away from the camera's own pixels, lit as shading/pbr.h lights those: by lights, with shadows, and from all
// around. All is along the world's axes and from the view's camera.
#pragma once
#include "path/path_surface.h"
#include "shading/pbr.h"

namespace warpcam {

// The lights of a world as shading/pbr.h takes them. Each is loaded where it is used; the headlight is the last.
template <class Physical> struct WorldLights {
    struct Loader {
        const Physical& physical;
        const Camera& hub;
        Vec3 backward;  // of the camera
        const int* lamps;
        int world, count, headlight;

        WARPCAM_DEVICE AreaLight operator[](int number) const
        {
            if (number < count)
                return load_area_light<true>(physical, hub, world, lamps[number], number);
            const auto& colors = physical.plain.headlight;
            AreaLight lamp {};
            lamp.place = make_float3_int(backward, 0);
            lamp.diffuse = make_float3_int(as_vec3(wp::index(colors, headlight + 1)), 0);
            lamp.specular = make_float3_int(as_vec3(wp::index(colors, headlight + 2)), 0);
            return lamp;
        }
    } area_lights;
    Sky sky;
    int count;
};

// `head`: of the world's list of shapes; `headlight`: where its colours begin.
template <class Physical> WARPCAM_DEVICE WorldLights<Physical> world_lights(const Physical& physical,
                                                                            const Camera& camera, const Camera& hub,
                                                                            const int* head, int world, int headlight)
{
    const int headlit = headlight_shines(physical.plain), count = min(head[NUM_LAMPS], MAX_LIGHTS - headlit);
    const Mat3& turn = camera.rotation;
    const Vec3 backward { turn.at[0][2], turn.at[1][2], turn.at[2][2] };
    WorldLights<Physical> list { { physical, hub, backward, head + FIRST_LAMP, world, count, headlight },
                                 {},
                                 count + headlit };
    gather_sky(physical, world, headlight, list.sky);
    return list;
}

// The far side of a shape that is left is met by `inside`, its near side never again by `convex`.
template <class Shapes> WARPCAM_DEVICE PathQuery query_from(const Shapes& shapes, int shape, int inside, bool backs)
{
    const int type = wp::index(shapes.types, shape);
    return { MAX_RAY_T, false, backs, false, type == MESH || type == HEIGHT_FIELD ? -1 : shape, inside };
}

// The surface's material as shading/pbr.h takes it, with what it emits.
WARPCAM_DEVICE PbrInputs<Vec3> pbr_inputs_of(const SurfaceMaterial& material)
{
    PbrInputs<Vec3> inputs { {}, material.emission, material.open };
    set_reflection(inputs, material.color, material.roughness, material.metallic, material.reflectance);
    return inputs;
}

// One world's scene and lights.
template <class Types, int FLAGS, class Scene_> struct LitWorld {
    const Scene_& scene;
    const Camera& camera;
    const Camera& hub;  // upright() of it
    int world;
    const Float3Int* rows;
    const int* head;

    WARPCAM_INLINED auto lights() const
    {
        return world_lights(scene.physical, camera, hub, head, world, headlight_of<FLAGS>(world));
    }

    WARPCAM_INLINED PathHit trace(const PathRay& ray, const PathQuery& query) const
    {
        return trace_path<Types>(rows, head[NUM_SHAPES], scene.meshes, scene.fields, ray, query);
    }

    // Bits of the lights that do not reach a surface, by one ray to each one's middle.
    template <class Lights>
    WARPCAM_INLINED int shadow_at(const Lights& list, const PathSurface& surface, int shape) const
    {
        int shadow = 0;
        if constexpr ((FLAGS & HAS_SHADOWS) != 0) {
            const Vec3 facing = surface.front ? surface.outward : -surface.outward;
            PathQuery query = query_from(scene.shapes, shape, -1, scene.frame.backs != 0);
            query.any = true;
            for (int number = 0; number < list.area_lights.count; ++number) {
                const AreaLight lamp = list.area_lights[number];
                Vec3 to_light = as_vec3(lamp.place);
                query.far = MAX_RAY_T;
                if (lamp.diffuse.w & SPOT) {
                    to_light = to_light - surface.point;
                    query.far = wp::sqrt(dot(to_light, to_light));
                }
                if (!(lamp.diffuse.w & CASTS) || !(dot(to_light, facing) > 0.0f))
                    continue;
                if (trace({ surface.point + surface.margin * facing, normalized(to_light) }, query).slot >= 0)
                    shadow |= lamp.place.w;
            }
        }
        return shadow;
    }

    WARPCAM_INLINED Vec3 light_of(const PbrInputs<Vec3>& inputs, const PathSurface& surface, int shape,
                                  Vec3 to_eye) const
    {
        const auto list = lights();
        return physical_light<FLAGS>(inputs, list, scene, hub.rotation, surface.point, surface.normal, to_eye,
                                     visibility_of<FLAGS>(scene.frame, 0, shadow_at(list, surface, shape)));
    }

    // Light from all around on a white matt surface.
    WARPCAM_INLINED Vec3 sky_on_surface(Vec3 normal) const
    {
        Sky sky;
        gather_sky(scene.physical, world, headlight_of<FLAGS>(world), sky);
        return sky_on(sky, normal);
    }

    // Light from beyond all shapes along a direction, as wide as a surface of that roughness mirrors it.
    WARPCAM_INLINED Vec3 sky_along_ray(Vec3 direction, float roughness) const
    {
        Sky sky;
        gather_sky(scene.physical, world, headlight_of<FLAGS>(world), sky);
        return mirrored_sky<FLAGS>(sky, scene, direction, roughness);
    }

    // The light that lights add to that from all around at a surface.
    WARPCAM_INLINED Vec3 ambient_at(const PathSurface& surface, int shape) const
    {
        const auto list = lights();
        Vec3 sum { 0.0f, 0.0f, 0.0f };
        bool some = false;
        for (int number = 0; number < list.area_lights.count; ++number)
            some = some || (list.area_lights[number].diffuse.w & AMBIENT);
        if (!some)
            return sum;
        const int shadow = shadow_at(list, surface, shape);
        for (int number = 0; number < list.area_lights.count; ++number) {
            const AreaLight lamp = list.area_lights[number];
            if ((lamp.diffuse.w & AMBIENT) && !(lamp.place.w & shadow))
                sum = sum + sample_light(lamp, surface.point).share * as_vec3(lamp.ambient);
        }
        return sum;
    }
};

}  // namespace warpcam
