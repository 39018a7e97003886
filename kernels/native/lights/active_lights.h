// Selects the lights of a world that count: shading and shadows must agree on them.
#pragma once
#include "core/vec3.h"

namespace warpcam {

enum LightType { LIGHT_SPOT, LIGHT_DIRECTIONAL };  // values of types.py

// OpenGL has this many lights, and so has MuJoCo's renderer: the headlight, where it shines, and the first active ones.
constexpr int MAX_LIGHTS = 8;

template <class Lights> WARPCAM_DEVICE bool headlight_shines(const Lights& lights)
{
    Vec3 sum { 0.0f, 0.0f, 0.0f };
    for (int part = 0; part < 3; ++part)
        sum = sum + as_vec3(wp::index(lights.headlight, part));
    return dot(sum, sum) > 0.0f;
}

// Goes through the lights of a world in their order.
struct ActiveLights {
    int slots;  // that the headlight leaves
    int taken = 0;  // by lights that are on, whether they give light or not
    int given = 0;  // lights that are on and give light
    int kept = 0;  // those of them that have a slot

    // The place of the next light among those that are kept, which is its bit of a shadow mask; -1 if it is not kept.
    template <class Lights> WARPCAM_DEVICE int next(const Lights& lights, int world, int light)
    {
        if (!per_world(lights.active, world, light))
            return -1;
        const bool has_slot = taken++ < slots;
        const int type = per_world(lights.types, world, light);
        if (type != LIGHT_SPOT && type != LIGHT_DIRECTIONAL)
            return -1;
        ++given;
        return has_slot ? kept++ : -1;
    }

#if defined(__CUDA_ARCH__)
    // Selects from the next 32 lights, a lane of a warp each; `light` may be beyond the last of `count`.
    template <class Lights> WARPCAM_DEVICE int next_of_lanes(const Lights& lights, int world, int light, int count)
    {
        const unsigned before = (1u << threadIdx.x % WARP_SIZE) - 1;
        const bool on = light < count && per_world(lights.active, world, light);
        const unsigned all_on = __ballot_sync(FULL_WARP, on);
        const int type = on ? per_world(lights.types, world, light) : -1;
        const bool gives = type == LIGHT_SPOT || type == LIGHT_DIRECTIONAL;
        const bool keeps = gives && taken + __popc(all_on & before) < slots;
        const unsigned all_active = __ballot_sync(FULL_WARP, keeps);
        const int place = keeps ? kept + __popc(all_active & before) : -1;
        taken += __popc(all_on);
        given += __popc(__ballot_sync(FULL_WARP, gives));
        kept += __popc(all_active);
        return place;
    }
#endif
};

template <class Lights> WARPCAM_DEVICE ActiveLights active_lights(const Lights& lights)
{
    return { headlight_shines(lights) ? MAX_LIGHTS - 1 : MAX_LIGHTS };
}

}  // namespace warpcam
