// Shapes that shine: places on them, drawn evenly by area, and the density with which they are drawn.
//
// Balls, boxes and meshes can be drawn. What else shines is met by chance, which is as right and takes more paths.
#pragma once
#include "path/environment_cells.h"
#include "path/lamps.h"
#include "path/trace_path.h"

namespace warpcam {

constexpr float SAME_PLACE = 1.0e-3f;  // part of a distance within which two places are one

WARPCAM_DEVICE float power_heuristic(float own, float other)
{
    return own * own / max(own * own + other * other, MIN_NORMAL);
}

// Whether a shape can be drawn as a light. Frame_::faces: rows of Meshes.faces by mesh, with where each mesh begins.
template <class Types, class Frame_, class Shapes, class Materials, class Physical>
WARPCAM_DEVICE bool is_emitter(const Frame_& frame, const Shapes& shapes, const Materials& materials,
                               const Physical& physical, int world, int id)
{
    const int material = material_of(shapes, materials, world, id);
    if (material < 0 || per_world(physical.reflectance, world, material) < 0.0f)
        return false;
    const Vec3 emission = as_vec3(per_world(physical.emissive, world, material));
    if (!(emission.x + emission.y + emission.z + per_world(materials.emission, world, material) > 0.0f))
        return false;
    const int type = wp::index(shapes.types, id), asset = per_world(shapes.assets, world, id);
    if (Types::has(MESH) && type == MESH)
        return asset >= 0 && asset + 1 < frame.face_starts.shape[0]
               && wp::index(frame.face_starts, asset + 1) > wp::index(frame.face_starts, asset);
    return type == SPHERE || type == BOX;
}

// A place on a shape, from the camera along the world's axes.
struct EmitterPlace {
    Vec3 point;
    Vec3 normal;  // unit
    float area;   // of which it is one, over the chance that it was this one [m^2]; 0: it is not drawn
};

struct EmitterTriangle {
    Vec3 origin, edge1, edge2;
    float share;  // the chance that this one is drawn of its mesh

    WARPCAM_DEVICE EmitterPlace place(float u, float v) const
    {
        const float root = wp::sqrt(u);
        const Vec3 normal = cross(edge1, edge2);
        const float twice = wp::sqrt(dot(normal, normal));
        return { origin + (root * (1.0f - v)) * edge1 + (root * v) * edge2, 1.0f / max(twice, MIN_NORMAL) * normal,
                 share > 0.0f ? 0.5f * twice / share : 0.0f };
    }
};

template <class Types, class Frame_, class Meshes>
WARPCAM_DEVICE EmitterTriangle emitter_triangle(const Frame_& frame, const Meshes& meshes, const Shape& shape, int face,
                                                Vec3 camera)
{
    const unsigned row = unsigned(wp::index(meshes.face_start, shape.asset)) + unsigned(FACE_ROWS * face);
    const float share = frame.face_shares.data[row / FACE_ROWS];
    const auto corner = [&](int k) {
        const Vec3 own = as_vec3(load(meshes.faces.data, row + k));
        return transform(shape.rotation, Types::has(PER_SHAPE_SCALE) ? mul(own, shape.size) : own);
    };
    const Vec3 first = corner(0);
    return { first + shape.position - camera, corner(1) - first, corner(2) - first, share };
}

// A box from a place: its sides that face the place, or all from within. The others are not drawn.
struct EmitterBox {
    static constexpr int SIDES = 6;  // -x +x -y +y -z +z

    Vec3 half;
    Vec3 from;  // the place, in the box's frame
    bool within;

    WARPCAM_DEVICE EmitterBox(const Shape& shape, Vec3 camera, Vec3 place)
        : half(shape.size), from(transform_transposed(shape.rotation, place - (shape.position - camera))),
          within(!(abs(from.x) > half.x || abs(from.y) > half.y || abs(from.z) > half.z))
    {
    }

    WARPCAM_DEVICE static float sign_of(int side) { return side & 1 ? 1.0f : -1.0f; }

    // Of a side that is drawn; else 0.
    WARPCAM_DEVICE float side_area(int side) const
    {
        const int axis = side >> 1;
        const float across = axis == 0 ? half.y * half.z : axis == 1 ? half.z * half.x : half.x * half.y;
        return within || sign_of(side) * component(from, axis) > component(half, axis) ? 4.0f * across : 0.0f;
    }

    WARPCAM_DEVICE float area() const
    {
        float sum = 0.0f;
        for (int side = 0; side < SIDES; ++side)
            sum += side_area(side);
        return sum;
    }

    WARPCAM_DEVICE EmitterPlace place(const Shape& shape, Vec3 camera, float u, float v) const
    {
        const float all = area(), at = u * all;
        int drawn = 0;
        float before = 0.0f, on = 0.0f;
        for (int side = 0; side < SIDES; ++side) {
            const float own = side_area(side);
            if (own > 0.0f && at >= before) {
                drawn = side;
                on = saturate((at - before) / own);
            }
            before += own;
        }
        const int axis = drawn >> 1;
        const float sign = sign_of(drawn), a = 2.0f * on - 1.0f, b = 2.0f * v - 1.0f;
        const Vec3 unit = axis == 0 ? Vec3 { sign, a, b } : axis == 1 ? Vec3 { b, sign, a } : Vec3 { a, b, sign };
        return { shape.position - camera + transform(shape.rotation, mul(unit, half)),
                 transform(shape.rotation, axis_vector(axis, sign)), all };
    }

    // area() if the side with that normal is drawn, else 0. `point`: on the side.
    WARPCAM_DEVICE float area_with(const Shape& shape, Vec3 camera, Vec3 point, Vec3 normal) const
    {
        const Vec3 out = transform_transposed(shape.rotation, normal);
        const Vec3 local = transform_transposed(shape.rotation, point - (shape.position - camera));
        const Vec3 size { abs(out.x), abs(out.y), abs(out.z) };
        const int axis = size.x > max(size.y, size.z) ? 0 : size.y > size.z ? 1 : 2;
        return side_area(2 * axis + (component(local, axis) > 0.0f ? 1 : 0)) > 0.0f ? area() : 0.0f;
    }
};

// Of the direction to a place that is drawn evenly from so large an area [1/sr]; 0 where it is not drawn.
WARPCAM_DEVICE float density_of_place(Vec3 away, Vec3 normal, float area)
{
    const float square = dot(away, away), distance = wp::sqrt(square), seen = abs(dot(away, normal)) * area;
    return seen > 1.0e-20f * distance ? square * distance / max(seen, MIN_NORMAL) : 0.0f;
}

// A ball as a lamp of its size.
WARPCAM_DEVICE AreaLight ball_lamp(const Shape& shape, Vec3 camera)
{
    AreaLight lamp {};
    lamp.place = make_float3_int(shape.position - camera, 0);
    lamp.axis = { 0.0f, 0.0f, 1.0f, as_int(-2.0f) };
    lamp.across.w = FORM_SPHERE;
    lamp.size.x = shape.size.x;
    lamp.diffuse.w = SPOT;
    return lamp;
}

// Direction and distance from `from` to a place of the shape; `density`: of the direction [1/sr]. Points of the unit square
// that are spread evenly lie evenly on each side and face, too: `u` chooses it, and goes on from 0 to 1 there.
template <class Types, class Frame_, class Meshes>
WARPCAM_DEVICE LampSample draw_emitter(const Frame_& frame, const Meshes& meshes, const Shape& shape, Vec3 camera,
                                       Vec3 from, float u, float v)
{
    if (shape.type == SPHERE)
        return draw_lamp(ball_lamp(shape, camera), from, u, v);
    EmitterPlace place;
    if (Types::has(MESH) && shape.type == MESH) {
        const int start = wp::index(frame.face_starts, shape.asset);
        const int count = wp::index(frame.face_starts, shape.asset + 1) - start;
        float on;
        const float* const sums = frame.face_sums.data + start + shape.asset;
        const int drawn = EnvironmentCells::find(sums, count, u, on);
        const int face = wp::index(frame.faces, start + drawn);
        place = emitter_triangle<Types>(frame, meshes, shape, face, camera).place(on, v);
    } else {
        place = EmitterBox(shape, camera, from).place(shape, camera, u, v);
    }
    const Vec3 away = place.point - from;
    const float distance = wp::sqrt(max(dot(away, away), 1.0e-20f));
    const float density = density_of_place(away, place.normal, place.area);
    return { 1.0f / distance * away, distance, density > 0.0f ? 1.0f / density : 0.0f, density };
}

// The density with which it would have drawn the direction to a place that a ray met; `face` and `normal` are what is there.
template <class Types, class Frame_, class Meshes>
WARPCAM_DEVICE float emitter_density(const Frame_& frame, const Meshes& meshes, const Shape& shape, Vec3 camera,
                                     Vec3 from, Vec3 point, Vec3 normal, int face)
{
    const Vec3 away = point - from;
    if (shape.type == SPHERE) {
        const Vec3 middle = shape.position - camera - from;
        const float far = dot(middle, middle), radius = shape.size.x * shape.size.x;
        return cap_density(far > radius ? cap_height(radius / far) : 2.0f);
    }
    if (Types::has(MESH) && shape.type == MESH) {
        const float area = emitter_triangle<Types>(frame, meshes, shape, face, camera).place(0.0f, 0.0f).area;
        return density_of_place(away, normal, area);
    }
    const float area = EmitterBox(shape, camera, from).area_with(shape, camera, point, normal);
    return density_of_place(away, normal, area);
}

}  // namespace warpcam
